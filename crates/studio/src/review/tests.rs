use std::collections::{BTreeMap, BTreeSet};

use super::*;

/// A review in short form: `ada+` approves, `ada-` rejects, `ada<` sends back, `ada~` takes back; a capital letter at the
/// beginning adjudicates; `!` at the end says that the scene looks wrong.
pub(super) fn review(text: &str, scenario: &str, content: &str) -> Review {
    let looks_right = !text.ends_with('!');
    let text = text.trim_end_matches('!');
    let (name, sign) = text.split_at(text.len() - 1);
    let decision = match sign {
        "+" => Decision::Approve,
        "-" => Decision::Reject { reasons: BTreeSet::from([Reason::LooksWrong]) },
        "<" => Decision::SendBack,
        _ => Decision::TakeBack,
    };
    Review {
        scenario: scenario.into(),
        content_sha256: content.into(),
        reviewer: Reviewer { name: name.to_lowercase(), kind: ReviewerKind::Human, version: None },
        decision,
        criteria: BTreeMap::from([(Criterion::LooksRight, looks_right)]),
        note: String::new(),
        adjudicates: name.starts_with(char::is_uppercase),
        duration_s: None,
        client_operation_id: String::new(),
        at: "2026-11-27T12:00:00Z".into(),
    }
}

#[test]
fn standing_follows_from_the_last_words_on_this_content() {
    use Standing::{Adjudication, Approved, Open, Rejected, SentBack, Uncertified};
    // Reviews in order, certified, standing.
    let cases: [(&str, bool, Standing); 12] = [
        ("", true, Open { missing: 2 }),
        ("ada+", true, Open { missing: 1 }),
        ("ada+ bo+", true, Approved),
        ("ada+ bo+", false, Uncertified),
        ("ada- bo-", false, Rejected),
        ("ada+ bo-", true, Adjudication),
        // They reject, and differ in a criterion.
        ("ada- bo-!", true, Adjudication),
        ("ada+ bo- Cy+", true, Approved),
        ("ada+ bo- Cy-", true, Rejected),
        ("ada+ bo- bo+", true, Approved),
        ("ada+ bo+ bo~", true, Open { missing: 1 }),
        ("ada+ bo<", true, SentBack),
    ];
    for (text, is_certified, expected) in cases {
        let reviews: Vec<Review> = text.split_whitespace().map(|text| review(text, "s", "1")).collect();
        assert_eq!(standing(&current(&reviews, "s", "1"), is_certified), expected, "{text}");
        // An edit voids them all.
        assert_eq!(standing(&current(&reviews, "s", "2"), is_certified), Open { missing: 2 }, "{text}");
        assert_eq!(standing(&current(&reviews, "other", "1"), is_certified), Open { missing: 2 }, "{text}");
    }
}

#[test]
fn pairs_are_completed_first_and_nobody_reviews_twice() {
    let scenarios = ["a", "b", "c"].map(|id| (id.to_owned(), "1".to_owned()));
    let mut reviews = vec![review("ada+", "b", "1")];
    let next =
        |name: &str, reviews: &[Review]| next_for(name, &scenarios, reviews).map(|index| scenarios[index].0.clone());
    assert_eq!(next("bo", &reviews).as_deref(), Some("b"));
    assert_eq!(next("ada", &reviews).as_deref(), Some("a"));
    reviews.push(review("bo-", "b", "1"));
    assert_eq!(next("bo", &reviews).as_deref(), Some("a"));
    for name in ["ada+", "bo+"] {
        reviews.extend(["a", "c"].map(|id| review(name, id, "1")));
    }
    assert_eq!(
        (next("ada", &reviews), next("bo", &reviews)),
        (None, None),
        "their own difference is not theirs to settle"
    );
    assert_eq!(next("cy", &reviews).as_deref(), Some("b"));
    reviews.push(review("Cy+", "b", "1"));
    assert_eq!(next("cy", &reviews), None);
}

#[test]
fn reviewers_see_others_only_after_their_own_review() {
    let reviews = [review("ada+", "s", "1")];
    let now = current(&reviews, "s", "1");
    assert_eq!((visible_to("bo", &now).len(), visible_to("ada", &now).len()), (0, 1));
    let reviews = [review("ada+", "s", "1"), review("bo-", "s", "1")];
    let now = current(&reviews, "s", "1");
    assert_eq!(visible_to("cy", &now).len(), 2, "whoever adjudicates sees both");
}

#[test]
fn faults_of_reviews_are_named() {
    type Spoil = fn(&mut Review);
    let with = |spoil: Spoil| {
        let mut review = review("ada+", "s", "1");
        spoil(&mut review);
        review.fault().unwrap_or_default()
    };
    let cases: [(Spoil, &str); 10] = [
        (|_| (), ""),
        (|it| it.decision = Decision::Reject { reasons: BTreeSet::new() }, "a rejection needs a reason: implausible"),
        (|it| it.decision = Decision::Reject { reasons: [Reason::Other].into() }, "`other` needs a note"),
        (|it| it.decision = Decision::Reject { reasons: [Reason::Unsafe].into() }, ""),
        (|it| it.decision = Decision::SendBack, "sent back with a note"),
        (|it| it.criteria = BTreeMap::from([(Criterion::Feasible, false)]), "`feasible` is false"),
        (|it| it.reviewer.kind = ReviewerKind::Model, "kind `model` has a version"),
        (|it| it.reviewer.name = " ".into(), "names its reviewer"),
        (|it| it.reviewer.name = "a\nb".into(), "`name` has"),
        (|it| it.note = "x".repeat(3000), "at most 2000"),
    ];
    for (spoil, expected) in cases {
        let fault = with(spoil);
        assert!(fault.contains(expected) && fault.is_empty() == expected.is_empty(), "{expected:?}: {fault:?}");
    }
}

#[test]
fn planted_faults_measure_reviewers() {
    let reviews = [
        review("ada-", "planted", "1"),
        review("ada+", "sound", "1"),
        review("bo+", "planted", "1"),
        review("bo-", "sound", "1"),
        review("Cy-", "sound", "1"),
    ];
    let now: Vec<&Review> = reviews.iter().collect();
    let measured = detections(&now, &BTreeSet::from(["planted".to_owned()]));
    let of = |name: &str| measured[name].clone();
    assert_eq!(of("ada"), Detection { planted: 1, detected: 1, sound: 1, false_alarms: 0 });
    assert_eq!(of("bo"), Detection { planted: 1, detected: 0, sound: 1, false_alarms: 1 });
    assert_eq!(measured.len(), 2, "adjudication is not independent");
}

#[test]
fn reviews_are_lines_of_json() {
    let said = review("ada-", "s", "1");
    let line = serde_json::to_string(&said).unwrap();
    assert!(line.contains(r#""decision":{"verdict":"reject","reasons":["looks_wrong"]}"#), "{line}");
    assert_eq!(serde_json::from_str::<Review>(&line).unwrap(), said);
}

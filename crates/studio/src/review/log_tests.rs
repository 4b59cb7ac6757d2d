//! The log: what is acknowledged survives, what does not fit is refused.

use std::io::Write;

use super::tests::review;
use super::*;

fn said(text: &str, content: &str, id: &str) -> Review {
    Review { client_operation_id: id.into(), ..review(text, "s", content) }
}

/// Words of all reviews in short form.
fn words(log: &ReviewLog) -> String {
    let word = |review: &Review| {
        let sign = match review.decision {
            Decision::Approve => '+',
            Decision::Reject { .. } => '-',
            Decision::SendBack => '<',
            Decision::TakeBack => '~',
        };
        format!("{}{sign}", review.reviewer.name)
    };
    log.reviews().iter().map(word).collect::<Vec<_>>().join(" ")
}

#[test]
fn a_torn_line_is_cut_off_and_the_rest_survives() {
    let folder = tempfile::tempdir().unwrap();
    let mut log = ReviewLog::read(folder.path()).unwrap();
    assert!(!ReviewLog::path_of(folder.path()).exists(), "reading writes nothing");
    log.add(said("ada+", "1", "a1"), "1").unwrap();
    log.add(said("ada+", "1", "a1"), "1").unwrap();
    let whole = std::fs::read(ReviewLog::path_of(folder.path())).unwrap();
    let mut file = std::fs::OpenOptions::new().append(true).open(ReviewLog::path_of(folder.path())).unwrap();
    file.write_all(b"{\"scenario\": \"s\", \"conte").unwrap();
    let mut log = ReviewLog::read(folder.path()).unwrap();
    assert_eq!(words(&log), "ada+", "a review that is sent twice is kept once");
    log.add(said("bo-", "1", "b1"), "1").unwrap();
    let now = std::fs::read(ReviewLog::path_of(folder.path())).unwrap();
    assert!(now.starts_with(&whole) && now.ends_with(b"}\n"));
    assert_eq!(words(&ReviewLog::read(folder.path()).unwrap()), "ada+ bo-");
}

#[test]
fn two_programs_append_to_one_log() {
    let folder = tempfile::tempdir().unwrap();
    let mut logs = [(); 2].map(|()| ReviewLog::read(folder.path()).unwrap());
    for number in 0..6 {
        let name = ["ada+", "bo-", "cleo+"][number / 2];
        logs[number % 2].add(said(name, "1", &number.to_string()), "1").unwrap();
    }
    logs.iter_mut().for_each(|log| log.refresh().unwrap());
    assert_eq!(logs.each_ref().map(words), ["ada+ ada+ bo- bo- cleo+ cleo+"; 2]);
    // From threads, which wait for each other.
    std::thread::scope(|scope| {
        for name in ["dan+", "eve-"] {
            let folder = folder.path();
            scope.spawn(move || {
                let mut log = ReviewLog::read(folder).unwrap();
                (0..20).for_each(|number| log.add(said(name, "1", &number.to_string()), "1").unwrap());
            });
        }
    });
    assert_eq!(ReviewLog::read(folder.path()).unwrap().reviews().len(), 46);
}

#[test]
fn what_does_not_fit_is_refused_and_changes_nothing() {
    // Reviews before, review, hash that the reviewer saw, message.
    let cases = [
        ("", "ada~", "1", "nothing to take back"),
        ("ada+ ada~", "ada~", "1", "nothing to take back"),
        ("", "ada+", "0", "was edited since"),
        ("ada+", "Bo+", "1", "two reviews that differ"),
        ("ada+ bo+", "Cy+", "1", "two reviews that differ"),
        ("ada+ bo-", "Bo-", "1", "bo is one of the two reviewers"),
        ("ada+ bo- Cy+", "cy+", "1", "cy has adjudicated"),
        ("ada+ bo-", "Cy+", "1", ""),
        ("ada+ bo- Cy+", "Cy-", "1", ""),
        ("ada+", "ada-", "1", ""),
    ];
    for (before, text, content, expected) in cases {
        let folder = tempfile::tempdir().unwrap();
        let mut log = ReviewLog::read(folder.path()).unwrap();
        for text in before.split_whitespace() {
            log.add(said(text, "1", ""), "1").unwrap_or_else(|error| panic!("{before}: {error}"));
        }
        let bytes = || std::fs::read(ReviewLog::path_of(folder.path())).unwrap_or_default();
        let known = bytes();
        let message = log.add(said(text, content, ""), "1").err().map_or(String::new(), |error| error.to_string());
        assert!(message.contains(expected) && message.is_empty() == expected.is_empty(), "{before}, {text}: {message}");
        assert_eq!(bytes() == known, !expected.is_empty(), "{before}, {text}");
    }
}

#[test]
fn trials_certify_only_when_all_are_verified() {
    let folder = tempfile::tempdir().unwrap();
    let mut log = ReviewLog::read(folder.path()).unwrap();
    let trials = |verified: usize, shortest: Option<f64>| ExpertTrials {
        scenario: "s".into(),
        content_sha256: "1".into(),
        episodes: 5,
        verified,
        shortest_path_m: shortest,
        shortest_s: shortest,
        horizon_s: 30.0,
        at: "2026-11-27T12:00:00Z".into(),
    };
    for (verified, shortest, is_certified) in [(0, None, false), (4, Some(1.0), false), (5, Some(1.0), true)] {
        log.add_trials(trials(verified, shortest)).unwrap();
        let read = ReviewLog::read(folder.path()).unwrap();
        assert_eq!(read.trials("1").unwrap().certificate().is_some(), is_certified, "{verified}");
        assert!(read.trials("2").is_none());
    }
}

#[test]
fn older_reviews_are_written_once() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["bo-", "cy+"] {
        let mut log = ReviewLog::read(folder.path()).unwrap();
        log.import("suite x", vec![said("ada+", "1", "")]);
        assert!(log.has_imported("suite x") && words(&log).starts_with("ada+"));
        log.add(said(name, "1", ""), "1").unwrap();
    }
    assert_eq!(words(&ReviewLog::read(folder.path()).unwrap()), "ada+ bo- cy+");
}

#[test]
fn a_damaged_log_names_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = ReviewLog::path_of(folder.path());
    for (text, line) in [
        ("{\"schema\": \"genmanip.reviews/9\"}\n", "line 1"),
        ("{\"schema\": \"genmanip.reviews/1\"}\n{\"scenario\": 7}\n", "line 2"),
        ("{\"schema\": \"genmanip.reviews/1\"}\nnone\n", "line 2"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = ReviewLog::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(line), "{error}");
    }
}

/// Words that a reviewer says after both have said, with the other's answer in view, do not count.
#[test]
fn agreement_counts_independent_words() {
    // Reviews, raw agreement of the decisions.
    for (text, expected) in [
        ("ada+ bo+", Some(1.0)),
        ("ada+ bo-", Some(0.0)),
        ("ada+ bo- bo+", Some(0.0)),
        ("ada- ada+ bo+", Some(1.0)),
        ("ada+ ada~ bo+ ada-", Some(0.0)),
        ("ada+ bo- Cy+", Some(0.0)),
        ("ada+", None),
    ] {
        let reviews: Vec<Review> = text.split_whitespace().map(|text| review(text, "s", "1")).collect();
        let found = agreement(&reviews, &Default::default());
        assert_eq!(found.decision.map(|decision| decision.raw), expected, "{text}");
        // Reviews of another content are another pair.
        let other: Vec<Review> =
            reviews.iter().cloned().map(|review| Review { content_sha256: "2".into(), ..review }).collect();
        let both = agreement(&[reviews, other].concat(), &["s".to_owned()].into());
        assert_eq!(both.decision.map(|decision| decision.items), expected.map(|_| 2), "{text}");
        assert_eq!(both.planted["ada"].planted, 2, "{text}");
    }
}

use proptest::prelude::*;

use super::*;

fn candidate(kind: usize, relation: usize, clutter: usize, thing: usize) -> Candidate {
    let one = |name: &str, value: usize| (name.to_owned(), vec![value.to_string()]);
    Candidate {
        kind: format!("kind {kind}"),
        traits: [one("relation", relation), one("objects", clutter)].into(),
        once: vec![format!("thing {thing}")],
        is_preferred: false,
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Skewed candidates that contain a balanced half.
    #[test]
    fn a_selection_is_balanced_where_candidates_allow_it(draws in prop::collection::vec((0_usize..2, 0_usize..16, 0_usize..9, 0_usize..30), 300)) {
        // The first value is five times as frequent as the others.
        let skewed = |drawn: usize, values: usize| drawn.saturating_sub(drawn.min(4)) % values;
        let candidates: Vec<Candidate> = draws
            .iter()
            .map(|&(kind, relation, clutter, thing)| candidate(kind, skewed(relation, 4), skewed(clutter, 3), thing))
            .collect();
        let chosen = select(&candidates, 24, &Targets::new());
        prop_assert_eq!(chosen.len(), 48);
        prop_assert_eq!(&chosen, &select(&candidates, 24, &Targets::new()));
        let of_first = chosen.iter().filter(|&&index| candidates[index].kind == "kind 0").count();
        prop_assert_eq!(of_first, 24);
        for marginal in marginals(chosen.iter().map(|&index| &candidates[index].traits)) {
            prop_assert!(marginal.deviation() < 0.15, "{:?}", marginal);
        }
    }
}

#[test]
fn what_is_not_there_is_not_taken() {
    assert!(select(&[], 3, &Targets::new()).is_empty());
    let few = [candidate(0, 0, 0, 0), candidate(1, 0, 0, 0)];
    assert_eq!(select(&few, 3, &Targets::new()), [0, 1]);
}

#[test]
fn other_things_are_preferred() {
    let all = [candidate(0, 0, 0, 1), candidate(0, 0, 0, 1), candidate(0, 0, 0, 2)];
    let chosen = select(&all, 2, &Targets::new());
    assert!(chosen.contains(&2), "{chosen:?}");
}

/// Preferred candidates are selected although others balance better, up to the requested number.
#[test]
fn preferred_candidates_come_first() {
    let mut all: Vec<Candidate> = (0..6).map(|thing| candidate(0, thing % 2, 0, thing)).collect();
    for index in [2, 4] {
        all[index].is_preferred = true;
    }
    assert_eq!(select(&all, 1, &Targets::new()), [2]);
    assert_eq!(select(&all, 2, &Targets::new()), [2, 4]);
    assert_eq!(select(&all, 4, &Targets::new()), [1, 2, 3, 4]);
}

/// Targets replace equal shares.
#[test]
fn targets_are_followed() {
    let all: Vec<Candidate> = (0..40).map(|thing| candidate(0, thing % 2, 0, thing)).collect();
    let targets = Targets::from([("relation".into(), [("0".into(), 0.75), ("1".into(), 0.25)].into())]);
    let chosen = select(&all, 12, &targets);
    assert_eq!(chosen.iter().filter(|&&index| index % 2 == 0).count(), 9);
}

/// At most half of the tasks of a kind have an object that is identified by its place and no second one, unless the
/// suite would be smaller for it.
#[test]
fn clues_are_shared_out_where_there_is_a_choice() {
    let with_clues = |clues: &str, thing: usize| {
        let mut candidate = candidate(0, 0, 0, thing);
        candidate.traits.insert("clues".into(), vec![clues.into()]);
        candidate
    };
    for (one, two, expected) in [(8, 8, (2, 2)), (8, 2, (2, 2)), (8, 1, (3, 1)), (8, 0, (4, 0)), (2, 1, (2, 1))] {
        let all: Vec<Candidate> =
            (0..one + two).map(|at| with_clues(if at < one { "one" } else { "two" }, at)).collect();
        let chosen = choose(&all, 4, &Targets::new());
        let with_one = chosen.iter().filter(|&&index| index < one).count();
        assert_eq!((with_one, chosen.len() - with_one), expected, "{one} {two}");
    }
}

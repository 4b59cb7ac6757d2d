use std::path::Path;

use genmanip_assets::Catalogue;
use genmanip_core::{Document, Scenario};

use super::*;
use crate::suite_format::{Candidate, Targets};

fn axes_of(pairs: &[(&str, &str)]) -> Axes {
    pairs.iter().map(|(axis, value)| ((*axis).to_owned(), vec![(*value).to_owned()])).collect()
}

#[test]
fn axes_say_what_a_task_is_about() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../suites/genmanip-200-rc/scenarios");
    let axes = |name: &str| {
        let text = std::fs::read_to_string(folder.join(format!("{name}.json"))).unwrap();
        axes(&Scenario::from_json(&text).unwrap().task, Catalogue::all())
    };
    let cans = axes("009_appearance-000");
    for (axis, value) in
        [("kind", "appearance"), ("goal", "single"), ("steps", "1"), ("relation", "right"), ("clutter", "up to 2")]
    {
        assert_eq!(cans[axis], [value], "{axis}");
    }
    assert!(!cans.contains_key("need") && !cans.contains_key("joint"), "{cans:?}");
    let long = axes("001_long_horizon-000");
    assert_eq!((long["goal"].as_slice(), long["steps"].as_slice()), (&["alternatives".into()][..], &["2".into()][..]));
    assert_eq!(axes("005_common_sense-000")["need"], ["my tea always drips on the tablecloth"]);
}

#[test]
fn total_variation_is_half_the_sum_of_differences() {
    let of = |relation: &str, goal: &str| axes_of(&[("relation", relation), ("goal", goal)]);
    let all = [of("left", "single"), of("left", "single"), of("left", "pair"), of("on", "pair")];
    let all: Vec<&Axes> = all.iter().collect();
    let found = balance(&all, &all, &Targets::new());
    let distance = |name: &str, found: &Balance| {
        found.axes.iter().find(|axis| axis.axis == name).map(|axis| axis.total_variation).unwrap()
    };
    assert_eq!((found.scenarios, distance("relation", &found), distance("goal", &found)), (4, 0.25, 0.0));
    // Combinations left-single 2, left-pair 1, on-pair 1, each wanted a third.
    let pair = &found.pairs[0];
    assert!((pair.total_variation - 1.0 / 6.0).abs() < 1e-12, "{pair:?}");
    let targets = Targets::from([("relation".into(), [("left".into(), 0.75), ("on".into(), 0.25)].into())]);
    assert_eq!(distance("relation", &balance(&all, &all, &targets)), 0.0);
    // A value that only candidates have is missing.
    let missing = balance(&all[..3], &all, &Targets::new());
    assert_eq!(distance("relation", &missing), 0.5);
    assert_eq!(balance(&[], &[], &Targets::new()), Balance::default());
}

#[test]
fn every_candidate_keeps_its_reason() {
    let offered: Vec<Offered> = (0..12)
        .map(|number| Offered {
            scenario: format!("s{number:02}"),
            candidate: Candidate {
                kind: "spatial".into(),
                traits: axes_of(&[("relation", ["left", "left", "left", "on"][number % 4])]),
                once: vec![number.to_string()],
                is_preferred: false,
            },
            refused: (number == 3).then(|| "rejected: unsafe".into()),
        })
        .collect();
    let made = choice(&offered, 4, &Targets::new());
    assert_eq!((made.chosen.len(), made.rejected.len()), (4, 8));
    let ids: Vec<&str> = made.chosen.iter().map(|one| one.scenario.as_str()).collect();
    assert!(ids.contains(&"s07") && ids.contains(&"s11"), "{ids:?}");
    let reason = |id: &str| made.rejected.iter().find(|one| one.scenario == id).map(|one| one.reason.as_str());
    assert_eq!(reason("s03"), Some("rejected: unsafe"));
    assert!(made.chosen.iter().chain(&made.rejected).all(|one| !one.reason.is_empty()), "{made:?}");
    assert_eq!(Choice::from_json(&made.to_json()).unwrap(), made);
    // Of what is left, a rare one helps most.
    let helpful = helpful(&offered, &[0, 1, 2].into(), &Targets::new());
    assert_eq!((helpful[0].0 % 4, helpful[0].1 > 0.0, helpful.len()), (3, true, 8));
    assert!(helpful[0].2.starts_with("relation on: 0 %, wanted 50 %"), "{}", helpful[0].2);
}

#[test]
fn difficulty_is_the_mean_of_the_policies() {
    let result = |policy: &str, episode: usize, success: bool| {
        let mut result = crate::statistics::tests::result("s", episode as u64, success);
        (result.scenario_id, result.policy) = ("s".into(), policy.into());
        result
    };
    for (strong, weak, expected) in [([1, 1], [1, 0], "easy"), ([1, 1], [0, 0], "medium"), ([1, 0], [0, 0], "hard")] {
        let of = |policy: &'static str, outcomes: [usize; 2]| {
            outcomes.into_iter().enumerate().map(move |(episode, outcome)| (policy, episode, outcome == 1))
        };
        let results: Vec<_> = of("strong", strong)
            .chain(of("weak", weak))
            .map(|(policy, at, success)| result(policy, at, success))
            .collect();
        // Results of another content of the same scenario do not mix with these.
        let easier = result("strong", 2, true);
        let all = results.iter().map(|one| ("as it is", one)).chain([("as it was", &easier)]);
        let measured = measured_contents(all);
        assert_eq!((measured["as it is"].difficulty(), measured["as it is"].episodes()), (expected, 4));
        assert_eq!((measured["as it was"].difficulty(), measured["as it was"].episodes()), ("easy", 1));
    }
}

//! `genmanip-lab worth`: amounts that teach nothing, with all that is counted and paired.

use super::lab;

#[test]
fn policies_are_trained_on_sources_generated_and_analytic_demonstrations() {
    let folder = tempfile::tempdir().unwrap();
    let amounts = ["--source-demos", "1", "--count", "2", "--layouts", "2", "--steps", "2", "--out", "out"];
    let outcome =
        lab(folder.path(), &[&["worth", "--seed", "5", "--skills", "press", "--json"], &amounts[..]].concat());
    if outcome.code == Some(1) {
        // A build without learned policies.
        return outcome.assert_refused(&["without learned policies", "cargo xtask install --learn"]);
    }
    let measured = outcome.json(0);
    let press = &measured["skills"]["press"];
    assert_eq!((&measured["steps"], &measured["layouts"], &press["source_demos"]), (&2.into(), &2.into(), &1.into()));
    for (arm, demonstrations) in [("sources", 1), ("generated", 2), ("analytic", 2)] {
        assert_eq!(press[arm]["demonstrations"], demonstrations, "{arm}");
        let [low, success, high] = ["low", "success", "high"].map(|key| press[arm][key].as_f64().unwrap());
        assert!(0.0 <= low && low <= success && success <= high && high <= 1.0, "{arm}: {press:#}");
        let policy = folder.path().join("out/press").join(format!("{arm}-policy/policy.json"));
        assert!(policy.is_file(), "{policy:?}");
    }
    for (difference, other) in [("generated_minus_sources", "sources"), ("generated_minus_analytic", "analytic")] {
        let success = |arm: &str| press[arm]["success"].as_f64().unwrap();
        let points = press[difference]["points"].as_f64().unwrap();
        assert!((points - 100.0 * (success("generated") - success(other))).abs() < 1e-9, "{press:#}");
    }
}

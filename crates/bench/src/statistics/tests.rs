use std::collections::BTreeMap;

use genmanip_core::{Ending, EpisodeResult, Failure, FailureCause, GoalVerdict, Seed, TaskKind};

use super::*;

const Z: f64 = 1.959_963_984_540_054;

pub(crate) fn result(policy: &str, scenario: u64, success: bool) -> EpisodeResult {
    EpisodeResult {
        id: format!("{policy}-{scenario}"),
        scenario_id: format!("s{scenario}"),
        task_id: format!("t{}", scenario % 2),
        policy: policy.into(),
        oracle: policy == "expert",
        seed: Seed::new(scenario),
        success,
        success_once: success || scenario == 0,
        verdict: GoalVerdict { score: if success { 1.0 } else { 0.5 }, success, alternatives: vec![] },
        ending: Some(Ending::Finished),
        failures: (!success)
            .then(|| Failure { cause: FailureCause::Slipped, evidence: "at 1 s".into() })
            .into_iter()
            .collect(),
        duration_s: 5.0 + scenario as f64,
        horizon_s: 30.0,
        control_rate_hz: 60.0,
        frames: 300,
        tcp_path_m: 2.0,
        max_stray_contact_n: if success { 0.0 } else { 25.0 },
        stray_contact: None,
        world_hashes: None,
        engine: "mujoco 3.17.0".into(),
        genmanip_version: "0.1.0".into(),
    }
}

fn kinds() -> BTreeMap<String, TaskKind> {
    [("t0".to_owned(), TaskKind::Spatial), ("t1".to_owned(), TaskKind::PickAndPlace)].into()
}

/// Examples of Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
#[test]
fn wilson_interval_matches_published_values() {
    for (successes, trials, low, high) in
        [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)]
    {
        let [got_low, got_high] = wilson_interval(successes, trials, Z);
        assert!(
            (got_low - low).abs() < 5e-5 && (got_high - high).abs() < 5e-5,
            "{successes}/{trials}: {got_low} {got_high}"
        );
        let [mirrored_low, mirrored_high] = wilson_interval(trials - successes, trials, Z);
        assert!((mirrored_low + got_high - 1.0).abs() < 1e-12 && (mirrored_high + got_low - 1.0).abs() < 1e-12);
    }
    assert_eq!(wilson_interval(0, 0, Z), [0.0, 1.0]);
    assert_eq!(wilson_interval(7, 7, Z)[1], 1.0);
}

#[test]
fn mcnemar_matches_binomial_tails() {
    for (only_first, only_second, expected) in [
        (0, 0, 1.0),
        (0, 1, 1.0),
        (0, 5, 0.0625),
        (3, 10, 2.0 * 378.0 / 8192.0),
        (6, 6, 1.0),
        (1, 9, 2.0 * 11.0 / 1024.0),
    ] {
        assert!((mcnemar_exact(only_first, only_second) - expected).abs() < 1e-12, "{only_first} {only_second}");
        assert_eq!(mcnemar_exact(only_first, only_second), mcnemar_exact(only_second, only_first));
    }
    // Too many for factorials.
    assert!((mcnemar_exact(2000, 2000) - 1.0).abs() < 1e-9);
    let p = mcnemar_exact(900, 1100);
    assert!((7e-6..1e-5).contains(&p), "{p}");
}

#[test]
fn bootstrap_is_repeatable_and_close_to_the_normal_interval() {
    let settings = StatisticsSettings::default();
    let values: Vec<f64> = (0..200).map(|index| f64::from(index % 20)).collect();
    let mean = mean_with_interval(&values, &settings, Seed::new(3));
    assert_eq!(mean, mean_with_interval(&values, &settings, Seed::new(3)));
    // Standard deviation of 0..20 is sqrt((20² - 1) / 12).
    let half = Z * (399.0_f64 / 12.0).sqrt() / 200_f64.sqrt();
    assert_eq!(mean.value, 9.5);
    assert!((mean.low - (9.5 - half)).abs() < 0.12 && (mean.high - (9.5 + half)).abs() < 0.12, "{mean:?}");

    let one = mean_with_interval(&[0.3, f64::NAN], &settings, Seed::new(0));
    assert_eq!((one.count, one.value, one.low, one.high), (1, 0.3, 0.3, 0.3));
    assert_eq!(mean_with_interval(&[], &settings, Seed::new(0)).count, 0);
}

#[test]
fn a_summary_counts_per_policy_and_kind_in_any_order() {
    let settings = StatisticsSettings::default();
    let mut results: Vec<EpisodeResult> = (0..6).map(|index| result("expert", index, index != 0)).collect();
    results.extend((0..6).map(|index| result("do_nothing", index, false)));
    let paths = (0..6).map(|index| (format!("s{index}"), 1.5)).collect();
    let summaries = summarise(&results, &kinds(), &paths, &settings).unwrap();

    let [expert, control] = &summaries[..] else { panic!("{summaries:?}") };
    assert_eq!((expert.success.successes, expert.success.trials, expert.oracle), (5, 6, true));
    assert_eq!((expert.success_once.successes, expert.collisions.successes), (6, 1));
    assert!((expert.score.value - 5.5 / 6.0).abs() < 1e-12);
    assert!((expert.spl.unwrap().value - 5.0 * 0.75 / 6.0).abs() < 1e-12);
    assert_eq!(
        expert.kinds.iter().map(|kind| kind.kind).collect::<Vec<_>>(),
        [TaskKind::PickAndPlace, TaskKind::Spatial]
    );
    assert_eq!(expert.kinds[1].success.successes, 2);
    assert_eq!(expert.failures, [FailureCount { cause: FailureCause::Slipped, count: 1 }]);
    assert_eq!((control.success.value, control.oracle), (0.0, false));

    let mut shuffled: Vec<EpisodeResult> = results[..6].iter().rev().cloned().collect();
    shuffled.extend(results[6..].iter().rev().cloned());
    assert_eq!(summarise(&shuffled, &kinds(), &paths, &settings).unwrap(), summaries);
    assert_eq!(summarise(&results, &kinds(), &BTreeMap::new(), &settings).unwrap()[0].spl, None);
    // Only scenarios with a reference count: 0 failed, 2 succeeded on a way of 2 m.
    let some = [("s0".to_owned(), 1.5), ("s2".to_owned(), 1.0)].into();
    let spl = summarise(&results, &kinds(), &some, &settings).unwrap()[0].spl.unwrap();
    assert_eq!((spl.count, spl.value), (2, 0.25));

    let error = summarise(&results, &BTreeMap::new(), &paths, &settings).unwrap_err();
    assert!(matches!(error, StatisticsError::UnknownTask { .. }), "{error}");
}

#[test]
fn a_comparison_pairs_episodes_by_scenario_and_seed() {
    let settings = StatisticsSettings::default();
    let first: Vec<EpisodeResult> = (0..8).map(|index| result("a", index, index < 6)).collect();
    let second: Vec<EpisodeResult> = (1..9).rev().map(|index| result("b", index, index == 7)).collect();
    let pair = compare(&first, &second, &settings).unwrap();
    assert_eq!((pair.pairs, pair.unpaired), (7, 2));
    assert_eq!((pair.both, pair.only_first, pair.only_second, pair.neither), (0, 5, 1, 1));
    assert!((pair.difference.value - 4.0 / 7.0).abs() < 1e-12);
    assert!((pair.p_value - 2.0 * 7.0 / 64.0).abs() < 1e-12);

    let twice = [result("a", 1, true), result("a", 1, false)];
    assert!(matches!(compare(&twice, &second, &settings), Err(StatisticsError::RepeatedEpisode { .. })));
}

#[test]
fn causes_are_counted_most_frequent_first() {
    use FailureCause::{NoIk, Planning, Slipped};
    let counts = failure_counts([Slipped, Planning, NoIk, Slipped, Planning]);
    let counts: Vec<_> = counts.into_iter().map(|entry| (entry.cause, entry.count)).collect();
    assert_eq!(counts, [(Planning, 2), (Slipped, 2), (NoIk, 1)]);
}

use std::collections::BTreeMap;

use genmanip_core::{Ending, EpisodeResult, Failure, FailureCause, GoalVerdict, Seed, TaskKind};

use proptest::prelude::*;

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
        unreachable_actions: 0,
        tcp_path_m: 2.0,
        max_stray_contact_n: if success { 0.0 } else { 25.0 },
        stray_contact: None,
        world_hashes: None,
        cloud: None,
        other_request_success: None,
        correction: None,
        expert: genmanip_core::ExpertStyle::Default,
        agent_failure: None,
        source: None,
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

    let [expert, baseline] = &summaries[..] else { panic!("{summaries:?}") };
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
    assert_eq!((baseline.success.value, baseline.oracle), (0.0, false));

    let mut shuffled: Vec<EpisodeResult> = results[..6].iter().rev().cloned().collect();
    shuffled.extend(results[6..].iter().rev().cloned());
    assert_eq!(summarise(&shuffled, &kinds(), &paths, &settings).unwrap(), summaries);
    assert_eq!(summarise(&results, &kinds(), &BTreeMap::new(), &settings).unwrap()[0].spl, None);
    // Only scenarios with a reference count: 0 failed, 2 succeeded on a path of 2 m.
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
fn scenarios_with_several_episodes_are_the_unit_of_comparison() {
    let settings = StatisticsSettings::default();
    // Five episodes of each of eight scenarios, equal within a scenario: as certain as eight episodes, not as forty.
    let results = |policy: &str, wins: u64| -> Vec<EpisodeResult> {
        let episode = |number: u64| {
            let (scenario, seed) = (number / 5, Seed::new(number));
            let result = result(policy, scenario, scenario < wins);
            EpisodeResult { id: format!("{policy}-{number}"), seed, ..result }
        };
        (0..40).map(episode).collect()
    };
    let pair = compare(&results("a", 6), &results("b", 0), &settings).unwrap();
    assert_eq!((pair.scenarios, pair.pairs, pair.only_first), (8, 40, 30));
    assert!((pair.p_value - mcnemar_exact(6, 0)).abs() < 1e-9);
    assert_eq!(pair.sequential.decided_after, None);
    let single: Vec<Vec<i8>> = (0..40).map(|number| vec![i8::from(number < 30)]).collect();
    let by_episode = paired_difference(&single, &settings, Seed::new(0));
    assert!(pair.difference.high - pair.difference.low > 1.5 * (by_episode.high - by_episode.low));

    let summary = &summarise(&results("a", 6), &kinds(), &BTreeMap::new(), &settings).unwrap()[0];
    assert_eq!((summary.success.successes, summary.success.trials), (30, 40));
    let few = Rate::new(6, 8, &settings);
    assert!(summary.success.low <= few.low && summary.success.high >= few.high, "{:?} {few:?}", summary.success);
}

#[test]
fn policies_that_always_agree_are_not_known_to_be_equal() {
    let settings = StatisticsSettings::default();
    for scenarios in [vec![vec![0]; 20], vec![vec![0, 0, 0]; 20]] {
        let difference = paired_difference(&scenarios, &settings, Seed::new(0));
        assert!(difference.value == 0.0 && difference.low < -0.05 && difference.high > 0.05, "{difference:?}");
    }
    assert_eq!(paired_difference(&[], &settings, Seed::new(0)).count, 0);
}

proptest! {
    #[test]
    fn one_episode_per_scenario_makes_the_permutation_test_mcnemars(wins in 0_usize..60, losses in 0_usize..60, ties in 0_usize..20) {
        let counts = [(wins, 1), (losses, -1), (ties, 0)];
        let sums: Vec<i64> = counts.iter().flat_map(|&(count, sum)| std::iter::repeat_n(sum, count)).collect();
        prop_assert!((permutation_test(&sums) - mcnemar_exact(wins, losses)).abs() < 1e-9);
    }

    #[test]
    fn larger_differences_and_suites_are_found_more_often(scenarios in 20_usize..300, permille in 0_u32..300) {
        let difference = f64::from(permille) / 1000.0;
        let chance = power(scenarios, 0.4, difference, 0.05);
        prop_assert!(power(scenarios, 0.4, difference + 0.05, 0.05) >= chance);
        // Exact tests of counts are discrete, so a few scenarios more may detect a little less.
        prop_assert!(power(2 * scenarios, 0.4, difference, 0.05) >= chance - 0.02);
        prop_assert!((0.0..=1.0).contains(&chance));
        let least = detectable_difference(scenarios, 0.4, 0.05);
        prop_assert!(least.is_none_or(|least| power(scenarios, 0.4, least, 0.05) >= 0.8));
    }
}

#[test]
fn a_bet_that_is_looked_at_all_the_time_pays_only_for_real_differences() {
    let mixed = sequential(&[1, -1, 0, 1, -1, 1, -1], 0.05);
    assert!(mixed.decided_after.is_none() && mixed.p_value > 0.5, "{mixed:?}");
    let clear = sequential(&[[1; 30].as_slice(), &[-1; 40]].concat(), 0.05);
    // Significant at the eighth, whatever follows; the likelihood ratio itself is small at the end.
    assert!(clear.decided_after == Some(8) && clear.p_value < 1e-6 && clear.e_value < 1.0, "{clear:?}");
    assert_eq!(sequential(&[], 0.05), Sequential { e_value: 1.0, p_value: 1.0, decided_after: None });
}

#[test]
fn causes_are_counted_most_frequent_first() {
    use FailureCause::{NoIk, Planning, Slipped};
    let counts = failure_counts([Slipped, Planning, NoIk, Slipped, Planning]);
    let counts: Vec<_> = counts.into_iter().map(|entry| (entry.cause, entry.count)).collect();
    assert_eq!(counts, [(Planning, 2), (Slipped, 2), (NoIk, 1)]);
}

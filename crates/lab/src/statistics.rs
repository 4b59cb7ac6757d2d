//! Simulated coverage of confidence intervals and type I error of tests.

use std::collections::BTreeMap;

use genmanip_benchmark::statistics::{
    Rate, StatisticsSettings, mcnemar_exact, paired_difference, permutation_test, sequential,
};
use genmanip_core::Seed;
use genmanip_workspace::text_table;
use rand::{Rng, RngExt};
use serde::Serialize;

use crate::clock::cpu_clock;

/// True success rates for which coverage is measured.
const RATES: [f64; 13] = [0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98];
/// True success rates of the two policies of a pair; all combinations are measured.
const PAIRS: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
/// Numbers of scenarios: those of one kind, and those of a suite.
const SCENARIOS: [usize; 2] = [50, 200];
/// Number of episodes per scenario, where there are several.
const EPISODES: usize = 5;
/// Intra-scenario correlation of successes.
const ALIKE: [f64; 3] = [0.0, 0.3, 0.7];
/// Bootstrap resamples: fewer than by default, since the bootstrap runs once per repetition.
const RESAMPLES: usize = 400;
/// Divisor of the number of repetitions for methods that need a bootstrap.
const BOOTSTRAP_SHARE: usize = 10;

/// Coverage and type I errors of all methods.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Number of simulated evaluations per setting.
    pub repetitions: usize,
    /// True success rates of the grid.
    pub rates: Vec<f64>,
    /// Coverage of 95 % intervals by method.
    pub coverage: BTreeMap<&'static str, Coverage>,
    /// Type I error of tests at level 5 %, the maximum over the grid, by test.
    pub type_one_error: BTreeMap<&'static str, Worst>,
    /// CPU time of the measurement, s.
    pub cpu_s: f64,
}

/// Coverage of one method over the grid: share of intervals that contain the true value.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Coverage {
    /// Number of settings of the grid.
    pub settings: usize,
    /// Mean coverage over the grid, 0 to 1.
    pub mean: f64,
    /// Minimum coverage over the grid, 0 to 1.
    pub min: f64,
    /// Setting with the minimum coverage.
    pub min_at: String,
}

/// Largest type I error of one test over the grid.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Worst {
    /// Number of settings of the grid.
    pub settings: usize,
    /// Largest share of false rejections, 0 to 1.
    pub value: f64,
    /// Setting with the largest share.
    pub at: String,
}

impl Coverage {
    fn add(&mut self, share: f64, at: impl FnOnce() -> String) {
        self.mean = (self.mean * self.settings as f64 + share) / (self.settings + 1) as f64;
        if self.settings == 0 || share < self.min {
            (self.min, self.min_at) = (share, at());
        }
        self.settings += 1;
    }
}

impl Worst {
    fn add(&mut self, share: f64, at: impl FnOnce() -> String) {
        if self.settings == 0 || share > self.value {
            (self.value, self.at) = (share, at());
        }
        self.settings += 1;
    }
}

/// Simulates evaluations with known success rates, `repetitions` times per setting.
pub fn measure(repetitions: usize, seed: Seed) -> Report {
    let mut clock = cpu_clock();
    let started = clock();
    let settings = StatisticsSettings { resamples: RESAMPLES, ..StatisticsSettings::default() };
    let mut report = Report {
        repetitions,
        rates: RATES.to_vec(),
        coverage: BTreeMap::new(),
        type_one_error: BTreeMap::new(),
        cpu_s: 0.0,
    };
    rates(&mut report, &settings, seed.fork("rates"));
    pairs(&mut report, &settings, seed.fork("pairs"));
    report.cpu_s = clock() - started;
    report
}

/// Adds the coverage of intervals of a single success rate.
fn rates(report: &mut Report, settings: &StatisticsSettings, seed: Seed) {
    for scenarios in SCENARIOS {
        for (episodes, alike) in [(1, 0.0)].into_iter().chain(ALIKE.map(|alike| (EPISODES, alike))) {
            for rate in RATES {
                let at = || format!("p {rate}, {scenarios} scenarios of {episodes}, correlation {alike}");
                let mut rng = seed.fork(&at()).rng();
                let held = (0..report.repetitions).filter(|_| {
                    let counts: Vec<(usize, usize)> =
                        (0..scenarios).map(|_| (successes(&mut rng, episodes, rate, alike), episodes)).collect();
                    let interval = Rate::clustered(&counts, settings);
                    interval.low <= rate && rate <= interval.high
                });
                let share = held.count() as f64 / report.repetitions as f64;
                let name = if episodes == 1 { "rate" } else { "rate_by_scenario" };
                report.coverage.entry(name).or_default().add(share, at);
            }
        }
    }
}

/// Number of successes among the episodes of one scenario, with mean rate `rate` and intra-scenario correlation
/// `alike`: each episode copies a shared draw with probability `sqrt(alike)`, and otherwise draws independently.
fn successes(rng: &mut impl Rng, episodes: usize, rate: f64, alike: f64) -> usize {
    let shared = rng.random_bool(rate);
    let copies = alike.sqrt();
    (0..episodes).filter(|_| if rng.random_bool(copies) { shared } else { rng.random_bool(rate) }).count()
}

/// Adds the coverage of intervals of the difference of two policies, and the type I error of tests for a difference.
fn pairs(report: &mut Report, settings: &StatisticsSettings, seed: Seed) {
    let alpha = 1.0 - settings.coverage;
    for scenarios in SCENARIOS {
        for episodes in [1, EPISODES] {
            let drawn = if episodes == 1 { report.repetitions } else { report.repetitions.div_ceil(BOOTSTRAP_SHARE) };
            for (first, second) in PAIRS.iter().flat_map(|&a| PAIRS.iter().map(move |&b| (a, b))) {
                let at = || format!("p {first} and {second}, {scenarios} scenarios of {episodes}");
                let mut rng = seed.fork(&at()).rng();
                let (mut held, mut found, mut found_early) = (0_usize, 0_usize, 0_usize);
                let repetitions = if first == second { report.repetitions } else { drawn };
                for repetition in 0..repetitions {
                    let differences: Vec<Vec<i8>> =
                        (0..scenarios).map(|_| differences(&mut rng, episodes, first, second)).collect();
                    if repetition < drawn {
                        let interval = paired_difference(&differences, settings, Seed::new(repetition as u64));
                        held += usize::from(interval.low <= first - second && first - second <= interval.high);
                    }
                    if first == second {
                        let sums: Vec<i64> =
                            differences.iter().map(|own| own.iter().map(|&d| i64::from(d)).sum()).collect();
                        let p = match episodes {
                            1 => {
                                let count = |sign| sums.iter().filter(|sum| **sum == sign).count();
                                mcnemar_exact(count(1), count(-1))
                            }
                            _ => permutation_test(&sums),
                        };
                        found += usize::from(p <= alpha);
                        found_early += usize::from(sequential(&sums, alpha).decided_after.is_some());
                    }
                }
                let share = |count: usize| count as f64 / repetitions as f64;
                let (interval, test) = match episodes {
                    1 => ("difference", "mcnemar"),
                    _ => ("difference_by_scenario", "permutation_by_scenario"),
                };
                report.coverage.entry(interval).or_default().add(held as f64 / drawn as f64, at);
                if first == second {
                    report.type_one_error.entry(test).or_default().add(share(found), at);
                    report.type_one_error.entry("sequential").or_default().add(share(found_early), at);
                }
            }
        }
    }
}

/// Differences of success (-1, 0, 1) in the episodes of one scenario. In half of the scenarios, one shared draw
/// decides all episodes of both policies, which correlates them; in the others every episode draws independently.
fn differences(rng: &mut impl Rng, episodes: usize, first: f64, second: f64) -> Vec<i8> {
    let shared = rng.random_bool(0.5).then(|| rng.random::<f64>());
    let draw = |rng: &mut dyn FnMut() -> f64, rate: f64| i8::from(shared.unwrap_or_else(rng) < rate);
    (0..episodes)
        .map(|_| {
            let mut own = || rng.random::<f64>();
            draw(&mut own, first) - draw(&mut own, second)
        })
        .collect()
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let head = ["intervals of 95 %", "settings", "mean coverage", "least", "where"];
    let mut rows = vec![head.map(String::from).to_vec()];
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    for (name, coverage) in &report.coverage {
        let figures = [coverage.settings.to_string(), percent(coverage.mean), percent(coverage.min)];
        rows.push(std::iter::once(name.replace('_', " ")).chain(figures).chain([coverage.min_at.clone()]).collect());
    }
    let head = ["tests at 5 %", "settings", "most errors", "where"];
    let mut tests = vec![head.map(String::from).to_vec()];
    for (name, worst) in &report.type_one_error {
        tests.push(vec![name.replace('_', " "), worst.settings.to_string(), percent(worst.value), worst.at.clone()]);
    }
    format!(
        "{} repetitions, {:.0} s of CPU time\n\n{}\n{}",
        report.repetitions,
        report.cpu_s,
        text_table(&rows),
        text_table(&tests)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_simulation_is_repeatable_and_near_what_is_promised() {
        let report = measure(300, Seed::new(5));
        assert_eq!(report.coverage.len(), 4);
        for (name, coverage) in &report.coverage {
            assert!((0.93..0.99).contains(&coverage.mean), "{name}: {coverage:?}");
        }
        for (name, worst) in &report.type_one_error {
            // 5 % and three standard deviations of 300 repetitions.
            assert!(worst.value < 0.09, "{name}: {worst:?}");
        }
        let again = measure(300, Seed::new(5));
        assert_eq!(serde_json::to_value(&again.coverage).unwrap(), serde_json::to_value(&report.coverage).unwrap());
    }
}

//! Agreement measures of a table of success rates, with bootstrap intervals.

use std::collections::BTreeSet;

use genmanip_core::Seed;
use genmanip_workspace::WorkspaceError;
use rand::{Rng, RngExt};
use serde::Serialize;

use super::table::{Cell, Comparisons, Observed, Table, World};
use crate::StatisticsSettings;
use crate::statistics::{
    Duel, bradley_terry, expanded_tail, kendall, mmrv, pearson, percentiles, rank_violations, spearman,
};

/// Number of policies below which the report warns. With three policies, one of six orders is right by chance.
const FEW_POLICIES: usize = 5;

/// Report on the agreement of simulation and reality.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SimToReal {
    /// Compared quantity: `success rate`, or `chance of winning` against the average policy.
    pub measure: String,
    /// Agreement over all tasks with equal weights; `None` if no task was tried with every policy in both worlds.
    pub overall: Option<Agreement>,
    /// Agreement by task, in the order of the table.
    pub tasks: Vec<TaskAgreement>,
    /// Reasons for caution with the results, for people.
    pub warnings: Vec<String>,
}

/// Agreement on one task.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TaskAgreement {
    /// Name of the task; empty if the table names none.
    pub task: String,
    /// Agreement on the task.
    #[serde(flatten)]
    pub agreement: Agreement,
}

/// Agreement of the rates in simulation with those in reality.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Number of tasks that the rates are averaged over.
    pub task_count: usize,
    /// Mean maximum rank violation, see [`mmrv`]; 0 is best, 1 worst.
    pub mmrv: Estimate,
    /// Pearson correlation of the rates.
    pub pearson: Estimate,
    /// Spearman's rank correlation of the rates.
    pub spearman: Estimate,
    /// Kendall's τ-b of the rates.
    pub kendall: Estimate,
    /// Rates by policy, in the order of the table.
    pub policies: Vec<PolicyRates>,
    /// Pairs of policies in different order in the two worlds, largest difference in reality first.
    pub violations: Vec<Violation>,
}

/// A value with its bootstrap interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Value; `None` if undefined, such as the rank correlation of a constant list.
    pub value: Option<f64>,
    /// Lower end of the 95 % interval; `None` if neither trials nor tasks can be resampled.
    pub low: Option<f64>,
    /// Upper end of the 95 % interval; `None` if neither trials nor tasks can be resampled.
    pub high: Option<f64>,
}

/// Rates of one policy.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PolicyRates {
    /// Name of the policy.
    pub policy: String,
    /// Mean rate in simulation, 0 to 1.
    pub sim: f64,
    /// Mean rate in reality, 0 to 1.
    pub real: f64,
    /// Rate in simulation minus that in reality, paired by task.
    pub difference: Estimate,
}

/// Pair of policies whose order differs between the two worlds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// Name of the policy that is better in reality.
    pub better: String,
    /// Name of the other policy, which is at least as good in simulation.
    pub worse: String,
    /// Rate of the better policy minus that of the worse in reality, > 0.
    pub real_gap: f64,
    /// Rate of the better policy minus that of the worse in simulation, ≤ 0.
    pub sim_gap: f64,
    /// Share of bootstrap resamples in which the pair is a violation as well, 0 to 1; `None` without resampling.
    pub resamples: Option<f64>,
}

/// Report on a table.
///
/// Intervals are percentiles of a bootstrap. It resamples tasks, the same for both worlds and all policies, and
/// trials within each cell. The choice of policies is not resampled.
///
/// # Errors
/// [`WorkspaceError::Input`] if fewer than two policies were tried in both worlds.
pub fn report(table: &Table, settings: &StatisticsSettings) -> Result<SimToReal, WorkspaceError> {
    let seed = settings.seed.fork("sim2real");
    let (measure, overall, tasks, mut warnings) = match table {
        Table::Rates(cells) => of_rates(cells, settings, seed),
        Table::Pairs(comparisons) => of_pairs(comparisons, settings, seed),
    };
    let most = overall.iter().chain(tasks.iter().map(|task| &task.agreement)).map(|it| it.policies.len()).max();
    let Some(most) = most else {
        return Err(WorkspaceError::input("fewer than two policies were tried in both worlds, on the same task")
            .with_hint("policies are matched by name; world is sim or real"));
    };
    if most < FEW_POLICIES {
        warnings.insert(
            0,
            format!("{most} policies; with fewer than {FEW_POLICIES}, these measures say next to nothing: any order is likely by chance"),
        );
    }
    Ok(SimToReal { measure: measure.into(), overall, tasks, warnings })
}

type Parts = (&'static str, Option<Agreement>, Vec<TaskAgreement>, Vec<String>);

fn of_rates(cells: &[Cell], settings: &StatisticsSettings, seed: Seed) -> Parts {
    let tasks = in_order(cells.iter().map(|cell| cell.task.as_str()));
    let policies = in_order(cells.iter().map(|cell| cell.policy.as_str()));
    let find = |task: &str, policy: &str, world: World| {
        let is_meant = |cell: &&Cell| (cell.task.as_str(), cell.policy.as_str(), cell.world) == (task, policy, world);
        cells.iter().find(is_meant).map(|cell| cell.observed)
    };
    let both = |task: &str, policy: &str| Some([find(task, policy, World::Sim)?, find(task, policy, World::Real)?]);
    let mut warnings = Vec::new();
    for cell in cells.iter().filter(|cell| both(&cell.task, &cell.policy).is_none()) {
        let on = if cell.task.is_empty() { String::new() } else { format!(" on task {}", cell.task) };
        let missing = match cell.world {
            World::Sim => "reality",
            World::Real => "simulation",
        };
        warnings.push(format!("policy {}{on} was not tried in {missing}; left out", cell.policy));
    }
    if cells.iter().any(|cell| cell.observed.trials.is_none()) {
        warnings.push("numbers of trials are missing: intervals do not contain the noise of those rates".into());
    }
    let paired: Vec<&str> =
        policies.iter().copied().filter(|policy| tasks.iter().any(|task| both(task, policy).is_some())).collect();
    let agreement = |tasks: &[&str], policies: &[&str], seed: Seed| {
        let rates = |task: &&str| policies.iter().filter_map(|policy| both(task, policy)).collect();
        let rates: Vec<Vec<[Observed; 2]>> = tasks.iter().map(rates).collect();
        of_cells(policies, &rates, settings, seed)
    };
    let mut by_task = Vec::new();
    for &task in &tasks {
        let there: Vec<&str> = paired.iter().copied().filter(|policy| both(task, policy).is_some()).collect();
        if there.len() >= 2 {
            let agreement = agreement(&[task], &there, seed.fork("task").fork(task));
            by_task.push(TaskAgreement { task: task.into(), agreement });
        }
    }
    let complete: Vec<&str> =
        tasks.iter().copied().filter(|task| paired.iter().all(|policy| both(task, policy).is_some())).collect();
    let is_partial = complete.len() < tasks.len();
    let overall = (paired.len() >= 2 && !complete.is_empty()).then(|| agreement(&complete, &paired, seed));
    if is_partial && !by_task.is_empty() {
        let (of, all) = (complete.len(), tasks.len());
        warnings
            .push(format!("{of} of {all} tasks were tried with every policy in both worlds; only they count for all"));
    }
    ("success rate", overall, by_task, warnings)
}

/// Agreement from cells by task and by policy, each cell with the rates in simulation and in reality.
fn of_cells(policies: &[&str], tasks: &[Vec<[Observed; 2]>], settings: &StatisticsSettings, seed: Seed) -> Agreement {
    let mean = |of: &dyn Fn(usize, usize, usize) -> f64| -> Rates {
        let rate = |policy, world| {
            (0..tasks.len()).map(|task| of(task, policy, world)).sum::<f64>() / tasks.len().max(1) as f64
        };
        [0, 1].map(|world| (0..policies.len()).map(|policy| rate(policy, world)).collect())
    };
    let observed = mean(&|task, policy, world| tasks[task][policy][world].rate);
    let has_trials = tasks.iter().flatten().flatten().any(|cell| cell.trials.is_some());
    let mut rng = seed.rng();
    let mut draw = || {
        let drawn: Vec<Vec<[f64; 2]>> = (0..tasks.len())
            .map(|_| {
                let task = if tasks.len() > 1 { rng.random_range(0..tasks.len()) } else { 0 };
                tasks[task].iter().map(|cell| cell.map(|cell| again(cell, &mut rng))).collect()
            })
            .collect();
        mean(&|task, policy, world| drawn[task][policy][world])
    };
    let count = if has_trials || tasks.len() > 1 { settings.resamples.max(1) } else { 0 };
    let resamples: Vec<Rates> = (0..count).map(|_| draw()).collect();
    let tail = match tasks.len() {
        0 | 1 => (1.0 - settings.coverage) / 2.0,
        several => expanded_tail(several, settings.coverage),
    };
    agreement(policies, tasks.len(), &observed, &resamples, tail)
}

/// A rate from as many new random trials as the cell has. Half a success and half a failure are added to the
/// observed ones, so that a rate of 0 of 10 is uncertain too. Without a number of trials, the observed rate is
/// returned.
fn again(cell: Observed, rng: &mut impl Rng) -> f64 {
    let Some(trials) = cell.trials else { return cell.rate };
    let chance = (cell.rate * trials as f64 + 0.5) / (trials as f64 + 1.0);
    (0..trials).filter(|_| rng.random_bool(chance)).count() as f64 / trials as f64
}

fn of_pairs(comparisons: &[Comparisons], settings: &StatisticsSettings, seed: Seed) -> Parts {
    let all = in_order(comparisons.iter().flat_map(|it| &it.policies).map(String::as_str));
    let is_in = |policy: &str, world: World| {
        comparisons.iter().any(|it| it.world == world && it.policies.iter().any(|own| own == policy))
    };
    let policies: Vec<&str> =
        all.iter().copied().filter(|policy| World::ALL.iter().all(|&world| is_in(policy, world))).collect();
    let mut warnings: Vec<String> = all
        .iter()
        .filter(|policy| !policies.contains(policy))
        .map(|policy| format!("policy {policy} was compared in one world alone; it is not in the measures"))
        .collect();
    let index = |policy: &str| all.iter().position(|own| *own == policy).unwrap_or_default();
    let strengths = |wins: &mut dyn FnMut(&Comparisons) -> [f64; 2]| -> Rates {
        World::ALL.map(|world| {
            let here = comparisons.iter().filter(|it| it.world == world);
            let duels: Vec<Duel> = here
                .map(|it| {
                    let [first, second] = it.policies.each_ref().map(|policy| index(policy));
                    let [first_wins, second_wins] = wins(it);
                    Duel { first, second, first_wins, second_wins }
                })
                .collect();
            let chances = bradley_terry(all.len(), &duels);
            policies.iter().map(|policy| chances[index(policy)]).collect()
        })
    };
    if policies.len() < 2 {
        return ("chance of winning", None, Vec::new(), warnings);
    }
    if let Some(parts) = separate_parts(comparisons, &all) {
        warnings.push(parts);
    }
    let observed = strengths(&mut |it| it.wins.map(|wins| wins as f64 + it.ties as f64 / 2.0));
    let mut rng = seed.rng();
    let mut again = |it: &Comparisons| {
        let trials = it.wins[0] + it.wins[1] + it.ties;
        let mut wins = [0.0; 2];
        for _ in 0..trials {
            let drawn = rng.random_range(0..trials);
            match drawn {
                _ if drawn < it.wins[0] => wins[0] += 1.0,
                _ if drawn < it.wins[0] + it.wins[1] => wins[1] += 1.0,
                _ => wins = wins.map(|wins| wins + 0.5),
            }
        }
        wins
    };
    let resamples: Vec<Rates> = (0..settings.resamples.max(1)).map(|_| strengths(&mut again)).collect();
    let agreement = agreement(&policies, 1, &observed, &resamples, (1.0 - settings.coverage) / 2.0);
    ("chance of winning", Some(agreement), Vec::new(), warnings)
}

/// Warning if the comparisons in a world do not connect all of its policies, so that their strengths have no common
/// scale; `None` if they do.
fn separate_parts(comparisons: &[Comparisons], all: &[&str]) -> Option<String> {
    World::ALL.into_iter().find_map(|world| {
        let here: Vec<&Comparisons> = comparisons.iter().filter(|it| it.world == world).collect();
        let mut reached: BTreeSet<&str> = here.first()?.policies.iter().map(String::as_str).collect();
        for _ in all {
            for pair in &here {
                if pair.policies.iter().any(|policy| reached.contains(policy.as_str())) {
                    reached.extend(pair.policies.iter().map(String::as_str));
                }
            }
        }
        let apart = here.iter().flat_map(|it| &it.policies).find(|policy| !reached.contains(policy.as_str()))?;
        let (first, world) = (&here[0].policies[0], world.name());
        Some(format!("no chain of comparisons in world {world} joins {first} and {apart}: their order is arbitrary"))
    })
}

/// Rates by policy, in simulation and in reality.
type Rates = [Vec<f64>; 2];

fn agreement(policies: &[&str], task_count: usize, observed: &Rates, resamples: &[Rates], tail: f64) -> Agreement {
    let [sim, real] = observed;
    let estimate = |measure: &dyn Fn(&Rates) -> Option<f64>| {
        let value = measure(observed);
        let drawn: Vec<f64> = resamples.iter().filter_map(measure).collect();
        let interval = value.filter(|_| !drawn.is_empty()).map(|value| {
            let [low, high] = percentiles(drawn, tail);
            (low.min(value), high.max(value))
        });
        Estimate { value, low: interval.map(|ends| ends.0), high: interval.map(|ends| ends.1) }
    };
    let rates = policies.iter().enumerate().map(|(index, &policy)| PolicyRates {
        policy: policy.into(),
        sim: sim[index],
        real: real[index],
        difference: estimate(&|[sim, real]| Some(sim[index] - real[index])),
    });
    let violations = rank_violations(sim, real).into_iter().map(|pair| {
        let is_again =
            |[sim, real]: &&Rates| real[pair.better] > real[pair.worse] && sim[pair.better] <= sim[pair.worse];
        let share = resamples.iter().filter(is_again).count() as f64 / resamples.len().max(1) as f64;
        Violation {
            better: policies[pair.better].into(),
            worse: policies[pair.worse].into(),
            real_gap: pair.real_gap,
            sim_gap: pair.sim_gap,
            resamples: (!resamples.is_empty()).then_some(share),
        }
    });
    Agreement {
        task_count,
        mmrv: estimate(&|[sim, real]| Some(mmrv(sim, real))),
        pearson: estimate(&|[sim, real]| Some(pearson(sim, real))),
        spearman: estimate(&|[sim, real]| spearman(sim, real)),
        kendall: estimate(&|[sim, real]| kendall(sim, real)),
        policies: rates.collect(),
        violations: violations.collect(),
    }
}

/// Distinct names in the order of their first appearance.
fn in_order<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut distinct = Vec::new();
    for name in names {
        if !distinct.contains(&name) {
            distinct.push(name);
        }
    }
    distinct
}

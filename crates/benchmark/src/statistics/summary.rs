//! Summaries of results by policy.

use std::collections::BTreeMap;

use genmanip_core::{AgentFailure, AgentStage, EpisodeResult, FailureCause, FailureClass, Seed, TaskKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::StatisticsSettings;
use super::interval::{Mean, Rate, mean_with_interval};
use super::traits::TraitSummary;

/// Summary of one policy on one suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SuiteSummary {
    /// Name of the policy.
    pub policy: String,
    /// True if any of the policy's results used simulator truth.
    pub oracle: bool,
    /// Share of episodes whose goal held at the end, after settling: the main result.
    pub success: Rate,
    /// Share of episodes whose goal held at some control step.
    pub success_once: Rate,
    /// Fraction of the goal reached, 0 to 1.
    pub score: Mean,
    /// Success weighted by path length (SPL) over the episodes whose scenario has a reference path; `count` is their
    /// number. Absent if no scenario has one.
    pub spl: Option<Mean>,
    /// Path length of the tool, m.
    pub tcp_path_m: Mean,
    /// Simulated duration of the episodes, s.
    pub duration_s: Mean,
    /// Share of episodes with a stray contact force of at least [`StatisticsSettings::collision_n`].
    pub collisions: Rate,
    /// Share of successes judged on point clouds of the final scene, among the episodes judged this way; absent without
    /// any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud_success: Option<Rate>,
    /// Ids of the episodes that point clouds and posed geometry judge differently.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cloud_disagreements: Vec<String>,
    /// Summary per kind of task, in the order of [`TaskKind::ALL`]; kinds without episodes are omitted.
    pub kinds: Vec<KindSummary>,
    /// Success by scenario trait, for suites with traits.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub traits: Vec<TraitSummary>,
    /// Failed episodes by cause, most frequent first.
    pub failures: Vec<FailureCount>,
    /// Failures of an agent by class and stage, most frequent first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub agent_failures: Vec<AgentFailureCount>,
}

/// Summary of one policy on the tasks of one kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct KindSummary {
    /// Kind of the tasks.
    pub kind: TaskKind,
    /// Share of episodes whose goal held at the end, after settling.
    pub success: Rate,
    /// Share of episodes whose goal held at some control step.
    pub success_once: Rate,
    /// Fraction of the goal reached, 0 to 1.
    pub score: Mean,
}

/// Frequency of one cause of failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FailureCount {
    /// Cause of failure.
    pub cause: FailureCause,
    /// Number of episodes or attempts with this cause.
    pub count: usize,
}

/// Frequency of one class of failures at one stage of an agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AgentFailureCount {
    /// Failure class; `None` for episodes that no annotator analysed.
    pub class: Option<FailureClass>,
    /// Stage of the agent at which the episode failed.
    pub stage: AgentStage,
    /// Number of episodes with this class and stage.
    pub count: usize,
}

/// Reasons why results cannot be summarised.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StatisticsError {
    /// Result of a task whose kind is not in the map.
    #[error("result {result} belongs to task {task} of unknown kind; known tasks: {known}")]
    UnknownTask {
        /// Id of the result.
        result: String,
        /// Id of the task.
        task: String,
        /// Ids of up to eight known tasks.
        known: String,
    },
    /// Two results of one policy for the same scenario and seed.
    #[error("policy {policy} has two results for scenario {scenario} with seed {seed}")]
    RepeatedEpisode {
        /// Name of the policy.
        policy: String,
        /// Id of the scenario.
        scenario: String,
        /// Seed of the episode.
        seed: Seed,
    },
}

/// Summarises results per policy, in order of first occurrence.
///
/// `kinds` gives the kind of each task by its id.
/// `reference_paths_m` gives the reference path length by scenario id (usually the shortest verified one of the
/// expert). Episodes of scenarios without one do not count for SPL, and without any the policy has no SPL.
/// The order of the results of one policy does not matter.
///
/// # Errors
/// [`StatisticsError::UnknownTask`] if a task's kind is missing.
pub fn summarise(
    results: &[EpisodeResult],
    kinds: &BTreeMap<String, TaskKind>,
    reference_paths_m: &BTreeMap<String, f64>,
    settings: &StatisticsSettings,
) -> Result<Vec<SuiteSummary>, StatisticsError> {
    let mut policies: Vec<&str> = Vec::new();
    for result in results {
        if !kinds.contains_key(&result.task_id) {
            let known: Vec<&str> = kinds.keys().take(8).map(String::as_str).collect();
            let (result, task) = (result.id.clone(), result.task_id.clone());
            return Err(StatisticsError::UnknownTask { result, task, known: known.join(", ") });
        }
        if !policies.contains(&result.policy.as_str()) {
            policies.push(&result.policy);
        }
    }
    Ok(policies
        .into_iter()
        .map(|policy| {
            let mut own: Vec<&EpisodeResult> = results.iter().filter(|result| result.policy == policy).collect();
            // Sort, since floating-point sums and bootstrap resamples depend on the order of the values.
            own.sort_by_key(|result| (&result.scenario_id, result.seed, &result.id));
            summarise_policy(policy, &own, kinds, reference_paths_m, settings)
        })
        .collect())
}

fn summarise_policy(
    policy: &str,
    results: &[&EpisodeResult],
    kinds: &BTreeMap<String, TaskKind>,
    reference_paths_m: &BTreeMap<String, f64>,
    settings: &StatisticsSettings,
) -> SuiteSummary {
    let mean = |label: &str, results: &[&EpisodeResult], value: &dyn Fn(&EpisodeResult) -> f64| {
        let values: Vec<f64> = results.iter().map(|result| value(result)).collect();
        mean_with_interval(&values, settings, settings.seed.fork(label))
    };
    let rate = |results: &[&EpisodeResult], flag: &dyn Fn(&EpisodeResult) -> bool| {
        let mut scenarios: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for result in results {
            let (successes, trials) = scenarios.entry(&result.scenario_id).or_default();
            *successes += usize::from(flag(result));
            *trials += 1;
        }
        Rate::clustered(&scenarios.into_values().collect::<Vec<_>>(), settings)
    };
    let spl_values: Vec<f64> = results
        .iter()
        .filter_map(|result| Some(spl(result.success, result.tcp_path_m, *reference_paths_m.get(&result.scenario_id)?)))
        .collect();
    let of_kind = |kind: TaskKind| {
        let own: Vec<&EpisodeResult> =
            results.iter().copied().filter(|result| kinds.get(&result.task_id) == Some(&kind)).collect();
        (!own.is_empty()).then(|| KindSummary {
            kind,
            success: rate(&own, &|result| result.success),
            success_once: rate(&own, &|result| result.success_once),
            score: mean("score", &own, &|result| result.verdict.score),
        })
    };
    let judged: Vec<&EpisodeResult> = results.iter().copied().filter(|result| result.cloud.is_some()).collect();
    let differ = |result: &&&EpisodeResult| result.cloud.as_ref().is_some_and(|cloud| cloud.success != result.success);
    let disagreements = judged.iter().filter(differ);
    SuiteSummary {
        policy: policy.into(),
        oracle: results.iter().any(|result| result.oracle),
        success: rate(results, &|result| result.success),
        success_once: rate(results, &|result| result.success_once),
        score: mean("score", results, &|result| result.verdict.score),
        spl: (!spl_values.is_empty()).then(|| mean_with_interval(&spl_values, settings, settings.seed.fork("spl"))),
        tcp_path_m: mean("path", results, &|result| result.tcp_path_m),
        duration_s: mean("duration", results, &|result| result.duration_s),
        collisions: rate(results, &|result| result.max_stray_contact_n >= settings.collision_n),
        cloud_success: (!judged.is_empty())
            .then(|| rate(&judged, &|result| result.cloud.as_ref().is_some_and(|cloud| cloud.success))),
        cloud_disagreements: disagreements.map(|result| result.id.clone()).collect(),
        kinds: TaskKind::ALL.into_iter().filter_map(of_kind).collect(),
        traits: Vec::new(),
        failures: failure_counts(results.iter().filter_map(|result| Some(result.failures.first()?.cause))),
        agent_failures: agent_failure_counts(results.iter().filter_map(|result| result.agent_failure.as_ref())),
    }
}

/// Success weighted by path length (Anderson et al. 2018): success · reference / max(path, reference).
///
/// ```
/// assert_eq!(genmanip_benchmark::spl(true, 2.0, 1.5), 0.75);
/// assert_eq!(genmanip_benchmark::spl(true, 1.0, 1.5), 1.0);
/// assert_eq!(genmanip_benchmark::spl(false, 1.0, 1.5), 0.0);
/// ```
pub fn spl(success: bool, path_m: f64, reference_m: f64) -> f64 {
    let longest = path_m.max(reference_m);
    match success {
        true if longest > 0.0 => (reference_m.max(0.0) / longest).clamp(0.0, 1.0),
        success => f64::from(u8::from(success)),
    }
}

/// Counts failure causes, most frequent first, ties in the order of [`FailureCause`].
pub fn failure_counts(causes: impl IntoIterator<Item = FailureCause>) -> Vec<FailureCount> {
    let counts = most_frequent_first(causes).into_iter();
    counts.map(|(cause, count)| FailureCount { cause, count }).collect()
}

/// Counts failures of an agent by class and stage, most frequent first.
pub fn agent_failure_counts<'a>(failures: impl IntoIterator<Item = &'a AgentFailure>) -> Vec<AgentFailureCount> {
    let counts = most_frequent_first(failures.into_iter().map(|failure| (failure.class, failure.stage))).into_iter();
    counts.map(|((class, stage), count)| AgentFailureCount { class, stage, count }).collect()
}

/// Distinct keys with their counts, most frequent first, ties in ascending order.
fn most_frequent_first<K: Ord>(keys: impl IntoIterator<Item = K>) -> Vec<(K, usize)> {
    let mut counts: BTreeMap<K, usize> = BTreeMap::new();
    for key in keys {
        *counts.entry(key).or_default() += 1;
    }
    let mut counts: Vec<(K, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    counts
}

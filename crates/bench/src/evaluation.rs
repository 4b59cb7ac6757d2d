//! The results of one policy on one suite, as a file.

use std::collections::BTreeMap;

use genmanip_core::{Document, EpisodeResult, NotRun, Scenario, TaskKind, Upgrade, upgrade};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::statistics::{StatisticsError, StatisticsSettings, SuiteSummary, summarise};

/// How one policy did on one suite: every result and what they amount to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EvaluationReport {
    /// Name of the suite.
    pub suite: String,
    /// [`suite_hash`] of its scenarios.
    pub suite_hash: String,
    /// Name of the policy.
    pub policy: String,
    /// Whether the policy read simulator truth.
    pub oracle: bool,
    /// Version of the program that made it.
    pub genmanip_version: String,
    /// How the summary was made.
    pub statistics: StatisticsSettings,
    /// What the results amount to.
    pub summary: SuiteSummary,
    /// Kind of each task, by its id.
    pub kinds: BTreeMap<String, TaskKind>,
    /// One per episode, ordered by scenario, seed and id.
    pub results: Vec<EpisodeResult>,
    /// Episodes that are still to be run, since the policy could not be reached; ordered by id, counted nowhere.
    pub not_run: Vec<NotRun>,
}

impl Document for EvaluationReport {
    const SCHEMA: &'static str = "genmanip.evaluation/2";
    const PREVIOUS: Option<Upgrade> =
        Some(Upgrade { schema: "genmanip.evaluation/1", upgrade: upgrade::result::evaluation_from_1 });
}

/// Why results make no report.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// Nothing to report.
    #[error("no results: an evaluation needs at least one episode")]
    NoResults,
    /// Results of several policies.
    #[error("expected results of policy {expected} only, got one of {got} ({result})")]
    MixedPolicies {
        /// Policy of the first result.
        expected: String,
        /// Another one.
        got: String,
        /// Id of its result.
        result: String,
    },
    /// Results on a scenario that is not in the suite.
    #[error("result {result} is of scenario {scenario}, which is not in suite {suite}")]
    ForeignScenario {
        /// Id of the result.
        result: String,
        /// Id of the scenario.
        scenario: String,
        /// Name of the suite.
        suite: String,
    },
    /// Parts of different evaluations.
    #[error("cannot merge: expected {what} {expected}, got {got}")]
    DifferentParts {
        /// What differs.
        what: &'static str,
        /// In the first part.
        expected: String,
        /// In another part.
        got: String,
    },
    /// The results cannot be summarised.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
}

/// Identity of a suite: the first twelve hexadecimal digits of the hash of its scenarios' files in order.
pub fn suite_hash(scenarios: &[Scenario]) -> String {
    let mut hasher = Sha256::new();
    for scenario in scenarios {
        hasher.update(scenario.to_json().as_bytes());
        hasher.update([0]);
    }
    hasher.finalize().iter().take(6).map(|byte| format!("{byte:02x}")).collect()
}

impl EvaluationReport {
    /// Summarises the results of one policy on the scenarios of a suite, in any order.
    ///
    /// `reference_paths_m` as in [`summarise`]; may be empty.
    ///
    /// # Errors
    /// No result, several policies, an episode twice, or a scenario from elsewhere.
    pub fn new(
        suite: &str,
        scenarios: &[Scenario],
        results: Vec<EpisodeResult>,
        reference_paths_m: &BTreeMap<String, f64>,
        statistics: &StatisticsSettings,
    ) -> Result<Self, EvaluationError> {
        let kinds = scenarios.iter().map(|scenario| (scenario.task.id.clone(), scenario.task.kind)).collect();
        if let Some(foreign) = results.iter().find(|result| scenarios.iter().all(|s| s.id != result.scenario_id)) {
            return Err(EvaluationError::ForeignScenario {
                result: foreign.id.clone(),
                scenario: foreign.scenario_id.clone(),
                suite: suite.into(),
            });
        }
        Self::from_parts(suite, suite_hash(scenarios), kinds, results, reference_paths_m, statistics)
    }

    /// One report from those of several shards of the same evaluation, in any order.
    ///
    /// `reference_paths_m` as in [`summarise`]; may be empty.
    ///
    /// # Errors
    /// Nothing to merge, parts of different suites, policies or settings, or an episode twice.
    pub fn merge(parts: Vec<Self>, reference_paths_m: &BTreeMap<String, f64>) -> Result<Self, EvaluationError> {
        let mut parts = parts.into_iter();
        let mut whole = parts.next().ok_or(EvaluationError::NoResults)?;
        for part in parts {
            for (what, expected, got) in [
                ("suite hash", &whole.suite_hash, &part.suite_hash),
                ("version", &whole.genmanip_version, &part.genmanip_version),
            ] {
                if expected != got {
                    return Err(EvaluationError::DifferentParts { what, expected: expected.clone(), got: got.clone() });
                }
            }
            whole.results.extend(part.results);
            whole.not_run.extend(part.not_run);
            whole.kinds.extend(part.kinds);
        }
        let Self { suite, suite_hash, kinds, results, not_run, statistics, .. } = whole;
        let whole = Self::from_parts(&suite, suite_hash, kinds, results, reference_paths_m, &statistics)?;
        Ok(whole.leaving(not_run))
    }

    /// The same report, telling also which episodes are still to be run.
    #[must_use]
    pub fn leaving(self, mut not_run: Vec<NotRun>) -> Self {
        not_run.sort_by(|a, b| a.id.cmp(&b.id));
        Self { not_run, ..self }
    }

    fn from_parts(
        suite: &str,
        suite_hash: String,
        kinds: BTreeMap<String, TaskKind>,
        mut results: Vec<EpisodeResult>,
        reference_paths_m: &BTreeMap<String, f64>,
        statistics: &StatisticsSettings,
    ) -> Result<Self, EvaluationError> {
        results.sort_by(|a, b| (&a.scenario_id, a.seed, &a.id).cmp(&(&b.scenario_id, b.seed, &b.id)));
        let first = results.first().ok_or(EvaluationError::NoResults)?;
        let (policy, genmanip_version) = (first.policy.clone(), first.genmanip_version.clone());
        if let Some(other) = results.iter().find(|result| result.policy != policy) {
            let (got, result) = (other.policy.clone(), other.id.clone());
            return Err(EvaluationError::MixedPolicies { expected: policy, got, result });
        }
        let same_episode =
            |pair: &&[EpisodeResult]| (&pair[0].scenario_id, pair[0].seed) == (&pair[1].scenario_id, pair[1].seed);
        if let Some(pair) = results.windows(2).find(same_episode) {
            let (scenario, seed) = (pair[0].scenario_id.clone(), pair[0].seed);
            return Err(StatisticsError::RepeatedEpisode { policy, scenario, seed }.into());
        }
        let summary = summarise(&results, &kinds, reference_paths_m, statistics)?;
        let summary = summary.into_iter().next().ok_or(EvaluationError::NoResults)?;
        Ok(Self {
            suite: suite.into(),
            suite_hash,
            policy,
            oracle: summary.oracle,
            genmanip_version,
            statistics: statistics.clone(),
            summary,
            kinds,
            results,
            not_run: Vec::new(),
        })
    }
}

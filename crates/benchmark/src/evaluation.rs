//! Results of one policy on one suite, as a file.

use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{
    Document, DocumentError, EpisodeResult, LongDocument, NotRun, Scenario, TaskKind, Upgrade, hexadecimal,
    long_from_json, long_to_json, upgrade,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::statistics::{StatisticsError, StatisticsSettings, SuiteSummary, Traits, by_trait, summarise};
use crate::suite_format::{Perturbation, sha256};

/// Results and summary of one policy on one suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EvaluationReport {
    /// Name of the suite.
    pub suite: String,
    /// [`suite_hash`] of its scenarios.
    pub suite_hash: String,
    /// Change of the suite; absent if it is not a perturbed suite.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub perturbation: Option<Perturbation>,
    /// Name of the policy.
    pub policy: String,
    /// Label of this evaluation within the suite: the policy with its non-default arguments and cameras.
    pub label: String,
    /// Name of the camera set that replaced the scenarios' cameras; `None` if they were not replaced.
    pub cameras: Option<String>,
    /// Time limit of every episode, simulated s; `None` for those of the scenarios.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub horizon_s: Option<f64>,
    /// True if an episode ended as soon as its goal had held for the settling time; the verdict is the one after
    /// settling.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stop_on_success: bool,
    /// True if the policy read simulator truth.
    pub oracle: bool,
    /// Version of this program.
    pub genmanip_version: String,
    /// Settings of the intervals and tests in the summary.
    pub statistics: StatisticsSettings,
    /// Aggregated results.
    pub summary: SuiteSummary,
    /// Kind of each task, by its id.
    pub kinds: BTreeMap<String, TaskKind>,
    /// Reference path length of the tool by scenario id, m; see [`reference_paths_m`].
    #[serde(default)]
    pub reference_paths_m: BTreeMap<String, f64>,
    /// SHA-256 of the file of each scenario by its id, with the scenario's own cameras; empty in reports of older
    /// versions.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub scenario_sha256: BTreeMap<String, String>,
    /// Results of all episodes, ordered by scenario, seed and id.
    pub results: Vec<EpisodeResult>,
    /// Episodes still to be run, since the policy could not be reached; ordered by id and excluded from all figures.
    pub not_run: Vec<NotRun>,
}

impl Document for EvaluationReport {
    const SCHEMA: &'static str = "genmanip.evaluation/2";
    const PREVIOUS: Option<Upgrade> =
        Some(Upgrade { schema: "genmanip.evaluation/1", upgrade: upgrade::result::evaluation_from_1 });

    fn from_json(text: &str) -> Result<Self, DocumentError> {
        long_from_json(text, |_| {})
    }

    fn to_json(&self) -> String {
        long_to_json(self)
    }
}

impl LongDocument for EvaluationReport {
    const LIST: &'static str = "results";
    type Entry = EpisodeResult;

    fn entries(&mut self) -> &mut Vec<EpisodeResult> {
        &mut self.results
    }
}

/// Reasons why results make no report.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EvaluationError {
    /// The list of results is empty.
    #[error("no results: an evaluation needs at least one episode")]
    NoResults,
    /// The list contains results of several policies.
    #[error("expected results of policy {expected} only, got one of {got} ({result})")]
    MixedPolicies {
        /// Policy of the first result.
        expected: String,
        /// A different policy.
        got: String,
        /// Id of the first result of that policy.
        result: String,
    },
    /// A result belongs to a scenario that is not in the suite.
    #[error("result {result} is of scenario {scenario}, which is not in suite {suite}")]
    ForeignScenario {
        /// Id of the result.
        result: String,
        /// Id of the scenario.
        scenario: String,
        /// Name of the suite.
        suite: String,
    },
    /// The results cannot be summarised.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
}

/// Name of the policy that collects demonstrations; its verified paths are the references.
const EXPERT: &str = "expert";

/// Identity of a suite: the first twelve hexadecimal digits of the hash of its scenarios' files in order.
pub fn suite_hash(scenarios: &[impl Borrow<Scenario>]) -> String {
    let mut hasher = Sha256::new();
    for scenario in scenarios {
        hasher.update(scenario.borrow().to_json().as_bytes());
        hasher.update([0]);
    }
    hexadecimal(&hasher.finalize()[..6])
}

/// Shortest verified tool path of the expert per scenario, m, from the results of collected episodes.
///
/// Scenarios that the expert did not solve have none.
pub fn reference_paths_m<'a>(collected: impl IntoIterator<Item = &'a EpisodeResult>) -> BTreeMap<String, f64> {
    let mut shortest: BTreeMap<String, f64> = BTreeMap::new();
    for result in collected.into_iter().filter(|result| result.policy == EXPERT && result.success) {
        let path_m = result.tcp_path_m;
        shortest.entry(result.scenario_id.clone()).and_modify(|known| *known = known.min(path_m)).or_insert(path_m);
    }
    shortest
}

impl EvaluationReport {
    /// Summarises the results of one policy on the scenarios of a suite, in any order.
    ///
    /// `reference_paths_m` as in [`summarise`], usually from [`reference_paths_m`]; may be empty.
    ///
    /// # Errors
    /// No result, several policies, a duplicate episode, or a scenario of another suite.
    pub fn new(
        suite: &str,
        scenarios: &[impl Borrow<Scenario>],
        mut results: Vec<EpisodeResult>,
        reference_paths_m: &BTreeMap<String, f64>,
        statistics: &StatisticsSettings,
    ) -> Result<Self, EvaluationError> {
        let scenarios: Vec<&Scenario> = scenarios.iter().map(Borrow::borrow).collect();
        let kinds = scenarios.iter().map(|scenario| (scenario.task.id.clone(), scenario.task.kind)).collect();
        let ours: BTreeSet<&str> = scenarios.iter().map(|scenario| scenario.id.as_str()).collect();
        if let Some(foreign) = results.iter().find(|result| !ours.contains(result.scenario_id.as_str())) {
            return Err(EvaluationError::ForeignScenario {
                result: foreign.id.clone(),
                scenario: foreign.scenario_id.clone(),
                suite: suite.into(),
            });
        }
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
        let references = reference_paths_m.iter().filter(|(id, _)| ours.contains(id.as_str()));
        let reference_paths_m = references.map(|(id, &path_m)| (id.clone(), path_m)).collect();
        let summary = summarise(&results, &kinds, &reference_paths_m, statistics)?;
        let summary = summary.into_iter().next().ok_or(EvaluationError::NoResults)?;
        let file_sha256 = |scenario: &&Scenario| (scenario.id.clone(), sha256(scenario.to_json().as_bytes()));
        Ok(Self {
            suite: suite.into(),
            suite_hash: suite_hash(&scenarios),
            perturbation: None,
            label: policy.clone(),
            policy,
            cameras: None,
            horizon_s: None,
            stop_on_success: false,
            oracle: summary.oracle,
            genmanip_version,
            statistics: statistics.clone(),
            summary,
            kinds,
            reference_paths_m,
            scenario_sha256: scenarios.iter().map(file_sha256).collect(),
            results,
            not_run: Vec::new(),
        })
    }

    /// The same report with success rates by scenario trait.
    #[must_use]
    pub fn by_traits(mut self, traits: &Traits) -> Self {
        self.summary.traits = by_trait(&self.results, traits, &self.statistics);
        self
    }

    /// The same report with these episodes as not run.
    #[must_use]
    pub fn leaving(self, mut not_run: Vec<NotRun>) -> Self {
        not_run.sort_by(|a, b| a.id.cmp(&b.id));
        Self { not_run, ..self }
    }
}

//! Suites: frozen scenarios for evaluation, with the record of their selection and with certificates of the expert.

mod review;
mod select;
mod template;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use genmanip_core::{AssetRef, AssetUid, Atom, Document, Seed, Task, TaskKind, hexadecimal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use review::{Review, ReviewFile, ReviewVerdict};
pub use select::{Candidate, Marginal, Targets, choose, marginals, select};
pub use template::template;

/// Document `suite.json` of a suite's folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SuiteFile {
    /// Name, e.g. `genmanip-200-rc`.
    pub name: String,
    /// Seed of tasks, layouts and trials.
    pub seed: Seed,
    /// Number of scenarios requested per kind of task.
    pub per_kind: usize,
    /// Version of this program that built the suite.
    pub genmanip_version: String,
    /// Name and version of the physics engine.
    pub engine: String,
    /// [`crate::suite_hash`] of the suite's scenarios.
    pub suite_hash: String,
    /// Change of the original suite, for a perturbed one; `None` for a built one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub perturbation: Option<Perturbation>,
    /// Selection steps in order, with the number of candidates that passed each.
    pub funnel: Vec<BuildStep>,
    /// The scenarios, ordered by id.
    pub scenarios: Vec<SuiteEntry>,
    /// Files of the scenarios' objects, if they were frozen too; empty otherwise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub assets: Vec<FrozenFile>,
}

/// An object of a frozen suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrozenFile {
    /// Reference of the object.
    pub asset: AssetRef,
    /// Name of its file in `assets/`.
    pub file: String,
    /// SHA-256 of that file, hexadecimal.
    pub sha256: String,
}

impl Document for SuiteFile {
    const SCHEMA: &'static str = "genmanip.suite/1";
}

/// Change of a suite along one axis; the original suite is the baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Perturbation {
    /// Name of the original suite.
    pub of: String,
    /// [`crate::suite_hash`] of the original suite's scenarios.
    pub of_hash: String,
    /// Axis of the change, e.g. `camera`.
    pub axis: String,
    /// Strength of the change, in (0, 1]: 1 for the largest change meant to be solvable.
    pub dial: f64,
    /// Seed of the random changes.
    pub seed: Seed,
}

/// One selection step.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct BuildStep {
    /// Selection criterion, as a phrase that completes "candidates that …".
    pub asked: String,
    /// Number of candidates that passed, by name of the kind.
    pub passed: BTreeMap<String, usize>,
    /// Number of rejected candidates by reason.
    pub refused: BTreeMap<String, usize>,
}

impl BuildStep {
    /// A step without candidates.
    pub fn new(asked: &str) -> Self {
        Self { asked: asked.into(), passed: BTreeMap::new(), refused: BTreeMap::new() }
    }

    /// Counts a candidate that passed.
    pub fn pass(&mut self, kind: TaskKind) {
        *self.passed.entry(kind.name().into()).or_default() += 1;
    }

    /// Counts a rejected candidate.
    pub fn refuse(&mut self, reason: impl Into<String>) {
        *self.refused.entry(reason.into()).or_default() += 1;
    }

    /// Reasons of rejection with counts, in one line.
    pub fn reasons(&self) -> String {
        let reasons = self.refused.iter().map(|(reason, count)| format!("{count} times: {reason}"));
        reasons.collect::<Vec<_>>().join("; ")
    }
}

/// One scenario of a suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SuiteEntry {
    /// Id of the scenario; its file is `scenarios/ID.json`.
    pub id: String,
    /// SHA-256 of that file, hexadecimal.
    pub sha256: String,
    /// Kind of its task.
    pub kind: TaskKind,
    /// Source of the task.
    pub source: String,
    /// Values of the balanced traits by name, see [`balanced_traits`].
    pub traits: BTreeMap<String, Vec<String>>,
    /// Simulated time available to a policy, s.
    pub horizon_s: f64,
    /// Proof of solvability by the expert.
    pub certificate: Certificate,
    /// SHA-256 of each camera's initial colour image, by camera name; empty if the suite is not frozen.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub pictures: BTreeMap<String, String>,
}

/// Effort of the expert on a scenario.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Certificate {
    /// Number of the expert's episodes, each with its own random stream.
    pub episodes: usize,
    /// Number of verified episodes.
    pub verified: usize,
    /// Shortest tool path among the verified episodes, m.
    pub shortest_path_m: f64,
    /// Shortest simulated duration of a verified episode, s.
    pub shortest_s: f64,
}

/// SHA-256, hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

/// Balanced traits of a task; `is_unseen` is true for assets held out from training.
///
/// `relation`: of its goal. `objects`: number of objects, in three ranges. `axis`: true if the goal names an object
/// held out from training. `steps`: conditions of the shortest alternative, of long-horizon tasks. `clues`: objects
/// identified by their place, of spatial tasks.
pub fn balanced_traits(
    task: &Task,
    clues_at_places: usize,
    is_unseen: &dyn Fn(&AssetUid) -> bool,
) -> BTreeMap<String, Vec<String>> {
    let atoms = || task.goal.alternatives.iter().flatten();
    let mut relations: Vec<String> = atoms()
        .filter_map(|atom| match atom {
            Atom::Relation { relation, .. } => Some(relation.name().to_owned()),
            Atom::State { .. } => None,
        })
        .collect();
    relations.sort();
    relations.dedup();
    let count = task.scene_graph.nodes.len();
    let range = match count {
        0..=5 => "up to 5",
        6..=7 => "6-7",
        _ => "8 or more",
    };
    let mut named = atoms().flat_map(Atom::ids).filter_map(|id| task.card(id));
    let axis = if named.any(|card| is_unseen(&card.uid)) { "unseen" } else { "train" };
    let mut traits = BTreeMap::from([
        ("relation".to_owned(), relations),
        ("objects".to_owned(), vec![range.to_owned()]),
        ("axis".to_owned(), vec![axis.to_owned()]),
    ]);
    if task.kind == TaskKind::LongHorizon {
        let steps = task.goal.alternatives.iter().map(Vec::len).min().unwrap_or(0);
        traits.insert("steps".into(), vec![steps.clamp(2, 4).to_string()]);
    }
    if task.kind == TaskKind::Spatial {
        traits.insert("clues".into(), vec![if clues_at_places >= 2 { "two or more" } else { "one" }.to_owned()]);
    }
    traits
}

//! A suite: scenarios that are frozen to be evaluated on, with how they were chosen and what the expert needed.

mod review;
mod select;
mod template;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use genmanip_core::{AssetRef, Atom, Document, Seed, Task, TaskKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

pub use review::{Review, ReviewFile, ReviewVerdict};
pub use select::{Candidate, Marginal, marginals, select};
pub use template::template;

/// The file `suite.json` of a suite's folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SuiteFile {
    /// Name, e.g. `genmanip-200-rc`.
    pub name: String,
    /// Seed of tasks, layouts and trials.
    pub seed: Seed,
    /// Scenarios asked for of each kind.
    pub per_kind: usize,
    /// Version of the program that made it.
    pub genmanip_version: String,
    /// Version of the physics.
    pub engine: String,
    /// [`crate::suite_hash`] of its scenarios.
    pub suite_hash: String,
    /// What was changed of another suite; `None` where it was built.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub perturbation: Option<Perturbation>,
    /// How many candidates each stage of the selection let pass, in order.
    pub funnel: Vec<Stage>,
    /// The scenarios, ordered by id.
    pub scenarios: Vec<SuiteEntry>,
    /// Their objects, where these were frozen beside them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub assets: Vec<FrozenFile>,
}

/// An object of a frozen suite.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrozenFile {
    /// Which it is.
    pub asset: AssetRef,
    /// Name of its file in `assets/`.
    pub file: String,
    /// SHA-256 of that file, hexadecimal.
    pub sha256: String,
}

impl Document for SuiteFile {
    const SCHEMA: &'static str = "genmanip.suite/1";
}

/// What was changed of a suite, one thing at a time; the suite itself is the control arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Perturbation {
    /// Name of the suite that was changed.
    pub of: String,
    /// [`crate::suite_hash`] of its scenarios.
    pub of_hash: String,
    /// What was changed, e.g. `camera`.
    pub axis: String,
    /// How much: 1 for the most that is meant to be solvable.
    pub dial: f64,
    /// Seed of what was drawn.
    pub seed: Seed,
}

/// What one stage of the selection refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Stage {
    /// What was asked of the candidates.
    pub asked: String,
    /// Candidates of each kind that passed, by the kind's name.
    pub passed: BTreeMap<String, usize>,
    /// Reasons for which others did not, with how often.
    pub refused: BTreeMap<String, usize>,
}

impl Stage {
    /// A stage that nothing has come to yet.
    pub fn new(asked: &str) -> Self {
        Self { asked: asked.into(), passed: BTreeMap::new(), refused: BTreeMap::new() }
    }

    /// Counts a candidate that passed.
    pub fn pass(&mut self, kind: TaskKind) {
        *self.passed.entry(kind.name().into()).or_default() += 1;
    }

    /// Counts a candidate that did not.
    pub fn refuse(&mut self, reason: impl Into<String>) {
        *self.refused.entry(reason.into()).or_default() += 1;
    }

    /// Why candidates did not pass, with how often, in one line.
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
    /// Where the task comes from.
    pub source: String,
    /// What is balanced, by name.
    pub traits: BTreeMap<String, Vec<String>>,
    /// Simulated time that a policy has, s.
    pub horizon_s: f64,
    /// That it can be solved.
    pub certificate: Certificate,
    /// SHA-256 of the colours that each camera sees at its start, where these were frozen, by the camera's name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub pictures: BTreeMap<String, String>,
}

/// What the expert needed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Certificate {
    /// Episodes of the expert, each with a stream of its own.
    pub episodes: usize,
    /// Those after which the goal held.
    pub verified: usize,
    /// Shortest way of the tool among these, m.
    pub shortest_path_m: f64,
    /// Shortest simulated time among these, s.
    pub shortest_s: f64,
}

/// SHA-256, hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What a suite is balanced over, of one task; `is_unseen` says of an asset whether it is kept from training.
///
/// `relation`: of its goal. `objects`: how many there are, in three ranges. `axis`: whether the goal names a thing that
/// training never shows. `steps`: conditions of the shortest alternative, of long-horizon tasks. `clues`: things told
/// by their place, of spatial tasks.
pub fn balanced_traits(
    task: &Task,
    clues_at_places: usize,
    is_unseen: &dyn Fn(&str) -> bool,
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
    let named = |atom: &Atom| atom.ids().any(|id| is_unseen(id.split('#').next().unwrap_or(id)));
    let axis = if atoms().any(named) { "unseen" } else { "train" };
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

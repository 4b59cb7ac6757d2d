//! One review of a scenario.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::named_enum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A review of a scenario, one line of the log of reviews.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Review {
    /// Id of the scenario.
    pub scenario: String,
    /// SHA-256 of the reviewed content: scenario, assets and engine.
    pub content_sha256: String,
    /// Author of the review.
    pub reviewer: Reviewer,
    /// Decision on the scenario.
    pub decision: Decision,
    /// Judgements by criterion, true if it is met; criteria that were not judged are absent.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub criteria: BTreeMap<Criterion, bool>,
    /// Remark for the editor of the scenario; may be empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// True if the review adjudicates between two reviews that differ.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub adjudicates: bool,
    /// Time spent on the review, s; absent if not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<f64>,
    /// Id that the client chose, so that a repeated request is stored once; empty for none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub client_operation_id: String,
    /// Time as an RFC 3339 text, given by the caller.
    pub at: String,
}

/// Maximum length of a reviewer's name and version, of an id and of a time, characters.
const MAX_NAME: usize = 128;
/// Maximum length of a note, characters.
const MAX_NOTE: usize = 2000;

/// Author of reviews.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reviewer {
    /// Name, unique among all reviewers; for a model, the name of the model.
    pub name: String,
    /// Person, model or script.
    pub kind: ReviewerKind,
    /// Version of the model or script; absent for a person.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<String>,
}

named_enum! {
    /// Kind of reviewer.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum ReviewerKind {
        /// A person.
        Human = "human",
        /// A language or vision-language model.
        Model = "model",
        /// A program with fixed rules.
        Script = "script",
    }
}

/// Decision of a review.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "verdict")]
pub enum Decision {
    /// The scenario can be in a suite.
    Approve,
    /// The scenario cannot be in a suite.
    Reject {
        /// Reasons of the rejection, at least one.
        reasons: BTreeSet<Reason>,
    },
    /// The scenario must be changed first, as the note says.
    SendBack,
    /// The reviewer's earlier review is withdrawn.
    TakeBack,
}

named_enum! {
    /// Criterion of a review.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum Criterion {
        /// The instruction is clear in this scene.
        InstructionClear = "instruction_clear",
        /// The goal means what the instruction says.
        GoalMatches = "goal_matches",
        /// The task is plausible in daily life.
        Plausible = "plausible",
        /// The robot can do the task.
        Feasible = "feasible",
        /// The scene looks as one would expect.
        LooksRight = "looks_right",
    }
}

named_enum! {
    /// Reason for rejecting a scenario.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum Reason {
        /// Nobody would ask for the task in daily life.
        Implausible = "implausible",
        /// The instruction is ambiguous in this scene.
        Ambiguous = "ambiguous",
        /// The goal is not what the instruction says.
        GoalWrong = "goal_wrong",
        /// An object cannot be grasped or placed.
        Unreachable = "unreachable",
        /// An object or the scene looks wrong.
        LooksWrong = "looks_wrong",
        /// Another scenario is a near-duplicate.
        Duplicate = "duplicate",
        /// Doing the task would be dangerous.
        Unsafe = "unsafe",
        /// Another reason, which the note states.
        Other = "other",
    }
}

impl Review {
    /// Description of the fault of a review that cannot be stored; `None` if it can.
    pub fn fault(&self) -> Option<String> {
        let Reviewer { name, kind, version } = &self.reviewer;
        let version = version.as_deref().unwrap_or_default();
        let texts =
            [("name", name.as_str()), ("version", version), ("id", &self.client_operation_id), ("at", &self.at)];
        if let Some((what, _)) = texts.into_iter().find(|(_, text)| !is_line(text)) {
            return Some(format!("`{what}` has more than {MAX_NAME} characters, or one that is no letter"));
        }
        if name.trim().is_empty() || self.at.is_empty() {
            return Some("a review names its reviewer and its time".into());
        }
        if *kind != ReviewerKind::Human && version.is_empty() {
            return Some(format!("a reviewer of kind `{}` has a version", kind.name()));
        }
        if self.note.chars().count() > MAX_NOTE {
            return Some(format!("expected a note of at most {MAX_NOTE} characters"));
        }
        if self.duration_s.is_some_and(|duration| !duration.is_finite() || duration < 0.0) {
            return Some("expected a duration of at least 0 s".into());
        }
        match &self.decision {
            Decision::Reject { reasons } if reasons.is_empty() => {
                Some(format!("a rejection needs a reason: {}", Reason::ALL.map(Reason::name).join(", ")))
            }
            Decision::Reject { reasons } if reasons.contains(&Reason::Other) && self.note.trim().is_empty() => {
                Some("the reason `other` needs a note".into())
            }
            Decision::SendBack if self.note.trim().is_empty() => {
                Some("a scenario is sent back with a note that names the change".into())
            }
            Decision::Approve if self.criteria.values().any(|holds| !holds) => {
                let failed = self.criteria.iter().find(|(_, holds)| !**holds);
                let name = failed.map_or("", |(criterion, _)| criterion.name());
                Some(format!("an approved scenario meets all criteria, and `{name}` is false"))
            }
            Decision::Approve | Decision::Reject { .. } | Decision::SendBack | Decision::TakeBack => None,
        }
    }
}

/// True for a text of at most [`MAX_NAME`] characters without control characters such as line breaks.
fn is_line(text: &str) -> bool {
    text.chars().count() <= MAX_NAME && !text.chars().any(char::is_control)
}

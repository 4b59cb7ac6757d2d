//! The kinds of questions and the identity of their prompts.

use genmanip_core::AgentStage;
use serde::{Deserialize, Serialize};

/// A kind of question, in pipeline order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QuestionKind {
    /// Split an instruction into pick-and-place sub-tasks.
    Decompose,
    /// Choose the numbered mask of the object to move.
    Object,
    /// Choose the numbered part to grasp.
    Part,
    /// Choose one of five grab points.
    GrabPoint,
    /// Give a path over the lettered grid, with heights and yaw.
    GridPath,
    /// Choose the grid cell of the placement.
    PointToPoint,
    /// Decide if the task is finished.
    Check,
}

impl QuestionKind {
    /// All kinds, in pipeline order.
    pub const ALL: [Self; 7] =
        [Self::Decompose, Self::Object, Self::Part, Self::GrabPoint, Self::GridPath, Self::PointToPoint, Self::Check];

    /// Name of the kind in transcripts and recorded answers.
    pub fn name(self) -> &'static str {
        AgentStage::from(self).name()
    }
}

impl From<QuestionKind> for AgentStage {
    fn from(kind: QuestionKind) -> Self {
        match kind {
            QuestionKind::Decompose => Self::Decompose,
            QuestionKind::Object => Self::Object,
            QuestionKind::Part => Self::Part,
            QuestionKind::GrabPoint => Self::GrabPoint,
            QuestionKind::GridPath => Self::GridPath,
            QuestionKind::PointToPoint => Self::PointToPoint,
            QuestionKind::Check => Self::Check,
        }
    }
}

/// Identity of a prompt, to detect changes of its text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptStamp {
    /// Prompt id, e.g. `agent.object`.
    pub id: String,
    /// Version, incremented with every change of the text.
    pub version: u32,
    /// First twelve hexadecimal digits of the SHA-256 of the text, in case the version was not incremented.
    pub sha256: String,
}

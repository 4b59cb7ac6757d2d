//! The stages that ask a model, and which prompt a stage used.

use serde::{Deserialize, Serialize};

/// The stages that ask a model, in their order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// An instruction into picks and places.
    Decompose,
    /// Which numbered mask is to be moved.
    Object,
    /// Which numbered part of it is to be held.
    Part,
    /// Which of five points to hold it at.
    GrabPoint,
    /// A way over the lettered grid, with heights and turns.
    GridPath,
    /// The one cell where to put it.
    PointToPoint,
    /// Whether the task is done.
    Check,
}

impl Stage {
    /// All stages.
    pub const ALL: [Self; 7] =
        [Self::Decompose, Self::Object, Self::Part, Self::GrabPoint, Self::GridPath, Self::PointToPoint, Self::Check];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Decompose => "decompose",
            Self::Object => "object",
            Self::Part => "part",
            Self::GrabPoint => "grab_point",
            Self::GridPath => "grid_path",
            Self::PointToPoint => "point_to_point",
            Self::Check => "check",
        }
    }
}

/// Which prompt was used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromptStamp {
    /// Name, e.g. `agent.object`.
    pub id: String,
    /// Grows with every change of the text.
    pub version: u32,
    /// First twelve digits of the SHA-256 of the text, in case somebody forgot to raise the version.
    pub sha256: String,
}

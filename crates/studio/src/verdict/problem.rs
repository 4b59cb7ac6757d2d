//! Problems of a scenario and their repairs.

use genmanip_core::{ReferenceId, named_enum};
use serde::{Deserialize, Serialize};

use crate::edit::Operation;

named_enum! {
    /// Stage of the verdict, in the order of judging.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Stage {
        /// Rules of task documents, and the rule-based reader on the instruction.
        Wording = "wording",
        /// Edges, states and goal at the initial poses.
        Relations = "relations",
        /// Penetration, support, and objects beyond the edges of surfaces.
        Collision = "collision",
        /// Reachable grasps of the objects that the goal moves.
        Reach = "reach",
        /// Visibility in the cameras.
        Visibility = "visibility",
        /// Rest of the objects in the physics simulation.
        Stability = "stability",
        /// Reachable goal poses.
        Goal = "goal",
    }
}

named_enum! {
    /// Kind of a problem.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum ProblemCode {
        /// An object named by goal, graph or instruction that is not in the scene, or whose asset is missing.
        MissingObject = "missing_object",
        /// The instruction fits several objects.
        AmbiguousSentence = "ambiguous_sentence",
        /// The instruction states another goal, or cannot be parsed.
        SentenceMismatch = "sentence_mismatch",
        /// The task breaks a rule of task documents.
        Rule = "rule",
        /// An edge of the initial scene graph does not hold.
        EdgeFalse = "edge_false",
        /// A state in the initial scene graph does not hold.
        StateFalse = "state_false",
        /// The goal already holds at the start.
        GoalHolds = "goal_holds",
        /// Two bodies penetrate each other.
        Overlap = "overlap",
        /// The object is above its support, without contact.
        Floating = "floating",
        /// The object extends beyond its support surface.
        Outside = "outside",
        /// No grasp of the object is reachable, or its joint cannot be moved.
        Unreachable = "unreachable",
        /// Every reachable grasp hits a neighbour.
        GraspBlocked = "grasp_blocked",
        /// No prompt camera sees enough of the object.
        Hidden = "hidden",
        /// The object moves in the physics simulation.
        Unstable = "unstable",
        /// Every goal pose of the object is in collision or out of reach.
        NoGoalPose = "no_goal_pose",
    }
}

/// A problem of a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Problem {
    /// Stage that found the problem.
    pub stage: Stage,
    /// Kind of the problem.
    pub code: ProblemCode,
    /// Id of the object with the problem; `None` if it concerns the whole scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<ReferenceId>,
    /// Id of a second object, such as an obstructing neighbour; `None` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other: Option<ReferenceId>,
    /// Explanation with names and numbers.
    pub message: String,
    /// Measured value that decides the problem; `None` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Limit that the value violates; `None` without a value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Unit of value and limit, e.g. `mm`; `None` without a value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// True if the scenario cannot be used unless the problem is repaired.
    pub blocking: bool,
    /// Repairs, best first; empty until they are requested.
    #[serde(default)]
    pub repairs: Vec<Repair>,
}

/// A repair: an operation with its description.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Repair {
    /// Description, e.g. `lift it by 4.0 mm`.
    pub label: String,
    /// Operation that repairs the problem.
    #[serde(flatten)]
    pub operation: Operation,
}

/// Problems of all stages.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Revision of the scenario that was judged.
    pub revision: u64,
    /// Problems, in the order of the stages.
    pub problems: Vec<Problem>,
}

impl Problem {
    /// A blocking problem without values and repairs.
    pub(super) fn new(
        stage: Stage,
        code: ProblemCode,
        object: Option<ReferenceId>,
        message: impl Into<String>,
    ) -> Self {
        Self {
            stage,
            code,
            object,
            other: None,
            message: message.into(),
            value: None,
            limit: None,
            unit: None,
            blocking: true,
            repairs: Vec::new(),
        }
    }

    /// The problem with a measured value, its limit and their unit.
    #[must_use]
    pub(super) fn measured(self, value: f64, limit: f64, unit: &str) -> Self {
        Self { value: Some(value), limit: Some(limit), unit: Some(unit.to_owned()), ..self }
    }

    /// The problem with the id of a second object.
    #[must_use]
    pub(super) fn with(self, other: impl Into<ReferenceId>) -> Self {
        Self { other: Some(other.into()), ..self }
    }

    /// True if the other problem has the same kind and objects; values and message may differ.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.code, &self.object, &self.other) == (other.code, &other.object, &other.other)
    }
}

impl Verdict {
    /// Blocking problems of all stages.
    pub fn blocking(&self) -> impl Iterator<Item = &Problem> {
        self.problems.iter().filter(|problem| problem.blocking)
    }
}

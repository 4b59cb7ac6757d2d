//! Problems of a scenario and their repairs.

use genmanip_core::named_enum;
use serde::{Deserialize, Serialize};

use crate::edit::Operation;

named_enum! {
    /// Stage of the verdict, in order.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Stage {
        /// Rules of task documents, and the independent reader on the instruction.
        Wording = "wording",
        /// Edges, states and goal on the poses as they are.
        Relations = "relations",
        /// Interpenetration, support and the edges of the surfaces.
        Collision = "collision",
        /// Grasps that the arm reaches.
        Reach = "reach",
        /// Visibility to the cameras.
        Visibility = "visibility",
        /// Rest in the simulation.
        Stability = "stability",
        /// Goal poses.
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
        /// The instruction states another goal, or is not understood.
        SentenceMismatch = "sentence_mismatch",
        /// The task breaks a rule of task documents.
        Rule = "rule",
        /// An edge of the initial graph does not hold.
        EdgeFalse = "edge_false",
        /// A state of the initial graph does not hold.
        StateFalse = "state_false",
        /// The goal holds already.
        GoalHolds = "goal_holds",
        /// Two bodies interpenetrate.
        Overlap = "overlap",
        /// Nothing carries the object.
        Floating = "floating",
        /// The object is not over its support surface.
        Outside = "outside",
        /// No grasp of the object is in reach, or its joint cannot be moved.
        Unreachable = "unreachable",
        /// Every grasp in reach hits a neighbour.
        GraspBlocked = "grasp_blocked",
        /// No prompt camera sees enough of the object.
        Hidden = "hidden",
        /// The object moves when simulated.
        Unstable = "unstable",
        /// No pose of the object at the goal is free.
        NoGoalPose = "no_goal_pose",
    }
}

/// A problem of a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Problem {
    /// Stage that found it.
    pub stage: Stage,
    /// Kind.
    pub code: ProblemCode,
    /// Id of the object with the problem.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
    /// Id of a second object, such as the neighbour in the way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other: Option<String>,
    /// Explanation with names and numbers.
    pub message: String,
    /// Measured value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<f64>,
    /// Limit of the value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Unit of value and limit, e.g. `mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// True if the scenario cannot be used with it.
    pub blocking: bool,
    /// Repairs, best first; empty until asked for.
    #[serde(default)]
    pub repairs: Vec<Repair>,
}

/// A repair: an operation with its description.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Repair {
    /// Description, e.g. `lift it by 4.0 mm`.
    pub label: String,
    /// The operation.
    #[serde(flatten)]
    pub operation: Operation,
}

/// Problems of all stages.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Revision of the scenario.
    pub revision: u64,
    /// The problems, in the order of the stages.
    pub problems: Vec<Problem>,
}

impl Problem {
    /// A blocking problem of an object.
    pub(super) fn new(stage: Stage, code: ProblemCode, object: Option<String>, message: impl Into<String>) -> Self {
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

    /// The problem with the number that decides it.
    #[must_use]
    pub(super) fn measured(self, value: f64, limit: f64, unit: &str) -> Self {
        Self { value: Some(value), limit: Some(limit), unit: Some(unit.to_owned()), ..self }
    }

    /// The problem with a second object.
    #[must_use]
    pub(super) fn with(self, other: impl Into<String>) -> Self {
        Self { other: Some(other.into()), ..self }
    }

    /// True if the other problem is the same, whatever its numbers and words.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.code, &self.object, &self.other) == (other.code, &other.object, &other.other)
    }
}

impl Verdict {
    /// The problems with which the scenario cannot be used.
    pub fn blocking(&self) -> impl Iterator<Item = &Problem> {
        self.problems.iter().filter(|problem| problem.blocking)
    }
}

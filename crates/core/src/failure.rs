//! Failures of episodes: causes, which every policy's failures have, and beside them, for the agent, stages and classes.
//!
//! Causes are decided in `genmanip_rollout::evidence`, classes in `genmanip_agent_sim`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A failure cause with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Failure {
    /// The cause.
    pub cause: FailureCause,
    /// Observation with numbers, e.g. `Red Mug slipped at 3.2 s`.
    pub evidence: String,
}

/// Cause of a failed attempt.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FailureCause {
    /// No valid layout was found.
    Layout,
    /// No collision-free grasp candidate.
    NoGrasp,
    /// No inverse-kinematics solution.
    NoIk,
    /// No placement satisfies the goal.
    NoGoalPose,
    /// No collision-free path.
    Planning,
    /// The object slipped out of the gripper or was never held.
    Slipped,
    /// Another object was knocked over or displaced.
    Disturbed,
    /// All motions were executed, but the goal does not hold.
    GoalMissed,
    /// The time limit was reached.
    Timeout,
    /// The policy refused or raised an error.
    Policy,
}

impl FailureCause {
    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Layout => "layout",
            Self::NoGrasp => "no_grasp",
            Self::NoIk => "no_ik",
            Self::NoGoalPose => "no_goal_pose",
            Self::Planning => "planning",
            Self::Slipped => "slipped",
            Self::Disturbed => "disturbed",
            Self::GoalMissed => "goal_missed",
            Self::Timeout => "timeout",
            Self::Policy => "policy",
        }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.cause.name(), self.evidence)
    }
}

/// Analysis of an agent's failed episode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AgentFailure {
    /// Class of the first wrong step that was not taken back; absent without an annotator that knows the simulator's
    /// state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<FailureClass>,
    /// Stage of that step; without a class, the stage at which the agent gave up.
    pub stage: AgentStage,
    /// Index of the wrongly answered question in the transcript; absent if no answer was wrong.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ask: Option<usize>,
    /// Evidence with numbers.
    pub evidence: String,
    /// Path of the transcript, if one was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transcript: Option<String>,
}

/// Failure class of an episode: the six classes of the paper, and those of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FailureClass {
    /// The task was split into the wrong sub-tasks.
    Decomposition,
    /// The wrong object was chosen to be picked.
    GraspGrounding,
    /// The chosen part or point, or the detector, gave no suitable grasp.
    GraspProposal,
    /// The grasp could not be executed, or did not hold.
    GraspExecution,
    /// The object was sent to the wrong reference.
    PlanGrounding,
    /// The reference was correct, the placement was not.
    PlanLocation,
    /// The path could not be executed, or the object did not end at its target.
    PlanMotion,
    /// The check reported *finished* before the goal held, or *not finished* after it did.
    Checker,
    /// Answers did not match the requested format, or named marks that are not in the image.
    Format,
    /// A service did not answer.
    Service,
}

impl FailureClass {
    /// All classes.
    pub const ALL: [Self; 10] = [
        Self::Decomposition,
        Self::GraspGrounding,
        Self::GraspProposal,
        Self::GraspExecution,
        Self::PlanGrounding,
        Self::PlanLocation,
        Self::PlanMotion,
        Self::Checker,
        Self::Format,
        Self::Service,
    ];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Decomposition => "decomposition",
            Self::GraspGrounding => "grasp_grounding",
            Self::GraspProposal => "grasp_proposal",
            Self::GraspExecution => "grasp_execution",
            Self::PlanGrounding => "plan_grounding",
            Self::PlanLocation => "plan_location",
            Self::PlanMotion => "plan_motion",
            Self::Checker => "checker",
            Self::Format => "format",
            Self::Service => "service",
        }
    }
}

/// Stage of the agent: a question to the model, or a step that no model answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AgentStage {
    /// Question: sub-tasks of the instruction.
    Decompose,
    /// Segmentation of the images.
    Segmentation,
    /// Question: the object to move.
    Object,
    /// Question: the part to grasp.
    Part,
    /// Question: the point to grasp.
    GrabPoint,
    /// Question: a path over the grid.
    GridPath,
    /// Question: the grid cell of the placement.
    PointToPoint,
    /// Collision world from the depth images.
    Look,
    /// Grasp proposal and selection.
    Grasp,
    /// Motion planning.
    Motion,
    /// Execution of the plan.
    Execute,
    /// Question: the task is finished or not.
    Check,
}

impl AgentStage {
    /// All stages, in the order of an episode.
    pub const ALL: [Self; 12] = [
        Self::Decompose,
        Self::Segmentation,
        Self::Object,
        Self::Part,
        Self::GrabPoint,
        Self::GridPath,
        Self::PointToPoint,
        Self::Look,
        Self::Grasp,
        Self::Motion,
        Self::Execute,
        Self::Check,
    ];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Decompose => "decompose",
            Self::Segmentation => "segmentation",
            Self::Object => "object",
            Self::Part => "part",
            Self::GrabPoint => "grab_point",
            Self::GridPath => "grid_path",
            Self::PointToPoint => "point_to_point",
            Self::Look => "look",
            Self::Grasp => "grasp",
            Self::Motion => "motion",
            Self::Execute => "execute",
            Self::Check => "check",
        }
    }
}

/// Reason for the failure of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StageCause {
    /// The answer is not in the requested format.
    Format,
    /// The answer names a mark that was not drawn.
    Undrawn,
    /// The answer says that no mark fits.
    NotFound,
    /// The object cannot be placed there.
    Unusable,
    /// Segmentation found nothing.
    NoMasks,
    /// Too little of the object is visible.
    TooSmall,
    /// No pixel of the object has a depth.
    NoDepth,
    /// Depth images or grasps that cannot be used.
    Unsuited,
    /// No grasp was proposed.
    #[serde(rename = "none")]
    NoGrasp,
    /// Most grasps are beyond the arm's reach.
    OutOfReach,
    /// Obstacles block all grasps or paths.
    Blocked,
    /// The object is not between the fingers.
    Slipped,
    /// The task is unfinished after the last round.
    Rounds,
    /// A service did not answer.
    Service,
}

impl StageCause {
    /// Name in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Format => "format",
            Self::Undrawn => "undrawn",
            Self::NotFound => "not_found",
            Self::Unusable => "unusable",
            Self::NoMasks => "no_masks",
            Self::TooSmall => "too_small",
            Self::NoDepth => "no_depth",
            Self::Unsuited => "unsuited",
            Self::NoGrasp => "none",
            Self::OutOfReach => "out_of_reach",
            Self::Blocked => "blocked",
            Self::Slipped => "slipped",
            Self::Rounds => "rounds",
            Self::Service => "service",
        }
    }
}

/// A failed stage, which ends the agent's episode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{} failed ({}): {evidence}", .stage.name(), .cause.name())]
#[serde(deny_unknown_fields)]
pub struct FailedStage {
    /// The stage.
    pub stage: AgentStage,
    /// Reason for its failure.
    pub cause: StageCause,
    /// Evidence.
    pub evidence: String,
}

impl FailedStage {
    /// Creates a failure of a stage.
    pub fn new(stage: impl Into<AgentStage>, cause: StageCause, evidence: String) -> Self {
        Self { stage: stage.into(), cause, evidence }
    }

    /// The failure as reported in results.
    pub fn failure(&self) -> Failure {
        let cause = match (self.stage, self.cause) {
            (AgentStage::Grasp, StageCause::OutOfReach) => FailureCause::NoIk,
            (AgentStage::Grasp, _) => FailureCause::NoGrasp,
            (AgentStage::Motion, _) => FailureCause::Planning,
            (AgentStage::Execute, _) => FailureCause::Slipped,
            (AgentStage::Check, StageCause::Rounds) => FailureCause::GoalMissed,
            (
                AgentStage::Decompose
                | AgentStage::Segmentation
                | AgentStage::Object
                | AgentStage::Part
                | AgentStage::GrabPoint
                | AgentStage::GridPath
                | AgentStage::PointToPoint
                | AgentStage::Look
                | AgentStage::Check,
                _,
            ) => FailureCause::Policy,
        };
        Failure { cause, evidence: self.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_files() {
        let text = |value: serde_json::Value| value.as_str().unwrap_or_default().to_owned();
        for stage in AgentStage::ALL {
            assert_eq!(text(serde_json::to_value(stage).unwrap()), stage.name());
        }
        for class in FailureClass::ALL {
            assert_eq!(text(serde_json::to_value(class).unwrap()), class.name());
        }
        for cause in ["format", "not_found", "no_masks", "none", "out_of_reach", "rounds", "service"] {
            let parsed: StageCause = serde_json::from_value(cause.into()).unwrap();
            assert_eq!(parsed.name(), cause);
        }
    }

    #[test]
    fn a_failed_stage_is_one_cause_of_the_episode() {
        let cases = [
            (AgentStage::Object, StageCause::NoMasks, FailureCause::Policy),
            (AgentStage::Grasp, StageCause::OutOfReach, FailureCause::NoIk),
            (AgentStage::Grasp, StageCause::Blocked, FailureCause::NoGrasp),
            (AgentStage::Motion, StageCause::Blocked, FailureCause::Planning),
            (AgentStage::Execute, StageCause::Slipped, FailureCause::Slipped),
            (AgentStage::Check, StageCause::Rounds, FailureCause::GoalMissed),
            (AgentStage::Check, StageCause::Format, FailureCause::Policy),
        ];
        for (stage, reason, cause) in cases {
            let failure = FailedStage::new(stage, reason, "so".into()).failure();
            assert_eq!(failure.cause, cause);
            assert_eq!(failure.evidence, format!("{} failed ({}): so", stage.name(), reason.name()));
        }
    }
}

//! Failures of episodes: a cause for every policy; for the agent also a stage and a class.
//!
//! Causes are decided in `genmanip_rollout::evidence`, classes in `genmanip_agent_sim`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::named_enum;

/// A failure cause with its evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Failure {
    /// Category of the failure.
    pub cause: FailureCause,
    /// Observation with numbers, e.g. `Red Mug slipped at 3.2 s`.
    pub evidence: String,
}

named_enum! {
    /// Cause of a failed attempt.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum FailureCause {
        /// No valid layout was found.
        Layout = "layout",
        /// No collision-free grasp candidate.
        NoGrasp = "no_grasp",
        /// No inverse-kinematics solution.
        NoIk = "no_ik",
        /// No placement satisfies the goal.
        NoGoalPose = "no_goal_pose",
        /// No collision-free path.
        Planning = "planning",
        /// The object slipped out of the gripper or was never held.
        Slipped = "slipped",
        /// Another object was knocked over or displaced.
        Disturbed = "disturbed",
        /// All motions were executed, but the goal does not hold.
        GoalMissed = "goal_missed",
        /// The time limit was reached.
        Timeout = "timeout",
        /// The policy refused or raised an error.
        Policy = "policy",
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
    /// Class of the first wrong step that was not undone; `None` without an annotator that knows the simulator's state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub class: Option<FailureClass>,
    /// Stage of that step; without a class, the stage at which the agent gave up.
    pub stage: AgentStage,
    /// Index of the wrongly answered question in the transcript; absent if no answer was wrong.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ask: Option<usize>,
    /// Observation with numbers.
    pub evidence: String,
    /// Path of the transcript; `None` if none was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transcript: Option<String>,
}

named_enum! {
    /// Failure class of an agent's episode: the six classes of the paper, and four more for a closed loop.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum FailureClass {
        /// The task was split into the wrong sub-tasks.
        Decomposition = "decomposition",
        /// The wrong object was chosen to be picked.
        GraspGrounding = "grasp_grounding",
        /// The chosen part or point admits no suitable grasp, or the detector proposed none.
        GraspProposal = "grasp_proposal",
        /// The grasp could not be executed, or did not hold.
        GraspExecution = "grasp_execution",
        /// The wrong reference object was chosen for the placement.
        PlanGrounding = "plan_grounding",
        /// The reference was correct, the placement was not.
        PlanLocation = "plan_location",
        /// The path could not be executed, or the object did not end at its target.
        PlanMotion = "plan_motion",
        /// The check reported *finished* before the goal held, or *not finished* after it did.
        Checker = "checker",
        /// An answer did not match the requested format, or named marks that are not in the image.
        Format = "format",
        /// A service did not answer.
        Service = "service",
    }
}

named_enum! {
    /// Stage of the agent: a question to the model, or a step that no model answers.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum AgentStage {
        /// Question: sub-tasks of the instruction.
        Decompose = "decompose",
        /// Segmentation of the images.
        Segmentation = "segmentation",
        /// Question: the object to move.
        Object = "object",
        /// Question: the part to grasp.
        Part = "part",
        /// Question: the point to grasp.
        GrabPoint = "grab_point",
        /// Question: a path over the grid.
        GridPath = "grid_path",
        /// Question: the grid cell of the placement.
        PointToPoint = "point_to_point",
        /// Reconstruction of the collision world from the depth images.
        Look = "look",
        /// Grasp proposal and selection.
        Grasp = "grasp",
        /// Planning of the arm's motion.
        Motion = "motion",
        /// Execution of the plan.
        Execute = "execute",
        /// Question: the task is finished or not.
        Check = "check",
    }
}

named_enum! {
    /// Reason for the failure of a stage.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
    #[serde(rename_all = "snake_case")]
    pub enum StageCause {
        /// The answer is not in the requested format.
        Format = "format",
        /// The answer names a mark that was not drawn.
        Undrawn = "undrawn",
        /// The answer says that no mark fits.
        NotFound = "not_found",
        /// The object cannot be placed at the chosen cell.
        Unusable = "unusable",
        /// Segmentation found nothing.
        NoMasks = "no_masks",
        /// Too little of the object is visible.
        TooSmall = "too_small",
        /// No pixel of the object has a depth.
        NoDepth = "no_depth",
        /// The depth images or the detector's response could not be used.
        Unsuited = "unsuited",
        /// The detector proposed no grasp on the object.
        #[serde(rename = "none")]
        NoGrasp = "none",
        /// Most grasps are beyond the arm's reach.
        OutOfReach = "out_of_reach",
        /// Obstacles block all grasps or paths.
        Blocked = "blocked",
        /// The object is not between the fingers.
        Slipped = "slipped",
        /// The task is unfinished after the last round.
        Rounds = "rounds",
        /// A service did not answer.
        Service = "service",
    }
}

/// A failed stage, which ends the agent's episode.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{} failed ({}): {evidence}", .stage.name(), .cause.name())]
#[serde(deny_unknown_fields)]
pub struct FailedStage {
    /// Stage that failed.
    pub stage: AgentStage,
    /// Reason for its failure.
    pub cause: StageCause,
    /// Observation with numbers.
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
        for cause in StageCause::ALL {
            assert_eq!(text(serde_json::to_value(cause).unwrap()), cause.name());
        }
        for cause in FailureCause::ALL {
            assert_eq!(text(serde_json::to_value(cause).unwrap()), cause.name());
        }
    }

    #[test]
    fn the_guide_explains_every_cause_and_class() {
        let guide = include_str!("../../../docs/guides/why-did-it-fail.md");
        for name in
            FailureCause::ALL.map(FailureCause::name).into_iter().chain(FailureClass::ALL.map(FailureClass::name))
        {
            let mut rows = guide.lines().filter(|line| line.starts_with("| `"));
            let is_explained = rows.any(|row| row.contains(&format!("`{name}`")));
            assert!(is_explained, "docs/guides/why-did-it-fail.md has no row of `{name}`");
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

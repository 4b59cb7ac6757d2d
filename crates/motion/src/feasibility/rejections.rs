//! Counted rejections of grasps.

use std::collections::BTreeMap;

use crate::plan::PlanError;

/// Reason why a grasp is infeasible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GraspRejection {
    /// No IK solution at the grasp.
    #[error("out of reach")]
    OutOfReach,
    /// Every configuration of the arm collides at the grasp.
    #[error("blocked by {by}")]
    Blocked {
        /// Name of the obstacle that blocks the first configuration, or of a robot link in self-collision.
        by: String,
    },
    /// The object cannot be released at any goal pose.
    #[error("no release possible at any goal pose")]
    NoUse,
    /// No collision-free pre-grasp in the IK branch of the grasp, or no straight-line motion between the two.
    #[error("no straight approach: {0}")]
    NoApproach(PlanError),
    /// No free motion to the pre-grasp.
    #[error("no free motion to the approach: {0}")]
    NoReach(PlanError),
    /// No straight-line motion that lifts the object.
    #[error("no straight lift: {0}")]
    NoLift(PlanError),
}

/// Number of rejected grasps by reason; the gripper rotated by half a turn counts separately.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GraspRejections {
    /// Number of grasps without an IK solution.
    pub out_of_reach: usize,
    /// Number of blocked grasps by the name of the first obstacle.
    pub blocked: BTreeMap<String, usize>,
    /// Number of grasps without a possible release at any goal pose.
    pub no_use: usize,
    /// Number of grasps without a straight approach.
    pub no_approach: usize,
    /// Number of grasps without a free motion to the pre-grasp.
    pub no_reach: usize,
    /// Number of grasps without a straight lift.
    pub no_lift: usize,
}

impl GraspRejections {
    /// Adds a rejection to the number of its reason.
    pub fn count(&mut self, rejection: &GraspRejection) {
        match rejection {
            GraspRejection::OutOfReach => self.out_of_reach += 1,
            GraspRejection::Blocked { by } => *self.blocked.entry(by.clone()).or_default() += 1,
            GraspRejection::NoUse => self.no_use += 1,
            GraspRejection::NoApproach(_) => self.no_approach += 1,
            GraspRejection::NoReach(_) => self.no_reach += 1,
            GraspRejection::NoLift(_) => self.no_lift += 1,
        }
    }

    /// Total number of blocked grasps.
    pub fn blocked_count(&self) -> usize {
        self.blocked.values().sum()
    }

    /// Blocking obstacles with counts, most frequent first.
    pub fn obstacles(&self) -> Vec<(&str, usize)> {
        let mut counts: Vec<_> = self.blocked.iter().map(|(name, &count)| (name.as_str(), count)).collect();
        counts.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        counts
    }
}

impl GraspRejection {
    /// Planning error of the approach, reach or lift; `None` for other reasons.
    pub fn plan_error(&self) -> Option<&PlanError> {
        match self {
            Self::NoApproach(error) | Self::NoReach(error) | Self::NoLift(error) => Some(error),
            Self::OutOfReach | Self::Blocked { .. } | Self::NoUse => None,
        }
    }
}

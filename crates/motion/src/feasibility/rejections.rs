//! Why grasps were refused, counted.

use std::collections::BTreeMap;

use crate::plan::PlanError;

/// Why one grasp is not feasible.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GraspRejection {
    /// No arm configuration brings the hand there.
    #[error("out of reach")]
    OutOfReach,
    /// Every configuration touches something; the obstacle is that of the first.
    #[error("blocked by {by}")]
    Blocked {
        /// Name of the obstacle, or of the link that the robot hits itself.
        by: String,
    },
    /// There is no room to let go of the object at any goal pose.
    #[error("of no use at any goal pose")]
    NoUse,
    /// The hand does not come in on a straight line.
    #[error("no straight approach: {0}")]
    NoApproach(PlanError),
    /// No free motion leads to the start of the approach.
    #[error("no free motion to the approach: {0}")]
    NoReach(PlanError),
    /// The object cannot be lifted on a straight line.
    #[error("no straight lift: {0}")]
    NoLift(PlanError),
}

/// How many grasps were refused for which reason; the hand turned by half a circle counts on its own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GraspRejections {
    /// Grasps out of the arm's reach.
    pub out_of_reach: usize,
    /// Grasps where something is in the way, by the name of the first obstacle.
    pub blocked: BTreeMap<String, usize>,
    /// Grasps with which the object cannot be let go of at any goal pose.
    pub no_use: usize,
    /// Grasps without a straight approach.
    pub no_approach: usize,
    /// Grasps to which no free motion leads.
    pub no_reach: usize,
    /// Grasps with which the object cannot be lifted straight.
    pub no_lift: usize,
}

impl GraspRejections {
    /// Counts one.
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

    /// Grasps where anything is in the way.
    pub fn blocked_count(&self) -> usize {
        self.blocked.values().sum()
    }

    /// What stands in the way and how often, the most frequent first.
    pub fn obstacles(&self) -> Vec<(&str, usize)> {
        let mut counts: Vec<_> = self.blocked.iter().map(|(name, &count)| (name.as_str(), count)).collect();
        counts.sort_by_key(|&(_, count)| std::cmp::Reverse(count));
        counts
    }
}

impl GraspRejection {
    /// Why there is no path, if that is the reason.
    pub fn plan_error(&self) -> Option<&PlanError> {
        match self {
            Self::NoApproach(error) | Self::NoReach(error) | Self::NoLift(error) => Some(error),
            Self::OutOfReach | Self::Blocked { .. } | Self::NoUse => None,
        }
    }
}

//! Motions of one pick, planned on demand.

use genmanip_core::{Pose, Seed};
use glam::DVec3;

use super::{FeasibleGrasp, GraspRejection, PickQuery};
use crate::collision::{AllowedCollisions, Attached};
use crate::path::Path;
use crate::plan::PlanError;
use crate::planner::{Planner, PlanningScene};

/// Maximum joint step between states of a motion checked against the object [rad]: 2 mm of finger motion at the
/// forearm's length of 0.4 m, mostly along the motion.
const APPROACH_STEP_RAD: f64 = 0.005;

/// Straight motion of the open gripper away from an object between its fingers, which is an obstacle in the first scene,
/// and may be touched by the gripper in the second.
///
/// Wide objects leave less clearance than motions keep elsewhere: then `object_clearance_m` suffices. Without a value,
/// the gripper may touch the object.
///
/// # Errors
/// The planning error, if the line is unreachable or blocked.
pub(super) fn straight_off(
    planner: &Planner,
    [open, beside]: [&PlanningScene; 2],
    object_clearance_m: Option<f64>,
    from: &[f64],
    to: &Pose,
) -> Result<Path, PlanError> {
    let Some(clearance_m) = object_clearance_m else { return planner.straight(beside, from, to) };
    planner.straight(open, from, to).or_else(|problem| {
        let path = planner.straight(beside, from, to)?;
        let exact = planner.checker(open, clearance_m);
        if path.states(APPROACH_STEP_RAD).iter().all(|state| exact.is_free(state)) { Ok(path) } else { Err(problem) }
    })
}

/// Motions of one pick, in order; the gripper closes after the second.
#[derive(Clone, Debug, PartialEq)]
pub struct PickMotions {
    /// Free motion to the pre-grasp.
    pub reach: Path,
    /// Straight approach to the grasp.
    pub approach: Path,
    /// Straight lift with the object.
    pub lift: Path,
}

impl PickQuery<'_> {
    /// Plans all motions of a feasible grasp.
    ///
    /// # Errors
    /// Reports the first motion that cannot be planned.
    pub fn motions(&self, grasp: &FeasibleGrasp, seed: Seed) -> Result<PickMotions, GraspRejection> {
        let approach = self.approach(grasp).map_err(GraspRejection::NoApproach)?;
        let reach = self.reach(grasp, &approach, seed).map_err(GraspRejection::NoReach)?;
        let lift = self.lift(grasp).map_err(GraspRejection::NoLift)?;
        Ok(PickMotions { reach, approach, lift })
    }

    /// Straight motion from the pre-grasp to the grasp along the fingers.
    ///
    /// # Errors
    /// The planning error, if the line is unreachable or blocked.
    pub fn approach(&self, grasp: &FeasibleGrasp) -> Result<Path, PlanError> {
        let (planner, settings) = (self.planner, self.settings);
        let world_from_tcp = planner.tcp_pose(&grasp.config);
        let back = world_from_tcp.transform_vector(DVec3::Z) * settings.approach_for_m(planner.robot());
        let before = Pose { position: world_from_tcp.position - back, ..world_from_tcp };
        let (no_contact, touching) = (AllowedCollisions::none(), self.with_gripper_touching());
        let open = self.empty_gripper(&no_contact, grasp.opening_m);
        let beside = PlanningScene { allowed: &touching, ..open };
        // The object itself is an obstacle too: the open fingers must come in around it.
        Ok(straight_off(planner, [&open, &beside], settings.object_clearance_m, &grasp.config, &before)?.reversed())
    }

    /// Free motion to the pre-grasp.
    ///
    /// # Errors
    /// The planning error, if no path is found.
    pub fn reach(&self, grasp: &FeasibleGrasp, approach: &Path, seed: Seed) -> Result<Path, PlanError> {
        let no_contact = AllowedCollisions::none();
        let open = self.empty_gripper(&no_contact, grasp.opening_m);
        self.planner.plan_joint(&open, self.arm, &[approach.start().to_vec()], seed)
    }

    /// Straight lift with the object in the gripper.
    ///
    /// # Errors
    /// The planning error, if the line is unreachable or blocked.
    pub fn lift(&self, grasp: &FeasibleGrasp) -> Result<Path, PlanError> {
        let held = &grasp.object_from_tcp;
        let world_from_tcp = self.planner.tcp_pose(&grasp.config);
        let rise_m = self.settings.lift_for_m(self.planner.robot());
        let lifted = Pose { position: world_from_tcp.position + DVec3::Z * rise_m, ..world_from_tcp };
        let attached = Attached::new(self.object.name, self.object.pieces, &held.pose.inverse())
            .map_err(|error| PlanError::Unreachable { what: error.to_string() })?;
        let allowed = self.without_object();
        let holding = PlanningScene {
            world: self.world,
            attached: Some(&attached),
            allowed: &allowed,
            gripper_width: held.width,
        };
        self.planner.straight(&holding, &grasp.config, &lifted)
    }
}

//! Manipulation of articulated objects: contact candidates and arm motions that follow a joint.
//!
//! Contacts are sampled from the moving link's geometry: grasps of its handle, or pushes with closed fingers.

mod contacts;
mod joint_path;
mod sweep;

pub use contacts::JointContact;
pub use sweep::{JointSweep, Sweeper};

use genmanip_core::{Aabb, JointKind, Pose};
use genmanip_relations::{PosedObject, PosedScene};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Settings of arm motions that follow a joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JointSettings {
    /// Distance between gripper and link at the start (m); the motion closes it.
    pub gap_m: f64,
    /// Length of straight approach and retreat (m).
    pub approach_m: f64,
    /// Shares of the link's rotation that the gripper follows, in the order tried; a grasp follows all of it unless the
    /// handle pivots between the pads.
    pub follow: Vec<f64>,
    /// Maximum number of arm configurations tried per contact.
    pub configurations: usize,
    /// Clearance to everything but the object while the joint moves (m).
    pub room_m: f64,
    /// Maximum contact displacement between two checked states (m).
    pub step_m: f64,
    /// Maximum rotation between two checked states (rad).
    pub step_rad: f64,
    /// Maximum change of an arm joint between two checked states (rad).
    pub max_arm_step_rad: f64,
}

impl Default for JointSettings {
    fn default() -> Self {
        Self {
            // Chosen larger than the collision margin of the approach.
            gap_m: 0.002,
            // Chosen so that the gripper approaches a handle from outside.
            approach_m: 0.07,
            // Chosen: all, half, none.
            follow: vec![1.0, 0.5, 0.0],
            // Search limit, chosen.
            configurations: 6,
            // Chosen: the expert's clearance at a grasp.
            room_m: 0.003,
            // Chosen: a contact that moves by 1 cm between two free states hardly collides in between.
            step_m: 0.012,
            // Chosen: 3.4 degrees, 1 cm at the edge of a 20 cm door.
            step_rad: 0.06,
            // Chosen: a larger change means another IK branch, which the arm cannot follow.
            max_arm_step_rad: 0.3,
        }
    }
}

/// A required change of one joint to reach a state.
#[derive(Clone, Debug, PartialEq)]
pub struct JointChange {
    /// Index of the object in the scene.
    pub object: usize,
    /// Index of the moving link.
    pub link: usize,
    /// Index into the object's joint positions.
    pub joint: usize,
    /// Current position [rad or m].
    pub from: f64,
    /// Acceptable target positions [rad or m], preferred one first.
    pub targets: Vec<f64>,
}

/// Joint changes required to bring an object into a state; empty if it is in that state or has no such state.
///
/// Ordered to avoid blocking: closing joints first, then from the lowest link up, so that no pulled-out link hangs over
/// the next one.
pub fn joint_changes(scene: &PosedScene, object: usize, state: &str) -> Vec<JointChange> {
    let Some(posed) = scene.objects().nth(object) else { return Vec::new() };
    let Some(wanted) = posed.model.joint_states.iter().find(|known| known.name == state) else { return Vec::new() };
    let links =
        posed.model.links.iter().enumerate().filter_map(|(link, link_model)| Some((link, link_model.joint.as_ref()?)));
    let mut changes = Vec::new();
    for (joint, (link, link_model)) in links.enumerate() {
        let interval = wanted.intervals.iter().position(|(name, _)| *name == link_model.name);
        let Some((index, from)) = interval.zip(posed.joint_positions.get(joint).copied()) else { continue };
        let [low, high] = wanted.intervals[index].1;
        if (low..=high).contains(&from) {
            continue;
        }
        let nominal = wanted.nominal.get(index).copied().unwrap_or(0.5 * (low + high));
        let edge = if from < low { low } else { high };
        changes.push(JointChange { object, link, joint, from, targets: vec![nominal, 0.5 * (nominal + edge)] });
    }
    let poses = posed.model.link_poses(&posed.joint_positions);
    let height = |change: &JointChange| {
        let bounds = Aabb::from_pieces(&poses[change.link], &posed.model.links[change.link].pieces);
        bounds.center().z
    };
    let closes = |change: &JointChange| change.targets[0].abs() < change.from.abs();
    changes.sort_by(|a, b| closes(b).cmp(&closes(a)).then(height(a).total_cmp(&height(b))));
    changes
}

/// Pose and joint axis of the moving link, world frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// Link pose at the current joint position.
    pub world_from_link: Pose,
    /// Unit joint axis, world frame.
    pub axis: DVec3,
    /// Point on the axis, world frame.
    pub pivot: DVec3,
    pub kind: JointKind,
    /// +1 if the position must increase, −1 otherwise.
    pub sign: f64,
}

impl Motion {
    pub fn of(posed: &PosedObject, change: &JointChange, target: f64) -> Option<Self> {
        let joint = posed.model.links.get(change.link)?.joint.as_ref()?;
        let poses = posed.model.link_poses(&posed.joint_positions);
        let world_from_joint = posed.pose * *poses.get(joint.parent)? * joint.parent_from_joint;
        Some(Self {
            world_from_link: posed.pose * *poses.get(change.link)?,
            axis: world_from_joint.transform_vector(joint.axis).normalize_or(DVec3::Z),
            pivot: world_from_joint.position,
            kind: joint.kind,
            sign: if target >= change.from { 1.0 } else { -1.0 },
        })
    }

    /// Direction of motion of a point on the link (unit vector), and its speed per unit of joint velocity [m/rad or
    /// m/m].
    pub fn velocity(&self, point: DVec3) -> (DVec3, f64) {
        let velocity = match self.kind {
            JointKind::Prismatic => self.axis,
            JointKind::Revolute => self.axis.cross(point - self.pivot),
        };
        (velocity.normalize_or_zero() * self.sign, velocity.length())
    }
}

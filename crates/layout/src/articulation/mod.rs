//! Moving a joint of an articulated object: where the hand takes hold or pushes, and the way of the arm along the joint.
//!
//! Contacts are proposed from the moving link's own geometry: the handle between the pads, or closed fingers against a
//! face that looks the right way.
//! Each is followed along the joint's line or arc by inverse kinematics, and the robot may touch nothing on that way;
//! layout uses the search to ask whether an object can be served where it stands, the expert to do it.

mod contacts;
mod sweep;
mod ways;

pub use contacts::JointContact;
pub use sweep::{JointSweep, Sweeper};

use genmanip_core::{Aabb, JointKind, Pose};
use genmanip_relations::{PosedObject, PosedScene};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// How joints are moved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JointSettings {
    /// Distance between the hand and the link where the motion starts, metres; it is closed by the motion itself.
    pub gap_m: f64,
    /// Length of the straight way in and out, metres.
    pub approach_m: f64,
    /// Shares of the link's turn that a hand may follow, in the order in which they are tried; a hand that holds
    /// follows it all, unless the handle can turn between the pads.
    pub follow: Vec<f64>,
    /// Arm configurations tried per contact.
    pub configurations: usize,
    /// Distance the robot keeps from everything but the object itself while the joint moves, metres.
    pub room_m: f64,
    /// Largest motion of the contact between two states that are tested, metres.
    pub step_m: f64,
    /// Largest turn between two states that are tested, radians.
    pub step_rad: f64,
    /// Largest joint motion of the arm between two such states, radians.
    pub max_arm_step_rad: f64,
}

impl Default for JointSettings {
    fn default() -> Self {
        Self {
            // Chosen, more than the collision margin of the motion before it.
            gap_m: 0.002,
            // Chosen, so that the hand comes from outside a handle.
            approach_m: 0.07,
            // Chosen: all of it, half, nothing.
            follow: vec![1.0, 0.5, 0.0],
            // A bound of the search, chosen.
            configurations: 6,
            // Chosen: as the expert keeps from everything where it takes something.
            room_m: 0.003,
            // Chosen: what two states a centimetre apart both miss, the motion between them hardly touches.
            step_m: 0.012,
            // Chosen: 3.4 degrees, a centimetre at a door's edge of 20 cm.
            step_rad: 0.06,
            // Chosen: farther means another branch of the arm, which it cannot follow along the joint.
            max_arm_step_rad: 0.3,
        }
    }
}

/// One joint that is not where a state wants it.
#[derive(Clone, Debug, PartialEq)]
pub struct JointChange {
    /// Index of the object in the scene.
    pub object: usize,
    /// Index of the link that moves.
    pub link: usize,
    /// Index among the object's joint positions.
    pub joint: usize,
    /// Position now, radians or metres.
    pub from: f64,
    /// Positions that would do, the preferred one first.
    pub targets: Vec<f64>,
}

/// The joints that must move to bring an object into a state; empty when it is in it, or has no such state.
///
/// In an order that leaves room: what goes back comes first, then from the lowest link up, so that nothing that was
/// pulled out hangs over what is next.
pub fn joint_changes(scene: &PosedScene, object: usize, state: &str) -> Vec<JointChange> {
    let Some(posed) = scene.objects().nth(object) else { return Vec::new() };
    let Some(wanted) = posed.model.joint_states.iter().find(|known| known.name == state) else { return Vec::new() };
    let links = posed.model.links.iter().enumerate().filter_map(|(link, part)| Some((link, part.joint.as_ref()?)));
    let mut changes = Vec::new();
    for (joint, (link, part)) in links.enumerate() {
        let interval = wanted.intervals.iter().position(|(name, _)| *name == part.name);
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
    let goes_back = |change: &JointChange| change.targets[0].abs() < change.from.abs();
    changes.sort_by(|a, b| goes_back(b).cmp(&goes_back(a)).then(height(a).total_cmp(&height(b))));
    changes
}

/// How the moving link lies and turns in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// Link pose at the present position.
    pub world_from_link: Pose,
    /// Unit axis in the world.
    pub axis: DVec3,
    /// A point of the axis in the world.
    pub pivot: DVec3,
    pub kind: JointKind,
    /// +1 when the position has to grow, −1 otherwise.
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

    /// Direction in which a point of the link moves, and how far per unit of the joint.
    pub fn velocity(&self, point: DVec3) -> (DVec3, f64) {
        let velocity = match self.kind {
            JointKind::Prismatic => self.axis,
            JointKind::Revolute => self.axis.cross(point - self.pivot),
        };
        (velocity.normalize_or_zero() * self.sign, velocity.length())
    }
}

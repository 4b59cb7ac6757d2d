//! Robots: a serial arm with a parallel gripper.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::hash::Canonical;
use crate::{JointKind, MassProperties, Piece, Pose, VisualPart};

/// An arm with a two-finger gripper: model for simulation, planning and rendering.
///
/// Links are listed parents first; link 0 is the base, fixed at the world origin.
/// Joints are ordered arm first, then the two fingers.
#[derive(Clone, Debug)]
pub struct RobotModel {
    /// Name, e.g. `panda`.
    pub name: String,
    /// Bodies, parents first.
    pub links: Vec<RobotLink>,
    /// Index of the hand link, to which the `wrist` camera is mounted.
    pub hand: usize,
    /// TCP frame: midpoint between the pads, axes of the hand link (z = approach, y = closing).
    pub hand_from_tcp: Pose,
    /// Fingers, maximum opening, maximum force and pads.
    pub gripper: Gripper,
    /// Arm joint positions at the start of an episode, rad.
    pub home: Vec<f64>,
    /// Motor gains and surface friction; `None` for a robot that is only used for planning.
    pub drives: Option<Drives>,
    /// Measured reach; `None` if unknown.
    pub reach: Option<Reach>,
    /// Default wrist-camera pose: optical frame in the hand link's frame; `None` for a robot without one.
    pub hand_from_wrist_camera: Option<Pose>,
    /// Pairs of links excluded from self-collision checks (neighbours and pairs that cannot meet).
    pub never_colliding: Vec<(usize, usize)>,
}

/// A rigid body of the robot.
#[derive(Clone, Debug)]
pub struct RobotLink {
    /// Name, e.g. `link4`.
    pub name: String,
    /// Index of the parent link; `None` for the base.
    pub parent: Option<usize>,
    /// Pose of the link's frame in the parent's frame at joint position 0.
    pub parent_from_link: Pose,
    /// Joint to the parent; `None` if rigidly attached.
    pub joint: Option<RobotJoint>,
    /// Meshes with materials, for rendering.
    pub visual: Vec<VisualPart>,
    /// Convex pieces for collision, in the link's frame.
    pub pieces: Vec<Piece>,
    /// Mass, centre of mass and inertia of the link.
    pub mass: MassProperties,
}

/// A joint with the manufacturer's limits.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotJoint {
    /// Name, e.g. `joint4`.
    pub name: String,
    /// Revolute or prismatic.
    pub kind: JointKind,
    /// Unit axis in the link's frame.
    pub axis: DVec3,
    /// Smallest position, rad or m.
    pub lower: f64,
    /// Largest position, rad or m.
    pub upper: f64,
    /// Largest speed, rad/s or m/s.
    pub max_velocity: f64,
    /// Largest acceleration, rad/s² or m/s².
    pub max_acceleration: f64,
    /// Largest jerk, rad/s³ or m/s³.
    pub max_jerk: f64,
    /// Largest torque or force, N·m or N.
    pub max_effort: f64,
    /// True for a joint without end stops: positions a full turn apart are the same.
    pub continuous: bool,
    /// Coupling to another joint, which then sets the position: the coupled joint is no degree of freedom. `None` for
    /// an independent joint.
    pub mimic: Option<Mimic>,
}

/// Position of a joint as a linear function of another joint's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mimic {
    /// Index of the link that the other joint moves.
    pub link: usize,
    /// Position per unit of the other joint's position.
    pub multiplier: f64,
    /// Position where the other joint is at 0, rad or m.
    pub offset: f64,
}

/// A parallel gripper: two mirrored fingers.
#[derive(Clone, Debug, PartialEq)]
pub struct Gripper {
    /// Links of the two fingers; the first moves along +y of the hand link, the second along -y.
    pub fingers: [usize; 2],
    /// Largest opening width between the pads, m.
    pub max_width: f64,
    /// Largest grip force as published (sum over the fingers), N.
    pub max_force: f64,
    /// Pad size: along the closing direction, across, along the finger, m.
    pub pad_size: DVec3,
}

/// Motor gains and surface friction of a robot.
///
/// The contact parameters hold thin and heavy objects by friction alone; they were tuned on scripted picks
/// (see `crates/sim/tests/sim`), starting from MuJoCo Menagerie's Panda.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drives {
    /// Position gains of the arm joints, base to tip, N·m/rad; the last one applies to all further joints.
    pub arm_kp: Vec<f64>,
    /// Velocity gains, N·m·s/rad, near critical damping; the last one applies to all further joints.
    pub arm_kv: Vec<f64>,
    /// Rotor inertia reflected to the joint, kg·m².
    pub arm_armature: f64,
    /// Viscous friction of an arm joint, N·m·s/rad.
    pub arm_damping: f64,
    /// Largest grip force, sum over both fingers, N; at most the gripper's limit.
    pub grip_force_n: f64,
    /// Stiffness of the width drive, N per metre of opening width.
    pub grip_kp: f64,
    /// Distance beyond closed that a commanded width of 0 aims for, m, so that thin objects are held with full force.
    pub grip_overclose_m: f64,
    /// Inertia of the finger drive reflected to one finger, kg.
    pub finger_armature: f64,
    /// Viscous friction of a finger, N·s/m. Its product with the physics time step must stay well below the inertia:
    /// the integrator adds it after solving contacts, and larger values make the grip chatter and creep.
    pub finger_damping: f64,
    /// Pad friction: sliding (1), torsional (m), rolling (m); overrides the object's.
    pub pad_friction: [f64; 3],
    /// Sliding friction of the robot's surface except the pads.
    pub hull_friction: f64,
}

/// Distances at which a robot can work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reach {
    /// Published maximum reach from the base axis, metres; used for drawings.
    pub max_m: f64,
    /// Smallest and largest distance from the base axis for top-down picks off a table, metres.
    pub from_above_m: [f64; 2],
}

impl Reach {
    /// Scale of the workspace relative to the default one, which is made for arms that take objects 0.7 m away; at
    /// most 1.
    pub fn scale(&self) -> f64 {
        (self.from_above_m[1] / 0.7).min(1.0)
    }
}

impl RobotModel {
    /// [`Reach::scale`] of the robot; 1 if its reach is unknown.
    pub fn reach_scale(&self) -> f64 {
        self.reach.map_or(1.0, |reach| reach.scale())
    }

    /// Hash of all physics inputs: links, pieces, inertia, joints, gripper, drives.
    /// Appearance and the home position are excluded; the latter is part of the world.
    ///
    /// Canonical bytes as in [`crate::AssetHashes`].
    pub fn physics_hash(&self) -> String {
        let mut bytes = Canonical::default();
        bytes.text(&self.name);
        bytes.whole(self.hand as u64);
        bytes.pose(&self.hand_from_tcp);
        bytes.list(&self.links, |bytes, link| {
            bytes.whole(link.parent.map_or(0, |parent| parent as u64 + 1));
            bytes.pose(&link.parent_from_link);
            bytes.numbers(&[link.mass.mass_kg]);
            bytes.vector(&link.mass.center);
            bytes.numbers(&link.mass.inertia.to_cols_array());
            bytes.list(&link.pieces, Canonical::piece);
            bytes.list(link.joint.as_slice(), |bytes, joint| {
                bytes.joint_kind(joint.kind);
                bytes.vector(&joint.axis);
                bytes.numbers(&[joint.lower, joint.upper, joint.max_velocity, joint.max_effort]);
            });
        });
        bytes.list(&self.gripper.fingers, |bytes, finger| bytes.whole(*finger as u64));
        bytes.numbers(&[self.gripper.max_width, self.gripper.max_force]);
        bytes.list(&self.never_colliding, |bytes, &(a, b)| {
            bytes.whole(a as u64);
            bytes.whole(b as u64);
        });
        bytes.list(self.drives.as_slice(), |bytes, drives| {
            bytes.list(&drives.arm_kp, |bytes, gain| bytes.numbers(&[*gain]));
            bytes.list(&drives.arm_kv, |bytes, gain| bytes.numbers(&[*gain]));
            bytes.numbers(&[
                drives.arm_armature,
                drives.arm_damping,
                drives.grip_force_n,
                drives.grip_kp,
                drives.grip_overclose_m,
                drives.finger_armature,
                drives.finger_damping,
                drives.hull_friction,
            ]);
            bytes.numbers(&drives.pad_friction);
        });
        bytes.finish()
    }

    /// Number of arm joints, excluding the fingers.
    pub fn arm_dof(&self) -> usize {
        self.home.len()
    }

    /// Joints of the arm that are not coupled to another joint, base to tip.
    pub fn arm_joints(&self) -> impl Iterator<Item = &RobotJoint> {
        self.arm_links().filter_map(|index| self.links[index].joint.as_ref())
    }

    /// Indices of the links that [`RobotModel::arm_joints`] move.
    pub fn arm_links(&self) -> impl Iterator<Item = usize> {
        let moves = |link: &RobotLink| link.joint.as_ref().is_some_and(|joint| joint.mimic.is_none());
        (0..self.links.len()).filter(move |index| !self.gripper.fingers.contains(index) && moves(&self.links[*index]))
    }

    /// `world_from_link` for every link, given arm joint positions and opening width.
    pub fn link_poses(&self, arm: &[f64], gripper_width: f64) -> Vec<Pose> {
        let mut poses: Vec<Pose> = Vec::with_capacity(self.links.len());
        let mut positions = vec![0.0; self.links.len()];
        for (link, &position) in self.arm_links().zip(arm) {
            positions[link] = position;
        }
        for finger in self.gripper.fingers {
            positions.get_mut(finger).into_iter().for_each(|position| *position = gripper_width / 2.0);
        }
        for (index, link) in self.links.iter().enumerate() {
            let parent = link.parent.and_then(|parent| poses.get(parent)).copied().unwrap_or_default();
            let motion = match &link.joint {
                None => Pose::IDENTITY,
                Some(joint) => {
                    let follow = |mimic: Mimic| positions[mimic.link] * mimic.multiplier + mimic.offset;
                    joint.kind.motion(joint.axis, joint.mimic.map_or(positions[index], follow))
                }
            };
            poses.push(parent * link.parent_from_link * motion);
        }
        poses
    }

    /// `world_from_tcp`, given arm joint positions.
    pub fn tcp_pose(&self, arm: &[f64]) -> Pose {
        self.link_poses(arm, 0.0).get(self.hand).copied().unwrap_or_default() * self.hand_from_tcp
    }
}

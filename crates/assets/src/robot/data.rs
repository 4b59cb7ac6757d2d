//! Robot file formats `genmanip.arm/1`, `genmanip.gripper/1` and `genmanip.robot/1`.
//!
//! Units are metres, radians, seconds, kilograms and newtons; angles are in degrees where the key ends in `_deg`.
//! docs/guides/your-own-robot.md explains every key.

use std::collections::BTreeMap;

use genmanip_core::{JointKind, MassProperties, Pose, Reach, RobotJoint, RobotLink, Seed};
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;

use crate::parts::{Part, assemble};

/// Serial arm without a gripper: a file of `arms/`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ArmData {
    pub schema: String,
    pub name: String,
    /// Sources of the file's numbers (data sheets, papers), by topic.
    pub sources: BTreeMap<String, String>,
    /// Name of the link that carries the gripper.
    pub tool_link: String,
    /// Joint positions at the start of an episode, base to tool, rad.
    pub home: Vec<f64>,
    #[serde(default)]
    pub reach: Option<Reach>,
    pub drives: ArmDrives,
    /// Links, parents before children; the first link is the base.
    pub links: Vec<LinkData>,
    /// Pairs of links that cannot collide; neighbours need not be listed.
    #[serde(default)]
    pub never_colliding: Vec<[String; 2]>,
}

/// Joint drives of an arm in simulation.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ArmDrives {
    /// Position gains of the joints, base to tool, N·m/rad.
    pub kp: Vec<f64>,
    /// Velocity gains of the joints, base to tool, N·m·s/rad.
    pub kv: Vec<f64>,
    /// Rotor inertia of each drive as seen at its joint, kg·m².
    pub armature: f64,
    /// Viscous joint friction, N·m·s/rad.
    pub damping: f64,
    /// Sliding friction coefficient of all robot surfaces but the finger pads.
    pub hull_friction: f64,
}

/// Parallel gripper: a file of `grippers/`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GripperData {
    pub schema: String,
    pub name: String,
    /// Sources of the file's numbers (data sheets, papers), by topic.
    pub sources: BTreeMap<String, String>,
    /// Distance of the tool centre point (TCP) from the origin of the first link, along +z, m.
    pub hand_from_tcp_z: f64,
    /// Names of the finger links; the first opens along +y of the hand, the second along -y.
    pub fingers: [String; 2],
    /// Largest opening between the pads, m.
    pub max_width: f64,
    /// Largest grip force according to the manufacturer, N.
    pub max_force: f64,
    /// Size of a finger pad along the closing direction, across the finger, and along the finger, m.
    pub pad_size: DVec3,
    #[serde(default)]
    pub wrist_camera: Option<WristCameraData>,
    pub drives: GripperDrives,
    /// Links of the gripper: the hand, which carries the fingers, then the fingers.
    pub links: Vec<LinkData>,
    #[serde(default)]
    pub never_colliding: Vec<[String; 2]>,
}

/// Drive of a gripper in simulation.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GripperDrives {
    /// Grip force limit of the drive, sum over both fingers, N.
    pub force_n: f64,
    /// Position gain of the drive, N per metre of opening.
    pub kp: f64,
    /// Distance by which the drive's target for a commanded width of 0 lies beyond fully closed, m.
    pub overclose_m: f64,
    /// Inertia of the drive as seen at one finger, kg.
    pub armature: f64,
    /// Viscous friction of a finger, N·s/m.
    pub damping: f64,
    /// Friction coefficients of the pads: sliding (no unit), torsional (m), rolling (m).
    pub pad_friction: [f64; 3],
}

/// Robot that consists of a gripper on an arm: a file of `robots/`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RobotData {
    pub schema: String,
    pub name: String,
    /// Name of the arm, as in its file.
    pub on: String,
    /// Name of the gripper, as in its file.
    pub gripper: String,
    /// Pose of the hand in the frame of the arm's tool link.
    pub mount: MountData,
    /// Joint positions at the start of an episode, rad; the arm's if absent.
    #[serde(default)]
    pub home: Option<Vec<f64>>,
    /// Reach; the arm's if absent.
    #[serde(default)]
    pub reach: Option<Reach>,
    /// Wrist camera; the gripper's if absent.
    #[serde(default)]
    pub wrist_camera: Option<WristCameraData>,
    /// Drive gains; the arm's if absent.
    #[serde(default)]
    pub gains: GainsData,
    /// Limits tighter than the arm's, by joint name.
    #[serde(default)]
    pub limits: BTreeMap<String, LimitsData>,
    /// Pairs of links that cannot collide; the name `gripper` stands for every link of the gripper.
    #[serde(default)]
    pub never_colliding: Vec<[String; 2]>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MountData {
    pub position: DVec3,
    /// Roll, pitch and yaw about the fixed x, y and z axes, in this order.
    pub rpy_deg: [f64; 3],
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GainsData {
    #[serde(default)]
    pub kp: Option<Vec<f64>>,
    #[serde(default)]
    pub kv: Option<Vec<f64>>,
}

/// Limits of one joint of a robot, in units of the joint; the arm's limit where one is absent.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LimitsData {
    #[serde(default)]
    pub lower: Option<f64>,
    #[serde(default)]
    pub upper: Option<f64>,
    #[serde(default)]
    pub max_velocity: Option<f64>,
    #[serde(default)]
    pub max_acceleration: Option<f64>,
    #[serde(default)]
    pub max_jerk: Option<f64>,
    #[serde(default)]
    pub max_effort: Option<f64>,
}

/// Wrist camera beside the hand; the upper edge of its image points towards +x of the hand.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WristCameraData {
    /// Position of the optical frame in the hand's frame, m.
    pub position: DVec3,
    /// Tilt of the optical axis from the approach direction towards the pads.
    pub tilt_deg: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinkData {
    pub name: String,
    /// Name of a link listed earlier; absent for the first link.
    #[serde(default)]
    pub parent: Option<String>,
    /// Origin of the link's frame in the parent's frame, m.
    #[serde(default)]
    pub position: DVec3,
    /// Roll, pitch and yaw about the fixed x, y and z axes, in this order.
    #[serde(default)]
    pub rpy_deg: [f64; 3],
    #[serde(default)]
    pub joint: Option<JointData>,
    pub mass_kg: f64,
    pub center: DVec3,
    /// Moments xx, yy, zz, xy, xz, yz about the centre of mass, kg·m².
    pub inertia: [f64; 6],
    pub parts: Vec<Part>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct JointData {
    pub name: String,
    pub kind: JointKind,
    pub axis: DVec3,
    pub lower: f64,
    pub upper: f64,
    pub max_velocity: f64,
    pub max_acceleration: f64,
    pub max_jerk: f64,
    pub max_effort: f64,
    /// True for a joint without end stops.
    #[serde(default)]
    pub continuous: bool,
}

impl WristCameraData {
    pub fn pose(&self) -> Pose {
        let (sin, cos) = self.tilt_deg.to_radians().sin_cos();
        Pose::from_axes(self.position, DVec3::Y, DVec3::new(-cos, 0.0, -sin), DVec3::new(-sin, 0.0, cos))
    }
}

impl MountData {
    pub fn pose(&self) -> Pose {
        frame(self.position, self.rpy_deg)
    }
}

impl LinkData {
    /// Link number `index` of the robot; the index also seeds the link's textures.
    pub fn build(&self, index: usize, parent: Option<usize>, parent_from_link: Pose) -> RobotLink {
        let link = assemble(&self.parts, Seed::new(index as u64));
        RobotLink {
            name: self.name.clone(),
            parent,
            parent_from_link,
            joint: self.joint.as_ref().map(JointData::build),
            visual: link.visual,
            pieces: link.solids.into_iter().map(|solid| solid.piece).collect(),
            mass: MassProperties { mass_kg: self.mass_kg, center: self.center, inertia: self.inertia() },
        }
    }

    pub fn pose(&self) -> Pose {
        frame(self.position, self.rpy_deg)
    }

    pub fn inertia(&self) -> DMat3 {
        let [xx, yy, zz, xy, xz, yz] = self.inertia;
        DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz])
    }
}

impl JointData {
    fn build(&self) -> RobotJoint {
        let &Self {
            kind, axis, lower, upper, max_velocity, max_acceleration, max_jerk, max_effort, continuous, ..
        } = self;
        let name = self.name.clone();
        RobotJoint {
            name,
            kind,
            axis,
            lower,
            upper,
            max_velocity,
            max_acceleration,
            max_jerk,
            max_effort,
            continuous,
            mimic: None,
        }
    }
}

fn frame(position: DVec3, rpy_deg: [f64; 3]) -> Pose {
    let [roll, pitch, yaw] = rpy_deg.map(f64::to_radians);
    let turn = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
    Pose::new(position, turn)
}

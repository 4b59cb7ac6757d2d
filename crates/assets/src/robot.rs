//! Robots from data files: published kinematics, limits and inertia; surfaces and collision pieces from parts.

use std::sync::{Arc, OnceLock};

use genmanip_core::{Drives, Gripper, MassProperties, Pose, Reach, RobotJoint, RobotLink, RobotModel, Seed};
use glam::{DMat3, DQuat, DVec3};
use serde::Deserialize;
use serde_json::{Map, Value};

use crate::AssetError;
use crate::catalogue::check_parts;
use crate::data_file::read;
use crate::parts::{Part, assemble};

/// The Franka Emika Panda with its parallel gripper; the same `Arc` on every call.
///
/// Link frames, limits and torques: published values (modified DH, joint axis = +z of its link).
/// Masses and inertias: Gaz et al. 2019, "Dynamic Identification of the Franka Emika Panda Robot"; link 0 and the hand
/// as in the manufacturer's robot description.
/// The fingers' maximum acceleration and jerk are unpublished; ours make the planner account for realistic closing
/// times.
/// Shapes are our own, within a few millimetres of the robot's outline.
///
/// Drives: gains near critical damping for the arm's inertia; rotor inertia as in MuJoCo Menagerie's Panda.
/// Of 146 test picks (8-73 mm, 12-700 g) all hold from 25 N grip force, and some slip 10 mm at 15 N; it is set to 40
/// N.
/// The width drive reaches full force at 5 mm of squeeze and aims 10 mm beyond closed.
/// Reach: 0.855 m is published; 0.32-0.70 m is the range of top-down picks off a table.
/// The wrist camera sits in front of the hand, tilted so that the pads are at the lower edge of the image.
///
/// # Panics
/// Never in a tested build: the data file is compiled in.
pub fn panda() -> Arc<RobotModel> {
    static PANDA: OnceLock<Arc<RobotModel>> = OnceLock::new();
    let built = PANDA.get_or_init(|| {
        Arc::new(robot_from_json(include_str!("../data/panda.json")).expect("built-in data files are tested"))
    });
    Arc::clone(built)
}

/// The Panda with a gripper like Robotiq's 2F-85, the second configuration of the DROID dataset; the same `Arc` on
/// every call.
///
/// From the data sheet: 85 mm stroke, up to 235 N, 20-150 mm/s between the fingers, 0.9 kg, pads 22 mm wide.
/// Shapes are our own. The real fingers move on four-bar linkages that keep the pads parallel; here the pads move in
/// straight lines at the height that the real ones have at half stroke.
///
/// # Panics
/// Never in a tested build: the data files are compiled in.
pub fn panda_2f85() -> Arc<RobotModel> {
    static BUILT: OnceLock<Arc<RobotModel>> = OnceLock::new();
    let built = BUILT.get_or_init(|| {
        let (arm, hand) = (include_str!("../data/panda.json"), include_str!("../data/hand_2f85.json"));
        Arc::new(with_gripper(arm, hand).expect("built-in data files are tested"))
    });
    Arc::clone(built)
}

/// Mounts another gripper on an arm: its links replace the arm's hand and fingers, its other fields replace those of
/// the same name.
fn with_gripper(arm: &str, hand: &str) -> Result<RobotModel, AssetError> {
    let mut robot: Map<String, Value> = read("robot", arm)?;
    let mut changes: Map<String, Value> = read("hand", hand)?;
    changes.remove("on");
    let first = robot.get("hand").and_then(Value::as_u64).unwrap_or(0) as usize;
    if let (Some(Value::Array(links)), Some(Value::Array(own))) = (robot.get_mut("links"), changes.remove("links")) {
        links.truncate(first);
        links.extend(own);
    }
    robot.extend(changes);
    robot_from_json(&Value::Object(robot).to_string())
}

/// Builds a robot from its data file.
///
/// # Errors
/// [`AssetError::Data`] with the position of the error, also for a link that refers to a later or missing one.
pub fn robot_from_json(text: &str) -> Result<RobotModel, AssetError> {
    let data: RobotData = read("robot", text)?;
    let count = data.links.len();
    let wrong = |message: String| AssetError::Data { file: "robot".into(), message };
    for (index, link) in data.links.iter().enumerate() {
        check_parts("robot", &link.name, &link.parts)?;
        if link.parent.is_some_and(|parent| parent >= index) || (link.parent.is_none() && index > 0) {
            return Err(wrong(format!("links[{index}].parent: expected an earlier link, got {:?}", link.parent)));
        }
    }
    let arm_joints = data.links.iter().filter(|link| link.joint.is_some()).count().saturating_sub(2);
    if data.home.len() != arm_joints {
        return Err(wrong(format!("home: expected {arm_joints} positions, got {}", data.home.len())));
    }
    let named =
        [data.hand].into_iter().chain(data.fingers).chain(data.never_colliding.iter().flat_map(|&(a, b)| [a, b]));
    if let Some(index) = named.into_iter().find(|&index| index >= count) {
        return Err(wrong(format!("expected the index of one of {count} links, got {index}")));
    }
    Ok(RobotModel {
        name: data.name,
        links: data.links.into_iter().enumerate().map(|(index, link)| link.build(index)).collect(),
        hand: data.hand,
        hand_from_tcp: Pose::from_position(DVec3::Z * data.hand_from_tcp_z),
        gripper: Gripper {
            fingers: data.fingers,
            max_width: data.max_width,
            max_force: data.max_force,
            pad_size: data.pad_size,
        },
        home: data.home,
        drives: data.drives,
        reach: data.reach,
        hand_from_wrist_camera: data.wrist_camera.map(WristCameraData::pose),
        never_colliding: data.never_colliding,
    })
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotData {
    name: String,
    links: Vec<LinkData>,
    hand: usize,
    hand_from_tcp_z: f64,
    fingers: [usize; 2],
    max_width: f64,
    max_force: f64,
    pad_size: DVec3,
    home: Vec<f64>,
    #[serde(default)]
    reach: Option<Reach>,
    #[serde(default)]
    wrist_camera: Option<WristCameraData>,
    #[serde(default)]
    drives: Option<Drives>,
    never_colliding: Vec<(usize, usize)>,
}

/// A camera beside the hand, with the image's upper edge towards +x of the hand.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WristCameraData {
    /// Position of the optical frame in the hand's frame, m.
    position: DVec3,
    /// Tilt from the approach direction towards the pads, degrees.
    tilt_deg: f64,
}

impl WristCameraData {
    fn pose(self) -> Pose {
        let (sin, cos) = self.tilt_deg.to_radians().sin_cos();
        Pose::from_axes(self.position, DVec3::Y, DVec3::new(-cos, 0.0, -sin), DVec3::new(-sin, 0.0, cos))
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LinkData {
    name: String,
    parent: Option<usize>,
    /// Position of the link's frame in the parent's frame, m.
    position: DVec3,
    /// Roll, pitch, yaw about the fixed axes x, y, z.
    rpy_deg: [f64; 3],
    joint: Option<JointData>,
    mass_kg: f64,
    center: DVec3,
    /// xx, yy, zz, xy, xz, yz about the centre of mass.
    inertia: [f64; 6],
    parts: Vec<Part>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JointData {
    name: String,
    kind: genmanip_core::JointKind,
    axis: DVec3,
    lower: f64,
    upper: f64,
    max_velocity: f64,
    max_acceleration: f64,
    max_jerk: f64,
    max_effort: f64,
}

impl LinkData {
    fn build(self, index: usize) -> RobotLink {
        let link = assemble(&self.parts, Seed::new(index as u64));
        let [roll, pitch, yaw] = self.rpy_deg.map(f64::to_radians);
        let turn = DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll);
        let [xx, yy, zz, xy, xz, yz] = self.inertia;
        let inertia = DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
        RobotLink {
            name: self.name,
            parent: self.parent,
            parent_from_link: Pose::new(self.position, turn),
            joint: self.joint.map(JointData::build),
            visual: link.visual,
            pieces: link.solids.into_iter().map(|solid| solid.piece).collect(),
            mass: MassProperties { mass_kg: self.mass_kg, center: self.center, inertia },
        }
    }
}

impl JointData {
    fn build(self) -> RobotJoint {
        let Self { name, kind, axis, lower, upper, max_velocity, max_acceleration, max_jerk, max_effort } = self;
        RobotJoint { name, kind, axis, lower, upper, max_velocity, max_acceleration, max_jerk, max_effort }
    }
}

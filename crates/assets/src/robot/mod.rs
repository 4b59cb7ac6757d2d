//! Robots from data files: an arm, a gripper, and a robot file that mounts the gripper on the arm.

mod check;
mod data;

use genmanip_core::{Drives, Gripper, Pose, RobotLink, RobotModel};
use glam::DVec3;

use crate::AssetError;
use crate::data_file::read;
use data::{ArmData, GripperData, LimitsData, LinkData, RobotData, WristCameraData};

/// Name in a robot's `never_colliding` that stands for every link of the gripper.
const GRIPPER: &str = "gripper";

/// Kinds of robot files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartKind {
    /// Gripper mounted on an arm.
    Robot,
    /// Serial arm without a gripper.
    Arm,
    /// Parallel gripper without an arm.
    Gripper,
}

impl PartKind {
    /// Schema name of files of this kind.
    pub const fn schema(self) -> &'static str {
        match self {
            Self::Robot => "genmanip.robot/1",
            Self::Arm => "genmanip.arm/1",
            Self::Gripper => "genmanip.gripper/1",
        }
    }

    /// Name of this kind in messages.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Arm => "arm",
            Self::Gripper => "gripper",
        }
    }
}

/// Function that finds the text of an arm or gripper file by name.
pub type PartFinder<'a> = dyn Fn(PartKind, &str) -> Result<String, AssetError> + 'a;

/// Builds a robot from the text of a robot file; `file` names it in errors, `find` reads its arm and gripper.
///
/// # Errors
/// [`AssetError::Data`] with the file, the place in it and the expected value, or an error of `find`.
pub fn compose(file: &str, text: &str, find: &PartFinder) -> Result<RobotModel, AssetError> {
    let wrong = |message| AssetError::Data { file: file.to_owned(), message };
    let robot: RobotData = read(file, text)?;
    check::header(PartKind::Robot, &robot.schema, &robot.name).map_err(wrong)?;

    let arm_file = format!("arm {}", robot.on);
    let mut arm: ArmData = read(&arm_file, &find(PartKind::Arm, &robot.on)?)?;
    check::arm(&arm).map_err(|message| AssetError::Data { file: arm_file, message })?;

    let gripper_file = format!("gripper {}", robot.gripper);
    let gripper: GripperData = read(&gripper_file, &find(PartKind::Gripper, &robot.gripper)?)?;
    check::gripper(&gripper).map_err(|message| AssetError::Data { file: gripper_file.clone(), message })?;

    override_arm(&mut arm, &robot).map_err(wrong)?;
    check::mounted(&robot, &arm, &gripper).map_err(wrong)?;
    let model = assemble(&robot, &arm, &gripper);
    check::pads(&model).map_err(|message| AssetError::Data { file: gripper_file, message })?;
    Ok(model)
}

/// Replaces home, reach, gains and limits of the arm by those that the robot states.
fn override_arm(arm: &mut ArmData, robot: &RobotData) -> Result<(), String> {
    for (name, changes) in &robot.limits {
        let joints: Vec<String> = arm.links.iter().filter_map(|link| Some(link.joint.as_ref()?.name.clone())).collect();
        let joint = arm.links.iter_mut().filter_map(|link| link.joint.as_mut()).find(|joint| joint.name == *name);
        let joint =
            joint.ok_or_else(|| format!("limits.{name}: expected a joint of the arm: {}", joints.join(", ")))?;
        tighten(name, changes, joint)?;
    }
    if let Some(home) = &robot.home {
        arm.home.clone_from(home);
    }
    arm.reach = robot.reach.or(arm.reach);
    for (gains, own) in [(&robot.gains.kp, &mut arm.drives.kp), (&robot.gains.kv, &mut arm.drives.kv)] {
        if let Some(gains) = gains {
            own.clone_from(gains);
        }
    }
    Ok(())
}

fn tighten(name: &str, changes: &LimitsData, joint: &mut data::JointData) -> Result<(), String> {
    let inside = |key: &str, value: f64, [least, most]: [f64; 2]| match (least..=most).contains(&value) {
        true => Ok(value),
        false => Err(format!("limits.{name}.{key}: expected {least} to {most} as the arm allows, got {value}")),
    };
    let range = [joint.lower, joint.upper];
    if let Some(lower) = changes.lower {
        joint.lower = inside("lower", lower, range)?;
    }
    if let Some(upper) = changes.upper {
        joint.upper = inside("upper", upper, range)?;
    }
    for (key, change, own) in [
        ("max_velocity", changes.max_velocity, &mut joint.max_velocity),
        ("max_acceleration", changes.max_acceleration, &mut joint.max_acceleration),
        ("max_jerk", changes.max_jerk, &mut joint.max_jerk),
        ("max_effort", changes.max_effort, &mut joint.max_effort),
    ] {
        if let Some(change) = change {
            *own = inside(key, change, [0.0, *own])?;
        }
    }
    Ok(())
}

/// Assembles the model of a robot from checked data.
fn assemble(robot: &RobotData, arm: &ArmData, gripper: &GripperData) -> RobotModel {
    let names: Vec<&str> = arm.links.iter().chain(&gripper.links).map(|link| link.name.as_str()).collect();
    let index_of = |name: &str| names.iter().position(|other| *other == name);
    let hand = arm.links.len();
    let arm_links = arm.links.iter().enumerate().map(|(index, link)| {
        let parent = link.parent.as_deref().and_then(index_of);
        link.build(index, parent, link.pose())
    });
    let gripper_links = gripper.links.iter().enumerate().map(|(index, link)| match &link.parent {
        None => link.build(hand, index_of(&arm.tool_link), robot.mount.pose()),
        Some(parent) => link.build(hand + index, index_of(parent), link.pose()),
    });
    let links: Vec<RobotLink> = arm_links.chain(gripper_links).collect();
    let fingers = [0, 1].map(|finger| index_of(&gripper.fingers[finger]).unwrap_or(hand));
    let never_colliding = never_colliding(
        &links,
        fingers,
        hand,
        &index_of,
        [&arm.never_colliding, &gripper.never_colliding, &robot.never_colliding],
    );
    let (arm_drives, grip) = (&arm.drives, &gripper.drives);
    RobotModel {
        name: robot.name.clone(),
        links,
        hand,
        hand_from_tcp: Pose::from_position(DVec3::Z * gripper.hand_from_tcp_z),
        gripper: Gripper {
            fingers,
            max_width: gripper.max_width,
            max_force: gripper.max_force,
            pad_size: gripper.pad_size,
        },
        home: arm.home.clone(),
        drives: Some(Drives {
            arm_kp: arm_drives.kp.clone(),
            arm_kv: arm_drives.kv.clone(),
            arm_armature: arm_drives.armature,
            arm_damping: arm_drives.damping,
            grip_force_n: grip.force_n,
            grip_kp: grip.kp,
            grip_overclose_m: grip.overclose_m,
            finger_armature: grip.armature,
            finger_damping: grip.damping,
            pad_friction: grip.pad_friction,
            hull_friction: arm_drives.hull_friction,
        }),
        reach: arm.reach,
        hand_from_wrist_camera: robot
            .wrist_camera
            .as_ref()
            .or(gripper.wrist_camera.as_ref())
            .map(WristCameraData::pose),
        never_colliding,
    }
}

/// Pairs of links that cannot collide: the listed ones, neighbouring links and the two fingers. Each pair and the list
/// are in ascending order.
fn never_colliding(
    links: &[RobotLink],
    fingers: [usize; 2],
    hand: usize,
    index_of: &dyn Fn(&str) -> Option<usize>,
    named: [&[[String; 2]]; 3],
) -> Vec<(usize, usize)> {
    let indices = |name: &str| -> Vec<usize> {
        if name == GRIPPER { (hand..links.len()).collect() } else { index_of(name).into_iter().collect() }
    };
    let neighbours = links.iter().enumerate().filter_map(|(index, link)| Some((link.parent?, index)));
    let mut pairs: Vec<(usize, usize)> = neighbours.chain([(fingers[0], fingers[1])]).collect();
    for [a, b] in named.into_iter().flatten() {
        for a in indices(a) {
            pairs.extend(indices(b).into_iter().map(|b| (a, b)));
        }
    }
    let mut pairs: Vec<(usize, usize)> = pairs.into_iter().map(|(a, b)| (a.min(b), a.max(b))).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Number of joints of the links.
fn joints(links: &[LinkData]) -> usize {
    links.iter().filter(|link| link.joint.is_some()).count()
}

//! The robot's bodies, actuators and limits.

use genmanip_core::{ArmPhysics, Drives, JointKind, MassProperties, RobotJoint, RobotModel};

use super::{GRIP, Parts, geom, inertial, mesh, with_pose};
use crate::engine_settings::CheckedSettings;
use crate::xml::Element;

/// Pieces whose centres are at most this much farther from the TCP than the nearest one also count as pads, m.
const PAD_TIE_M: f64 = 1e-3;
/// Time constant of the finger coupling, in physics steps: as stiff as the integrator allows.
const COUPLING_STEPS: f64 = 2.5;

/// Body of a payload that is rigidly attached to the hand.
const PAYLOAD: &str = "robot/payload";

pub(crate) fn robot_body(link: &str) -> String {
    format!("robot/{link}")
}

pub(crate) fn robot_joint(joint: &str) -> String {
    format!("robot/{joint}")
}

/// Name of a finger's joint; `None` for a fixed finger.
pub(crate) fn finger_joint(robot: &RobotModel, finger: usize) -> Option<String> {
    let link = robot.links.get(*robot.gripper.fingers.get(finger)?)?;
    link.joint.as_ref().map(|joint| robot_joint(&joint.name))
}

/// Adds the robot; `payload`, in the hand's frame, is rigidly attached to the hand, and the drives do not compensate
/// its weight.
pub(super) fn add(
    parts: &mut Parts,
    robot: &RobotModel,
    start: &[f64],
    settings: &CheckedSettings,
    drives: &Drives,
    payload: Option<&MassProperties>,
) {
    let arm = settings.physics.arm.as_ref();
    let timestep_s = settings.physics.timestep_s();
    let mut writer = Writer { robot, start: start.iter().copied(), settings, drives, payload };
    let roots = (0..robot.links.len()).filter(|&index| robot.links[index].parent.is_none());
    for root in roots {
        let body = writer.link_body(parts, root);
        parts.bodies.push(body);
    }
    for &(a, b) in &robot.never_colliding {
        if let (Some(a), Some(b)) = (robot.links.get(a), robot.links.get(b)) {
            parts
                .contacts
                .push(Element::new("exclude").text("body1", &robot_body(&a.name)).text("body2", &robot_body(&b.name)));
        }
    }
    add_arm_drives(parts, robot, drives, arm.map(|arm| arm.latency_s), timestep_s);
    add_gripper_drive(parts, robot, drives, timestep_s);
}

struct Writer<'a, S: Iterator<Item = f64>> {
    robot: &'a RobotModel,
    start: S,
    settings: &'a CheckedSettings,
    drives: &'a Drives,
    payload: Option<&'a MassProperties>,
}

impl<S: Iterator<Item = f64>> Writer<'_, S> {
    fn link_body(&mut self, parts: &mut Parts, index: usize) -> Element {
        let robot = self.robot;
        let link = &robot.links[index];
        let is_finger = robot.gripper.fingers.contains(&index);
        let mut body =
            with_pose(Element::named("body", &robot_body(&link.name)), &link.parent_from_link).number("gravcomp", 1.0);
        if link.mass.mass_kg > 0.0 {
            body.push(inertial(&link.mass));
        }
        if let Some(joint) = &link.joint {
            let start = if is_finger { robot.gripper.max_width / 2.0 } else { self.start.next().unwrap_or(0.0) };
            parts.qpos.push(start);
            body.push(self.joint_element(joint, is_finger));
        }
        let pads = if is_finger { pad_pieces(robot, index) } else { Vec::new() };
        for (number, piece) in link.pieces.iter().enumerate() {
            let name = format!("robot/{}/{number}", link.name);
            parts.assets.extend(mesh(piece, &name));
            let class = if pads.contains(&number) { "pad" } else { "robot" };
            body.push(geom(&name, class, piece, &name));
        }
        if let Some(payload) = self.payload.filter(|_| index == robot.hand) {
            body.push(Element::named("body", PAYLOAD).child(inertial(payload)));
        }
        for child in (0..robot.links.len()).filter(|&child| robot.links[child].parent == Some(index)) {
            let child = self.link_body(parts, child);
            body.push(child);
        }
        body
    }

    fn joint_element(&self, joint: &RobotJoint, is_finger: bool) -> Element {
        let drives = self.drives;
        let kind = match joint.kind {
            JointKind::Revolute => "hinge",
            JointKind::Prismatic => "slide",
        };
        let element = Element::named("joint", &robot_joint(&joint.name))
            .text("type", kind)
            .numbers("axis", &joint.axis.to_array())
            .numbers("range", &[joint.lower, joint.upper]);
        if is_finger {
            return element.number("armature", drives.finger_armature).number("damping", drives.finger_damping);
        }
        let own = |list: fn(&ArmPhysics) -> &Vec<f64>| {
            let number = self.robot.arm_joints().position(|other| other.name == joint.name)?;
            list(self.settings.physics.arm.as_ref()?).get(number).copied()
        };
        // The engine counts gravity compensation as actuator force, so that it is part of the published torque limit.
        let mut element = element
            .number("armature", drives.arm_armature)
            .number("damping", own(|arm| &arm.damping).unwrap_or(drives.arm_damping))
            .text("actuatorgravcomp", "true")
            .numbers("actuatorfrcrange", &[-joint.max_effort, joint.max_effort]);
        if let Some(friction_loss) = own(|arm| &arm.friction_loss) {
            element = element
                .number("frictionloss", friction_loss)
                .numbers("solimpfriction", &self.settings.engine.joint_friction_solimp);
        }
        element
    }
}

/// Pad pieces of a finger: those whose centre is nearest to the TCP with the gripper closed.
fn pad_pieces(robot: &RobotModel, finger: usize) -> Vec<usize> {
    let poses = robot.link_poses(&robot.home, 0.0);
    let (Some(world_from_finger), Some(world_from_hand)) = (poses.get(finger), poses.get(robot.hand)) else {
        return Vec::new();
    };
    let tcp = world_from_hand.transform_point(robot.hand_from_tcp.position);
    let distances: Vec<f64> = robot.links[finger]
        .pieces
        .iter()
        .map(|piece| world_from_finger.transform_point(piece.link_from_piece.position).distance(tcp))
        .collect();
    let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
    (0..distances.len()).filter(|&index| distances[index] <= nearest + PAD_TIE_M).collect()
}

/// PD drives: a position and a velocity servo per joint; the latter tracks the command's velocity.
///
/// With a latency, set points take effect at the time that they are for, and the latency later. A position set point is
/// that of the end of a physics step, hence one step more; a velocity set point is the mean over the step.
fn add_arm_drives(parts: &mut Parts, robot: &RobotModel, drives: &Drives, latency_s: Option<f64>, timestep_s: f64) {
    let gain = |gains: &[f64], index: usize| gains.get(index).or(gains.last()).copied().unwrap_or(0.0);
    let position_delay = latency_s.map_or(0.0, |latency| latency + timestep_s);
    let velocity_delay = latency_s.unwrap_or(0.0);
    let kinds =
        [("position", "kp", &drives.arm_kp, position_delay), ("velocity", "kv", &drives.arm_kv, velocity_delay)];
    for (kind, key, gains, delay_s) in kinds {
        for (index, joint) in robot.arm_joints().enumerate() {
            let mut drive = Element::new(kind)
                .text("name", &format!("arm/{}/{kind}", joint.name))
                .text("joint", &robot_joint(&joint.name))
                .number(key, gain(gains, index));
            if delay_s > 0.0 {
                drive = drive
                    .number("delay", delay_s)
                    .number("nsample", (delay_s / timestep_s).ceil() + 2.0)
                    .text("interp", "linear");
            }
            parts.actuators.push(drive);
        }
    }
}

/// A force-limited drive on the opening width, and an equality constraint that couples the fingers like the gripper's
/// gear.
fn add_gripper_drive(parts: &mut Parts, robot: &RobotModel, drives: &Drives, timestep_s: f64) {
    let (Some(first), Some(second)) = (finger_joint(robot, 0), finger_joint(robot, 1)) else { return };
    let term = |joint: &str| Element::new("joint").text("joint", joint).number("coef", 1.0);
    parts.tendons.push(Element::named("fixed", "width").child(term(&first)).child(term(&second)));
    parts.equalities.push(
        Element::named("joint", "fingers")
            .text("joint1", &second)
            .text("joint2", &first)
            .numbers("polycoef", &[0.0, 1.0, 0.0, 0.0, 0.0])
            .numbers("solref", &[COUPLING_STEPS * timestep_s, 1.0]),
    );
    // A tendon force acts on each finger in full, so the limit is halved.
    let per_finger = drives.grip_force_n / 2.0;
    parts.actuators.push(
        Element::named("position", GRIP)
            .text("tendon", "width")
            .number("kp", drives.grip_kp)
            .numbers("forcerange", &[-per_finger, per_finger]),
    );
}

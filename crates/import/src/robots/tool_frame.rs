//! Tool frame of an arm: a flange, a hand or a frame on it, before the fingers.

use genmanip_core::glam::{DMat3, DVec3};
use genmanip_core::{JointKind, MassProperties, Pose, RobotLink, RobotModel};

/// Parts of names of finger joints, and (`FINGER_LINKS`) of finger links.
const FINGER_JOINTS: [&str; 7] = ["finger", "gripper", "knuckle", "jaw", "claw", "thumb", "grip_"];
const FINGER_LINKS: [&str; 5] = ["finger", "knuckle", "jaw", "claw", "thumb"];
/// Parts of names of tool frames, best first.
const TOOL_NAMES: [&str; 7] = ["tcp", "tool0", "tool", "grasp", "ee_", "end_effector", "gripper_frame"];
/// Parts of names of links that carry sensors, which are no tools.
const SENSORS: [&str; 6] = ["camera", "optical", "imu", "sensor", "depth", "lidar"];
/// Maximum range of a prismatic joint that can be a finger, m. Chosen by hand.
const FINGER_SLIDE_M: f64 = 0.15;

/// For each link, true if it is a finger or descends from one.
pub fn behind_fingers(links: &[RobotLink]) -> Vec<bool> {
    let named = |name: &str, parts: &[&str]| parts.iter().any(|part| name.to_lowercase().contains(part));
    let mut behind = vec![false; links.len()];
    for (index, link) in links.iter().enumerate() {
        let above = link.parent.is_some_and(|parent| behind[parent]);
        let own = link.joint.as_ref().is_some_and(|joint| {
            let short_slide = joint.kind == JointKind::Prismatic && joint.upper - joint.lower < FINGER_SLIDE_M;
            let is_last = !(0..links.len()).any(|below| {
                links[below]
                    .joint
                    .as_ref()
                    .is_some_and(|joint| joint.kind == JointKind::Revolute && joint.mimic.is_none())
                    && is_below(links, below, index)
            });
            named(&joint.name, &FINGER_JOINTS)
                || named(&link.name, &FINGER_LINKS)
                || is_last && short_slide && joints_above(links, index) > 1
        });
        behind[index] = above || own;
    }
    behind
}

/// For each link, true if it is a sensor or descends from one.
fn behind_sensors(links: &[RobotLink]) -> Vec<bool> {
    let mut behind = vec![false; links.len()];
    for (index, link) in links.iter().enumerate() {
        let name = link.name.to_lowercase();
        let above = link.parent.is_some_and(|parent| behind[parent]);
        behind[index] = above || SENSORS.iter().any(|part| name.contains(part));
    }
    behind
}

fn is_below(links: &[RobotLink], mut link: usize, ancestor: usize) -> bool {
    while let Some(parent) = links[link].parent {
        if parent == ancestor {
            return true;
        }
        link = parent;
    }
    false
}

/// Number of independent joints from a link, its own included, up to the root; mimic joints do not count.
fn joints_above(links: &[RobotLink], mut link: usize) -> usize {
    let moves = |link: usize| usize::from(links[link].joint.as_ref().is_some_and(|joint| joint.mimic.is_none()));
    let mut joints = moves(link);
    while let Some(parent) = links[link].parent {
        link = parent;
        joints += moves(link);
    }
    joints
}

/// Tool frame at the end of the arm with the most joints, fingers excluded: preferably a leaf without geometry whose
/// name is that of a tool frame, otherwise the last link before a branch.
pub fn tool_frame(links: &[RobotLink]) -> usize {
    let mut left_out = behind_fingers(links);
    let depth = |link: usize| joints_above(links, link);
    // A hand without an arm: the longest finger is treated as the arm.
    if (0..links.len()).filter(|link| !left_out[*link]).all(|link| depth(link) == 0) {
        left_out = vec![false; links.len()];
    }
    let deepest_of = |left_out: &[bool]| (0..links.len()).filter(|link| !left_out[*link]).map(depth).max();
    let without_sensors: Vec<bool> = behind_sensors(links).iter().zip(&left_out).map(|(a, b)| *a || *b).collect();
    if deepest_of(&without_sensors) == deepest_of(&left_out) {
        left_out = without_sensors;
    }
    let kept: Vec<usize> = (0..links.len()).filter(|link| !left_out[*link]).collect();
    let deepest = kept.iter().map(|link| depth(*link)).max().unwrap_or(0);
    let children = |link: usize| kept.iter().copied().filter(move |child| links[*child].parent == Some(link));
    let frames: Vec<usize> = kept
        .iter()
        .copied()
        .filter(|link| depth(*link) == deepest && links[*link].pieces.is_empty() && children(*link).next().is_none())
        .collect();
    let name = |link: usize| links[link].name.to_lowercase();
    let named = TOOL_NAMES.iter().find_map(|part| frames.iter().copied().find(|link| name(*link).contains(part)));
    if let Some(frame) = named.or(frames.last().copied()) {
        return frame;
    }
    let mut last = kept.iter().copied().find(|link| depth(*link) == deepest).unwrap_or(0);
    while let (Some(child), None) = (children(last).next(), children(last).nth(1)) {
        last = child;
    }
    last
}

/// Adds a link without geometry at the tool frame: a link that a joint moves cannot be the hand.
pub fn add_tool_frame(robot: &mut RobotModel) {
    let parent = &robot.links[robot.hand];
    robot.links.push(RobotLink {
        name: format!("{} (tool)", parent.name),
        parent: Some(robot.hand),
        parent_from_link: Pose::IDENTITY,
        joint: None,
        visual: vec![],
        pieces: vec![],
        mass: MassProperties { mass_kg: 0.0, center: DVec3::ZERO, inertia: DMat3::ZERO },
    });
    robot.hand = robot.links.len() - 1;
    robot.gripper.fingers = [robot.hand; 2];
}

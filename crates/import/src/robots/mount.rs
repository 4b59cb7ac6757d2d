//! Place of one of the program's grippers on the arm of a URDF.

use genmanip_assets::AssetError;
use genmanip_assets::robots::{self as registry, PartKind};
use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, RobotModel};
use genmanip_motion::triangulate;
use serde_json::Value;

use super::tool_frame::behind_fingers;

/// Distance of the tool frame from the link that carries the fingers, along the approach, above which it is taken to
/// lie between the fingertips, m. Chosen by hand.
const FINGERTIPS_M: f64 = 0.02;
/// Distance by which shapes may reach beyond the tool frame with the gripper still mounted at the frame, m, and (`AROUND`)
/// number of directions in which a shape is compared with the tool's axis. Chosen by hand.
const FLANGE_M: f64 = 0.01;
const AROUND: u32 = 16;
/// Pose of the gripper's hand frame in the tool frame: the hand's z axis is the axis of the tool frame that points away
/// from the arm. If the tool frame lies between the tips of the fingers that the gripper replaces, so does the gripper's
/// tool centre point; without such fingers, the gripper stands on the shapes that reach beyond the tool frame.
///
/// # Errors
/// If there is no such gripper.
pub fn mount(robot: &RobotModel, own_hand: Option<usize>, gripper: &str) -> Result<Pose, AssetError> {
    let turn = turn(robot);
    let text = registry::find(PartKind::Gripper, gripper)?;
    let file: Value = serde_json::from_str(&text).unwrap_or_default();
    let length = file["hand_from_tcp_z"].as_f64().unwrap_or(0.0);
    let poses = robot.link_poses(&robot.home, 0.0);
    let tool = poses[robot.hand];
    let ahead =
        own_hand.map_or(0.0, |hand| (tool.position - poses[hand].position).dot(tool.rotation * turn * DVec3::Z));
    let forward = match own_hand {
        Some(_) if ahead > FINGERTIPS_M => -length,
        Some(_) => 0.0,
        None => Some(shapes_ahead_m(robot, turn * DVec3::Z)).filter(|ahead| *ahead > FLANGE_M).unwrap_or(0.0),
    };
    Ok(Pose::new(turn * DVec3::Z * forward, turn))
}

/// Distance by which the shapes that move with the tool frame reach beyond it on its axis, m: that of the farthest corner
/// of a shape that the axis, a unit vector in the tool frame, passes through.
fn shapes_ahead_m(robot: &RobotModel, axis: DVec3) -> f64 {
    let carrier = |mut link: usize| {
        while let (None, Some(parent)) = (&robot.links[link].joint, robot.links[link].parent) {
            link = parent;
        }
        link
    };
    let poses = robot.link_poses(&robot.home, 0.0);
    let (first, second) = axis.any_orthonormal_pair();
    let mut ahead: f64 = 0.0;
    for (index, link) in robot.links.iter().enumerate().filter(|(index, _)| carrier(*index) == carrier(robot.hand)) {
        let tool_from_link = poses[robot.hand].inverse() * poses[index];
        for (corners, _) in link.pieces.iter().filter_map(|piece| triangulate(piece).ok()) {
            let corners: Vec<DVec3> = corners.iter().map(|corner| tool_from_link.transform_point(*corner)).collect();
            let mut around = (0..AROUND).map(|side| f64::from(side) * std::f64::consts::TAU / f64::from(AROUND));
            let is_on_axis = around.all(|angle| {
                let outwards = first * angle.cos() + second * angle.sin();
                corners.iter().any(|corner| corner.dot(outwards) >= 0.0)
            });
            let farthest = corners.iter().map(|corner| corner.dot(axis)).fold(0.0, f64::max);
            ahead = ahead.max(if is_on_axis { farthest } else { 0.0 });
        }
    }
    ahead
}

/// Link that carries the fingers of the URDF and the tool frame, without a joint between; `None` if there is none.
pub fn own_hand(robot: &RobotModel) -> Option<usize> {
    let fingers = behind_fingers(&robot.links);
    let carrier = (0..robot.links.len()).find_map(|link| {
        let parent = robot.links[link].parent?;
        (fingers[link] && !fingers[parent]).then_some(parent)
    })?;
    let is_hand =
        robot.hand == carrier || is_fixed_to(robot, robot.hand, carrier) || is_fixed_to(robot, carrier, robot.hand);
    is_hand.then_some(carrier)
}

/// True if a link descends from another one without a joint between.
pub fn is_fixed_to(robot: &RobotModel, mut link: usize, ancestor: usize) -> bool {
    while let (Some(parent), None) = (robot.links[link].parent, &robot.links[link].joint) {
        if parent == ancestor {
            return true;
        }
        link = parent;
    }
    false
}

/// Rotation `tool_from_hand` of the gripper.
fn turn(robot: &RobotModel) -> DQuat {
    let poses = robot.link_poses(&robot.home, 0.0);
    let tool = poses[robot.hand];
    let mut above = Vec::new();
    let mut link = Some(robot.hand);
    while let Some(index) = link {
        if robot.links[index].joint.is_some() {
            above.push(index);
        }
        link = robot.links[index].parent;
    }
    let Some(&last) = above.first() else { return DQuat::IDENTITY };
    // "Away" is measured from the joint before the last one, which always lies behind the flange.
    let before = above.get(1).map_or(DVec3::ZERO, |link| poses[*link].position);
    let away = tool.position - before;
    let axis = robot.links[last].joint.as_ref().map(|joint| poses[last].transform_vector(joint.axis));
    let through = axis.filter(|axis| {
        let offset = tool.position - poses[last].position;
        (offset - *axis * offset.dot(*axis)).length() < 0.02 && axis.dot(away).abs() > 0.02
    });
    let approach = through.map_or(away.normalize_or(DVec3::Z), |axis| axis * axis.dot(away).signum());
    let in_tool = tool.rotation.inverse() * approach;
    let (axis, _) = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z]
        .into_iter()
        .map(|axis| (axis, axis.dot(in_tool)))
        .fold((DVec3::Z, f64::NEG_INFINITY), |best, found| if found.1 > best.1 { found } else { best });
    DQuat::from_rotation_arc(DVec3::Z, axis)
}

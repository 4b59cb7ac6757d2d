//! Contact candidates of the gripper on a moving link: grasps of the handle and pushes.

use std::f64::consts::TAU;

use genmanip_assets::HANDLE;
use genmanip_core::{ObjectLink, Pose, RobotModel, Seed};
use glam::{DQuat, DVec3};

use super::{JointSettings, Motion};

/// A candidate contact of the gripper with a moving link.
#[derive(Clone, Debug, PartialEq)]
pub struct JointContact {
    /// TCP pose at the start of the motion.
    pub world_from_tcp: Pose,
    /// Contact point that moves with the link, TCP frame.
    pub tool_point: DVec3,
    /// Gripper opening during the approach (m).
    pub open_width: f64,
    /// Commanded gripper width while the joint moves (m).
    pub hold_width: f64,
    /// Distance between gripper and link before contact (m); 0 for a grasp.
    pub gap_m: f64,
    /// True if the gripper need not follow the link's rotation: the shares of [`JointSettings::follow`] are then tried.
    pub turns_freely: bool,
    /// Share of the link's rotation that the gripper follows.
    pub follow: f64,
    /// Heuristic cost; contacts are tried in ascending order.
    pub cost: f64,
}

/// Preferred approach direction: down and slightly forward. Chosen: about the gripper's direction at home.
const PREFERRED_APPROACH: DVec3 = DVec3::new(0.35, 0.0, -0.94);
/// Total free space between the pads and a handle, both sides (m); chosen.
const FINGER_CLEARANCE_M: f64 = 0.016;
/// Squeeze: difference between handle width and commanded width while holding (m). Chosen by hand; smaller is gentler.
const SQUEEZE_M: f64 = 0.006;
/// Squeeze of a handle that pivots between the pads: a stronger grip resists the rotation and tips the object over.
/// At 1.5 mm (15 N, about 0.5 N·m at pad friction 1) bins of 0.6 kg, which tip at 0.4 N·m, fell over; chosen.
const PIVOT_SQUEEZE_M: f64 = 0.0006;
/// Distances from the TCP to the side, back and tip of the closed fingers [m]: half a pad's width, both fingers' depth,
/// and the tip; from the colliders of the Panda's fingers in `assets`.
const SIDE_M: f64 = 0.0105;
const BACK_M: f64 = 0.025;
const TIP_M: f64 = 0.009;
/// Number of surface points sampled for pushes, and of pushes kept. Search limits, chosen.
const PUSH_POINTS: usize = 160;
const PUSHES: usize = 10;

/// Contact candidates for a joint motion, lowest cost first.
pub(crate) fn contacts(
    link: &ObjectLink,
    motion: &Motion,
    robot: &RobotModel,
    settings: &JointSettings,
) -> Vec<JointContact> {
    let mut found = grasps(link, motion, robot);
    found.extend(pushes(link, motion, settings));
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    found
}

fn cost(world_from_tcp: &Pose) -> f64 {
    world_from_tcp.transform_vector(DVec3::Z).angle_between(PREFERRED_APPROACH)
}

/// True for approach directions that point neither up nor back towards the robot.
fn is_allowed_approach(approach: DVec3) -> bool {
    approach.z < 0.3 && approach.x > -0.7
}

/// Grasps of the handle with all approach directions, closing directions and depths.
fn grasps(link: &ObjectLink, motion: &Motion, robot: &RobotModel) -> Vec<JointContact> {
    let handle = link.visual.iter().filter(|part| part.name == HANDLE);
    let points: Vec<DVec3> = handle
        .flat_map(|part| {
            part.mesh.positions.iter().map(|point| {
                motion.world_from_link.transform_point(part.link_from_part.transform_point(point.as_dvec3()))
            })
        })
        .collect();
    let pad = robot.gripper.pad_size;
    let mut found = Vec::new();
    for (closing, slant) in closing_directions() {
        let closing = motion.world_from_link.transform_vector(closing);
        // Pads that close along the joint axis let the handle pivot.
        let pivots = closing.dot(motion.axis).abs() > 0.99;
        let start = closing.any_orthonormal_vector();
        for turn in 0..24 {
            let approach = DQuat::from_axis_angle(closing, f64::from(turn) / 24.0 * TAU) * start;
            if !is_allowed_approach(approach) {
                continue;
            }
            for (share, side) in [1.0, 0.7, 0.5].into_iter().flat_map(|share| [(share, 1.0), (share, -1.0)]) {
                let Some((point, width)) = between_pads(&points, approach, closing, share, pad.z) else { continue };
                if width + FINGER_CLEARANCE_M > robot.gripper.max_width {
                    continue;
                }
                let y = closing * side;
                let world_from_tcp = Pose::from_axes(point, y.cross(approach), y, approach);
                found.push(JointContact {
                    world_from_tcp,
                    tool_point: DVec3::ZERO,
                    open_width: width + FINGER_CLEARANCE_M,
                    hold_width: (width - if pivots { PIVOT_SQUEEZE_M } else { SQUEEZE_M }).max(0.0),
                    gap_m: 0.0,
                    follow: 1.0,
                    cost: cost(&world_from_tcp) + 0.15 + 0.3 * (1.0 - share) + slant,
                    turns_freely: pivots,
                });
            }
        }
    }
    found
}

/// Closing directions in the link frame, each with its cost: the axes, then oblique directions.
fn closing_directions() -> Vec<(DVec3, f64)> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut found: Vec<(DVec3, f64)> = axes.iter().map(|&axis| (axis, 0.0)).collect();
    for &one in &axes {
        for &other in axes.iter().filter(|&&other| other != one) {
            found.extend([0.55, -0.55].map(|slant| ((one + other * slant).normalize(), 3.0)));
        }
    }
    found
}

/// TCP position at which the pads cover a share of the near end of a handle, and the handle's width there (m); `None`
/// without points.
fn between_pads(
    points: &[DVec3],
    approach: DVec3,
    closing: DVec3,
    share: f64,
    pad_length: f64,
) -> Option<(DVec3, f64)> {
    let across = closing.cross(approach);
    let range = |axis: DVec3, points: &mut dyn Iterator<Item = &DVec3>| {
        points
            .map(|point| point.dot(axis))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let (near, far) = range(approach, &mut points.iter());
    let depth = share * (far - near - 0.001).min(pad_length);
    let covered = |point: &&DVec3| point.dot(approach) <= near + depth;
    let (low, high) = range(closing, &mut points.iter().filter(covered));
    let (left, right) = range(across, &mut points.iter().filter(covered));
    let tcp =
        approach * (near + depth - pad_length / 2.0) + closing * (0.5 * (low + high)) + across * (0.5 * (left + right));
    (tcp.is_finite() && depth > 0.003).then_some((tcp, high - low))
}

/// Pushes with closed fingers on faces opposite to the motion, far from the axis.
fn pushes(link: &ObjectLink, motion: &Motion, settings: &JointSettings) -> Vec<JointContact> {
    let mut points: Vec<(f64, DVec3, DVec3)> = Vec::new();
    for (index, part) in link.visual.iter().enumerate() {
        let rng = &mut Seed::new(0).fork("push points").fork_index(index as u64).rng();
        for (point, normal) in part.mesh.sample_surface(PUSH_POINTS / link.visual.len().max(1), rng) {
            let world_from_part = motion.world_from_link * part.link_from_part;
            let (point, normal) = (world_from_part.transform_point(point), world_from_part.transform_vector(normal));
            let (direction, lever) = motion.velocity(point);
            if normal.dot(direction) < -0.8 {
                points.push((lever, point, direction));
            }
        }
    }
    points.sort_by(|a, b| b.0.total_cmp(&a.0));
    let longest = points.first().map_or(0.0, |point| point.0);
    // Every n-th point of the outer part, farthest from the axis first.
    let outer: Vec<_> = points.into_iter().filter(|point| point.0 >= 0.6 * longest).collect();
    let stride = (outer.len() / PUSHES).max(1);
    let chosen = outer.iter().step_by(stride);
    chosen.flat_map(|&(lever, point, direction)| pushes_at(point, direction, lever / longest, settings)).collect()
}

fn pushes_at(point: DVec3, direction: DVec3, lever: f64, settings: &JointSettings) -> Vec<JointContact> {
    let mut found = Vec::new();
    let start = direction.any_orthonormal_vector();
    for turn in 0..12 {
        let around = DQuat::from_axis_angle(direction, f64::from(turn) / 12.0 * TAU) * start;
        // Pushes with the fingertip, straight and tilted.
        for tilt in [0.0, 0.4, 0.8] {
            let y = direction.cross(around);
            let approach = DQuat::from_axis_angle(y, tilt) * direction;
            for (x, y) in [(y.cross(approach), y), (-y, y.cross(approach))] {
                let tool = DVec3::new(0.0, 0.0, TIP_M);
                // A tilt lifts the centre of the tip off the face.
                let gap = settings.gap_m + tilt.sin() * BACK_M.min(0.5 * (SIDE_M + BACK_M));
                found.push((Pose::from_axes(DVec3::ZERO, x, y, approach), tool, gap, 0.1));
            }
        }
        // Pushes with the wide and narrow sides of the fingers.
        for sign in [1.0, -1.0] {
            let face = direction * sign;
            let broad = Pose::from_axes(DVec3::ZERO, face, around.cross(face), around);
            found.push((broad, DVec3::new(sign * SIDE_M, 0.0, 0.0), settings.gap_m, 0.25));
            let narrow = Pose::from_axes(DVec3::ZERO, face.cross(around), face, around);
            found.push((narrow, DVec3::new(0.0, sign * BACK_M, -0.006), settings.gap_m, 0.35));
        }
    }
    found
        .into_iter()
        .filter(|(pose, ..)| is_allowed_approach(pose.transform_vector(DVec3::Z)))
        .map(|(pose, tool_point, gap_m, kind)| {
            let world_from_tcp =
                Pose { position: point - direction * gap_m - pose.transform_vector(tool_point), ..pose };
            let cost = cost(&world_from_tcp) + kind + 0.5 * (1.0 - lever);
            JointContact {
                world_from_tcp,
                tool_point,
                open_width: 0.0,
                hold_width: 0.0,
                gap_m,
                turns_freely: true,
                follow: 1.0,
                cost,
            }
        })
        .collect()
}

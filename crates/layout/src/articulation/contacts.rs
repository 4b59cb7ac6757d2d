//! Where the hand may take hold of a link or push it.

use std::f64::consts::TAU;

use genmanip_assets::HANDLE;
use genmanip_core::{ObjectLink, Pose, RobotModel, Seed};
use glam::{DQuat, DVec3};

use super::{JointSettings, Motion};

/// A place of the hand on a moving link.
#[derive(Clone, Debug, PartialEq)]
pub struct JointContact {
    /// Pose of the tcp at the start of the motion.
    pub world_from_tcp: Pose,
    /// Point of the hand that stays with the link, in the tcp's frame.
    pub tool_point: DVec3,
    /// Opening on the way to the contact, metres.
    pub open_width: f64,
    /// Width commanded while the joint moves, metres.
    pub hold_width: f64,
    /// Distance between the hand and the link before it touches, metres; 0 when the pads hold it.
    pub gap_m: f64,
    /// Whether the hand need not follow the link's turn.
    pub turns_freely: bool,
    /// Share of the link's turn that the hand follows.
    pub follow: f64,
    /// What a person would call awkward about it; the least is tried first.
    pub awkwardness: f64,
}

/// Where the arm points by nature when it works on a table: down and a little forward; chosen, about the hand at home.
const NATURAL: DVec3 = DVec3::new(0.35, 0.0, -0.94);
/// Room between the pads and a handle on both sides together, metres; chosen.
const FINGER_ROOM_M: f64 = 0.016;
/// How much narrower than the handle the width is that is commanded while holding, metres; the less, the gentler; chosen.
const SQUEEZE_M: f64 = 0.006;
/// The same where the handle is to turn between the pads: pads that press harder hold it against the turn and tip the
/// whole object over instead. At 1.5 mm (15 N, which pads of friction 1 turn into some 0.5 N·m) bins of 0.6 kg, which
/// tip at 0.4 N·m, were dragged over; chosen.
const PIVOT_SQUEEZE_M: f64 = 0.0006;
/// Distance of a closed finger's side, back and tip from the tcp, metres: half a pad's breadth, both fingers' depth, and
/// the tip; from the colliders of the Panda's fingers in `assets`.
const SIDE_M: f64 = 0.0105;
const BACK_M: f64 = 0.025;
const TIP_M: f64 = 0.009;
/// Points of the surface that are looked at for a push, and how many of them are kept; bounds of
/// the search, chosen.
const PUSH_POINTS: usize = 160;
const PUSHES: usize = 10;

/// Contacts on a link for a motion, least awkward first.
pub(crate) fn of_link(
    link: &ObjectLink,
    motion: &Motion,
    robot: &RobotModel,
    settings: &JointSettings,
) -> Vec<JointContact> {
    let mut found = holds(link, motion, robot);
    found.extend(pushes(link, motion, settings));
    found.sort_by(|a, b| a.awkwardness.total_cmp(&b.awkwardness));
    found
}

fn awkwardness(world_from_tcp: &Pose) -> f64 {
    world_from_tcp.transform_vector(DVec3::Z).angle_between(NATURAL)
}

/// The hand never points up or back at the robot.
fn is_natural(approach: DVec3) -> bool {
    approach.z < 0.3 && approach.x > -0.7
}

/// The handle between the pads, from all directions.
fn holds(link: &ObjectLink, motion: &Motion, robot: &RobotModel) -> Vec<JointContact> {
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
    for (closing, slant) in closings() {
        let closing = motion.world_from_link.transform_vector(closing);
        // Pads that close along the axis of the joint turn on the handle like on a hinge.
        let pivots = closing.dot(motion.axis).abs() > 0.99;
        let start = closing.any_orthonormal_vector();
        for turn in 0..24 {
            let approach = DQuat::from_axis_angle(closing, f64::from(turn) / 24.0 * TAU) * start;
            if !is_natural(approach) {
                continue;
            }
            for (share, side) in [1.0, 0.7, 0.5].into_iter().flat_map(|share| [(share, 1.0), (share, -1.0)]) {
                let Some((point, width)) = between_pads(&points, approach, closing, share, pad.z) else { continue };
                if width + FINGER_ROOM_M > robot.gripper.max_width {
                    continue;
                }
                let y = closing * side;
                let world_from_tcp = Pose::from_axes(point, y.cross(approach), y, approach);
                found.push(JointContact {
                    world_from_tcp,
                    tool_point: DVec3::ZERO,
                    open_width: width + FINGER_ROOM_M,
                    hold_width: (width - if pivots { PIVOT_SQUEEZE_M } else { SQUEEZE_M }).max(0.0),
                    gap_m: 0.0,
                    follow: 1.0,
                    awkwardness: awkwardness(&world_from_tcp) + 0.15 + 0.3 * (1.0 - share) + slant,
                    turns_freely: pivots,
                });
            }
        }
    }
    found
}

/// Closing directions in the link's frame with what is awkward about them: its axes, then directions between them.
fn closings() -> Vec<(DVec3, f64)> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut found: Vec<(DVec3, f64)> = axes.iter().map(|&axis| (axis, 0.0)).collect();
    for &one in &axes {
        for &other in axes.iter().filter(|&&other| other != one) {
            found.extend([0.55, -0.55].map(|slant| ((one + other * slant).normalize(), 3.0)));
        }
    }
    found
}

/// Where the tcp must be so that the pads cover the near end of a handle, or a share of it, and its width there.
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

/// Closed fingers against a face that the motion runs away from, far from the axis.
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
    // Spread over the outer half, the middle of the range first in line for its room on all sides.
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
        // The tip, straight and leaning.
        for lean in [0.0, 0.4, 0.8] {
            let y = direction.cross(around);
            let approach = DQuat::from_axis_angle(y, lean) * direction;
            for (x, y) in [(y.cross(approach), y), (-y, y.cross(approach))] {
                let tool = DVec3::new(0.0, 0.0, TIP_M);
                // Leaning lifts the middle of the tip off the face.
                let gap = settings.gap_m + lean.sin() * BACK_M.min(0.5 * (SIDE_M + BACK_M));
                found.push((Pose::from_axes(DVec3::ZERO, x, y, approach), tool, gap, 0.1));
            }
        }
        // The sides of the fingers: broad and narrow.
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
        .filter(|(pose, ..)| is_natural(pose.transform_vector(DVec3::Z)))
        .map(|(pose, tool_point, gap_m, kind)| {
            let world_from_tcp =
                Pose { position: point - direction * gap_m - pose.transform_vector(tool_point), ..pose };
            let awkwardness = awkwardness(&world_from_tcp) + kind + 0.5 * (1.0 - lever);
            JointContact {
                world_from_tcp,
                tool_point,
                open_width: 0.0,
                hold_width: 0.0,
                gap_m,
                turns_freely: true,
                follow: 1.0,
                awkwardness,
            }
        })
        .collect()
}

//! Scripts of the scripted operator for moving joints: hand poses that it wants to reach, from simulator truth.
//!
//! They stand in for a person who knows how such an object is handled: the hand comes to the handle from one direction,
//! closes or not, moves it along by eye, releases and leaves. Neither a planner nor a check of collisions or of the arm's
//! reach is involved, and the operator steers to the poses by feedback through its device.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{JointKind, ObjectModel, Pose};
use genmanip_layout::articulation::JointChange;
use genmanip_teleop::device::Control;
use genmanip_teleop::scripted::Waypoint;

use crate::Verb;
use crate::handle::{Handle, verb};

/// Distance from which the hand approaches, and to which it retreats, m.
const AWAY_M: f64 = 0.1;
/// Largest way (m) and angle (rad) of the link between two waypoints.
const STEP_M: f64 = 0.03;
const STEP_RAD: f64 = 0.25;
/// Distance from the tool to the tip of the fingers, m.
const TIP_M: f64 = 0.009;
/// Half of a finger's width, and distance kept between the fingers and what the handle is fixed to, m.
const SIDE_M: f64 = 0.0105;
const FRONT_M: f64 = 0.005;
/// Depth by which the tool stays behind the top of a handle that is gripped from above, m.
const DEPTH_M: f64 = 0.008;
/// Share of the wanted travel after which the hand releases a lid.
const LID_SHARE: f64 = 0.88;
/// Travel beyond the wanted position that the hand aims at while it pushes, m.
const BEYOND_M: f64 = 0.003;
/// Tolerances (m, rad) within which the operator accepts a waypoint: where precision matters, while it moves the link,
/// and (`COARSE`) on the way.
const PRECISE: (f64, f64) = (0.003, 0.06);
const MOVING: (f64, f64) = (0.008, 0.1);
const COARSE: (f64, f64) = (0.015, 0.12);

/// Difference between measured and commanded opening with which a verb's handle is held, m: a lid's pivots between the
/// pads, and a stronger grip would tip the box over.
pub fn squeeze_m(verb: Verb) -> Option<f64> {
    (verb == Verb::Lift).then_some(LID_SQUEEZE_M)
}

/// Squeeze of a handle that pivots between the pads, m.
const LID_SQUEEZE_M: f64 = 0.001;

/// Manner in which a person handles a link.
struct Manner {
    /// Approach direction of the hand in the link's frame.
    approach: DVec3,
    /// Closing direction of the fingers in the link's frame.
    closing: DVec3,
    /// True if the fingers close on the handle; false if they push with closed fingers.
    grasps: bool,
    /// Share of the link's rotation that the hand follows.
    follow: f64,
}

impl Manner {
    /// `None` for a kind of manipulation without a joint.
    fn of(verb: Verb, handle: &Handle) -> Option<Self> {
        // The front of an articulated object faces -x, also that of its links.
        let slanted = DVec3::new(0.42, 0.0, -0.91).normalize();
        let (down, across) = (DVec3::NEG_Z, DVec3::Y);
        Some(match verb {
            Verb::Push => Self { approach: slanted, closing: across, grasps: false, follow: 1.0 },
            Verb::Press => Self { approach: down, closing: across, grasps: false, follow: 0.0 },
            Verb::Turn => {
                let closing = if handle.half_m.x < handle.half_m.y { DVec3::X } else { DVec3::Y };
                // A lever is taller than wide: the hand tilts with it half-way and lets it pivot.
                let is_lever = handle.half_m.z > handle.half_m.x.max(handle.half_m.y);
                Self { approach: down, closing, grasps: true, follow: if is_lever { 0.5 } else { 1.0 } }
            }
            // A lid pivots between the pads, so that the hand need not tilt back as far.
            Verb::Lift => Self { approach: slanted, closing: across, grasps: true, follow: 0.6 },
            Verb::Pull => Self { approach: slanted, closing: across, grasps: true, follow: 1.0 },
            Verb::PickAndPlace => return None,
        })
    }
}

/// Waypoints that move a joint as a person would, for an arm whose tool starts at `world_from_tcp`. `None` if the object
/// has no such link.
pub fn joint_script(
    model: &ObjectModel,
    world_from_object: &Pose,
    joint_positions: &[f64],
    change: &JointChange,
    world_from_tcp: &Pose,
) -> Option<Vec<Waypoint>> {
    let handle = Handle::of(model, change.link, change.joint)?;
    let kind = model.links.get(change.link)?.joint.as_ref()?.kind;
    let kind_of_motion = verb(model, change);
    let manner = Manner::of(kind_of_motion, &handle)?;
    let wanted = *change.targets.first()?;
    // A person releases a lid before its stop.
    let share = if kind_of_motion == Verb::Lift { LID_SHARE } else { 1.0 };
    let target = change.from + (wanted - change.from) * share;
    let handle_at = |position: f64| handle.world_pose(model, world_from_object, joint_positions, position);
    let start = handle_at(change.from);
    let motion = (handle_at(change.from + (target - change.from) * 0.02).position - start.position).normalize_or_zero();

    let hand = |closing: DVec3| {
        let from_motion = start.rotation.inverse() * motion;
        let position = contact_point(&manner, &handle, from_motion);
        start * Pose::from_axes(position, closing.cross(manner.approach), closing, manner.approach)
    };
    let at = |contact: &Pose, position: f64| {
        let handle_from_tcp = start.inverse() * *contact;
        let now = handle_at(position);
        let moved = now * handle_from_tcp;
        let turn = now.rotation * start.rotation.inverse();
        let held = DQuat::IDENTITY.slerp(turn, manner.follow) * contact.rotation;
        Pose { position: moved.position, rotation: held }
    };
    // Of both ways to hold the handle, the one with the smaller rotation half-way.
    let middle = 0.5 * (change.from + target);
    let contact = [hand(manner.closing), hand(-manner.closing)]
        .into_iter()
        .min_by(|a, b| at(a, middle).angle_to(world_from_tcp).total_cmp(&at(b, middle).angle_to(world_from_tcp)))?;

    let back = |pose: Pose| Pose { position: pose.position - pose.transform_vector(DVec3::Z) * AWAY_M, ..pose };
    let waypoint = |world_from_tcp: Pose, (within_m, within_rad): (f64, f64), press: Option<Control>| Waypoint {
        world_from_tcp,
        within_m,
        within_rad,
        press,
    };
    let lever_m = handle_at(target).position.distance(start.position) / (target - change.from).abs();
    let beyond = match (manner.grasps, kind) {
        (true, _) => 0.0,
        (false, JointKind::Prismatic) => BEYOND_M,
        (false, JointKind::Revolute) => BEYOND_M / lever_m.max(0.02),
    };
    let end = target + beyond * (target - change.from).signum();
    let steps = (handle_at(end).position.distance(start.position) / STEP_M)
        .max(at(&contact, end).angle_to(&contact) / STEP_RAD)
        .ceil()
        .max(1.0) as usize;

    let grip = |now: bool| now.then_some(Control::Gripper);
    let mut script =
        vec![waypoint(back(contact), COARSE, grip(!manner.grasps)), waypoint(contact, PRECISE, grip(manner.grasps))];
    for step in 1..=steps {
        let pose = at(&contact, change.from + (end - change.from) * step as f64 / steps as f64);
        let is_last = step == steps;
        script.push(waypoint(pose, if is_last { PRECISE } else { MOVING }, grip(is_last && manner.grasps)));
    }
    script.push(waypoint(back(at(&contact, end)), COARSE, Some(Control::Finish)));
    Some(script)
}

/// Position of the tool at the contact in the handle's frame, m; `motion` is the direction of the handle's motion in
/// the same frame.
fn contact_point(manner: &Manner, handle: &Handle, motion: DVec3) -> DVec3 {
    let half_along = |direction: DVec3| direction.abs().dot(handle.half_m);
    let approach = manner.approach;
    if !manner.grasps {
        // The fingertips touch the face that the motion leads away from.
        return -motion * half_along(motion) - approach * TIP_M;
    }
    // Fingers reach over a handle that is deeper than they are.
    let mut point = -approach * (half_along(approach) - DEPTH_M).max(0.0);
    if approach.x > 0.0 {
        // They stop in front of what the handle is fixed to.
        let reach_m = TIP_M * approach.x + SIDE_M * manner.closing.cross(approach).x.abs();
        point.x = point.x.min(handle.half_m.x - FRONT_M - reach_m);
    }
    point
}

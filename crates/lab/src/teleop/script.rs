//! Script of a pick and place from simulator truth: the poses that the scripted operator wants to reach.

use genmanip_assets::GraspLibrary;
use genmanip_core::glam::DVec3;
use genmanip_core::{Aabb, Atom, Goal, InstanceId, Pose, ReferenceId, Relation};
use genmanip_rollout::Stage;
use genmanip_teleop::device::Control;
use genmanip_teleop::scripted::Waypoint;

/// Height of the tool above the grasp before and after it, m.
const APPROACH_M: f64 = 0.1;
/// Clearance between the lower edge of a carried object and the tops of the other objects, m.
const CLEARANCE_M: f64 = 0.08;
/// Height above its place at which an object is released, m.
const RELEASE_M: f64 = 0.01;
/// Half of the hand's width along the closing direction, (`FINGER_M`) length of the fingers below the hand, and
/// (`HAND_MARGIN_M`) half of the hand's thickness plus a margin, m.
const HAND_M: f64 = 0.1;
const FINGER_M: f64 = 0.05;
const HAND_MARGIN_M: f64 = 0.035;
/// Maximum angle between the approach direction and straight down, rad.
const STEEP_RAD: f64 = 0.3;
/// Tolerances (m, rad) within which the operator accepts a waypoint: where precision matters, and (`COARSE`) on the
/// way.
const PRECISE: (f64, f64) = (0.004, 0.06);
const COARSE: (f64, f64) = (0.015, 0.12);

/// A scripted pick and place.
pub struct Script {
    /// Index of the object to pick, among the scenario's objects.
    pub object: usize,
    /// Waypoints of the tool, in order.
    pub waypoints: Vec<Waypoint>,
}

/// Object and reference of a goal with a single condition *on*, *top* or *in*; `None` for other goals.
pub fn placement(goal: &Goal) -> Option<(&InstanceId, &ReferenceId)> {
    match goal.alternatives.as_slice() {
        [atoms] => match atoms.as_slice() {
            [Atom::Relation { subject, relation: Relation::On | Relation::In | Relation::Top, reference, .. }] => {
                Some((subject, reference))
            }
            _ => None,
        },
        _ => None,
    }
}

/// Script for a stage; `None` unless its goal is a single placement and a grasp from above held the object in every
/// trial.
pub fn script(stage: &Stage, grasps: &GraspLibrary) -> Option<Script> {
    let (subject, reference) = placement(&stage.scenario.task.goal)?;
    let index = |id: &ReferenceId| stage.scenario.index_of(id);
    let (object, reference) = (index(subject)?, index(reference)?);
    let placed = &stage.scenario.objects[object];
    let model = &stage.models[object];
    let home = stage.robot.tcp_pose(&stage.scenario.world.robot.home);
    let known = grasps.of(&stage.robot, model).ok()?;
    let steady = known.iter().filter(|grasp| grasp.share() >= 1.0);
    let turns = steady.flat_map(|verified| [verified.grasp.clone(), verified.grasp.flipped()]);
    let steep = turns
        .map(|grasp| placed.pose * grasp.pose)
        .filter(|pose| (pose.rotation * DVec3::Z).dot(DVec3::NEG_Z) > STEEP_RAD.cos());
    let others: Vec<Aabb> =
        (0..stage.models.len()).filter(|other| *other != object).map(|other| bounds_of(stage, other)).collect();
    // The grasp with the smallest rotation of the hand from home, preferably one at which the hand is not blocked.
    let grasp = steep.min_by(|a, b| {
        let key = |pose: &Pose| (is_blocked(pose, &others), pose.angle_to(&home));
        let ((blocked, turn), (other_blocked, other_turn)) = (key(a), key(b));
        blocked.cmp(&other_blocked).then(turn.total_cmp(&other_turn))
    })?;

    let (bounds, under) = (bounds_of(stage, object), bounds_of(stage, reference));
    let over_m = others.iter().map(|bounds| bounds.max.z).fold(0.0, f64::max) + CLEARANCE_M;
    let lift_m = (over_m - bounds.min.z).max(APPROACH_M);
    let shift = under.center() - bounds.center();
    let release_m = under.max.z + RELEASE_M - bounds.min.z;
    let up = |pose: Pose, height_m: f64| Pose { position: pose.position + DVec3::Z * height_m, ..pose };
    let at_goal = |height_m: f64| {
        let position = grasp.position + DVec3::new(shift.x, shift.y, height_m);
        Pose { position, ..grasp }
    };
    let waypoint = |world_from_tcp: Pose, (within_m, within_rad): (f64, f64), press: Option<Control>| Waypoint {
        world_from_tcp,
        within_m,
        within_rad,
        press,
    };
    let waypoints = vec![
        waypoint(up(grasp, APPROACH_M.max(over_m - bounds.max.z)), COARSE, None),
        waypoint(up(grasp, APPROACH_M / 2.0), PRECISE, None),
        waypoint(grasp, PRECISE, Some(Control::Gripper)),
        waypoint(up(grasp, lift_m), COARSE, None),
        waypoint(at_goal(lift_m.max(release_m)), COARSE, None),
        waypoint(at_goal(release_m), PRECISE, Some(Control::Gripper)),
        waypoint(at_goal(release_m + APPROACH_M), COARSE, Some(Control::Finish)),
    ];
    Some(Script { object, waypoints })
}

/// Bounds of an object at the start, in the world.
fn bounds_of(stage: &Stage, object: usize) -> Aabb {
    let placed = &stage.scenario.objects[object];
    stage.models[object].world_bounds(&placed.pose, &placed.joint_positions)
}

/// True if the hand would hit an object at a grasp. The hand is approximated by points along the closing direction, a
/// finger's length above the tool.
fn is_blocked(world_from_tcp: &Pose, others: &[Aabb]) -> bool {
    let points =
        (-4..=4).map(|at| world_from_tcp.transform_point(DVec3::new(0.0, f64::from(at) / 4.0 * HAND_M, -FINGER_M)));
    points.into_iter().any(|point| {
        let hits = |bounds: &Aabb| {
            let is_over = |axis: usize| {
                point[axis] > bounds.min[axis] - HAND_MARGIN_M && point[axis] < bounds.max[axis] + HAND_MARGIN_M
            };
            is_over(0) && is_over(1) && point.z < bounds.max.z + HAND_MARGIN_M
        };
        others.iter().any(hits)
    })
}

//! Script of a pick and place from simulator truth: the poses that the scripted operator wants to reach.

use genmanip_assets::GraspLibrary;
use genmanip_core::glam::DVec3;
use genmanip_core::{Aabb, Atom, Goal, InstanceId, Pose, ReferenceId, Relation};
use genmanip_layout::obstacles;
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
/// Depth of an open finger along the closing direction, half of its width, and distance of the palm above its tip, m.
const FINGER_DEPTH_M: f64 = 0.025;
const FINGER_SIDE_M: f64 = 0.0105;
const PALM_M: f64 = 0.042;
/// Height of a pad above the fingertip, and depth of the fingertips below the top of an object that is gripped around,
/// m.
const PAD_M: f64 = 0.018;
const REACH_M: f64 = 0.035;
/// Smallest distance of the open fingers from an object, on either side, m.
const GAP_M: f64 = 0.0025;
/// Points on the surface of an object by which the operator sees whether the open hand fits.
const POINTS: usize = 2000;
/// Closing directions that the operator considers for a grip around an object.
const DIRECTIONS: usize = 12;
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

/// Script for a stage; `None` unless its goal is a single placement and the object can be gripped from above: by a grasp
/// that held it in every trial, or around the whole of it.
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
    let open_m = stage.robot.gripper.max_width;
    let surface: Vec<DVec3> =
        obstacles::surface(model, POINTS).iter().map(|(point, _)| placed.pose.transform_point(*point)).collect();
    let middle = placed.pose.transform_point(model.links.first()?.mass.center);
    // A device's gripper opens all the way: of the known grasps only those will do around which the open hand fits. If
    // there is none, the hand grips around the whole object.
    let tried = steep.map(|pose| (gap_m(&pose, &surface, open_m) < 0.0, false, pose));
    let around = grips_around(&surface, middle, open_m).into_iter().map(|pose| (false, true, pose));
    // The grasp with the smallest rotation of the hand from home, preferably one at which the hand is not blocked.
    let (.., grasp) = tried.chain(around).min_by(|a, b| {
        let key = |(hits, is_new, pose): &(bool, bool, Pose)| {
            (*hits, is_blocked(pose, &others), *is_new, pose.angle_to(&home))
        };
        let ((hits, blocked, is_new, turn), other) = (key(a), key(b));
        (hits, blocked, is_new).cmp(&(other.0, other.1, other.2)).then(turn.total_cmp(&other.3))
    })?;
    // Fingers that pass the object closely have to arrive more exactly.
    let near = match gap_m(&grasp, &surface, open_m) {
        gap_m if gap_m > 0.0 && gap_m < 2.0 * PRECISE.0 => (gap_m / 2.0, PRECISE.1 / 2.0),
        _ => PRECISE,
    };

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
        waypoint(up(grasp, APPROACH_M / 2.0), near, None),
        waypoint(grasp, near, Some(Control::Gripper)),
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

/// Distance of the open hand at a grasp from the surface of the object that it is to grip, m; negative if they overlap.
fn gap_m(world_from_tcp: &Pose, surface: &[DVec3], open_m: f64) -> f64 {
    let tcp_from_world = world_from_tcp.inverse();
    let mut gap_m = f64::INFINITY;
    for point in surface.iter().map(|point| tcp_from_world.transform_point(*point)).filter(|point| point.z < 0.0) {
        let side_m = point.x.abs() - FINGER_SIDE_M;
        let (inner_m, outer_m) = (open_m / 2.0 - point.y.abs(), point.y.abs() - open_m / 2.0 - FINGER_DEPTH_M);
        let is_at_palm = point.z < -PALM_M && point.y.abs() < HAND_M && side_m < HAND_MARGIN_M - FINGER_SIDE_M;
        gap_m = gap_m.min(if is_at_palm { -1.0 } else { side_m.max(inner_m).max(outer_m) });
    }
    gap_m
}

/// Grips from above around an object, the fingers on either side of its middle, for which the open hand fits.
fn grips_around(surface: &[DVec3], middle: DVec3, open_m: f64) -> Vec<Pose> {
    let top_m = surface.iter().map(|point| point.z).fold(f64::NEG_INFINITY, f64::max);
    let bottom_m = surface.iter().map(|point| point.z).fold(f64::INFINITY, f64::min);
    let height_m = (top_m - REACH_M).max(0.5 * (bottom_m + top_m - PAD_M));
    let grip = |index: usize| {
        let (sin, cos) = (std::f64::consts::TAU * index as f64 / (2 * DIRECTIONS) as f64).sin_cos();
        let closing = DVec3::new(cos, sin, 0.0);
        let at = |position: DVec3| Pose::from_axes(position, closing.cross(DVec3::NEG_Z), closing, DVec3::NEG_Z);
        let here = at(middle.with_z(height_m));
        let here_from_world = here.inverse();
        let seen = surface.iter().map(|point| here_from_world.transform_point(*point));
        let between = seen.filter(|point| point.x.abs() < FINGER_SIDE_M && point.z < 0.0 && point.z > -PAD_M);
        let (low_m, high_m) = between
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| (low.min(point.y), high.max(point.y)));
        let pose = at(here.position + closing * (low_m + high_m) / 2.0);
        (low_m < high_m && gap_m(&pose, surface, open_m) > GAP_M).then_some(pose)
    };
    (0..2 * DIRECTIONS).filter_map(grip).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on the wall of an upright cup of radius `radius_m`, and on its handle towards +x if it has one.
    fn cup(radius_m: f64, has_handle: bool) -> Vec<DVec3> {
        let mut points = Vec::new();
        for level in 0..=30 {
            let z = 0.003 * f64::from(level);
            for sector in 0..90 {
                let (sin, cos) = (f64::from(sector) / 90.0 * std::f64::consts::TAU).sin_cos();
                points.push(DVec3::new(radius_m * cos, radius_m * sin, z));
            }
            if has_handle && (7..=28).contains(&level) {
                points.extend((1..=9).map(|step| DVec3::new(radius_m + 0.003 * f64::from(step), 0.0, z)));
            }
        }
        points
    }

    #[test]
    fn the_hand_grips_around_what_fits_between_its_open_fingers_but_not_over_a_handle() {
        let all = 2 * DIRECTIONS;
        for (radius_m, has_handle, expected) in
            [(0.035, false, all..all + 1), (0.035, true, 1..all), (0.039, false, 0..1), (0.05, false, 0..1)]
        {
            let surface = cup(radius_m, has_handle);
            let grips = grips_around(&surface, DVec3::new(0.0, 0.0, 0.04), 0.08);
            assert!(expected.contains(&grips.len()), "{radius_m} {has_handle}: {}", grips.len());
            for grip in &grips {
                assert!(gap_m(grip, &surface, 0.08) > GAP_M);
                let closing = grip.transform_vector(DVec3::Y);
                assert!(!has_handle || closing.x.abs() < 0.99, "over the handle: {closing}");
            }
        }
    }

    #[test]
    fn open_fingers_do_not_fit_over_the_wall_of_a_cup() {
        let wall = DVec3::new(0.0, 0.029, 0.05);
        let over = Pose::from_axes(wall, DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        assert!(gap_m(&over, &cup(0.03, false), 0.08) < 0.0);
    }
}

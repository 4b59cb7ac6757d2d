//! Plausibility limits of robot descriptions that keep all derived data small and fast.
//!
//! All limits are chosen by hand: generous for real arms (the largest industrial ones reach five metres), and far below
//! what would overload grids, tables and sampled motions. A file in millimetres exceeds them by a factor of a thousand.

use genmanip_core::{JointKind, Piece, RobotLink, RobotModel, Shape, glam::DVec3};

use crate::ImportError;
use crate::formats::urdf::MIN_RANGE;
use crate::formats::xml::Element;

/// Maximum number of links of a robot.
pub const MAX_LINKS: usize = 512;
/// Maximum number of moving joints: more than a humanoid with hands.
pub const MAX_JOINTS: usize = 128;
/// Maximum number of collision pieces of all links.
pub const MAX_PIECES: usize = 512;
/// Maximum distance of a vertex from the base with all joints stretched out (m).
pub const MAX_REACH_M: f64 = 10.0;
/// Allowed extents of a collision piece, and coordinates of a frame in its parent frame (m).
const SIZES_M: [f64; 2] = [1e-6, 10.0];
/// Maximum limit of a revolute joint [rad]: 16 turns either way.
pub(super) const MAX_ANGLE: f64 = 100.0;
/// Allowed joint velocities [rad/s or m/s].
pub(super) const SPEEDS: [f64; 2] = [1e-4, 1e3];
/// Maximum time from one joint limit to the other [s]: motions are sampled at the control rate.
const MAX_CROSSING_S: f64 = 1000.0;
/// Maximum joint effort [N·m or N].
pub(super) const MAX_EFFORT: f64 = 1e6;
/// Maximum mass of a link (kg) and maximum moment of inertia [kg·m²].
const MAX_MASS: f64 = 1e5;
/// Tolerance for rounding errors of a moment of inertia, kg·m².
const ROUNDING: f64 = 1e-9;

/// Hint on likely causes of oversized values.
const MILLIMETRES: &str =
    "is this in millimetres? URDF is in metres; a mesh can be scaled with scale=\"0.001 0.001 0.001\"";
const DEGREES: &str = "is this in degrees? URDF is in radians";

/// Checks each link, then the robot as a whole.
pub(super) fn check(path: &str, links: &[RobotLink]) -> Result<(), ImportError> {
    let joints = links.iter().filter(|link| link.joint.is_some()).count();
    let pieces = links.iter().map(|link| link.pieces.len()).sum();
    for (size, limit, unit) in [(joints, MAX_JOINTS, "moving joints"), (pieces, MAX_PIECES, "collision pieces")] {
        if size > limit {
            let message = format!("the robot has {size} {unit}, at most {limit} are allowed");
            return Err(ImportError::new(path, message).hint("remove links and pieces that planning does not need"));
        }
    }
    for link in links {
        check_link(path, link)?;
        check_joint(path, link)?;
    }
    Ok(())
}

/// Checks the reach of the whole robot.
pub(super) fn check_reach(path: &str, robot: &RobotModel) -> Result<(), ImportError> {
    // Upper bound of the reach: the lengths of all link offsets and the larger joint limits of slides are added up.
    let mut reach_m: Vec<f64> = Vec::with_capacity(robot.links.len());
    for link in &robot.links {
        let above = link.parent.and_then(|parent| reach_m.get(parent)).copied().unwrap_or(0.0);
        let slide = link.joint.as_ref().filter(|joint| joint.kind == JointKind::Prismatic);
        let slide = slide.map_or(0.0, |joint| joint.lower.abs().max(joint.upper.abs()));
        let here = above + link.parent_from_link.position.length() + slide;
        let body = link.pieces.iter().map(farthest_m);
        let outermost = here + body.fold(0.0, f64::max);
        if outermost > MAX_REACH_M {
            let message = format!(
                "link {}: reach should be at most {MAX_REACH_M} m from the base, all joints stretched out, got \
                 {outermost:.3e} m",
                link.name
            );
            return Err(ImportError::new(path, message).hint(MILLIMETRES));
        }
        reach_m.push(here);
    }
    Ok(())
}

fn check_link(path: &str, link: &RobotLink) -> Result<(), ImportError> {
    let place = || format!("link {}", link.name);
    check_frame(path, &place(), link.parent_from_link.position)?;
    for piece in &link.pieces {
        check_frame(path, &place(), piece.link_from_piece.position)?;
        let sizes = match &piece.shape {
            Shape::Box { half_extents } => (*half_extents * 2.0).to_array().to_vec(),
            Shape::Sphere { radius } => vec![2.0 * radius],
            Shape::Cylinder { radius, half_height } => vec![2.0 * radius, 2.0 * half_height],
            Shape::Hull { points } => {
                let bounds = genmanip_core::Aabb::from_points(points.iter().copied());
                let far = points.iter().map(|point| point.abs().max_element()).fold(0.0, f64::max);
                vec![bounds.size().max_element(), far]
            }
            Shape::Capsule { .. } | Shape::Ellipsoid { .. } => vec![],
        };
        let [smallest, largest] = SIZES_M;
        if let Some(size) = sizes.into_iter().find(|size| !(smallest..=largest).contains(size)) {
            let hint = if size > largest { MILLIMETRES } else { "remove pieces without extent" };
            return Err(implausible(
                path,
                &place(),
                "size of the collision geometry",
                (smallest, largest, "m"),
                size,
                hint,
            ));
        }
    }
    Ok(())
}

fn check_frame(path: &str, place: &str, position: DVec3) -> Result<(), ImportError> {
    let far = position.abs().max_element();
    let largest = SIZES_M[1];
    if far <= largest {
        return Ok(());
    }
    Err(implausible(path, place, "origin", (-largest, largest, "m"), far, MILLIMETRES))
}

fn check_joint(path: &str, link: &RobotLink) -> Result<(), ImportError> {
    let Some(joint) = &link.joint else { return Ok(()) };
    // A mimic joint may turn several times for one turn of the joint that it follows.
    if joint.mimic.is_some() && joint.kind == JointKind::Revolute && (joint.upper - joint.lower).is_finite() {
        return Ok(());
    }
    let place = || format!("joint {}", joint.name);
    let (farthest, unit, hint) = match joint.kind {
        JointKind::Revolute => (MAX_ANGLE, "rad", DEGREES),
        JointKind::Prismatic => (SIZES_M[1], "m", MILLIMETRES),
    };
    for limit in [joint.lower, joint.upper] {
        if limit.abs() > farthest {
            return Err(implausible(path, &place(), "limit", (-farthest, farthest, unit), limit, hint));
        }
    }
    let range = joint.upper - joint.lower;
    if range < MIN_RANGE {
        let fixed = "use type=\"fixed\" for a joint that does not move";
        return Err(implausible(
            path,
            &place(),
            "range of the limits",
            (MIN_RANGE, 2.0 * farthest, unit),
            range,
            fixed,
        ));
    }
    let [slowest, fastest] = SPEEDS;
    // A joint without end stops crosses at most a turn.
    let turn = if joint.continuous { range.min(std::f64::consts::TAU) } else { range };
    let slowest = slowest.max(turn / MAX_CROSSING_S);
    if !(slowest..=fastest).contains(&joint.max_velocity) {
        let hint = "a joint must cross its range within 1000 s; velocities are in rad/s or m/s";
        return Err(implausible(
            path,
            &place(),
            "velocity",
            (slowest, fastest, "per second"),
            joint.max_velocity,
            hint,
        ));
    }
    if !(0.0..=MAX_EFFORT).contains(&joint.max_effort) {
        let hint = "efforts are in N·m or N";
        return Err(implausible(path, &place(), "effort", (0.0, MAX_EFFORT, "N·m or N"), joint.max_effort, hint));
    }
    Ok(())
}

/// Checks mass and moments of inertia of a link. Planning does not use them, but implausible values indicate a misread
/// file.
pub(super) fn check_inertial(node: &Element) -> Result<(), ImportError> {
    let hint = "masses are in kg, moments of inertia in kg·m²";
    let within = |element: &Element, name: &str, [low, high]: [f64; 2]| {
        let value = element.number(name, 0.0)?;
        if (low..=high).contains(&value) {
            return Ok(());
        }
        Err(element.wrong(format!("{name} should be {low:?} to {high:?}, got {value:?}")).hint(hint))
    };
    if let Some(mass) = node.first("mass") {
        within(mass, "value", [0.0, MAX_MASS])?;
    }
    let Some(inertia) = node.first("inertia") else { return Ok(()) };
    ["ixx", "iyy", "izz"].iter().try_for_each(|name| within(inertia, name, [-ROUNDING, MAX_MASS]))?;
    ["ixy", "ixz", "iyz"].iter().try_for_each(|name| within(inertia, name, [-MAX_MASS, MAX_MASS]))
}

fn implausible(
    path: &str,
    place: &str,
    what: &str,
    (low, high, unit): (f64, f64, &str),
    got: f64,
    hint: &str,
) -> ImportError {
    ImportError::new(path, format!("{place}: {what} should be {low:?} to {high:?} {unit}, got {got:?}")).hint(hint)
}

/// Distance of a piece's farthest point from the origin of its link; for other shapes than hulls an upper bound.
fn farthest_m(piece: &Piece) -> f64 {
    let center = piece.link_from_piece.position.length();
    match &piece.shape {
        Shape::Box { half_extents } => center + half_extents.length(),
        Shape::Sphere { radius } => center + *radius,
        Shape::Ellipsoid { radii } => center + radii.max_element(),
        Shape::Cylinder { radius, half_height } => center + radius.hypot(*half_height),
        Shape::Capsule { radius, half_length } => center + radius + half_length,
        Shape::Hull { points } => {
            points.iter().map(|point| piece.link_from_piece.transform_point(*point).length()).fold(0.0, f64::max)
        }
    }
}

//! Checks of robot files; every message names the place, the expected value and the value found.

use std::fmt::Display;

use genmanip_core::{Aabb, JointKind, RobotModel};
use glam::DVec3;

use super::data::{ArmData, GripperData, JointData, LinkData, RobotData};
use super::{GRIPPER, PartKind, joints};
use crate::parts::Part;

/// Largest distance of a pad's inner face from the plane y = 0 of the gripper's frame when the gripper is closed, m.
const PAD_GAP_M: f64 = 0.001;
/// Tolerance of a unit axis' length, of the fingers' directions, and of the fingers' travel (m).
const TOLERANCE: f64 = 1e-6;
/// Largest valid coordinate or extent, m; the largest arms reach five metres.
const MAX_EXTENT_M: f64 = 10.0;
/// Largest valid joint angle, rad: about 16 turns.
const MAX_ANGLE_RAD: f64 = 100.0;
/// Largest valid opening of a gripper, m.
const MAX_OPENING_M: f64 = 0.5;

type Checked = Result<(), String>;

fn expect(holds: bool, place: impl Display, expected: impl Display, got: impl Display) -> Checked {
    if holds { Ok(()) } else { Err(format!("{place}: expected {expected}, got {got}")) }
}

fn positive(place: impl Display, value: f64) -> Checked {
    expect(value > 0.0 && value.is_finite(), place, "a positive number", value)
}

/// Checks the schema and the robot's, arm's or gripper's name in a file.
pub(super) fn header(kind: PartKind, schema: &str, name: &str) -> Checked {
    expect(schema == kind.schema(), "schema", format!("{:?}", kind.schema()), format!("{schema:?}"))?;
    let plain = |letter: char| letter.is_ascii_lowercase() || letter.is_ascii_digit() || letter == '_';
    let is_name = !name.is_empty() && name.len() <= 64 && name.chars().all(plain);
    expect(is_name, "name", "1-64 lower-case letters, digits and underscores", format!("{name:?}"))
}

/// Checks an arm without a gripper.
pub(super) fn arm(arm: &ArmData) -> Checked {
    header(PartKind::Arm, &arm.schema, &arm.name)?;
    expect(
        !arm.sources.is_empty(),
        "sources",
        "the origin of the figures, e.g. {\"limits\": \"the maker's manual\"}",
        "none",
    )?;
    links(&arm.links)?;
    expect(joints(&arm.links) > 0, "links", "at least one joint", "none")?;
    let first = &arm.links[0];
    expect(first.joint.is_none(), "links[0].joint", "none, since the base is fixed", "a joint")?;
    serial(arm)?;
    for (key, value) in [
        ("drives.armature", arm.drives.armature),
        ("drives.damping", arm.drives.damping),
        ("drives.hull_friction", arm.drives.hull_friction),
    ] {
        expect(value >= 0.0 && value.is_finite(), key, "0 or a positive number", value)?;
    }
    if let Some(reach) = arm.reach {
        let [near, far] = reach.from_above_m;
        expect(
            0.0 <= near && near < far && far <= MAX_EXTENT_M && reach.max_m > 0.0 && reach.max_m <= MAX_EXTENT_M,
            "reach",
            format!("0 ≤ from_above_m[0] < from_above_m[1] ≤ {MAX_EXTENT_M} and max_m in 0-{MAX_EXTENT_M}"),
            format!("{:?} and {}", reach.from_above_m, reach.max_m),
        )?;
    }
    pairs("never_colliding", &arm.never_colliding, &|name| arm.links.iter().any(|link| link.name == name))
}

/// Checks that every joint of an arm lies between its base and the tool link.
fn serial(arm: &ArmData) -> Checked {
    let place = |name: &str| arm.links.iter().position(|link| link.name == name);
    let names = || arm.links.iter().map(|link| link.name.as_str()).collect::<Vec<_>>().join(", ");
    let Some(mut index) = place(&arm.tool_link) else {
        return Err(format!("tool_link: expected one of {}, got {:?}", names(), arm.tool_link));
    };
    let mut carried = 0;
    loop {
        carried += usize::from(arm.links[index].joint.is_some());
        match arm.links[index].parent.as_deref().and_then(place) {
            Some(parent) => index = parent,
            None => break,
        }
    }
    let all = joints(&arm.links);
    expect(carried == all, "tool_link", format!("a link behind all {all} joints"), format!("one behind {carried}"))
}

/// Checks a gripper without an arm.
pub(super) fn gripper(gripper: &GripperData) -> Checked {
    header(PartKind::Gripper, &gripper.schema, &gripper.name)?;
    expect(
        !gripper.sources.is_empty(),
        "sources",
        "the origin of the figures, e.g. {\"limits\": \"the maker's manual\"}",
        "none",
    )?;
    links(&gripper.links)?;
    expect(gripper.links[0].joint.is_none(), "links[0].joint", "none, since the hand is fixed to the arm", "a joint")?;
    let moving = joints(&gripper.links);
    expect(moving == 2, "links", "two joints, one per finger", moving)?;
    expect(
        gripper.fingers[0] != gripper.fingers[1],
        "fingers",
        "two different links",
        format!("{:?}", gripper.fingers),
    )?;
    expect(
        (0.0..=MAX_OPENING_M).contains(&gripper.max_width) && gripper.max_width > 0.0,
        "max_width",
        format!("metres in 0-{MAX_OPENING_M}"),
        gripper.max_width,
    )?;
    expect(
        (0.0..=1.0).contains(&gripper.hand_from_tcp_z),
        "hand_from_tcp_z",
        "metres in 0-1",
        gripper.hand_from_tcp_z,
    )?;
    for (finger, sign) in [(0, 1.0), (1, -1.0)] {
        check_finger(gripper, finger, sign)?;
    }
    positive("max_force", gripper.max_force)?;
    for (axis, size) in ["[0]", "[1]", "[2]"].iter().zip(gripper.pad_size.to_array()) {
        expect(
            size > 0.0 && size <= MAX_OPENING_M,
            format!("pad_size{axis}"),
            format!("metres in 0-{MAX_OPENING_M}"),
            size,
        )?;
    }
    let drives = &gripper.drives;
    let force = format!("a positive number up to max_force, {}", gripper.max_force);
    expect(drives.force_n > 0.0 && drives.force_n <= gripper.max_force, "drives.force_n", force, drives.force_n)?;
    for (key, value) in [
        ("drives.kp", drives.kp),
        ("drives.overclose_m", drives.overclose_m),
        ("drives.armature", drives.armature),
        ("drives.damping", drives.damping),
    ] {
        positive(key, value)?;
    }
    for (index, value) in drives.pad_friction.iter().enumerate() {
        expect(
            *value >= 0.0 && value.is_finite(),
            format!("drives.pad_friction[{index}]"),
            "0 or a positive number",
            value,
        )?;
    }
    pairs("never_colliding", &gripper.never_colliding, &|name| gripper.links.iter().any(|link| link.name == name))
}

/// Checks that a finger slides along ±y of the hand, from closed at 0 to half the opening.
fn check_finger(gripper: &GripperData, finger: usize, sign: f64) -> Checked {
    let name = &gripper.fingers[finger];
    let names = || gripper.links.iter().map(|link| link.name.as_str()).collect::<Vec<_>>().join(", ");
    let Some(index) = gripper.links.iter().position(|link| link.name == *name) else {
        return Err(format!("fingers[{finger}]: expected one of {}, got {name:?}", names()));
    };
    let (place, link, hand) = (format!("links[{index}] ({name})"), &gripper.links[index], &gripper.links[0].name);
    let parent = link.parent.as_deref().unwrap_or_default();
    expect(parent == hand, format!("{place}.parent"), format!("{hand:?}"), format!("{parent:?}"))?;
    let Some(joint) = &link.joint else {
        return Err(format!("{place}.joint: expected a prismatic joint, got none"));
    };
    expect(joint.kind == JointKind::Prismatic, format!("{place}.joint.kind"), "\"prismatic\"", "\"revolute\"")?;
    let along = link.pose().transform_vector(joint.axis);
    let wanted = DVec3::Y * sign;
    expect(
        along.distance(wanted) < TOLERANCE,
        format!("{place}.joint.axis"),
        format!("{wanted} in the frame of the hand"),
        along,
    )?;
    expect(joint.lower == 0.0, format!("{place}.joint.lower"), "0, where the gripper is closed", joint.lower)?;
    let half = gripper.max_width / 2.0;
    let enough = joint.upper >= half - TOLERANCE;
    expect(enough, format!("{place}.joint.upper"), format!("at least half of max_width, {half}"), joint.upper)
}

/// Checks the links of an arm or a gripper.
fn links(links: &[LinkData]) -> Checked {
    expect(!links.is_empty(), "links", "at least one link", "none")?;
    for (index, link) in links.iter().enumerate() {
        let place = format!("links[{index}] ({})", link.name);
        let is_new = links[..index].iter().all(|other| other.name != link.name);
        expect(is_new && !link.name.is_empty(), format!("{place}.name"), "a unique name", format!("{:?}", link.name))?;
        expect(
            link.name != GRIPPER,
            format!("{place}.name"),
            "another name, since this one is reserved for all links of a gripper",
            GRIPPER,
        )?;
        check_parent(&place, index, links)?;
        let far = link.position.abs().max_element();
        expect(far <= MAX_EXTENT_M, format!("{place}.position"), format!("metres up to {MAX_EXTENT_M}"), far)?;
        positive(format!("{place}.mass_kg"), link.mass_kg)?;
        expect(link.center.is_finite(), format!("{place}.center"), "finite numbers", link.center)?;
        let inertia = link.inertia();
        let minors =
            [inertia.x_axis.x, inertia.x_axis.x * inertia.y_axis.y - inertia.x_axis.y.powi(2), inertia.determinant()];
        expect(
            minors.iter().all(|minor| *minor > 0.0),
            format!("{place}.inertia"),
            "[xx, yy, zz, xy, xz, yz] of a positive definite matrix",
            format!("{:?}", link.inertia),
        )?;
        if let Some((part, flaw)) = link.parts.iter().enumerate().find_map(|(part, it)| Some((part, Part::flaw(it)?))) {
            return Err(format!("{place}.parts[{part}]: {flaw}"));
        }
        if let Some(joint) = &link.joint {
            check_joint(&format!("{place}.joint"), joint)?;
            let is_new =
                links[..index].iter().all(|other| other.joint.as_ref().is_none_or(|other| other.name != joint.name));
            expect(is_new, format!("{place}.joint.name"), "a unique name", format!("{:?}", joint.name))?;
        }
    }
    Ok(())
}

fn check_parent(place: &str, index: usize, links: &[LinkData]) -> Checked {
    let before: Vec<&str> = links[..index].iter().map(|link| link.name.as_str()).collect();
    match (&links[index].parent, index) {
        (None, 0) => Ok(()),
        (Some(parent), 0) => Err(format!("{place}.parent: expected none for the first link, got {parent:?}")),
        (parent, _) => {
            let parent = parent.as_deref().unwrap_or_default();
            expect(
                before.contains(&parent),
                format!("{place}.parent"),
                format!("an earlier link: {}", before.join(", ")),
                format!("{parent:?}"),
            )
        }
    }
}

fn check_joint(place: &str, joint: &JointData) -> Checked {
    let length = joint.axis.length();
    expect((length - 1.0).abs() < TOLERANCE, format!("{place}.axis"), "a unit vector", joint.axis)?;
    let (far, unit) = match joint.kind {
        JointKind::Revolute => (MAX_ANGLE_RAD, "radians"),
        JointKind::Prismatic => (MAX_EXTENT_M, "metres"),
    };
    for (key, value) in [("lower", joint.lower), ("upper", joint.upper)] {
        expect(value.abs() <= far, format!("{place}.{key}"), format!("{unit} up to {far}"), value)?;
    }
    expect(
        joint.lower < joint.upper,
        format!("{place}.upper"),
        format!("more than lower, {}", joint.lower),
        joint.upper,
    )?;
    let can_turn = !joint.continuous || joint.kind == JointKind::Revolute;
    expect(can_turn, format!("{place}.continuous"), "false for a prismatic joint", joint.continuous)?;
    for (key, value) in [
        ("max_velocity", joint.max_velocity),
        ("max_acceleration", joint.max_acceleration),
        ("max_jerk", joint.max_jerk),
        ("max_effort", joint.max_effort),
    ] {
        positive(format!("{place}.{key}"), value)?;
    }
    Ok(())
}

/// Checks that pairs consist of two different existing links.
fn pairs(place: &str, pairs: &[[String; 2]], exists: &dyn Fn(&str) -> bool) -> Checked {
    for (index, pair) in pairs.iter().enumerate() {
        for name in pair {
            expect(exists(name), format!("{place}[{index}]"), "names of two links", format!("{name:?}"))?;
        }
        expect(pair[0] != pair[1], format!("{place}[{index}]"), "two different links", format!("{:?} twice", pair[0]))?;
    }
    Ok(())
}

/// Checks gripper and arm together, after the robot's values have replaced those of the arm.
pub(super) fn mounted(robot: &RobotData, arm: &ArmData, gripper: &GripperData) -> Checked {
    let dof = joints(&arm.links);
    let mount = robot.mount.pose();
    let far = mount.position.abs().max_element();
    expect(far <= 1.0 && mount.rotation.is_finite(), "mount", "metres up to 1 and angles in degrees", mount.position)?;
    expect(arm.home.len() == dof, "home", format!("{dof} positions, one per joint of the arm"), arm.home.len())?;
    let arm_joints = || arm.links.iter().filter_map(|link| link.joint.as_ref());
    for (index, (position, joint)) in arm.home.iter().zip(arm_joints()).enumerate() {
        let inside = (joint.lower..=joint.upper).contains(position);
        let range = format!("{} to {}, the limits of {}", joint.lower, joint.upper, joint.name);
        expect(inside, format!("home[{index}]"), range, position)?;
    }
    for joint in arm_joints() {
        check_joint(&format!("limits.{}", joint.name), joint)?;
    }
    for (key, gains) in [("kp", &arm.drives.kp), ("kv", &arm.drives.kv)] {
        let count = format!("1 to {dof} positive gains, the last one for all further joints");
        let sound = (1..=dof).contains(&gains.len()) && gains.iter().all(|gain| *gain > 0.0 && gain.is_finite());
        expect(sound, key, count, format!("{gains:?}"))?;
    }
    for link in &gripper.links {
        let is_new = arm.links.iter().all(|other| other.name != link.name);
        expect(
            is_new,
            "gripper",
            format!("link names that the arm {} does not use", arm.name),
            format!("{:?}", link.name),
        )?;
        let joint = |link: &LinkData| link.joint.as_ref().map(|joint| joint.name.clone());
        let clash = joint(link).filter(|name| arm.links.iter().any(|other| joint(other).as_ref() == Some(name)));
        if let Some(name) = clash {
            return Err(format!("gripper: expected joint names that the arm {} does not use, got {name:?}", arm.name));
        }
    }
    let all = || arm.links.iter().chain(&gripper.links);
    pairs("never_colliding", &robot.never_colliding, &|name| name == GRIPPER || all().any(|link| link.name == name))
}

/// Checks that the pads meet in the plane y = 0 of the hand when the gripper is closed.
pub(super) fn pads(robot: &RobotModel) -> Checked {
    let poses = robot.link_poses(&robot.home, 0.0);
    let hand_from_world = poses[robot.hand].inverse();
    for (finger, sign) in robot.gripper.fingers.into_iter().zip([1.0, -1.0]) {
        let link = &robot.links[finger];
        let place = format!("links[{}] ({}).parts", finger - robot.hand, link.name);
        let bounds = |piece| Aabb::from_pieces(&(hand_from_world * poses[finger]), [piece]);
        let inner = link.pieces.iter().map(|piece| {
            let bounds: Aabb = bounds(piece);
            if sign > 0.0 { bounds.min.y } else { -bounds.max.y }
        });
        let inner = inner.fold(f64::INFINITY, f64::min);
        expect(
            inner.abs() <= PAD_GAP_M,
            place,
            "a pad whose inner face lies at y = 0 of the hand when closed",
            format!("{inner:.4} m from it"),
        )?;
    }
    Ok(())
}

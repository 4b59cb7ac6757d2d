//! Tree of links from the bodies of a stage: bodies that are fixed to each other are merged into one link, and the
//! frame of a link is that of its joint.

use std::collections::{BTreeMap, VecDeque};

use genmanip_core::{Joint, JointKind, Pose};
use glam::DVec3;

use super::bodies::{Body, Contents, JointPrim};
use super::units::Units;
use crate::files::shortened;
use crate::formats::urdf;
use crate::raw::{MAX_LINKS, RawLink};

/// Damping of a joint whose drive states none, and dry friction of all joints: N·m·s/rad and N·m, or N·s/m and N.
const DAMPING: f64 = 0.1;
const FRICTION_LOSS: f64 = 0.05;
/// Half range of a joint without limits: revolute (rad), prismatic (m).
const UNLIMITED: [f64; 2] = [std::f64::consts::PI, 0.2];
/// Distance (m) and angle (rad) between the two frames of a joint above which a note says that its bodies are apart.
const APART: [f64; 2] = [1e-3, 1e-2];

/// Motion of a joint: kind, axis in the joint's frame, range (rad or m), and damping, stiffness and rest position of
/// its drive (per rad or m).
struct Motion {
    kind: JointKind,
    axis: DVec3,
    range: [f64; 2],
    damping: f64,
    stiffness: f64,
    target: f64,
}

/// Links of the only object of a stage, parents first; the fixed surroundings of an object that moves freely are
/// dropped with a note.
///
/// # Errors
/// If there are several objects (groups of joined bodies), or too many moving bodies.
pub fn links(mut contents: Contents, units: Units, notes: &mut Vec<String>) -> Result<Vec<RawLink>, String> {
    let motions: Vec<Option<Motion>> = contents.joints.iter().map(|joint| motion(joint, units, notes)).collect();
    let count = contents.bodies.len();
    // By body: index of each of its joints, and the end (0 or 1) at which the other body is.
    let mut around: Vec<Vec<(usize, usize)>> = vec![Vec::new(); count];
    for (index, joint) in contents.joints.iter().enumerate() {
        let [(a, _), (b, _)] = joint.ends;
        if a == b {
            notes.push(format!("joint {}: it joins a body with itself", path(joint)));
            continue;
        }
        around[a].push((index, 1));
        around[b].push((index, 0));
    }
    let is_empty = |held: &RawLink| held.surfaces.is_empty() && held.collision.is_empty();
    let mut groups = components(&contents, &around);
    let fixed = groups.remove(0);
    let has_geometry = |group: &Vec<usize>| group.iter().any(|&body| !is_empty(&contents.bodies[body].held));
    let free: Vec<Vec<usize>> = groups.into_iter().filter(has_geometry).collect();
    let is_still = fixed.iter().all(|&body| around[body].iter().all(|&(joint, _)| motions[joint].is_none()));
    let root = match free.as_slice() {
        [] => 0,
        [group] if is_still => {
            // The only group of bodies that moves freely is the object.
            let parts =
                |&body: &usize| contents.bodies[body].held.surfaces.len() + contents.bodies[body].held.collision.len();
            let parts: usize = fixed.iter().map(parts).sum();
            if parts > 0 {
                notes.push(format!("ignored {parts} surfaces and shapes of the surrounding scene"));
            }
            base(group, &contents)
        }
        _ => {
            let names: Vec<String> =
                free.iter().take(5).map(|group| shortened(&contents.bodies[group[0]].path)).collect();
            return Err(format!(
                "{} bodies move freely: {}; it contains several objects",
                free.len(),
                names.join(", ")
            ));
        }
    };
    grow(root, &mut contents, &motions, &around, notes)
}

/// Groups of bodies connected by joints; the first group is connected to the world and has all kinematic bodies.
fn components(contents: &Contents, around: &[Vec<(usize, usize)>]) -> Vec<Vec<usize>> {
    let mut group_of = vec![None; around.len()];
    let mut groups = Vec::new();
    for start in 0..around.len() {
        if group_of[start].is_some() {
            continue;
        }
        let (mut group, mut open) = (Vec::new(), VecDeque::from([start]));
        if start == 0 {
            open.extend((1..around.len()).filter(|&body| contents.bodies[body].is_kinematic));
        }
        while let Some(body) = open.pop_front() {
            if group_of[body].replace(groups.len()).is_some() {
                continue;
            }
            group.push(body);
            open.extend(around[body].iter().map(|&(joint, end)| contents.joints[joint].ends[end].0));
        }
        groups.push(group);
    }
    groups
}

/// Base body of a group: its articulation root, or else the first body that is not the second body of any joint, or
/// else the first body.
fn base(group: &[usize], contents: &Contents) -> usize {
    let is_child = |body: usize| contents.joints.iter().any(|joint| joint.ends[1].0 == body);
    let root = group.iter().copied().find(|&body| contents.bodies[body].is_root);
    root.or_else(|| group.iter().copied().find(|&body| !is_child(body))).unwrap_or(group[0])
}

fn grow(
    root: usize,
    contents: &mut Contents,
    motions: &[Option<Motion>],
    around: &[Vec<(usize, usize)>],
    notes: &mut Vec<String>,
) -> Result<Vec<RawLink>, String> {
    let Contents { bodies, joints, .. } = contents;
    let take = |body: &mut Body| std::mem::take(&mut body.held);
    let mut made = vec![RawLink { name: "body".into(), ..RawLink::default() }];
    // By body: index of its link, and `link_from_world` for the body's geometry as placed in the file.
    let mut places: BTreeMap<usize, (usize, Pose)> = BTreeMap::new();
    let mut open = VecDeque::from([(root, 0, Pose::IDENTITY)]);
    if root == 0 {
        open.extend((1..bodies.len()).filter(|&body| bodies[body].is_kinematic).map(|body| (body, 0, Pose::IDENTITY)));
    }
    let mut used = vec![false; joints.len()];
    while let Some((body, link, link_from_file)) = open.pop_front() {
        if places.contains_key(&body) {
            continue;
        }
        places.insert(body, (link, link_from_file));
        if made[link].name == "body" && body != 0 {
            made[link].name = or(&bodies[body].held.name, "body").to_owned();
        }
        urdf::merge(&mut made[link], take(&mut bodies[body]), &link_from_file);
        for &(index, end) in &around[body] {
            let joint = &joints[index];
            let (child, file_from_far) = joint.ends[end];
            if std::mem::replace(&mut used[index], true) {
                continue;
            }
            if places.contains_key(&child) || open.iter().any(|(waiting, ..)| *waiting == child) {
                notes.push(format!("joint {}: it closes a loop and is left out", path(joint)));
                continue;
            }
            let file_from_near = joint.ends[1 - end].1;
            say_apart(joint, motions[index].as_ref(), notes);
            let link_from_joint = link_from_file * file_from_near;
            let Some(motion) = &motions[index] else {
                open.push_back((child, link, link_from_joint * file_from_far.inverse()));
                continue;
            };
            if made.len() == MAX_LINKS {
                return Err(format!("more than {MAX_LINKS} moving bodies"));
            }
            let own = or(&bodies[child].held.name, "part").to_owned();
            let is_new = made.iter().all(|link| link.name != own);
            let name = if is_new { own } else { format!("{own}_{}", made.len()) };
            let said = joint.at.name();
            let is_new = made.iter().filter_map(|link| link.joint.as_ref()).all(|joint| joint.name != said);
            let moves = Joint {
                name: if is_new { said } else { format!("{said}_{}", made.len()) },
                parent: link,
                kind: motion.kind,
                parent_from_joint: link_from_joint,
                // The axis moves the second body relative to the first; with the first as the child, it is reversed.
                axis: if end == 1 { motion.axis } else { -motion.axis },
                range: motion.range,
                damping: motion.damping,
                friction_loss: FRICTION_LOSS,
                stiffness: motion.stiffness,
                spring_reference: motion.target,
            };
            made.push(RawLink { name, joint: Some(moves), ..RawLink::default() });
            open.push_back((child, made.len() - 1, file_from_far.inverse()));
        }
    }
    Ok(made)
}

/// Motion of a joint in rad or m; `None` if it is fixed, or treated as fixed with a note.
fn motion(joint: &JointPrim, units: Units, notes: &mut Vec<String>) -> Option<Motion> {
    let at = &joint.at;
    let (kind, drive) = match at.kind().as_str() {
        "PhysicsRevoluteJoint" => (JointKind::Revolute, "drive:angular:physics"),
        "PhysicsPrismaticJoint" => (JointKind::Prismatic, "drive:linear:physics"),
        "PhysicsFixedJoint" => return None,
        other => {
            notes.push(format!("joint {}: a {} is treated as fixed", path(joint), shortened(other)));
            return None;
        }
    };
    let is_revolute = kind == JointKind::Revolute;
    let unit = if is_revolute { 1.0_f64.to_radians() } else { units.metres };
    let limit = |name: &str, otherwise: f64| {
        at.number(name).filter(|limit| limit.is_finite()).map_or(otherwise, |limit| limit * unit)
    };
    let most = UNLIMITED[usize::from(!is_revolute)];
    let range = [limit("physics:lowerLimit", -most), limit("physics:upperLimit", most)];
    if range[1] - range[0] <= 1e-6 {
        notes.push(format!("joint {}: its range is empty, so it is treated as fixed", path(joint)));
        return None;
    }
    // Drive gains are given per degree or per unit of length: torques in kg·m²/s², forces in kg·m/s² of the stage's
    // units.
    let force = if is_revolute { units.kilograms * units.metres.powi(2) } else { units.kilograms * units.metres };
    let stated = |name: &str| at.positive(&format!("{drive}:{name}")).map(|value| value * force / unit);
    let axis = match at.text("physics:axis").as_deref() {
        Some("Y") => DVec3::Y,
        Some("Z") => DVec3::Z,
        _ => DVec3::X,
    };
    Some(Motion {
        kind,
        axis,
        range,
        damping: stated("damping").unwrap_or(DAMPING),
        stiffness: stated("stiffness").unwrap_or(0.0),
        target: limit(&format!("{drive}:targetPosition"), 0.0),
    })
}

/// Adds a note if the two frames of a joint differ by more than the joint's motion allows.
fn say_apart(joint: &JointPrim, motion: Option<&Motion>, notes: &mut Vec<String>) {
    let [(_, first), (_, second)] = joint.ends;
    let between = first.inverse() * second;
    let (mut along, mut turn) = (between.position, between.rotation.xyz() * between.rotation.w.signum());
    match motion {
        Some(Motion { kind: JointKind::Prismatic, axis, .. }) => along -= *axis * along.dot(*axis),
        Some(Motion { kind: JointKind::Revolute, axis, .. }) => turn -= *axis * turn.dot(*axis),
        None => {}
    }
    let angle = 2.0 * turn.length().min(1.0).asin();
    if along.length() > APART[0] || angle > APART[1] {
        notes.push(format!(
            "joint {}: its bodies are {:.1} mm and {:.1}° apart in the file; they are placed where it holds them",
            path(joint),
            along.length() * 1e3,
            angle.to_degrees()
        ));
    }
}

fn path(joint: &JointPrim) -> String {
    shortened(joint.at.prim.path().as_str())
}

/// `name`, or `otherwise` if it is empty.
fn or<'a>(name: &'a str, otherwise: &'a str) -> &'a str {
    if name.is_empty() { otherwise } else { name }
}

//! URDF: the tree of links and joints, read once for objects and robots.

mod object;

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{JointKind, MassProperties, Pose, Shape};
use glam::{DMat3, DQuat, DVec3};

pub use object::{Surfaces, combined, merge, read};

use super::xml::{self, Element};
use crate::ImportError;
use crate::files::{Files, shortened};
use crate::units_and_frame::transformed_mass;

/// Reads the root element of a URDF.
///
/// # Errors
/// If the file is not XML, not a URDF, or a xacro file.
pub fn robot(path: &str, files: &mut Files<'_>) -> Result<Element, ImportError> {
    let robot = xml::parse(path, files)?;
    if robot.tag != "robot" {
        let error = robot.wrong("expected <robot>");
        return Err(match robot.tag.as_str() {
            "sdf" | "gazebo" => {
                error.hint("this is SDF, of Gazebo: robots are read from URDF; its authors often have both")
            }
            "mujoco" => error.hint("this is MJCF, of MuJoCo: robots are read from URDF, objects also from MJCF"),
            _ => error,
        });
    }
    match first_macro(&robot).or_else(|| path.ends_with(".xacro").then_some(&robot)) {
        Some(found) => Err(found.wrong("a xacro file, which must be expanded first").hint(format!(
            "expand it: `xacro {path} > robot.urdf`, with ROS or after `pip install xacro`; then use robot.urdf"
        ))),
        None => Ok(robot),
    }
}

fn first_macro(node: &Element) -> Option<&Element> {
    if node.tag.starts_with("xacro:") { Some(node) } else { node.children.iter().find_map(first_macro) }
}

/// A link with its joint to the parent.
#[derive(Debug)]
pub struct Link<'x> {
    /// Name, unique in the file.
    pub name: &'x str,
    /// XML element of the link.
    pub node: &'x Element,
    /// Index of the parent link, and the joint to it; `None` for the root link.
    pub joint: Option<(usize, Joint<'x>)>,
}

/// A joint as written in the file.
#[derive(Clone, Debug)]
pub struct Joint<'x> {
    /// Name; the child link's name if the joint has none.
    pub name: &'x str,
    /// XML element of the joint.
    pub node: &'x Element,
    /// Name of the parent link.
    pub parent: &'x str,
    /// Name of the child link.
    pub child: &'x str,
    /// Pose of the joint's frame in the parent link's frame; at position 0 it is also that of the child's frame.
    pub parent_from_joint: Pose,
    /// Motion; `None` for a fixed joint.
    pub motion: Option<Motion<'x>>,
    /// Position of a joint with an empty range, which counts as fixed there, rad or m; `None` for any other joint.
    pub held: Option<f64>,
}

/// Motion of a joint.
#[derive(Clone, Debug)]
pub struct Motion<'x> {
    /// Type: rotation or translation.
    pub kind: JointKind,
    /// True for a revolute joint without limits.
    pub continuous: bool,
    /// Unit vector of the axis, in the joint's frame.
    pub axis: DVec3,
    /// Lower and upper limit, rad or m, in ascending order; `None` without limits.
    pub range: Option<[f64; 2]>,
    /// Maximum velocity, rad/s or m/s; `None` if not stated.
    pub velocity: Option<f64>,
    /// Maximum torque (N·m) or force (N); `None` if not stated.
    pub effort: Option<f64>,
    /// Mimic joint: name of the joint whose position this one follows, multiplier and offset. `None` for an independent
    /// joint.
    pub mimic: Option<(&'x str, f64, f64)>,
}

/// Minimum range of a joint that moves, rad or m.
pub const MIN_RANGE: f64 = 1e-6;

/// Limit beyond which a revolute joint counts as continuous, rad: limits mistakenly given in degrees are smaller.
pub const NO_LIMIT: f64 = 1000.0;

/// True if an angle is larger than two turns, which no joint and no frame of a robot needs.
fn is_in_degrees<const N: usize>(angles: [f64; N]) -> bool {
    angles.iter().any(|angle| angle.abs() > 2.0 * std::f64::consts::TAU + 0.01)
}

/// True if limits mean that there is none.
pub fn is_endless([lower, upper]: [f64; 2]) -> bool {
    lower < -NO_LIMIT && upper > NO_LIMIT
}

impl Motion<'_> {
    /// The position of an independent joint with an empty range; `None` for a joint that moves.
    fn only_position(&self) -> Option<f64> {
        let [lower, upper] = self.range.filter(|_| self.mimic.is_none())?;
        (upper - lower < MIN_RANGE).then_some(lower)
    }
}

/// Links of a description, parents first; more than `most` are an error.
///
/// # Errors
/// With the line of a joint to an unknown link, a loop, or an invalid number.
pub fn links<'x>(robot: &'x Element, most: usize, notes: &mut Vec<String>) -> Result<Vec<Link<'x>>, ImportError> {
    let nodes: Vec<&Element> = robot.all("link").collect();
    if nodes.is_empty() || nodes.len() > most {
        return Err(ImportError::new(&robot.place.0, format!("{} links; expected 1 to {most}", nodes.len())));
    }
    let joints = robot.all("joint").map(|node| joint(node, notes)).collect::<Result<Vec<_>, _>>()?;
    ordered(robot, &nodes, joints, notes)
}

fn joint<'x>(node: &'x Element, notes: &mut Vec<String>) -> Result<Joint<'x>, ImportError> {
    let link = |tag: &str| {
        let found = node.first(tag).and_then(|end| end.attribute("link"));
        found.ok_or_else(|| node.wrong(format!("expected <{tag} link=\"…\">")))
    };
    let (parent, child) = (link("parent")?, link("child")?);
    let name = node.attribute("name").unwrap_or(child);
    let kind = match node.attribute("type").unwrap_or_default() {
        "revolute" | "continuous" => Some(JointKind::Revolute),
        "prismatic" => Some(JointKind::Prismatic),
        "fixed" => None,
        other => {
            notes.push(format!("joint of type `{}` to {} treated as fixed", shortened(other), shortened(child)));
            None
        }
    };
    let mut motion = kind.map(|kind| motion(node, kind)).transpose()?;
    if let Some(range) = motion.as_mut().and_then(|motion| motion.range.as_mut()) {
        let soft = soft_range(node, *range)?;
        if soft != *range {
            let [[lower, upper], [from, to]] = [*range, soft];
            let name = shortened(name);
            notes.push(format!("joint {name} moves within its soft limits {from} to {to}, not {lower} to {upper}"));
        }
        *range = soft;
    }
    let parent_from_joint = origin(node)?;
    if node.first("origin").map(|origin| origin.exactly::<3>("rpy")).transpose()?.flatten().is_some_and(is_in_degrees) {
        notes.push(format!("joint {} is turned by more than two turns: is its rpy in degrees?", shortened(name)));
    }
    let turning = motion.as_ref().filter(|motion| motion.kind == JointKind::Revolute);
    if turning.and_then(|motion| motion.range).is_some_and(|range| is_in_degrees(range) && !is_endless(range)) {
        notes.push(format!("joint {} has limits of more than two turns: are its limits in degrees?", shortened(name)));
    }
    if let Some((motion, held)) = motion.as_ref().and_then(|motion| Some((motion, motion.only_position()?))) {
        notes.push(format!("joint {} has an empty range: taken as fixed at {held}", shortened(name)));
        let parent_from_joint = parent_from_joint * motion.kind.motion(motion.axis, held);
        return Ok(Joint { name, node, parent, child, parent_from_joint, motion: None, held: Some(held) });
    }
    Ok(Joint { name, node, parent, child, parent_from_joint, motion, held: None })
}

fn motion(node: &Element, kind: JointKind) -> Result<Motion<'_>, ImportError> {
    let continuous = node.attribute("type") == Some("continuous");
    let axis = match node.first("axis") {
        Some(axis) => axis.exactly::<3>("xyz")?.unwrap_or([1.0, 0.0, 0.0]),
        None => [1.0, 0.0, 0.0],
    };
    let axis = DVec3::from_array(axis).try_normalize().ok_or_else(|| node.wrong("its axis has no length"))?;
    let limit = node.first("limit");
    let range = match limit {
        Some(limit) if !continuous => {
            Some([limit.bounded("lower")?.unwrap_or(0.0), limit.bounded("upper")?.unwrap_or(0.0)])
        }
        Some(_) | None => None,
    };
    if let Some([lower, upper]) = range.filter(|[lower, upper]| lower > upper) {
        return Err(node.wrong(format!("expected an increasing range, got {lower} to {upper}")));
    }
    let stated = |name: &str| match limit {
        Some(limit) => limit.bounded(name),
        None => Ok(None),
    };
    let mimic = match node.first("mimic") {
        Some(mimic) => {
            let joint = mimic.attribute("joint").ok_or_else(|| mimic.wrong("expected the name of a joint"))?;
            Some((joint, mimic.number("multiplier", 1.0)?, mimic.number("offset", 0.0)?))
        }
        None => None,
    };
    Ok(Motion { kind, continuous, axis, range, velocity: stated("velocity")?, effort: stated("effort")?, mimic })
}

/// The part of a range that the soft limits of a `<safety_controller>` leave, which drivers of the robot keep to; the
/// whole range if they leave nothing.
fn soft_range(node: &Element, range @ [lower, upper]: [f64; 2]) -> Result<[f64; 2], ImportError> {
    let Some(safety) = node.first("safety_controller") else { return Ok(range) };
    let from = safety.bounded("soft_lower_limit")?.map_or(lower, |soft| soft.max(lower));
    let to = safety.bounded("soft_upper_limit")?.map_or(upper, |soft| soft.min(upper));
    Ok(if to - from < MIN_RANGE { range } else { [from, to] })
}

/// Pose of the `<origin>` of an element, whose rotation is `rpy` or, since URDF 1.1, `quat_xyzw`.
///
/// # Errors
/// If a number is invalid, or both rotations are given.
pub fn origin(node: &Element) -> Result<Pose, ImportError> {
    let Some(origin) = node.first("origin") else { return Ok(Pose::IDENTITY) };
    let position = origin.exactly::<3>("xyz")?.unwrap_or_default();
    let rotation = match (origin.exactly::<3>("rpy")?, origin.exactly::<4>("quat_xyzw")?) {
        (Some(_), Some(_)) => return Err(origin.wrong("expected rpy or quat_xyzw, got both")),
        (None, Some(quaternion)) if quaternion.iter().all(|part| part.abs() < 1e-6) => {
            return Err(origin.wrong("quat_xyzw: expected a rotation, got zeros"));
        }
        (None, Some(quaternion)) => DQuat::from_array(quaternion).normalize(),
        (rpy, None) => {
            let [roll, pitch, yaw] = rpy.unwrap_or_default();
            DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(pitch) * DQuat::from_rotation_x(roll)
        }
    };
    Ok(Pose { position: DVec3::from_array(position), rotation })
}

/// Mass properties of an `<inertial>` element, in the link's frame; `None` without mass.
///
/// # Errors
/// If a number is invalid.
pub fn mass(node: &Element) -> Result<Option<MassProperties>, ImportError> {
    let Some(mass) = node.first("mass") else { return Ok(None) };
    let mass_kg = mass.number("value", 0.0)?;
    let mut moments = [0.0; 6];
    if let Some(inertia) = node.first("inertia") {
        for (value, name) in moments.iter_mut().zip(["ixx", "iyy", "izz", "ixy", "ixz", "iyz"]) {
            *value = inertia.number(name, 0.0)?;
        }
    }
    let [ixx, iyy, izz, ixy, ixz, iyz] = moments;
    let inertia = DMat3::from_cols(DVec3::new(ixx, ixy, ixz), DVec3::new(ixy, iyy, iyz), DVec3::new(ixz, iyz, izz));
    // A body of zero mass, as bases often have, counts as a body that states no mass.
    let own = MassProperties { mass_kg, center: DVec3::ZERO, inertia };
    Ok((mass_kg > 0.0).then_some(transformed_mass(&own, &origin(node)?)))
}

/// Geometry of a visual or collision element.
#[derive(Clone, Debug)]
pub enum Form {
    /// A primitive shape.
    Shape(Shape),
    /// A mesh file, resolved, and its scale.
    Mesh(String, DVec3),
}

/// Tags of supported geometry.
const FORMS: [&str; 5] = ["box", "sphere", "cylinder", "capsule", "mesh"];

/// Geometry of a visual or collision element; `None`, with a note, if it has none of a supported type or its size is 0,
/// as in placeholders.
///
/// # Errors
/// If a size is invalid or a mesh file is missing.
pub fn form(
    path: &str,
    element: &Element,
    files: &mut Files<'_>,
    notes: &mut Vec<String>,
) -> Result<Option<Form>, ImportError> {
    let line = element.place.1;
    let parts = element.first("geometry").map_or(&[][..], |geometry| &geometry.children);
    let Some(node) = parts.first().filter(|node| FORMS.contains(&node.tag.as_str())) else {
        notes.push(format!("line {line}: {} geometry of an unknown kind is left out", element.tag));
        return Ok(None);
    };
    if parts.len() > 1 {
        notes.push(format!("line {line}: only the first of {} shapes of one <geometry> is used", parts.len()));
    }
    let size = |name: &str| {
        let value = node.number(name, 0.0)?;
        if value > 0.0 { Ok(value) } else { Err(node.wrong(format!("{name}: expected a positive length"))) }
    };
    let lengths = ["size", "radius", "length"].map(|name| node.numbers(name).ok().flatten().unwrap_or_default());
    let are_zero = |values: &Vec<f64>| !values.is_empty() && values.iter().all(|value| *value == 0.0);
    if lengths.iter().any(are_zero) {
        notes.push(format!("line {line}: geometry without extent is left out"));
        return Ok(None);
    }
    let shape = match node.tag.as_str() {
        "box" => {
            let size = DVec3::from_array(node.exactly::<3>("size")?.unwrap_or_default());
            if size.min_element() <= 0.0 {
                return Err(node.wrong("expected three positive lengths as size"));
            }
            Shape::Box { half_extents: size / 2.0 }
        }
        "sphere" => Shape::Sphere { radius: size("radius")? },
        "cylinder" => Shape::Cylinder { radius: size("radius")?, half_height: size("length")? / 2.0 },
        "capsule" => Shape::Capsule { radius: size("radius")?, half_length: size("length")? / 2.0 },
        _ => {
            let named = node.attribute("filename").ok_or_else(|| node.wrong("expected a filename"))?;
            let scale = match node.numbers("scale")?.as_deref() {
                None => DVec3::ONE,
                Some(&[all]) => DVec3::splat(all),
                Some(&[x, y, z]) => DVec3::new(x, y, z),
                Some(_) => return Err(node.wrong("expected one or three numbers as scale")),
            };
            return Ok(Some(Form::Mesh(files.locate(path, named)?, scale)));
        }
    };
    Ok(Some(Form::Shape(shape)))
}

/// Links in the order parents before children, each with the joint to its parent.
fn ordered<'x>(
    robot: &'x Element,
    links: &[&'x Element],
    joints: Vec<Joint<'x>>,
    notes: &mut Vec<String>,
) -> Result<Vec<Link<'x>>, ImportError> {
    let mut nodes: BTreeMap<&str, &'x Element> = BTreeMap::new();
    for link in links {
        let name = link.attribute("name").ok_or_else(|| link.wrong("expected a name"))?;
        if nodes.insert(name, link).is_some() {
            return Err(link.wrong("duplicate link name"));
        }
    }
    // Grippers and other parts often hang from a link of the robot that they are made for.
    let children: BTreeSet<&str> = joints.iter().map(|joint| joint.child).collect();
    if let Some(joint) = joints.iter().find(|joint| !nodes.contains_key(joint.parent))
        && nodes.keys().all(|link| children.contains(link))
        && !children.contains(joint.parent)
    {
        notes.push(format!("link {} is not described: it is taken as an empty base", shortened(joint.parent)));
        // A joint has no geometry and no mass.
        nodes.insert(joint.parent, joint.node);
    }
    let mut hung: BTreeSet<&str> = BTreeSet::new();
    for joint in &joints {
        for end in [joint.parent, joint.child] {
            if !nodes.contains_key(end) {
                return Err(robot.wrong(format!("a joint refers to the unknown link `{}`", shortened(end))));
            }
        }
        if !hung.insert(joint.child) {
            return Err(robot.wrong(format!("link `{}` has two parent joints", shortened(joint.child))));
        }
    }
    let roots: Vec<&str> = nodes.keys().copied().filter(|name| !hung.contains(name)).collect();
    if roots.is_empty() {
        return Err(robot
            .wrong("expected exactly one root link, but every link has a parent joint: the joints form a loop")
            .hint("remove the joint that closes the loop"));
    }
    let [root] = roots.as_slice() else {
        let names = roots.iter().map(|name| shortened(name)).collect::<Vec<_>>().join(", ");
        return Err(robot
            .wrong(format!("expected exactly one root link, got {}: {}", roots.len(), shortened(&names)))
            .hint("attach the others to the first with fixed joints, or remove them"));
    };
    let mut order = vec![Link { name: root, node: nodes[root], joint: None }];
    let mut known = BTreeMap::from([(*root, 0_usize)]);
    while order.len() < nodes.len() {
        let before = order.len();
        // Children in file order, so that equal files give equal indices.
        let parents = known.clone();
        for joint in joints.iter().filter(|joint| !known.contains_key(joint.child)).collect::<Vec<_>>() {
            let Some(&parent) = parents.get(joint.parent) else { continue };
            known.insert(joint.child, order.len());
            order.push(Link { name: joint.child, node: nodes[joint.child], joint: Some((parent, joint.clone())) });
        }
        if order.len() == before {
            return Err(robot.wrong("some links form a loop"));
        }
    }
    Ok(order)
}

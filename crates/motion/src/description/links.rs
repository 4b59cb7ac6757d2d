//! Links with joints, limits and collision pieces.

use genmanip_core::{
    JointKind, MassProperties, Piece, Pose, RobotJoint, RobotLink, Shape,
    glam::{DMat3, DQuat, DVec3, EulerRot},
};
use roxmltree::Node;

use super::error::DescriptionError;
use super::mesh::MeshFile;
use super::tree::Tree;
use super::{mesh, plausible};

/// Joint limits missing in URDF: acceleration [rad/s² or m/s²] and jerk [rad/s³ or m/s³].
const ACCELERATION: f64 = 10.0;
const JERK: f64 = 5000.0;

pub(super) fn read(
    tree: &Tree,
    load: &mut dyn FnMut(&str) -> Result<MeshFile, String>,
) -> Result<Vec<RobotLink>, DescriptionError> {
    // Planning needs no masses; a unit mass keeps the model valid.
    let mass = MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY };
    let read_link = |(node, above): &(Node, Option<(Node, usize)>)| {
        let name = node.attribute("name").unwrap_or_default().to_owned();
        inertial(&name, *node)?;
        let collisions = node.children().filter(|child| child.has_tag_name("collision"));
        let pieces = collisions.map(|collision| piece(&name, collision, load)).collect::<Result<Vec<_>, _>>()?;
        let (parent, parent_from_link, joint) = match above {
            None => (None, Pose::IDENTITY, None),
            Some((node, parent)) => {
                let place = format!("joint {}", node.attribute("name").unwrap_or_default());
                (Some(*parent), origin(&place, *node)?, joint(&place, *node)?)
            }
        };
        Ok(RobotLink { name, parent, parent_from_link, joint, visual: vec![], pieces, mass })
    };
    tree.links.iter().map(read_link).collect()
}

fn joint(place: &str, node: Node) -> Result<Option<RobotJoint>, DescriptionError> {
    let bad = |attribute, expected, got: &str| {
        Err(DescriptionError::BadAttribute { place: place.to_owned(), attribute, expected, got: got.to_owned() })
    };
    let mimics = node.children().any(|child| child.has_tag_name("mimic"));
    let (kind, is_continuous) = match node.attribute("type").unwrap_or_default() {
        "fixed" => return Ok(None),
        _ if mimics => return Ok(None),
        "revolute" => (JointKind::Revolute, false),
        "continuous" => (JointKind::Revolute, true),
        "prismatic" => (JointKind::Prismatic, false),
        other => return bad("type", "fixed, revolute, continuous or prismatic", other),
    };
    let child = |tag| node.children().find(|child| child.has_tag_name(tag));
    let axis = match child("axis").and_then(|axis| axis.attribute("xyz")) {
        None => DVec3::X,
        Some(text) => three(place, "axis", text)?,
    };
    let Some(axis) = axis.try_normalize() else { return bad("axis", "a direction", &axis.to_string()) };
    let limit = child("limit");
    let number = |attribute: &'static str, missing: Option<f64>| match (
        limit.and_then(|limit| limit.attribute(attribute)),
        missing,
    ) {
        (Some(text), _) => finite(place, attribute, text),
        (None, Some(value)) => Ok(value),
        (None, None) => finite(place, attribute, "nothing"),
    };
    let (lower, upper) = if is_continuous {
        (-std::f64::consts::PI, std::f64::consts::PI)
    } else {
        (number("lower", None)?, number("upper", None)?)
    };
    if lower >= upper {
        return bad("limit", "an interval", &format!("{lower}..{upper}"));
    }
    let max_velocity = number("velocity", Some(1.0))?;
    if max_velocity <= 0.0 {
        return bad("velocity", "a positive number", &max_velocity.to_string());
    }
    Ok(Some(RobotJoint {
        name: node.attribute("name").unwrap_or_default().to_owned(),
        kind,
        axis,
        lower,
        upper,
        max_velocity,
        max_acceleration: ACCELERATION,
        max_jerk: JERK,
        max_effort: number("effort", Some(1.0))?,
    }))
}

/// Planning needs no masses, but implausible masses indicate a misread file.
fn inertial(link: &str, node: Node) -> Result<(), DescriptionError> {
    let Some(inertial) = node.children().find(|child| child.has_tag_name("inertial")) else { return Ok(()) };
    let place = format!("link {link}");
    let child = |tag| inertial.children().find(|child| child.has_tag_name(tag));
    let number = |node: Option<Node>, attribute: &'static str| match node.and_then(|node| node.attribute(attribute)) {
        Some(text) => finite(&place, attribute, text),
        None => Ok(0.0),
    };
    let (mass, tensor) = (number(child("mass"), "value")?, child("inertia"));
    let mut inertia = [0.0; 6];
    for (value, name) in inertia.iter_mut().zip(["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]) {
        *value = number(tensor, name)?;
    }
    plausible::check_inertial(&place, mass, inertia)
}

fn piece(
    link: &str,
    collision: Node,
    load: &mut dyn FnMut(&str) -> Result<MeshFile, String>,
) -> Result<Piece, DescriptionError> {
    let place = format!("link {link}");
    let link_from_piece = origin(&place, collision)?;
    let geometry = collision.children().find(|child| child.has_tag_name("geometry"));
    let shape = geometry.and_then(|geometry| geometry.children().find(Node::is_element));
    let Some(shape) = shape else {
        return Err(DescriptionError::BadAttribute {
            place,
            attribute: "geometry",
            expected: "box, cylinder, sphere or mesh",
            got: "nothing".into(),
        });
    };
    let text = |attribute| shape.attribute(attribute).unwrap_or_default();
    let shape = match shape.tag_name().name() {
        "box" => Shape::Box { half_extents: three(&place, "size", text("size"))? / 2.0 },
        "sphere" => Shape::Sphere { radius: finite(&place, "radius", text("radius"))? },
        "cylinder" => Shape::Cylinder {
            radius: finite(&place, "radius", text("radius"))?,
            half_height: finite(&place, "length", text("length"))? / 2.0,
        },
        "mesh" => {
            let scale = shape.attribute("scale").map_or(Ok(DVec3::ONE), |scale| three(&place, "scale", scale))?;
            let name = text("filename");
            let broken = |what| DescriptionError::Mesh { name: name.to_owned(), link: link.to_owned(), what };
            let file = load(name).map_err(broken)?;
            Shape::Hull { points: mesh::hull_corners(&file.name, &file.bytes, scale).map_err(broken)? }
        }
        other => {
            return Err(DescriptionError::BadAttribute {
                place,
                attribute: "geometry",
                expected: "box, cylinder, sphere or mesh",
                got: other.to_owned(),
            });
        }
    };
    Ok(Piece { shape, link_from_piece })
}

fn origin(place: &str, node: Node) -> Result<Pose, DescriptionError> {
    let Some(origin) = node.children().find(|child| child.has_tag_name("origin")) else { return Ok(Pose::IDENTITY) };
    let values = |key: &'static str| origin.attribute(key).map_or(Ok(DVec3::ZERO), |text| three(place, key, text));
    let (position, angles) = (values("xyz")?, values("rpy")?);
    // Fixed axes, roll first.
    Ok(Pose::new(position, DQuat::from_euler(EulerRot::ZYX, angles.z, angles.y, angles.x)))
}

fn three(place: &str, attribute: &'static str, text: &str) -> Result<DVec3, DescriptionError> {
    let values: Vec<f64> = text.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    match values.as_slice() {
        &[x, y, z] if DVec3::new(x, y, z).is_finite() && text.split_whitespace().count() == 3 => {
            Ok(DVec3::new(x, y, z))
        }
        _ => Err(DescriptionError::BadAttribute {
            place: place.to_owned(),
            attribute,
            expected: "three finite numbers",
            got: text.chars().take(60).collect(),
        }),
    }
}

fn finite(place: &str, attribute: &'static str, text: &str) -> Result<f64, DescriptionError> {
    text.trim().parse().ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| DescriptionError::BadAttribute {
        place: place.to_owned(),
        attribute,
        expected: "a finite number",
        got: text.chars().take(60).collect(),
    })
}

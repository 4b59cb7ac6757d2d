//! Robot models from URDF: links, joints and convex collision pieces, with typed errors.
//!
//! Text and meshes are arguments: the caller reads the files. Values missing in URDF are chosen here: accelerations, a
//! home configuration, and the tool frame. Every mesh is replaced by its convex hull, and fingers are fixed at their
//! zero position.

mod error;
mod links;
mod mesh;
mod plausible;
#[cfg(test)]
mod tests;
mod tree;

use std::collections::BTreeMap;

use genmanip_core::limits;
use genmanip_core::{Gripper, Pose, RobotModel, Seed, glam::DVec3};
use rand::RngExt;

use crate::collision::{AllowedCollisions, Checker, CollisionWorld, RobotShape};
pub use error::DescriptionError;
pub use mesh::MeshFile;
pub use plausible::{MAX_CORNERS, MAX_JOINTS, MAX_LINKS, MAX_PIECES, MAX_REACH_M};

/// Number of sampled configurations to find links that always touch.
const SAMPLES: usize = 64;

/// Reads a robot from URDF, and the pairs allowed to touch from SRDF.
///
/// `mesh` loads the mesh of a name in the file, or another with the same convex hull. `tip` names the link of the tool
/// frame; the default is the SRDF's end effector or the last frame of the arm. Adjacent links, and without an SRDF
/// those that touch at every sampled configuration, are never checked against each other.
///
/// # Errors
///
/// Reports the first problem with its location; see [`DescriptionError`].
pub fn read_robot(
    urdf: &str,
    srdf: Option<&str>,
    tip: Option<&str>,
    mesh: &mut dyn FnMut(&str) -> Result<MeshFile, String>,
) -> Result<RobotModel, DescriptionError> {
    for text in [Some(urdf), srdf].into_iter().flatten() {
        if text.len() as u64 > limits::ROBOT.bytes {
            return Err(DescriptionError::Huge {
                what: "the description".into(),
                size: text.len(),
                limit: limits::ROBOT.bytes as usize,
                unit: "bytes",
            });
        }
    }
    let parse = |text| roxmltree::Document::parse(text).map_err(|error| DescriptionError::NotXml(error.to_string()));
    let document = parse(urdf)?;
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(DescriptionError::NotARobot { found: root.tag_name().name().to_owned() });
    }
    let semantics = srdf.map(parse).transpose()?;
    let tree = tree::Tree::of(root)?;
    let links = links::read(&tree, mesh)?;
    plausible::check(&links)?;
    let indices: BTreeMap<&str, usize> =
        links.iter().zip(0..).map(|(link, index)| (link.name.as_str(), index)).collect();
    let position = |name: &str, by: &str| {
        let found = indices.get(name).copied();
        found.ok_or_else(|| DescriptionError::UnknownLink { name: name.to_owned(), by: by.to_owned() })
    };
    let mut never_colliding: Vec<(usize, usize)> =
        links.iter().enumerate().filter_map(|(index, link)| Some((link.parent?, index))).collect();
    let mut named_tip = tip.map(|name| position(name, "the requested tool frame")).transpose()?;
    if let Some(semantics) = &semantics {
        for semantic in semantics.descendants() {
            let attribute = |key| semantic.attribute(key).unwrap_or_default();
            match semantic.tag_name().name() {
                "disable_collisions" => never_colliding.push((
                    position(attribute("link1"), "disable_collisions")?,
                    position(attribute("link2"), "disable_collisions")?,
                )),
                "end_effector" if named_tip.is_none() => {
                    named_tip = Some(position(attribute("parent_link"), "end_effector")?);
                }
                _ => {}
            }
        }
    }
    if !links.iter().any(|link| link.joint.is_some()) {
        return Err(DescriptionError::NothingMoves);
    }
    let hand = named_tip.unwrap_or_else(|| tree::last_frame(&links));
    let home = links.iter().filter_map(|link| link.joint.as_ref());
    let home: Vec<f64> = home
        .map(|joint| if joint.lower < 0.0 && joint.upper > 0.0 { 0.0 } else { 0.5 * (joint.lower + joint.upper) })
        .collect();
    let mut robot = RobotModel {
        name: root.attribute("name").unwrap_or("robot").to_owned(),
        hand,
        hand_from_tcp: Pose::IDENTITY,
        // No finger links: the tool frame never moves by itself.
        gripper: Gripper { fingers: [hand, hand], max_width: 0.0, max_force: 0.0, pad_size: DVec3::ZERO },
        home,
        drives: None,
        reach: None,
        hand_from_wrist_camera: None,
        never_colliding,
        links,
    };
    if robot.links[hand].joint.is_some() {
        tree::add_tool_frame(&mut robot);
    }
    robot.never_colliding.sort_unstable();
    robot.never_colliding.dedup();
    plausible::check_reach(&robot)?;
    if semantics.is_none() {
        let always = always_touching(&robot)?;
        robot.never_colliding.extend(always);
    }
    RobotShape::new(&robot)?;
    Ok(robot)
}

/// Link pairs that touch at every sampled configuration: their hulls overlap by construction.
fn always_touching(robot: &RobotModel) -> Result<Vec<(usize, usize)>, DescriptionError> {
    let shape = RobotShape::new(robot)?;
    let (world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
    let checker = Checker::new(&shape, &world, None, &allowed, 0.0, 0.0);
    let mut rng = Seed::new(0).fork("links that always touch").rng();
    let mut always: Option<Vec<(usize, usize)>> = None;
    for _ in 0..SAMPLES {
        let limits = shape.chain().lower().zip(shape.chain().upper());
        let config: Vec<f64> = limits.map(|(lower, upper)| rng.random_range(lower..=upper)).collect();
        let touching = checker.touching_links(&config);
        always = Some(match always {
            None => touching,
            Some(pairs) => pairs.into_iter().filter(|pair| touching.contains(pair)).collect(),
        });
    }
    Ok(always.unwrap_or_default())
}

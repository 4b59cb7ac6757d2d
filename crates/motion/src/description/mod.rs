//! Robots from URDF text: links, joints and convex collision pieces, with typed errors for what is broken.
//!
//! Text and meshes are arguments: whoever calls reads the files.
//! What URDF does not hold is chosen here: accelerations, a home configuration, and the tool frame.
//! Every mesh stands for its convex hull, and fingers stay where the file puts them.

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

use crate::collision::{Allowed, Checker, CollisionWorld, RobotShape};
pub use error::DescriptionError;
pub use plausible::{MAX_CORNERS, MAX_JOINTS, MAX_LINKS, MAX_PIECES, MAX_REACH_M};

/// Configurations at which links that always touch are found.
const SAMPLES: usize = 64;

/// What was found for the name of a mesh.
#[derive(Clone, Debug)]
pub struct MeshFile {
    /// Its file name; the ending tells the format (`stl`, `obj`).
    pub name: String,
    /// Its contents.
    pub bytes: Vec<u8>,
}

/// A robot from its URDF, and the pairs of links that its SRDF lets touch.
///
/// `mesh` gives the mesh, or another with the same convex hull, for a name in the file, or says why it cannot.
/// `tip` names the link that is the tool frame; without it, the SRDF's end effector, or the last frame of the arm, is.
/// Links that are joined, and without an SRDF those that touch at every sampled configuration, are never tested
/// against each other.
///
/// # Errors
///
/// One for the first thing that is wrong, with its place; see [`DescriptionError`].
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
    let rules = srdf.map(parse).transpose()?;
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
    let mut named_tip = tip.map(|name| position(name, "the wish for a tool frame")).transpose()?;
    if let Some(rules) = &rules {
        for rule in rules.descendants() {
            let attribute = |key| rule.attribute(key).unwrap_or_default();
            match rule.tag_name().name() {
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
        // No link is a finger: the tool frame never moves by itself.
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
    if rules.is_none() {
        let always = always_touching(&robot)?;
        robot.never_colliding.extend(always);
    }
    RobotShape::new(&robot)?;
    Ok(robot)
}

/// Pairs of links that touch at every sampled configuration: their hulls overlap by construction.
fn always_touching(robot: &RobotModel) -> Result<Vec<(usize, usize)>, DescriptionError> {
    let shape = RobotShape::new(robot)?;
    let (world, allowed) = (CollisionWorld::new(), Allowed::none());
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

//! Kinematic tree of a description, parents first.

use std::collections::BTreeMap;

use genmanip_core::{Pose, RobotLink, RobotModel};
use roxmltree::Node;

use super::{DescriptionError, plausible::MAX_LINKS};

/// Link elements with their parent joint and parent index, parents first.
pub(super) struct Tree<'a> {
    pub(super) links: Vec<(Node<'a, 'a>, Option<(Node<'a, 'a>, usize)>)>,
}

impl<'a> Tree<'a> {
    pub(super) fn of(root: Node<'a, 'a>) -> Result<Self, DescriptionError> {
        let children = |tag: &'static str| root.children().filter(move |node| node.has_tag_name(tag));
        let count = children("link").count();
        if count > MAX_LINKS {
            return Err(DescriptionError::Huge {
                what: "the robot".into(),
                size: count,
                limit: MAX_LINKS,
                unit: "links",
            });
        }
        let elements = unique(children("link"), "link")?;
        unique(children("joint"), "joint")?;
        let mut above: BTreeMap<&str, (Node, &str)> = BTreeMap::new();
        for joint in children("joint") {
            let name = joint.attribute("name").unwrap_or_default();
            let end = |tag: &'static str| {
                let link = joint.children().find(|node| node.has_tag_name(tag)).and_then(|node| node.attribute("link"));
                let link = link.unwrap_or_default();
                if elements.contains_key(link) {
                    return Ok(link);
                }
                Err(DescriptionError::UnknownLink { name: link.to_owned(), by: format!("joint {name}, as {tag},") })
            };
            let (parent, child) = (end("parent")?, end("child")?);
            if above.insert(child, (joint, parent)).is_some() {
                return Err(DescriptionError::TwoParents(child.to_owned()));
            }
        }
        let bases: Vec<&str> = elements.keys().copied().filter(|name| !above.contains_key(name)).collect();
        let [base] = bases.as_slice() else {
            let what = match bases.as_slice() {
                [] => "every link is the child of another".to_owned(),
                several => format!("{} have no joint above them", several.join(", ")),
            };
            return Err(DescriptionError::NotATree(what));
        };
        let mut order = vec![*base];
        let mut links = vec![(elements[base], None)];
        let mut next = 0;
        // Joints in file order, so that the arm's joints keep theirs.
        let mut below: Vec<(&str, Node, &str)> =
            above.iter().map(|(&child, &(joint, parent))| (child, joint, parent)).collect();
        below.sort_by_key(|(_, joint, _)| joint.id().get());
        while next < order.len() {
            let here = order[next];
            for &(child, joint, _) in below.iter().filter(|(_, _, parent)| *parent == here) {
                order.push(child);
                links.push((elements[child], Some((joint, next))));
            }
            next += 1;
        }
        if let Some(name) = elements.keys().find(|name| !order.contains(name)) {
            return Err(DescriptionError::NotATree(format!("{name} is part of a cycle")));
        }
        Ok(Self { links })
    }
}

fn unique<'a>(
    nodes: impl Iterator<Item = Node<'a, 'a>>,
    kind: &'static str,
) -> Result<BTreeMap<&'a str, Node<'a, 'a>>, DescriptionError> {
    let mut found = BTreeMap::new();
    for node in nodes {
        let name = node.attribute("name").unwrap_or_default();
        if found.insert(name, node).is_some() {
            return Err(DescriptionError::Twice { kind, name: name.to_owned() });
        }
    }
    Ok(found)
}

/// The frame at the end of the longest arm: preferably a leaf without geometry after its last joint (such as a tool
/// frame), otherwise the last link before a branch.
pub(super) fn last_frame(links: &[RobotLink]) -> usize {
    let depth = |mut index: usize| {
        let mut joints = usize::from(links[index].joint.is_some());
        while let Some(parent) = links[index].parent {
            index = parent;
            joints += usize::from(links[index].joint.is_some());
        }
        joints
    };
    let depths: Vec<usize> = (0..links.len()).map(depth).collect();
    let deepest = depths.iter().copied().max().unwrap_or(0);
    let children = |index: usize| (0..links.len()).filter(move |child| links[*child].parent == Some(index));
    let is_frame = |index: &usize| links[*index].pieces.is_empty() && children(*index).next().is_none();
    if let Some(frame) = (0..links.len()).rev().filter(|index| depths[*index] == deepest).find(is_frame) {
        return frame;
    }
    let mut last = (0..links.len()).find(|index| depths[*index] == deepest).unwrap_or(0);
    while let (Some(child), None) = (children(last).next(), children(last).nth(1)) {
        last = child;
    }
    last
}

/// Adds a link without geometry at the tool frame: a link moved by a joint cannot be the hand.
pub(super) fn add_tool_frame(robot: &mut RobotModel) {
    let parent = &robot.links[robot.hand];
    robot.links.push(RobotLink {
        name: format!("{} (tool)", parent.name),
        parent: Some(robot.hand),
        parent_from_link: Pose::IDENTITY,
        joint: None,
        visual: vec![],
        pieces: vec![],
        mass: parent.mass,
    });
    robot.hand = robot.links.len() - 1;
    robot.gripper.fingers = [robot.hand; 2];
}

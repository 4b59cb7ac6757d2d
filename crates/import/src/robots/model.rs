//! Planning model of a robot from its description.
//!
//! Values missing in URDF are proposed here: accelerations, velocities, a home configuration, and the tool frame. Every
//! collision mesh is replaced by its convex hull, or the hulls of its parts if it is bent.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{
    Gripper, JointKind, MassProperties, Mimic, Piece, Pose, RobotJoint, RobotLink, RobotModel, Shape,
    glam::{DMat3, DVec3},
};

use super::cuts;
use super::hulls::{self, MAX_CORNERS};
use super::plausible::{self, MAX_ANGLE, MAX_LINKS};
use super::srdf::Semantics;
use super::{tool_frame, visual};
use crate::ImportError;
use crate::files::{Files, shortened};
use crate::formats::urdf::{self, Form, Link, Motion};
use crate::formats::{self, xml::Element};

/// Joint limits missing in URDF: acceleration [rad/s² or m/s²] and (`JERK`) jerk [rad/s³ or m/s³]. Chosen by hand.
const ACCELERATION: f64 = 10.0;
const JERK: f64 = 5000.0;
/// Velocity [rad/s or m/s] and (`EFFORT`) effort [N·m or N] of a joint that states none, or 0. Chosen by hand.
const VELOCITY: f64 = 1.0;
const EFFORT: f64 = 1.0;
/// Limit beyond which a slide counts as unlimited, m: limits mistakenly given in millimetres are smaller; and (`SLIDE_M`)
/// the limit that is assumed then, either way.
const UNLIMITED_M: f64 = 50_000.0;
const SLIDE_M: f64 = 5.0;
/// Distance below which a link pair counts as always near (m): twice the clearance that the planner keeps, since a
/// search could hardly move pairs that always stay closer.
const ALWAYS_NEAR_M: f64 = 0.006;
/// Minimum simplification error of a hull that is noted, m. Chosen by hand.
const NOTED_M: f64 = 0.001;

/// Options of the reader.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// Name of the link that is the tool frame; `None` to choose it automatically.
    pub tip: Option<String>,
    /// True to replace missing collision geometry by hulls of visual meshes.
    pub visuals_collide: bool,
    /// True to read surfaces for rendering; planning needs none.
    pub visible: bool,
}

/// A robot model for planning, with the assumptions made.
#[derive(Debug)]
pub struct PlannedRobot {
    /// Robot model with collision hulls.
    pub model: RobotModel,
    /// Assumptions, repairs and omissions, one sentence each.
    pub notes: Vec<String>,
}

/// Builds the model of a parsed description.
///
/// Adjacent links, pairs that the SRDF disables, and pairs that are near at nearly every configuration are excluded
/// from self-collision checks.
///
/// # Errors
/// With file and line of the first problem.
pub fn build(
    robot: &Element,
    semantics: &Semantics,
    choices: &Choices,
    files: &mut Files<'_>,
) -> Result<PlannedRobot, ImportError> {
    let path = robot.place.0.clone();
    let mut notes = Vec::new();
    let described = urdf::links(robot, MAX_LINKS, &mut notes)?;
    let mut builder =
        Builder { path: &path, files, notes, hulls: BTreeMap::new(), cut: Vec::new(), simplified: Vec::new() };
    let mut links = builder.links(&described, choices)?;
    builder.follow(&described, &mut links)?;
    let would_move = |joint: &urdf::Joint<'_>| joint.motion.is_some() || joint.held.is_some();
    let has_motion = described.iter().any(|link| link.joint.as_ref().is_some_and(|(_, joint)| would_move(joint)));
    let Builder { mut notes, cut, simplified, .. } = builder;
    if choices.visible {
        visual::add(robot, &described, &mut links, files, &mut notes)?;
    }
    if !cut.is_empty() {
        notes.push(format!("bent meshes collide as the hulls of their parts: {}", listed(&cut)));
    }
    if let Some((name, from, to, error_m)) = simplified.iter().max_by(|a, b| a.3.total_cmp(&b.3)) {
        notes.push(format!(
            "{} hulls simplified outwards to at most {MAX_CORNERS} corners, by up to {:.1} mm ({name}: {from} to {to})",
            simplified.len(),
            error_m * 1e3
        ));
    }
    plausible::check(&path, &links)?;
    if !links.iter().any(|link| link.joint.is_some()) {
        let hint = if has_motion {
            "the range of every joint is empty: state their limits, as in <limit lower=\"-3.1\" upper=\"3.1\"/>"
        } else {
            "expected at least one revolute, continuous or prismatic joint"
        };
        return Err(ImportError::new(path, "no joint moves").hint(hint));
    }
    let position = |name: &str, by: &str| {
        links.iter().position(|link| link.name == name).ok_or_else(|| {
            ImportError::new(&path, format!("{by} refers to link {}, which does not exist", shortened(name)))
                .hint("link names must match those of the URDF")
        })
    };
    let mut never_colliding: Vec<(usize, usize)> =
        links.iter().enumerate().filter_map(|(index, link)| Some((link.parent?, index))).collect();
    // The SRDF of a robot with another gripper or base names links that this one lacks.
    let mut unknown: BTreeSet<String> = BTreeSet::new();
    for [a, b] in &semantics.disabled {
        match (position(a, "disable_collisions"), position(b, "disable_collisions")) {
            (Ok(a), Ok(b)) => never_colliding.push((a, b)),
            (first, second) => {
                unknown.extend(first.is_err().then(|| shortened(a)));
                unknown.extend(second.is_err().then(|| shortened(b)));
            }
        }
    }
    if !unknown.is_empty() {
        let names: Vec<String> = unknown.into_iter().collect();
        notes.push(format!("pairs of the SRDF with links that do not exist are left out: {}", listed(&names)));
    }
    let hand = match (&choices.tip, &semantics.end_effector) {
        (Some(tip), _) => position(tip, "the requested tool frame")?,
        (None, Some(link)) => position(link, "end_effector")?,
        (None, None) => tool_frame::tool_frame(&links),
    };
    if choices.tip.is_none() {
        notes.push(format!("tool frame: link {}; another one by --tip LINK", links[hand].name));
    }
    let own = links.iter().filter_map(|link| link.joint.as_ref()).filter(|joint| joint.mimic.is_none());
    let home = own
        .map(|joint| if joint.lower < 0.0 && joint.upper > 0.0 { 0.0 } else { 0.5 * (joint.lower + joint.upper) })
        .collect();
    let mut model = RobotModel {
        name: robot.attribute("name").unwrap_or("robot").to_owned(),
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
    if model.links[hand].joint.is_some() {
        tool_frame::add_tool_frame(&mut model);
    }
    model.never_colliding.iter_mut().for_each(|pair| *pair = (pair.0.min(pair.1), pair.0.max(pair.1)));
    model.never_colliding.sort_unstable();
    model.never_colliding.dedup();
    plausible::check_reach(&path, &model)?;
    let always = genmanip_motion::always_near(&model, ALWAYS_NEAR_M).map_err(|error| {
        ImportError::new(&path, error.to_string()).hint("expected finite, convex collision geometry")
    })?;
    if !always.is_empty() {
        let name = |link: usize| model.links[link].name.as_str();
        let pairs: Vec<String> = always.iter().map(|&(a, b)| format!("{} and {}", name(a), name(b))).collect();
        notes.push(format!(
            "always within {:.0} mm of each other, so not checked, as an SRDF would say: {}",
            ALWAYS_NEAR_M * 1e3,
            listed(&pairs)
        ));
        model.never_colliding.extend(always);
    }
    Ok(PlannedRobot { model, notes })
}

/// The first few names of a list, joined for a message.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 6;
    let shown = names.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown} and {} more", names.len() - SHOWN) } else { shown }
}

struct Builder<'a, 'b> {
    path: &'a str,
    files: &'a mut Files<'b>,
    notes: Vec<String>,
    /// Vertices of the hulls of a mesh by file and scale.
    hulls: BTreeMap<(String, [u64; 3]), Vec<Vec<DVec3>>>,
    /// Files that are cut, with the number of parts.
    cut: Vec<String>,
    /// File, number of hull vertices before and after simplification, and error (m).
    simplified: Vec<(String, usize, usize, f64)>,
}

impl Builder<'_, '_> {
    fn links(&mut self, described: &[Link<'_>], choices: &Choices) -> Result<Vec<RobotLink>, ImportError> {
        // Planning needs no masses.
        let none = MassProperties { mass_kg: 0.0, center: DVec3::ZERO, inertia: DMat3::ZERO };
        let (mut free, mut borrowed) = (Vec::new(), Vec::new());
        let mut links = Vec::new();
        for link in described {
            let mut mass = none;
            if let Some(inertial) = link.node.first("inertial") {
                plausible::check_inertial(inertial)?;
                mass = urdf::mass(inertial)?.unwrap_or(none);
            }
            let mut pieces = Vec::new();
            for collision in link.node.all("collision") {
                pieces.extend(self.pieces(collision)?);
            }
            if pieces.is_empty() && link.node.first("visual").is_some() {
                if choices.visuals_collide {
                    for visual in link.node.all("visual") {
                        pieces.extend(self.pieces(visual)?);
                    }
                    borrowed.push(link.name.to_owned());
                } else {
                    free.push(link.name.to_owned());
                }
            }
            let (parent, parent_from_link, joint) = match &link.joint {
                None => (None, Pose::IDENTITY, None),
                Some((parent, joint)) => {
                    let motion = joint.motion.as_ref().map(|motion| self.joint(joint.name, joint.node, motion));
                    (Some(*parent), joint.parent_from_joint, motion.transpose()?.flatten())
                }
            };
            let name = link.name.to_owned();
            links.push(RobotLink { name, parent, parent_from_link, joint, visual: vec![], pieces, mass });
        }
        if !free.is_empty() {
            self.notes.push(format!(
                "visible but without collision geometry, so nothing stops: {}; --visuals-collide takes the hulls of what is \
                 visible",
                listed(&free)
            ));
        }
        if !borrowed.is_empty() {
            self.notes.push(format!("the hulls of visual geometry collide for {}", listed(&borrowed)));
        }
        Ok(links)
    }

    /// A moving joint; `None` if its range is empty. For a mimic joint, the joint that it follows is filled in by
    /// [`Self::follow`].
    fn joint(&mut self, name: &str, node: &Element, motion: &Motion<'_>) -> Result<Option<RobotJoint>, ImportError> {
        let coupled = motion.mimic.is_some();
        let is_endless = motion.kind == JointKind::Revolute && motion.range.is_some_and(urdf::is_endless);
        let continuous = motion.continuous || is_endless;
        if continuous && !motion.continuous {
            self.notes
                .push(format!("joint {name} has limits of more than {} rad: taken as continuous", urdf::NO_LIMIT));
        }
        let (lower, upper) = match (motion.range, motion.kind) {
            _ if continuous => (-MAX_ANGLE, MAX_ANGLE),
            (Some([lower, upper]), JointKind::Prismatic) if lower.abs().max(upper.abs()) > UNLIMITED_M => {
                let [lower, upper] = [lower, upper].map(|limit| limit.clamp(-SLIDE_M, SLIDE_M));
                self.notes.push(format!(
                    "joint {name} has limits of more than {UNLIMITED_M} m: {lower} to {upper} m are assumed"
                ));
                (lower, upper)
            }
            (Some([lower, upper]), _) => (lower, upper),
            (None, JointKind::Revolute) => {
                self.notes.push(format!("joint {name} states no limits: half a turn either way is assumed"));
                (-std::f64::consts::PI, std::f64::consts::PI)
            }
            (None, JointKind::Prismatic) => {
                return Err(node.wrong("a slide needs limits").hint("add <limit lower=\"…\" upper=\"…\"/> in metres"));
            }
        };
        if upper - lower < urdf::MIN_RANGE && !coupled {
            self.notes.push(format!("joint {name} has the empty range {lower}..{upper}: taken as fixed at 0"));
            return Ok(None);
        }
        let mut positive = |what: &str, value: Option<f64>, otherwise: f64, most: f64| match value {
            Some(0.0) => {
                self.notes.push(format!("joint {name} states the {what} 0: {otherwise} is assumed"));
                otherwise
            }
            Some(value) if value > most => {
                self.notes.push(format!("joint {name} states the {what} {value}: {most} is assumed"));
                most
            }
            Some(value) => value,
            None => otherwise,
        };
        let max_velocity = positive("velocity", motion.velocity, VELOCITY, plausible::SPEEDS[1]);
        let max_effort = positive("effort", motion.effort, EFFORT, plausible::MAX_EFFORT);
        Ok(Some(RobotJoint {
            name: name.to_owned(),
            kind: motion.kind,
            axis: motion.axis,
            lower,
            upper,
            max_velocity,
            max_acceleration: ACCELERATION,
            max_jerk: JERK,
            max_effort,
            continuous,
            mimic: motion.mimic.map(|(_, multiplier, offset)| Mimic { link: 0, multiplier, offset }),
        }))
    }

    /// Resolves the joints that mimic joints follow, also through chains of mimic joints.
    fn follow(&mut self, described: &[Link<'_>], links: &mut [RobotLink]) -> Result<(), ImportError> {
        let mimic = |link: usize| described[link].joint.as_ref()?.1.motion.as_ref()?.mimic;
        'links: for link in 0..described.len() {
            let Some((_, mut multiplier, mut offset)) = mimic(link) else { continue };
            let mut at = link;
            let mut steps = 0;
            while let Some((named, factor, shift)) = mimic(at) {
                if at != link {
                    (multiplier, offset) = (multiplier * factor, multiplier * shift + offset);
                }
                let is_named =
                    |(_, other): &(usize, &Link)| other.joint.as_ref().is_some_and(|(_, joint)| joint.name == named);
                let Some((found, _)) = described.iter().enumerate().find(is_named) else {
                    // Left as a joint of its own.
                    let own = described[link].joint.as_ref().map_or("", |(_, joint)| joint.name);
                    self.notes.push(format!(
                        "joint {} follows {}, which does not exist: it moves by itself",
                        shortened(own),
                        shortened(named)
                    ));
                    links[link].joint = self.alone(&described[link])?;
                    continue 'links;
                };
                at = found;
                steps += 1;
                if steps > described.len() {
                    return Err(ImportError::new(self.path, "joints follow each other in a circle"));
                }
            }
            let driver = links[at].joint.as_ref().map(|joint| [joint.lower, joint.upper]);
            match (&mut links[link].joint, driver) {
                (Some(joint), Some(limits)) => {
                    joint.mimic = Some(Mimic { link: at, multiplier, offset });
                    // A mimic joint moves as far as the joint that it follows; its own stated limits are ignored.
                    let [one, other] = limits.map(|limit| multiplier * limit + offset);
                    (joint.lower, joint.upper) = (one.min(other), one.max(other));
                }
                // A joint that follows a fixed joint is fixed as well, where that one puts it.
                (joint, _) => {
                    let Some(own) = joint.take() else { continue };
                    let led_by = described[at].joint.as_ref().and_then(|(_, leader)| leader.held).unwrap_or(0.0);
                    let position = multiplier * led_by + offset;
                    self.notes.push(format!("joint {} follows a fixed joint: it is fixed at {position}", own.name));
                    let link = &mut links[link];
                    link.parent_from_link = link.parent_from_link * own.kind.motion(own.axis, position);
                }
            }
        }
        Ok(())
    }

    /// The joint to a link, without what it follows.
    fn alone(&mut self, link: &Link<'_>) -> Result<Option<RobotJoint>, ImportError> {
        let Some((_, joint)) = &link.joint else { return Ok(None) };
        let Some(motion) = &joint.motion else { return Ok(None) };
        self.joint(joint.name, joint.node, &Motion { mimic: None, ..motion.clone() })
    }

    /// Convex pieces of a collision or visual element.
    fn pieces(&mut self, element: &Element) -> Result<Vec<Piece>, ImportError> {
        let link_from_piece = urdf::origin(element)?;
        let shapes = match urdf::form(self.path, element, self.files, &mut self.notes)? {
            None => Vec::new(),
            Some(Form::Shape(shape)) => vec![shape],
            Some(Form::Mesh(file, scale)) => {
                self.hulls(&file, scale)?.into_iter().map(|points| Shape::Hull { points }).collect()
            }
        };
        Ok(shapes.into_iter().map(|shape| Piece { shape, link_from_piece }).collect())
    }

    /// Vertices of the hulls that enclose a mesh; empty if it has no triangles.
    fn hulls(&mut self, file: &str, scale: DVec3) -> Result<Vec<Vec<DVec3>>, ImportError> {
        let key = (file.to_owned(), scale.to_array().map(f64::to_bits));
        if let Some(known) = self.hulls.get(&key) {
            return Ok(known.clone());
        }
        // A precomputed hull beside the mesh is read instead of the mesh.
        let beside = format!("{file}.convex.stl");
        let source = if std::path::Path::new(&beside).is_file() { beside } else { file.to_owned() };
        let mut mesh = formats::triangles(&source, self.files).map_err(formats::advised)?;
        mesh.as_flattened_mut().iter_mut().for_each(|corner| *corner *= scale);
        if !mesh.as_flattened().iter().all(|corner| corner.is_finite() && corner.abs().max_element() < 1e3) {
            return Err(ImportError::new(source, "a vertex is not finite or more than 1 km away"));
        }
        let name = file.rsplit('/').next().unwrap_or(file);
        let parts = cuts::parts(mesh);
        if parts.len() > 1 {
            self.cut.push(format!("{name} ({})", parts.len()));
        }
        let mut found = Vec::new();
        for part in parts {
            let count = 3 * part.len();
            match hulls::hull(part.concat()) {
                None => self.notes.push(format!("mesh {name} has no triangles: it collides with nothing")),
                Some(hull) => {
                    if hull.thickened {
                        self.notes.push(format!("mesh {name} is flat: it is taken as 1 mm thick"));
                    } else if hull.error_m > NOTED_M {
                        self.simplified.push((name.to_owned(), count, hull.corners.len(), hull.error_m));
                    }
                    found.push(hull.corners);
                }
            }
        }
        self.hulls.insert(key, found.clone());
        Ok(found)
    }
}

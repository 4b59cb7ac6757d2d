//! The import pipeline: from a raw object to an object model.

use genmanip_assets::surface;
use genmanip_core::{
    Aabb, Annotations, AssetRef, CavitySize, JointState, ObjectCard, ObjectLink, ObjectModel, Piece, Pose, VisualPart,
};
use glam::{DVec2, DVec3, Vec2};

use crate::collision::{self, Body};
use crate::raw::{RawLink, RawObject, Surface};
use crate::report::{Guess, Report};
use crate::typical_sizes::{self, Prior};
use crate::units_and_frame::{self, Given};
use crate::{ImportError, clean, mass, names_and_colors, simplify};

/// Default friction coefficient: between wood and rubber on dry surfaces.
const FRICTION: f64 = 0.6;
/// Plausible range of sliding friction coefficients; values from files are clamped to it.
const FRICTION_RANGE: [f64; 2] = [0.2, 1.1];
/// Maximum width of a graspable object, m: the gripper's opening minus clearance.
const GRASP_M: f64 = 0.074;
/// Maximum mass of a graspable object, kg. Chosen by hand.
const GRASP_KG: f64 = 2.0;
/// Fractions of a joint's range up to which it counts as closed, and (`OPEN`) from which it counts as open. Chosen by
/// hand.
const CLOSED: f64 = 0.1;
const OPEN: f64 = 0.7;
/// Maximum number of collision pieces of all links. Objects of most packs have fewer than 100; an object standing on
/// 600 needed 12 s of CPU time to settle.
const MAX_PIECES: usize = 256;
/// Maximum number of joints for which states are generated. Chosen by hand.
const MAX_STATES: usize = 6;

/// Builds an object model from file contents; properties that the files do not specify are guessed.
///
/// # Errors
/// If nothing remains after cleaning, or the object encloses no volume.
pub fn build(file: &str, mut raw: RawObject, hash: &str, given: &Given) -> Result<(ObjectModel, Report), ImportError> {
    let mut guesses = Vec::new();
    let mut name = names_and_colors::name(file, &raw.name);
    if let Some(category) = given.category.as_deref().filter(|_| name == names_and_colors::NAMELESS) {
        name = names_and_colors::title(category);
    }
    clean::clean(file, &mut raw)?;
    raw.drop_empty_root();
    let prior = match &given.category {
        Some(category) => typical_sizes::of_name(category).filter(|prior| prior.category == *category),
        None => typical_sizes::of_name(&name).or_else(|| typical_sizes::of_name(&raw.name)),
    };
    guesses.push(match prior {
        _ if given.category.is_some() => Guess::new("category", category(&name, prior, given), "given"),
        Some(prior) => Guess::new("category", &prior.category, format!("the name `{name}`")),
        None => Guess::new("category", category(&name, None, given), "no category of the catalogue is in its name"),
    });
    units_and_frame::to_metres(&mut raw, given.scale, prior, &mut guesses);
    units_and_frame::upright(&mut raw, given.up, prior, &mut guesses);
    if let Some(up) = given.tipped_up {
        units_and_frame::lay(&mut raw, up, &mut guesses);
    }
    units_and_frame::center(&mut raw);
    simplify::simplify(&mut raw);
    bound_pieces(file, raw.links.iter().map(|link| link.collision.len()).sum(), 8 * MAX_PIECES)?;
    let mut bodies: Vec<Body> = raw.links.iter().map(collision::body).collect();
    let duplicates: usize = bodies.iter_mut().map(|body| drop_duplicates(&mut body.pieces)).sum();
    if duplicates > 0 {
        raw.notes.push(format!("dropped {duplicates} duplicate collision shapes"));
    }
    bound_pieces(file, bodies.iter().map(|body| body.pieces.len()).sum(), MAX_PIECES)?;
    for (link, body) in raw.links.iter().zip(&bodies).filter(|(_, body)| !body.pieces.is_empty()) {
        let what = if bodies.len() == 1 { "collision".to_owned() } else { format!("collision of {}", link.name) };
        if link.collision.is_empty() || body.how.contains("mesh") {
            guesses.push(Guess::new(what, &body.how, "the visual mesh"));
        }
    }
    if bodies[0].pieces.is_empty() && bodies.iter().all(|body| body.pieces.is_empty()) {
        return Err(ImportError::new(file, "encloses no volume, so it has no collision geometry"));
    }
    let (mut raw, bodies) = standing(raw, bodies);
    let size = units_and_frame::bounds(&raw).size().max(collision_bounds(&raw, &bodies).size());
    let pieces: Vec<&[Piece]> = bodies.iter().map(|body| body.pieces.as_slice()).collect();
    let masses = mass::masses(&raw.links, &pieces, size, prior, &mut guesses);
    let friction = friction(&raw, &mut guesses);
    let states = joint_states(&raw.links);
    let links: Vec<ObjectLink> = raw
        .links
        .iter()
        .zip(bodies)
        .zip(&masses)
        .map(|((link, body), mass)| ObjectLink {
            name: link.name.clone(),
            joint: link.joint.clone(),
            visual: visual(&link.surfaces),
            pieces: body.pieces,
            cavity: body.cavity,
            mass: *mass,
        })
        .collect();
    let mut repairs = std::mem::take(&mut raw.notes);
    repairs.dedup();
    let category = category(&name, prior, given);
    let card = card(&name, category, &raw, &links, size, hash, prior, &states, &mut guesses);
    let model = ObjectModel {
        asset: card.asset.clone(),
        family: card.category.clone(),
        card,
        links,
        friction,
        joint_states: states,
    };
    Ok((model, Report { guesses, repairs }))
}

/// Rejects objects with more collision shapes than physics can handle.
fn bound_pieces(file: &str, count: usize, most: usize) -> Result<(), ImportError> {
    if count <= most {
        return Ok(());
    }
    let message = format!("{count} collision shapes; at most {most} are supported");
    Err(ImportError::new(file, message)
        .hint("merge its collision shapes, or remove them to derive a few from the visual mesh"))
}

/// Removes duplicate pieces and returns their number.
fn drop_duplicates(pieces: &mut Vec<Piece>) -> usize {
    let before = pieces.len();
    let mut kept: Vec<Piece> = Vec::new();
    for piece in pieces.drain(..) {
        if !kept.contains(&piece) {
            kept.push(piece);
        }
    }
    *pieces = kept;
    before - pieces.len()
}

/// Bounds of the collision pieces with joints at 0.
fn collision_bounds(raw: &RawObject, bodies: &[Body]) -> Aabb {
    raw.link_poses()
        .iter()
        .zip(bodies)
        .fold(Aabb::EMPTY, |bounds, (pose, body)| bounds.union(&Aabb::from_pieces(pose, &body.pieces)))
}

/// Moves an object so that its collision pieces, rather than its visuals, stand at height 0.
fn standing(mut raw: RawObject, mut bodies: Vec<Body>) -> (RawObject, Vec<Body>) {
    let low = collision_bounds(&raw, &bodies).min.z;
    let up = Pose::from_position(DVec3::Z * -low);
    units_and_frame::move_root(&mut raw, &up);
    let Body { pieces, cavity, .. } = &mut bodies[0];
    for piece in pieces.iter_mut().chain(cavity) {
        piece.link_from_piece = up * piece.link_from_piece;
    }
    (raw, bodies)
}

fn friction(raw: &RawObject, guesses: &mut Vec<Guess>) -> f64 {
    let said = raw.links.iter().filter_map(|link| link.friction).reduce(f64::max);
    let Some(said) = said else {
        guesses.push(Guess::new("friction", format!("{FRICTION}"), "usual between dry household surfaces"));
        return FRICTION;
    };
    let kept = said.clamp(FRICTION_RANGE[0], FRICTION_RANGE[1]);
    if kept != said {
        guesses.push(Guess::new("friction", format!("{kept}"), format!("the files' {said} is implausible")));
    }
    kept
}

/// Visual parts with smooth normals.
pub(crate) fn visual(surfaces: &[Surface]) -> Vec<VisualPart> {
    surfaces
        .iter()
        .map(|surface| {
            let uv = |index: u32| {
                surface.mesh.uvs.get(index as usize).map_or(DVec2::ZERO, |uv| Vec2::from_array(*uv).as_dvec2())
            };
            let corners: Vec<[(DVec3, DVec2); 3]> = surface
                .mesh
                .triangles
                .iter()
                .map(|triangle| triangle.map(|index| (surface.mesh.positions[index as usize], uv(index))))
                .collect();
            VisualPart::new(&surface.name, surface::smooth(&corners), surface.material.clone(), Pose::IDENTITY)
        })
        .collect()
}

/// The state `closed`, and `LINK open` for each of at most six joints: at most 10 %, and at least 70 % of the joint's
/// range.
fn joint_states(links: &[RawLink]) -> Vec<JointState> {
    let joints: Vec<_> = links.iter().filter_map(|link| link.joint.as_ref()).collect();
    if joints.is_empty() || joints.len() > MAX_STATES {
        return Vec::new();
    }
    // Closed is the end of the range nearest to 0, by convention of door and drawer descriptions.
    let at = |range: [f64; 2], share: f64| {
        let [closed, open] = if range[0].abs() <= range[1].abs() { range } else { [range[1], range[0]] };
        closed + share * (open - closed)
    };
    let between = |range: [f64; 2], from: f64, to: f64| {
        let (a, b) = (at(range, from), at(range, to));
        [a.min(b) - 1e-4, a.max(b) + 1e-4]
    };
    let state = |name: String, opened: Option<usize>| JointState {
        name,
        intervals: joints
            .iter()
            .enumerate()
            .map(|(index, joint)| {
                let ends = if opened == Some(index) { (OPEN, 1.0) } else { (0.0, CLOSED) };
                (joint.name.clone(), between(joint.range, ends.0, ends.1))
            })
            .collect(),
        nominal: joints
            .iter()
            .enumerate()
            .map(|(index, joint)| at(joint.range, if opened == Some(index) { 0.9 } else { 0.0 }))
            .collect(),
    };
    let mut states = vec![state("closed".into(), None)];
    for (index, joint) in joints.iter().enumerate() {
        let name = if joints.len() == 1 { "open".to_owned() } else { format!("{} open", joint.name) };
        states.push(state(name, Some(index)));
    }
    states
}

/// The category that is given, or that of a catalogue's object, or the last word of the name.
fn category(name: &str, prior: Option<&Prior>, given: &Given) -> String {
    if let Some(category) = &given.category {
        return category.clone();
    }
    let last = || {
        name.split_whitespace()
            .rfind(|word| word.chars().filter(|c| c.is_alphabetic()).count() > 2)
            .unwrap_or("thing")
            .to_lowercase()
    };
    prior.map_or_else(last, |prior| prior.category.clone())
}

#[expect(clippy::too_many_arguments, reason = "inputs of a card")]
fn card(
    name: &str,
    category: String,
    raw: &RawObject,
    links: &[ObjectLink],
    size: DVec3,
    hash: &str,
    prior: Option<&Prior>,
    states: &[JointState],
    guesses: &mut Vec<Guess>,
) -> ObjectCard {
    let is_articulated = links.len() > 1;
    let rigid = if is_articulated { &[][..] } else { &links[0].pieces[..] };
    let cavity = links.iter().flat_map(|link| &link.cavity).next();
    let mass_kg = links.iter().map(|link| link.mass.mass_kg).sum::<f64>();
    let colors = names_and_colors::colors(raw);
    let is_metal = raw.links.iter().flat_map(|link| &link.surfaces).any(|surface| surface.material.metallic > 0.5);
    let materials = match prior {
        Some(prior) => prior.materials.clone(),
        None => vec![if is_metal { "metal" } else { "plastic" }.to_owned()],
    };
    guesses.push(Guess::new(
        "materials",
        materials.join(", "),
        if prior.is_some() { "usual for its category" } else { "the surface's metalness" },
    ));
    // Narrowest width of the whole object; rims and handles may be narrower, which only grasp trials show.
    let narrow = narrowest(rigid);
    let can_grasp = !is_articulated && mass_kg <= GRASP_KG && (narrow <= GRASP_M || cavity.is_some());
    guesses.push(Guess::new(
        "can_grasp",
        can_grasp.to_string(),
        format!("{:.0} mm at its narrowest, {mass_kg:.2} kg", narrow * 1e3),
    ));
    let shape = names_and_colors::shape(size, rigid, cavity.is_some());
    ObjectCard {
        uid: format!("{}-{}", names_and_colors::slug(name), &hash[..hash.len().min(6)]).into(),
        asset: AssetRef::Imported { hash: hash.to_owned() },
        name: name.to_owned(),
        description: names_and_colors::description(&category, &colors, &shape, size),
        general_category: prior.map_or_else(|| "imported".into(), |prior| prior.general_category.clone()),
        category,
        colors,
        materials,
        shape,
        size_m: size,
        mass_kg,
        is_container: cavity.is_some(),
        is_articulated,
        states: states.iter().map(|state| state.name.clone()).collect(),
        can_grasp,
        annotations: Annotations {
            room: cavity.filter(|_| !is_articulated).and_then(CavitySize::of_cavity),
            affordances: prior.map_or_else(Vec::new, |prior| prior.affordances.clone()),
            ..Annotations::default()
        },
    }
}

/// Smallest horizontal width of the pieces.
fn narrowest(pieces: &[Piece]) -> f64 {
    let width = |direction: DVec3| {
        let reach = |d: DVec3| pieces.iter().map(|piece| piece.support(d).dot(d)).fold(f64::NEG_INFINITY, f64::max);
        reach(direction) + reach(-direction)
    };
    let across = (0..18).map(|turn| {
        let (sin, cos) = (std::f64::consts::PI * f64::from(turn) / 18.0).sin_cos();
        width(DVec3::new(cos, sin, 0.0))
    });
    let least = across.fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

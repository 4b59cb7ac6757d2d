//! Support of objects: the body below each one, and the vertical gap to it.

use genmanip_core::World;
use genmanip_relations::{PosedScene, contact_below};

/// The body below an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Below {
    /// Another object of the scene.
    Object(usize),
    /// A support surface of the world.
    Surface(usize),
    /// No body: the object is beside all surfaces.
    Nothing,
}

/// Support of an object, or the body that it would fall onto.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Support {
    pub below: Below,
    /// Vertical gap between the object and the body below, m; negative if they penetrate.
    pub gap_m: f64,
    /// True if the object's outline lies within the top of the surface, or another object carries it.
    pub is_inside: bool,
}

/// Maximum depth by which an object may penetrate a body that still counts as below it, m. Chosen by hand: half of a
/// small object.
const MAX_SUNK_M: f64 = 0.03;

/// Support of an object: the body that it would touch first if it fell.
pub(super) fn support(scene: &PosedScene, world: &World, object: usize) -> Support {
    let Some(bounds) = scene.bounds(object) else {
        return Support { below: Below::Nothing, gap_m: f64::INFINITY, is_inside: false };
    };
    let outline = scene.outline(object).unwrap_or_default();
    let center = bounds.center().truncate();
    let surfaces = world.surfaces.iter().enumerate().filter_map(|(index, surface)| {
        let gap_m = bounds.min.z - surface.top_center_m.z;
        let is_inside = surface.is_over_top(outline.iter().copied(), 0.0);
        let is_over = is_inside || surface.is_over_top(std::iter::once(center), -surface.edge_margin_m);
        (is_over && gap_m > -MAX_SUNK_M).then_some(Support { below: Below::Surface(index), gap_m, is_inside })
    });
    let others = (0..scene.objects().len()).filter(|&other| other != object).filter_map(|other| {
        let contact = contact_below(scene, object, other, &world.relations)?;
        // For an object in a container: its centre is below the middle of the walls, but the container would have to be
        // raised much further to clear it.
        let is_under = || {
            let over = contact_below(scene, other, object, &world.relations);
            over.is_none_or(|over| over.gap_m < contact.gap_m)
        };
        let touches = contact.gap_m >= -world.relations.sinking_m;
        let is_below = contact.gap_m > -MAX_SUNK_M && (contact.rise_m > 0.0 || (touches && is_under()));
        is_below.then_some(Support { below: Below::Object(other), gap_m: contact.gap_m, is_inside: true })
    });
    let nearest = surfaces.chain(others).min_by(|one, other| one.gap_m.total_cmp(&other.gap_m));
    nearest.unwrap_or(Support { below: Below::Nothing, gap_m: f64::INFINITY, is_inside: false })
}

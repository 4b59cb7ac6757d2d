//! Space occupied by objects at their poses, as exact convex pieces.

use genmanip_core::{Aabb, Pose, ReferenceId};
use glam::DVec3;

use super::contact::{Contact, vertical_gap};
use super::extent::{Extent, Extents, supported};
use super::posed_scene::Body;
use super::requirement::Requirement;
use super::solid::Solid;
use super::state::state_requirements;
use super::{PosedScene, RelationSettings};

impl Extents for PosedScene {
    type Extent = Body;

    fn find(&self, id: &ReferenceId) -> Option<usize> {
        self.index_of(id)
    }

    fn extent(&self, index: usize) -> Option<&Body> {
        self.bodies.get(index)
    }

    fn is_table(&self, index: usize) -> bool {
        self.surface_at(index) == Some(0)
    }
}

impl Extent for Body {
    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn center(&self) -> DVec3 {
        self.center
    }

    fn planar_gap(&self, other: &Self) -> f64 {
        planar_gap(self, other)
    }

    fn share_inside(&self, container: &Self) -> f64 {
        share_inside(self, container)
    }

    fn contact_above(&self, lower: &Self, settings: &RelationSettings) -> Option<Contact> {
        contact(self, lower, settings)
    }

    fn supports(&self, upper: &Self, settings: &RelationSettings) -> bool {
        supported(&upper.footprint().hull, &self.footprint().hull, settings)
    }

    fn state(&self, state: &str, settings: &RelationSettings) -> Vec<Requirement> {
        state_requirements(self, state, settings)
    }
}

/// Shortest distance between the unions of the projected pieces (m); 0 if they overlap.
fn planar_gap(a: &Body, b: &Body) -> f64 {
    let (a, b) = (a.footprint(), b.footprint());
    let mut best = f64::INFINITY;
    for one in &a.pieces {
        if one.bounds_distance(&b.hull) >= best {
            continue;
        }
        for other in &b.pieces {
            if one.bounds_distance(other) < best {
                best = best.min(one.distance(other));
                if best == 0.0 {
                    return 0.0;
                }
            }
        }
    }
    best
}

/// Tolerance (m) beyond the bounds of a cavity: points farther outside are certainly not in the cavity.
const ROUNDING_M: f64 = 1e-9;

/// Cavities of one link: their bounds in the world, for a quick test, and the solids that they consist of.
struct Room<'a> {
    bounds: Aabb,
    room_from_world: Pose,
    solids: &'a [Solid],
}

impl Room<'_> {
    fn contains(&self, point: DVec3) -> bool {
        let near = |low: DVec3, high: DVec3| point.cmpge(low).all() && point.cmple(high).all();
        near(self.bounds.min - DVec3::splat(ROUNDING_M), self.bounds.max + DVec3::splat(ROUNDING_M)) && {
            let local = self.room_from_world.transform_point(point);
            self.solids.iter().any(|solid| solid.contains(local))
        }
    }
}

/// Share of A's surface points in B's cavities at the current joint positions, or in B's convex hull if no cavity is
/// known.
fn share_inside(a: &Body, b: &Body) -> f64 {
    let hull;
    let mut rooms: Vec<Room> = Vec::new();
    if b.shape.model.links().iter().any(|link| !link.cavity.is_empty()) {
        let links = b.shape.links.iter().zip(b.shape.model.links()).zip(&b.object_from_link);
        rooms.extend(links.filter(|((link, _), _)| !link.cavity.is_empty()).map(
            |((link, model), object_from_link)| {
                let world_from_link = b.pose * *object_from_link;
                let bounds = Aabb::from_pieces(&world_from_link, &model.cavity);
                Room { bounds, room_from_world: world_from_link.inverse(), solids: &link.cavity }
            },
        ));
    } else {
        hull = b.shape.hull(&b.object_from_link);
        let solids = std::slice::from_ref(hull.as_ref());
        rooms.push(Room { bounds: b.bounds, room_from_world: b.pose.inverse(), solids });
    }
    let (mut inside, mut count) = (0usize, 0usize);
    for point in a.samples() {
        count += 1;
        inside += usize::from(rooms.iter().any(|room| room.contains(point)));
    }
    if count == 0 { 0.0 } else { inside as f64 / count as f64 }
}

/// The contact of A falling onto B: the smallest gap of pieces that are above each other; without such pieces, the
/// least negative gap. `None` if the projections do not overlap.
fn contact(a: &Body, b: &Body, settings: &RelationSettings) -> Option<Contact> {
    let mut best: Option<Contact> = None;
    let (a_outlines, b_outlines) = (a.footprint(), b.footprint());
    for (upper, upper_outline) in a.pieces.iter().zip(&a_outlines.pieces) {
        if upper_outline.bounds_distance(&b_outlines.hull) > 0.0 {
            continue;
        }
        for (lower, lower_outline) in b.pieces.iter().zip(&b_outlines.pieces) {
            let least = upper.bounds.min.z - lower.bounds.max.z;
            let known = best.map_or(f64::INFINITY, |contact| contact.gap_m);
            let cannot_improve = known >= -settings.sinking_m && least > known;
            if cannot_improve || upper_outline.bounds_distance(lower_outline) > 0.0 {
                continue;
            }
            let (upper_shape, lower_shape) = (a.shape_of(upper), b.shape_of(lower));
            let support =
                |direction: DVec3| upper.support(upper_shape, direction) - lower.support(lower_shape, -direction);
            let Some(gap_m) = vertical_gap(support, -settings.sinking_m) else { continue };
            if better(gap_m, known, settings.sinking_m) {
                best = Some(Contact { gap_m, rise_m: a.center.z - b.link_center(lower.link).z });
            }
        }
    }
    best
}

/// True if `gap` takes precedence over `known`: gaps between pieces above each other do, the smallest first; among the
/// others the largest does.
fn better(gap: f64, known: f64, sinking: f64) -> bool {
    match (gap >= -sinking, known >= -sinking) {
        (true, true) => gap < known,
        (true, false) => true,
        (false, true) => known.is_infinite(),
        (false, false) => gap > known,
    }
}

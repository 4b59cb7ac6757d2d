//! The quantities of objects on which relations are based, for exact geometry and for point clouds.

use genmanip_core::{Aabb, ReferenceId};
use glam::DVec3;

use super::RelationSettings;
use super::contact::Contact;
use super::requirement::Requirement;
use crate::planar::Polygon;

/// The space that an object occupies in the world, metres.
pub(super) trait Extent {
    /// Axis-aligned bounds.
    fn bounds(&self) -> Aabb;
    /// Centroid of the surface.
    fn center(&self) -> DVec3;
    /// Shortest distance between the projections onto the table.
    fn planar_gap(&self, other: &Self) -> f64;
    /// Share of this object's surface that is inside a container.
    fn share_inside(&self, container: &Self) -> f64;
    /// The contact at which this object would first touch the lower one if it fell straight down; `None` if the
    /// projections do not overlap.
    fn contact_above(&self, lower: &Self, settings: &RelationSettings) -> Option<Contact>;
    /// True if `upper` passes the overlap-area test with this object as its support.
    fn supports(&self, upper: &Self, settings: &RelationSettings) -> bool;
    /// Requirements for the object to be in a state.
    fn state(&self, state: &str, settings: &RelationSettings) -> Vec<Requirement>;
}

/// A scene whose objects have ids and indices.
pub(super) trait Extents {
    /// Representation of an object: exact geometry or a point cloud.
    type Extent: Extent;

    /// Index of an object or a surface by its id; `None` for an unknown id.
    fn find(&self, id: &ReferenceId) -> Option<usize>;
    /// The object with an index; `None` if the index is out of range.
    fn extent(&self, index: usize) -> Option<&Self::Extent>;
    /// True if the index is that of the table, on which every other support stands.
    fn is_table(&self, _index: usize) -> bool {
        false
    }
}

/// True if most of the upper footprint is over the lower one and is not much larger than it.
pub(super) fn supported(upper: &Polygon, lower: &Polygon, settings: &RelationSettings) -> bool {
    let (lower_area, upper_area) = (lower.area(), upper.area());
    upper.intersection(lower).area() > settings.support_overlap * upper_area
        && upper_area < settings.support_area_ratio * lower_area
}

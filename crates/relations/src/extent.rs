//! What the judges ask of an object, whatever its place is known from: exact pieces or a cloud of points.

use genmanip_core::Aabb;
use glam::DVec3;

use super::RelationSettings;
use super::contact::Contact;
use super::requirement::Requirement;
use crate::planar::Polygon;

/// The place an object takes up in the world, metres.
pub(super) trait Extent {
    /// Bounds.
    fn bounds(&self) -> Aabb;
    /// Mean of the surface.
    fn center(&self) -> DVec3;
    /// Shortest distance between the projections onto the table.
    fn planar_gap(&self, other: &Self) -> f64;
    /// Share of this surface that is inside a container.
    fn share_inside(&self, container: &Self) -> f64;
    /// Where this would first touch the lower one if it fell; `None` when the projections do not overlap.
    fn contact_above(&self, lower: &Self, settings: &RelationSettings) -> Option<Contact>;
    /// Whether the overlap-area test holds for something on this.
    fn supports(&self, upper: &Self, settings: &RelationSettings) -> bool;
    /// What has to be true for the object to be in a state.
    fn state(&self, state: &str, settings: &RelationSettings) -> Vec<Requirement>;
}

/// Objects by uid.
pub(super) trait Extents {
    /// How the place of an object is known.
    type Extent: Extent;

    /// Index of an object.
    fn find(&self, uid: &str) -> Option<usize>;
    /// The object with an index.
    fn extent(&self, index: usize) -> Option<&Self::Extent>;
}

/// Whether most of the upper footprint is over the lower one, and it is not much larger.
pub(super) fn supported(upper: &Polygon, lower: &Polygon, settings: &RelationSettings) -> bool {
    let (lower_area, upper_area) = (lower.area(), upper.area());
    upper.intersection(lower).area() > settings.support_overlap * upper_area
        && upper_area < settings.support_area_ratio * lower_area
}

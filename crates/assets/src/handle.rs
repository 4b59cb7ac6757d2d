//! Handles of articulated links.

use genmanip_core::{Aabb, ObjectLink};

/// Name of the visual part by which the gripper moves a link.
pub const HANDLE: &str = "handle";

/// Bounds of a link's handle (bar, knob, tab, lever, button) in the link's frame, m; `None` if the link has no handle.
///
/// Every moving link of the catalogue has a handle; that of a laptop's lid is the lip that overhangs the base.
pub fn handle_bounds(link: &ObjectLink) -> Option<Aabb> {
    let handles = link.visual.iter().filter(|part| part.name == HANDLE);
    let corners = handles.flat_map(|part| {
        part.mesh.positions.iter().map(|position| part.link_from_part.transform_point(position.as_dvec3()))
    });
    let bounds = Aabb::from_points(corners);
    bounds.size().is_finite().then_some(bounds)
}

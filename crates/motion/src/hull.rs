//! Convex hulls of points.

use genmanip_core::glam::DVec3;
use parry3d_f64::{math::Vector, transformation::try_convex_hull};

/// Vertices and triangles of the convex hull of points, triangles counter-clockwise seen from outside.
///
/// # Errors
/// If there is no hull with a volume; the error is a message.
pub(crate) fn convex_hull(points: &[DVec3]) -> Result<(Vec<DVec3>, Vec<[u32; 3]>), String> {
    let input: Vec<Vector> = points.iter().map(|point| Vector::from_array(point.to_array())).collect();
    let (vertices, triangles) = try_convex_hull(&input).map_err(|error| format!("it has no convex hull: {error:?}"))?;
    Ok((vertices.iter().map(|vertex| DVec3::from_array(vertex.to_array())).collect(), triangles))
}

//! Point clouds as obstacles.

use std::sync::Arc;

use glam::DVec3;

use super::surface::{Facets, Surface};

/// Maximum number of points of a cloud and of triangles of a mesh.
const MAX_FACETS: usize = 1 << 20;
/// Maximum distance of a point from the origin (m).
const MAX_DISTANCE_M: f64 = 100.0;

/// Error in a point cloud or triangle mesh obstacle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// The cloud or mesh has no facets.
    #[error("{name} has no {what}; omit it")]
    Empty {
        /// Name of the obstacle.
        name: String,
        /// Kind of facet: `points` or `triangles`.
        what: &'static str,
    },
    /// The cloud or mesh has more than `limit` facets.
    #[error("{name} has {got} {what}, at most {limit} are allowed; downsample it")]
    Huge {
        /// Name of the obstacle.
        name: String,
        /// Kind of facet: `points` or `triangles`.
        what: &'static str,
        /// Number of facets.
        got: usize,
        /// Maximum number of facets.
        limit: usize,
    },
    /// A coordinate is not finite or too large.
    #[error("point {index} of {name} is not finite, or more than 100 m away")]
    NotFinite {
        /// Name of the obstacle.
        name: String,
        /// Index of the invalid point or vertex.
        index: usize,
    },
    /// The point radius is out of range.
    #[error("the points of {name} should have a radius above 0 and up to 1 m, got {radius_m} m")]
    BadRadius {
        /// Name of the obstacle.
        name: String,
        /// Radius given (m).
        radius_m: f64,
    },
    /// A triangle refers to a missing vertex.
    #[error("triangle {index} of {name} refers to vertex {corner}, but there are only {corners}")]
    NoSuchCorner {
        /// Name of the obstacle.
        name: String,
        /// Index of the invalid triangle.
        index: usize,
        /// Index of the missing vertex.
        corner: u32,
        /// Number of vertices of the mesh.
        corners: usize,
    },
    /// A triangle has (nearly) no area.
    #[error("triangle {index} of {name} is degenerate: its vertices are collinear; remove it")]
    Degenerate {
        /// Name of the obstacle.
        name: String,
        /// Index of the degenerate triangle.
        index: usize,
    },
}

/// Builds a point cloud obstacle: spheres of one radius, world frame.
pub(super) fn cloud(name: &str, points: &[DVec3], radius_m: f64) -> Result<Arc<Surface>, SurfaceError> {
    check(name, "points", points.len(), points)?;
    if !(radius_m > 0.0 && radius_m <= 1.0) {
        return Err(SurfaceError::BadRadius { name: name.to_owned(), radius_m });
    }
    Ok(Arc::new(Surface::new(Facets::Points(points.to_vec()), radius_m)))
}

/// Common validation of clouds and meshes; `count` is the number of facets.
pub(super) fn check(name: &str, what: &'static str, count: usize, points: &[DVec3]) -> Result<(), SurfaceError> {
    if count == 0 {
        return Err(SurfaceError::Empty { name: name.to_owned(), what });
    }
    if count > MAX_FACETS {
        return Err(SurfaceError::Huge { name: name.to_owned(), what, got: count, limit: MAX_FACETS });
    }
    // `!` rather than `>`, since every comparison with NaN is false.
    let far = |point: &DVec3| !point.abs().cmple(DVec3::splat(MAX_DISTANCE_M)).all();
    match points.iter().position(far) {
        Some(index) => Err(SurfaceError::NotFinite { name: name.to_owned(), index }),
        None => Ok(()),
    }
}

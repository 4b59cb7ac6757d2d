//! Point clouds as obstacles.

use std::sync::Arc;

use glam::DVec3;

use super::surface::{Facets, Surface};

/// Most points of a cloud, and triangles of a mesh.
const MAX_FACETS: usize = 1 << 20;
/// Points farther from the origin than this are a mistake, m.
const MAX_DISTANCE_M: f64 = 100.0;

/// A point cloud or a triangle mesh that cannot be an obstacle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceError {
    /// There is nothing in it.
    #[error("{name} has no {what}; leave it out instead")]
    Empty {
        /// Obstacle.
        name: String,
        /// `points` or `triangles`.
        what: &'static str,
    },
    /// It has more facets than can be worked with.
    #[error("{name} has {got} {what}; at most {limit} are taken, so thin it out")]
    Huge {
        /// Obstacle.
        name: String,
        /// `points` or `triangles`.
        what: &'static str,
        /// Their number.
        got: usize,
        /// The bound.
        limit: usize,
    },
    /// A coordinate is NaN, infinite or absurd.
    #[error("point {index} of {name} is not finite, or more than 100 m away")]
    NotFinite {
        /// Obstacle.
        name: String,
        /// Index of the point.
        index: usize,
    },
    /// The radius of the points makes no sense.
    #[error("the points of {name} should have a radius above 0 and up to 1 m, got {radius_m} m")]
    BadRadius {
        /// Obstacle.
        name: String,
        /// The radius.
        radius_m: f64,
    },
    /// A triangle names a corner that is not there.
    #[error("triangle {index} of {name} names corner {corner}, but there are {corners}")]
    NoSuchCorner {
        /// Obstacle.
        name: String,
        /// Index of the triangle.
        index: usize,
        /// The corner named.
        corner: u32,
        /// Number of corners.
        corners: usize,
    },
    /// A triangle without area.
    #[error("triangle {index} of {name} has no area: its corners lie on a line; remove it")]
    Degenerate {
        /// Obstacle.
        name: String,
        /// Index of the triangle.
        index: usize,
    },
}

/// Balls of one radius around points in the world frame.
pub(super) fn cloud(name: &str, points: &[DVec3], radius_m: f64) -> Result<Arc<Surface>, SurfaceError> {
    check(name, "points", points.len(), points)?;
    if !(radius_m > 0.0 && radius_m <= 1.0) {
        return Err(SurfaceError::BadRadius { name: name.to_owned(), radius_m });
    }
    Ok(Arc::new(Surface::new(Facets::Points(points.to_vec()), radius_m)))
}

/// Tests what clouds and meshes have in common; `count` is the number of their facets.
pub(super) fn check(name: &str, what: &'static str, count: usize, points: &[DVec3]) -> Result<(), SurfaceError> {
    if count == 0 {
        return Err(SurfaceError::Empty { name: name.to_owned(), what });
    }
    if count > MAX_FACETS {
        return Err(SurfaceError::Huge { name: name.to_owned(), what, got: count, limit: MAX_FACETS });
    }
    // A NaN is within nothing.
    let far = |point: &DVec3| !point.abs().cmple(DVec3::splat(MAX_DISTANCE_M)).all();
    match points.iter().position(far) {
        Some(index) => Err(SurfaceError::NotFinite { name: name.to_owned(), index }),
        None => Ok(()),
    }
}

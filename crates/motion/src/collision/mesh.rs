//! Triangle meshes as obstacles: only their surface counts, not the enclosed volume.

use std::sync::Arc;

use genmanip_core::{Piece, Pose, Shape};
use glam::DVec3;

use super::convex::{Convex, GeometryError};
use super::points::{SurfaceError, check};
use super::surface::{Facets, Surface};
use super::triangle::Triangle;
use crate::rigid::Rigid;

/// Area below which a triangle counts as degenerate [m²].
const NO_AREA_M2: f64 = 1e-12;

/// Builds the surface of a mesh with vertices in its own frame.
pub(super) fn mesh(
    name: &str,
    corners: &[DVec3],
    triangles: &[[u32; 3]],
    world_from_mesh: &Pose,
) -> Result<Arc<Surface>, SurfaceError> {
    let place = Rigid::from(world_from_mesh);
    let placed: Vec<DVec3> = corners.iter().map(|corner| place.point(*corner)).collect();
    check(name, "triangles", triangles.len(), &placed)?;
    let triangle = |(index, corners): (usize, &[u32; 3])| {
        if let Some(&corner) = corners.iter().find(|&&corner| corner as usize >= placed.len()) {
            let name = name.to_owned();
            return Err(SurfaceError::NoSuchCorner { name, index, corner, corners: placed.len() });
        }
        let triangle = Triangle(corners.map(|corner| placed[corner as usize]));
        if triangle.area() < NO_AREA_M2 {
            return Err(SurfaceError::Degenerate { name: name.to_owned(), index });
        }
        Ok(triangle)
    };
    let triangles = triangles.iter().enumerate().map(triangle).collect::<Result<Vec<_>, _>>()?;
    Ok(Arc::new(Surface::new(Facets::Triangles(triangles), 0.0)))
}

/// Triangulates a collision piece: vertices in the link frame, and three indices per triangle, counter-clockwise seen
/// from outside.
///
/// Curved shapes get 48 vertices around, all on the surface: the triangles are at most 1 % of the radius below it.
///
/// # Errors
/// Fails if the piece has no volume or is not finite.
pub fn triangulate(piece: &Piece) -> Result<(Vec<DVec3>, Vec<[u32; 3]>), GeometryError> {
    const AROUND: usize = 48;
    let directions = (0..AROUND * AROUND / 2).map(|index| {
        let turn = std::f64::consts::TAU * (index % AROUND) as f64 / AROUND as f64;
        let polar = std::f64::consts::TAU * (0.5 + (index / AROUND) as f64) / AROUND as f64;
        DVec3::new(polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos())
    });
    let mut corners: Vec<DVec3> = match &piece.shape {
        Shape::Hull { points } => points.iter().map(|point| piece.link_from_piece.transform_point(*point)).collect(),
        _ => {
            directions.map(|direction| piece.link_from_piece.transform_point(piece.shape.support(direction))).collect()
        }
    };
    let bad = |what: String| GeometryError { owner: "the piece".into(), index: 0, what };
    Convex::new("the piece", 0, piece)?;
    corners.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    corners.dedup_by(|a, b| a.distance(*b) < 1e-9);
    crate::hull::convex_hull(&corners).map_err(bad)
}

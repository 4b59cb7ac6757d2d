//! Collision geometry of an object: a primitive if one fits, otherwise the convex hull, otherwise walls around a
//! cavity, otherwise a convex decomposition (V-HACD, Mamou 2016, as implemented in parry).

mod fit;
pub mod hull;
mod shell;

use std::collections::BTreeMap;

use genmanip_core::{Piece, Shape};
use glam::DVec3;
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::vhacd::{VHACD, VHACDParameters};

use crate::clean::{is_closed, signed_volume};
use crate::raw::{RawCollision, RawLink, RawMesh};
use crate::simplify::reduced;

/// Maximum ratio of hull volume to mesh volume at which a mesh is replaced by its hull. Chosen by hand.
const NEARLY_CONVEX: f64 = 1.15;
/// Maximum number of hull vertices that the engine's hull collision handles without slowing down.
const MAX_VERTICES: usize = 48;
/// Maximum number of pieces of a decomposition, and (`RESOLUTION`) its resolution in voxels along the longest side.
/// Chosen by hand.
const MAX_PIECES: u32 = 24;
const RESOLUTION: u32 = 48;
/// Maximum number of connected components of a pre-decomposed mesh. Chosen by hand.
const MAX_COMPONENTS: usize = 64;
/// Maximum number of pieces, and (`REST_RESOLUTION`) resolution in voxels, for the protrusions of a shell. Chosen by
/// hand.
const REST_PIECES: u32 = 6;
const REST_RESOLUTION: u32 = 28;
/// Maximum number of triangles for measuring and decomposing; about as many as the visual mesh has.
const MAX_TRIANGLES: usize = 12_000;

/// Collision geometry of a link.
#[derive(Clone, Debug, Default)]
pub struct Body {
    /// Convex pieces in the link's frame.
    pub pieces: Vec<Piece>,
    /// Convex cavities; an object inside one counts as being in this object.
    pub cavity: Vec<Piece>,
    /// Description of the method that made the pieces, for the report.
    pub how: String,
    /// Volume of the material, m³, if the mesh is closed; `None` otherwise.
    pub volume_m3: Option<f64>,
}

/// Collision pieces of a link: those of its files, or pieces fitted to the visual mesh.
pub fn body(link: &RawLink) -> Body {
    if link.collision.is_empty() {
        let mut all = RawMesh::default();
        link.surfaces.iter().for_each(|surface| all.append(&surface.mesh));
        return if all.triangles.is_empty() { Body::default() } else { of_surface(&all, true) };
    }
    let mut body = Body { how: "from the files".into(), ..Body::default() };
    for collision in &link.collision {
        match collision {
            RawCollision::Piece(piece) => body.pieces.push(piece.clone()),
            RawCollision::HullOf(points) => body.pieces.extend(hull::piece(points, MAX_VERTICES)),
            RawCollision::Mesh(mesh) => {
                if let Some(pieces) = convex_parts(mesh) {
                    body.how = format!("from the collision mesh: {} convex parts", pieces.len());
                    body.pieces.extend(pieces);
                    continue;
                }
                let found = of_surface(mesh, link.collision.len() == 1);
                body.how = format!("from the collision mesh: {}", found.how);
                body.pieces.extend(found.pieces);
                body.cavity.extend(found.cavity);
            }
        }
    }
    body
}

/// The hulls of a mesh's connected components if there are several and all are nearly convex, i.e. if the mesh is
/// already decomposed. `None` otherwise.
fn convex_parts(mesh: &RawMesh) -> Option<Vec<Piece>> {
    let parts = connected(mesh);
    if !(2..=MAX_COMPONENTS).contains(&parts.len()) {
        return None;
    }
    let hull_of = |part: &RawMesh| {
        let (corners, triangles) = hull::convex_hull(&part.positions)?;
        let is_convex = hull::volume(&corners, &triangles) <= NEARLY_CONVEX * signed_volume(part).abs();
        is_convex.then(|| hull::piece(&corners, MAX_VERTICES)).flatten()
    };
    parts.iter().map(hull_of).collect()
}

/// Connected components of a mesh.
fn connected(mesh: &RawMesh) -> Vec<RawMesh> {
    let mut places: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let place = mesh.positions.iter().map(|point| {
        let next = places.len() as u32;
        *places.entry(point.to_array().map(|value| (value + 0.0).to_bits())).or_insert(next)
    });
    let place: Vec<u32> = place.collect();
    let mut parent: Vec<u32> = (0..places.len() as u32).collect();
    let root = |parent: &mut Vec<u32>, mut index: u32| {
        while parent[index as usize] != index {
            parent[index as usize] = parent[parent[index as usize] as usize];
            index = parent[index as usize];
        }
        index
    };
    for &[a, b, c] in &mesh.triangles {
        for (one, other) in [(a, b), (b, c)] {
            let ends = [one, other].map(|index| root(&mut parent, place[index as usize]));
            parent[ends[0].max(ends[1]) as usize] = ends[0].min(ends[1]);
        }
    }
    let mut parts: BTreeMap<u32, RawMesh> = BTreeMap::new();
    for triangle in &mesh.triangles {
        let part = parts.entry(root(&mut parent, place[triangle[0] as usize])).or_default();
        let first = part.positions.len() as u32;
        part.positions.extend(triangle.map(|index| mesh.positions[index as usize]));
        part.triangles.push([first, first + 1, first + 2]);
    }
    parts.into_values().collect()
}

/// Collision pieces of a mesh; looks for a cavity if `may_be_hollow`.
fn of_surface(mesh: &RawMesh, may_be_hollow: bool) -> Body {
    let mut mesh = mesh.clone();
    mesh.uvs.clear();
    let mesh = reduced(&mesh, MAX_TRIANGLES);
    let Some((corners, triangles)) = hull::convex_hull(&mesh.positions) else {
        let pieces = hull::piece(&mesh.positions, MAX_VERTICES).into_iter().collect();
        return Body { pieces, how: "a thin plate".into(), ..Body::default() };
    };
    let outer = hull::volume(&corners, &triangles);
    let closed = is_closed(&mesh);
    let volume = closed.then(|| signed_volume(&mesh).abs()).filter(|volume| *volume > 0.02 * outer);
    if let Some(volume) = volume {
        if let Some((piece, name)) = fit::fit(&corners, volume.min(outer)) {
            return Body { pieces: vec![piece], how: format!("a {name}"), volume_m3: Some(volume), ..Body::default() };
        }
        if outer < NEARLY_CONVEX * volume {
            let pieces = hull::piece(&corners, MAX_VERTICES).into_iter().collect();
            return Body { pieces, how: "its convex hull".into(), volume_m3: Some(volume), ..Body::default() };
        }
    }
    if let Some(shell) = may_be_hollow.then(|| shell::shell(&mesh)).flatten() {
        let walls = shell.pieces.len();
        let mut pieces = shell.pieces;
        let rest = if shell.rest.triangles.len() >= 8 {
            decomposed(&shell.rest, REST_RESOLUTION, REST_PIECES)
        } else {
            Vec::new()
        };
        let how = format!(
            "a cavity with walls of {:.1} mm in {walls} wedges, and {} protruding pieces",
            shell.thickness_m * 1e3,
            rest.len()
        );
        pieces.extend(rest);
        return Body { pieces, cavity: vec![shell.cavity], how, volume_m3: volume };
    }
    let pieces = decomposed(&mesh, RESOLUTION, MAX_PIECES);
    // An open surface has no volume: if its pieces fill the hull, the simpler hull is used.
    let filled: f64 = pieces.iter().map(piece_volume).sum();
    if pieces.is_empty() || outer < NEARLY_CONVEX * filled {
        if let Some((piece, name)) = fit::fit(&corners, filled.min(outer)) {
            return Body { pieces: vec![piece], how: format!("a {name}"), volume_m3: volume, ..Body::default() };
        }
        let pieces = hull::piece(&corners, MAX_VERTICES).into_iter().collect();
        return Body { pieces, how: "its convex hull".into(), volume_m3: volume, ..Body::default() };
    }
    Body {
        how: format!("a decomposition into {} convex pieces", pieces.len()),
        pieces,
        volume_m3: volume,
        ..Body::default()
    }
}

fn decomposed(mesh: &RawMesh, resolution: u32, most: u32) -> Vec<Piece> {
    let mut used = BTreeMap::new();
    let mut points: Vec<Vector> = Vec::new();
    let indices: Vec<[u32; 3]> = mesh
        .triangles
        .iter()
        .map(|triangle| {
            triangle.map(|index| {
                *used.entry(index).or_insert_with(|| {
                    points.push(Vector::from_array(mesh.positions[index as usize].to_array()));
                    points.len() as u32 - 1
                })
            })
        })
        .collect();
    let settings =
        VHACDParameters { resolution, max_convex_hulls: most, concavity: 0.004, ..VHACDParameters::default() };
    let parts = VHACD::decompose(&settings, &points, &indices, false);
    // Voxels protrude from the mesh by up to their size, so points are clamped to its bounds.
    let low = points.iter().fold(DVec3::INFINITY, |low, p| low.min(DVec3::from_array(p.to_array())));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(DVec3::from_array(p.to_array())));
    parts
        .compute_convex_hulls(2)
        .iter()
        .filter_map(|(corners, _)| {
            let corners: Vec<DVec3> =
                corners.iter().map(|corner| DVec3::from_array(corner.to_array()).clamp(low, high)).collect();
            hull::piece(&corners, MAX_VERTICES)
        })
        .collect()
}

/// Volume of a piece, m³.
pub fn piece_volume(piece: &Piece) -> f64 {
    use std::f64::consts::PI;
    match &piece.shape {
        Shape::Box { half_extents } => 8.0 * half_extents.element_product(),
        Shape::Sphere { radius } => 4.0 / 3.0 * PI * radius.powi(3),
        Shape::Ellipsoid { radii } => 4.0 / 3.0 * PI * radii.element_product(),
        Shape::Cylinder { radius, half_height } => 2.0 * PI * radius * radius * half_height,
        Shape::Capsule { radius, half_length } => PI * radius * radius * (2.0 * half_length + 4.0 / 3.0 * radius),
        Shape::Hull { points } => {
            hull::convex_hull(points).map_or(0.0, |(corners, triangles)| hull::volume(&corners, &triangles))
        }
    }
}

#[cfg(test)]
mod tests;

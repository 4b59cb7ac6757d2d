//! What an object touches with: exact shapes where its surface nearly is one, else its hull, else walls around a hollow,
//! else a convex decomposition (V-HACD, Mamou 2016, as parry has it).

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

/// A surface whose hull is at most so much larger is taken for its hull.
const NEARLY_CONVEX: f64 = 1.15;
/// Corners of a hull: what the engine's collision of hulls takes without slowing down.
const MOST_CORNERS: usize = 48;
/// Most pieces of a decomposition, and its resolution in voxels along the longest side.
const MOST_PIECES: u32 = 24;
const RESOLUTION: u32 = 48;
/// Most parts of a mesh that was decomposed before.
const MOST_PARTS: usize = 64;
/// Pieces and resolution of what sticks out of a shell.
const REST_PIECES: u32 = 6;
const REST_RESOLUTION: u32 = 28;
/// Triangles of a surface that is measured or decomposed; what is drawn has about as many.
const MEASURED: usize = 12_000;

/// What a link touches with.
#[derive(Clone, Debug, Default)]
pub struct Body {
    /// Convex pieces in the link's frame.
    pub pieces: Vec<Piece>,
    /// Hollows in which something counts as in the object.
    pub cavity: Vec<Piece>,
    /// How the pieces were found, in words.
    pub how: String,
    /// Volume of the matter, m³, where the surface says it.
    pub volume_m3: Option<f64>,
}

/// The pieces of a link: those that its files give, or those that fit what is drawn.
pub fn body(link: &RawLink) -> Body {
    if link.collision.is_empty() {
        let mut all = RawMesh::default();
        link.surfaces.iter().for_each(|surface| all.append(&surface.mesh));
        return if all.triangles.is_empty() { Body::default() } else { of_surface(&all, true) };
    }
    let mut body = Body { how: "as the files say".into(), ..Body::default() };
    for collision in &link.collision {
        match collision {
            RawCollision::Piece(piece) => body.pieces.push(piece.clone()),
            RawCollision::HullOf(points) => body.pieces.extend(hull::piece(points, MOST_CORNERS)),
            RawCollision::Mesh(mesh) => {
                if let Some(pieces) = convex_parts(mesh) {
                    body.how = format!("of the files' collision mesh: {} convex parts", pieces.len());
                    body.pieces.extend(pieces);
                    continue;
                }
                let found = of_surface(mesh, link.collision.len() == 1);
                body.how = format!("of the files' collision mesh: {}", found.how);
                body.pieces.extend(found.pieces);
                body.cavity.extend(found.cavity);
            }
        }
    }
    body
}

/// The hulls of the connected parts of a mesh, where there are several and each nearly is its hull: somebody has
/// decomposed it already.
fn convex_parts(mesh: &RawMesh) -> Option<Vec<Piece>> {
    let parts = connected(mesh);
    if !(2..=MOST_PARTS).contains(&parts.len()) {
        return None;
    }
    let hull_of = |part: &RawMesh| {
        let (corners, triangles) = hull::convex_hull(&part.positions)?;
        let is_convex = hull::volume(&corners, &triangles) <= NEARLY_CONVEX * signed_volume(part).abs();
        is_convex.then(|| hull::piece(&corners, MOST_CORNERS)).flatten()
    };
    parts.iter().map(hull_of).collect()
}

/// Parts of a mesh that share no corner.
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

/// Pieces of a surface; a hollow is looked for where it may be one.
fn of_surface(mesh: &RawMesh, may_be_hollow: bool) -> Body {
    let mut mesh = mesh.clone();
    mesh.uvs.clear();
    let mesh = reduced(&mesh, MEASURED);
    let Some((corners, triangles)) = hull::convex_hull(&mesh.positions) else {
        let pieces = hull::piece(&mesh.positions, MOST_CORNERS).into_iter().collect();
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
            let pieces = hull::piece(&corners, MOST_CORNERS).into_iter().collect();
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
            "a hollow with walls of {:.1} mm in {walls} wedges, and {} pieces that stick out",
            shell.thickness_m * 1e3,
            rest.len()
        );
        pieces.extend(rest);
        return Body { pieces, cavity: vec![shell.cavity], how, volume_m3: volume };
    }
    let pieces = decomposed(&mesh, RESOLUTION, MOST_PIECES);
    // An open surface that encloses nothing but itself: where its parts fill the hull, the hull is simpler.
    let filled: f64 = pieces.iter().map(piece_volume).sum();
    if pieces.is_empty() || outer < NEARLY_CONVEX * filled {
        if let Some((piece, name)) = fit::fit(&corners, filled.min(outer)) {
            return Body { pieces: vec![piece], how: format!("a {name}"), volume_m3: volume, ..Body::default() };
        }
        let pieces = hull::piece(&corners, MOST_CORNERS).into_iter().collect();
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
    // Voxels stick out of the surface by up to their size: what lies beyond its bounds is cut.
    let low = points.iter().fold(DVec3::INFINITY, |low, p| low.min(DVec3::from_array(p.to_array())));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(DVec3::from_array(p.to_array())));
    parts
        .compute_convex_hulls(2)
        .iter()
        .filter_map(|(corners, _)| {
            let corners: Vec<DVec3> =
                corners.iter().map(|corner| DVec3::from_array(corner.to_array()).clamp(low, high)).collect();
            hull::piece(&corners, MOST_CORNERS)
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

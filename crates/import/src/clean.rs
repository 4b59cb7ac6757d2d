//! Mesh repair: non-finite, degenerate, duplicate and inverted triangles.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use crate::ImportError;
use crate::raw::{RawMesh, RawObject};

/// Vertices farther from the origin than this indicate a damaged file, in the file's unit.
const MAX_COORDINATE: f64 = 1e6;
/// Maximum fraction of invalid triangles that is repaired; a file with more is rejected as damaged.
const MAX_BAD: f64 = 0.05;

/// Repairs every mesh and notes the repairs.
///
/// # Errors
/// If more than 5 % of the triangles have invalid vertices, or nothing remains.
pub fn clean(file: &str, raw: &mut RawObject) -> Result<(), ImportError> {
    let mut counts = Counts::default();
    for link in &mut raw.links {
        for surface in &mut link.surfaces {
            clean_mesh(&mut surface.mesh, &mut counts);
        }
        link.surfaces.retain(|surface| !surface.mesh.triangles.is_empty());
        for collision in &mut link.collision {
            if let crate::raw::RawCollision::Mesh(mesh) = collision {
                clean_mesh(mesh, &mut counts);
            }
        }
    }
    let Counts { all, bad, flat, twice } = counts;
    if bad as f64 > MAX_BAD * all as f64 {
        return Err(ImportError::new(
            file,
            format!("{bad} of {all} triangles have vertices that are not finite or farther than {MAX_COORDINATE:e} from the origin"),
        )
        .hint("the file is damaged: export it again"));
    }
    let repaired = [(bad, "with invalid vertices"), (flat, "without area"), (twice, "that are duplicates")];
    raw.notes.extend(
        repaired
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("dropped {count} of {all} triangles {what}")),
    );
    let is_empty = |link: &crate::raw::RawLink| link.surfaces.is_empty() && link.collision.is_empty();
    if raw.links.iter().all(is_empty) {
        return Err(ImportError::new(file, "contains no triangle with an area and no collision shape"));
    }
    fix_inverted(raw);
    Ok(())
}

#[derive(Default)]
struct Counts {
    all: usize,
    bad: usize,
    flat: usize,
    twice: usize,
}

fn clean_mesh(mesh: &mut RawMesh, counts: &mut Counts) {
    let is_sound = |point: &DVec3| point.is_finite() && point.abs().max_element() < MAX_COORDINATE;
    let mut seen = HashSet::new(); // only looked up
    let size =
        mesh.positions.iter().filter(|p| is_sound(p)).fold(DVec3::ZERO, |size, p| size.max(p.abs())).max_element();
    let least_area = (size * 1e-7).powi(2);
    let mut welded: HashMap<[u64; 5], u32> = HashMap::new(); // only looked up
    let mut clean = RawMesh::default();
    let has_uvs = mesh.uvs.len() == mesh.positions.len();
    for triangle in &mesh.triangles {
        counts.all += 1;
        let corners = triangle.map(|index| mesh.positions[index as usize]);
        if !corners.iter().all(is_sound) {
            counts.bad += 1;
            continue;
        }
        if (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() <= least_area {
            counts.flat += 1;
            continue;
        }
        let indices = triangle.map(|index| {
            let point = mesh.positions[index as usize];
            let uv =
                if has_uvs { mesh.uvs[index as usize].map(|v| if v.is_finite() { v } else { 0.0 }) } else { [0.0; 2] };
            let key = [point.x, point.y, point.z, uv[0].into(), uv[1].into()].map(|v: f64| (v + 0.0).to_bits());
            *welded.entry(key).or_insert_with(|| {
                clean.positions.push(point);
                if has_uvs {
                    clean.uvs.push(uv);
                }
                clean.positions.len() as u32 - 1
            })
        });
        let mut sorted = indices;
        sorted.sort_unstable();
        if !seen.insert(sorted) {
            counts.twice += 1;
            continue;
        }
        clean.triangles.push(indices);
    }
    *mesh = clean;
}

/// Flips all triangles of an object that encloses a negative volume.
fn fix_inverted(raw: &mut RawObject) {
    if raw.links.iter().map(|link| link.surfaces.len()).sum::<usize>() == 0 {
        return;
    }
    if signed_volume(&raw.all_surfaces()) < 0.0 {
        for surface in raw.links.iter_mut().flat_map(|link| &mut link.surfaces) {
            surface.mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        raw.notes.push("all triangles were inside out and have been flipped".into());
    }
}

/// Signed volume enclosed by triangles, negative if inside out; an open surface is closed from its centroid.
pub fn signed_volume(mesh: &RawMesh) -> f64 {
    let count = mesh.positions.len().max(1) as f64;
    let middle = mesh.positions.iter().sum::<DVec3>() / count;
    mesh.corners().map(|[a, b, c]| (a - middle).dot((b - middle).cross(c - middle)) / 6.0).sum()
}

/// True if every edge belongs to exactly two triangles; vertices at equal positions count as one.
pub fn is_closed(mesh: &RawMesh) -> bool {
    let mut places: HashMap<[u64; 3], u32> = HashMap::new(); // only looked up
    let place: Vec<u32> = mesh
        .positions
        .iter()
        .map(|point| {
            let next = places.len() as u32;
            *places.entry(point.to_array().map(|v| (v + 0.0).to_bits())).or_insert(next)
        })
        .collect();
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new(); // only summed
    for triangle in &mesh.triangles {
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            let (a, b) = (place[triangle[a] as usize], place[triangle[b] as usize]);
            *edges.entry((a.min(b), a.max(b))).or_default() += if a < b { 1 } else { -1 };
        }
    }
    edges.values().all(|&sum| sum == 0)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::raw::{RawLink, Surface, Unit, Up};
    use genmanip_core::Material;

    /// A box between two corners.
    pub fn cuboid(low: DVec3, high: DVec3) -> RawMesh {
        let corner = |i: u32| {
            DVec3::new(
                if i & 1 == 0 { low.x } else { high.x },
                if i & 2 == 0 { low.y } else { high.y },
                if i & 4 == 0 { low.z } else { high.z },
            )
        };
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        RawMesh { positions: (0..8).map(corner).collect(), uvs: Vec::new(), triangles }
    }

    /// An object with one surface.
    pub fn object(mesh: RawMesh) -> RawObject {
        let surface = Surface { name: "body".into(), mesh, material: Material::plain([0.8, 0.1, 0.1], 0.5) };
        RawObject {
            name: "thing".into(),
            links: vec![RawLink { name: "body".into(), surfaces: vec![surface], ..RawLink::default() }],
            unit: Unit::Metre,
            up: Up::Z,
            licence: None,
            creator: None,
            notes: Vec::new(),
        }
    }

    #[test]
    fn damage_is_repaired_and_reported() {
        let mut mesh = cuboid(DVec3::ZERO, DVec3::splat(0.1));
        assert!(is_closed(&mesh) && (signed_volume(&mesh) - 1e-3).abs() < 1e-9);
        mesh.triangles.push(mesh.triangles[0]);
        mesh.triangles.push([0, 0, 1]);
        mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        let mut raw = object(mesh);
        clean("thing.obj", &mut raw).unwrap();
        assert_eq!(raw.links[0].surfaces[0].mesh.triangles.len(), 12);
        assert!((signed_volume(&raw.all_surfaces()) - 1e-3).abs() < 1e-9);
        assert_eq!(raw.notes.len(), 3, "{:?}", raw.notes);
    }

    #[test]
    fn non_finite_vertices_are_dropped_or_rejected() {
        let mut mesh = cuboid(DVec3::ZERO, DVec3::splat(0.1));
        mesh.positions[0].x = f64::NAN;
        let error = clean("thing.obj", &mut object(mesh.clone())).unwrap_err();
        assert!(error.message.contains("of 12 triangles"), "{error}");
        let mut many = RawMesh::default();
        for index in 0..20 {
            let low = DVec3::X * f64::from(index);
            many.append(&cuboid(low, low + DVec3::splat(0.1)));
        }
        many.positions[0].y = f64::INFINITY;
        let mut raw = object(many);
        clean("thing.obj", &mut raw).unwrap();
        assert!(raw.notes[0].contains("invalid vertices"), "{:?}", raw.notes);
    }
}

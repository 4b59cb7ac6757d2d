//! Mesh simplification by vertex clustering (Rossignac and Borrel 1993).

use std::collections::{BTreeMap, HashMap};

use glam::DVec3;

use crate::raw::{RawMesh, RawObject};

/// Maximum number of visual triangles of an object: twice what the catalogue's objects have.
const MAX_VISUAL_TRIANGLES: usize = 12_000;
/// Number of bisection steps for the cluster size.
const SEARCH_STEPS: usize = 14;

/// Reduces the visual meshes of an object to at most about `MAX_VISUAL_TRIANGLES` triangles in total, each in
/// proportion, and adds a note.
pub fn simplify(raw: &mut RawObject) {
    let count: usize = raw.links.iter().flat_map(|link| &link.surfaces).map(|s| s.mesh.triangles.len()).sum();
    if count <= MAX_VISUAL_TRIANGLES {
        return;
    }
    for surface in raw.links.iter_mut().flat_map(|link| &mut link.surfaces) {
        let share = surface.mesh.triangles.len() as f64 / count as f64;
        surface.mesh = reduced(&surface.mesh, ((MAX_VISUAL_TRIANGLES as f64 * share) as usize).max(20));
    }
    let left: usize = raw.links.iter().flat_map(|link| &link.surfaces).map(|s| s.mesh.triangles.len()).sum();
    raw.notes.push(format!("reduced from {count} to {left} visual triangles"));
}

/// Simplified mesh with at most about `most` triangles.
pub fn reduced(mesh: &RawMesh, most: usize) -> RawMesh {
    if mesh.triangles.len() <= most {
        return mesh.clone();
    }
    let charts = charts(mesh);
    let low = mesh.positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let size = (mesh.positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p)) - low).max_element();
    let (mut fine, mut coarse) = (size / 4096.0, size / 2.0);
    let mut best = clustered(mesh, &charts, low, coarse);
    for _ in 0..SEARCH_STEPS {
        let cell = (fine * coarse).sqrt();
        let tried = clustered(mesh, &charts, low, cell);
        if tried.triangles.len() <= most {
            (coarse, best) = (cell, tried);
        } else {
            fine = cell;
        }
    }
    best
}

/// Connected component of each vertex; vertices of different components are not merged, since textures have seams
/// there.
fn charts(mesh: &RawMesh) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    fn root(parent: &mut [u32], mut index: u32) -> u32 {
        while parent[index as usize] != index {
            parent[index as usize] = parent[parent[index as usize] as usize];
            index = parent[index as usize];
        }
        index
    }
    if mesh.uvs.is_empty() {
        return vec![0; mesh.positions.len()];
    }
    for &[a, b, c] in &mesh.triangles {
        for (one, other) in [(a, b), (b, c)] {
            let (one, other) = (root(&mut parent, one), root(&mut parent, other));
            parent[one.max(other) as usize] = one.min(other);
        }
    }
    (0..mesh.positions.len() as u32).map(|index| root(&mut parent, index)).collect()
}

fn clustered(mesh: &RawMesh, charts: &[u32], low: DVec3, cell: f64) -> RawMesh {
    let key = |index: usize| {
        let [x, y, z] = ((mesh.positions[index] - low) / cell).floor().to_array().map(|value| value as i32);
        (x, y, z, charts[index])
    };
    let mut sums: BTreeMap<(i32, i32, i32, u32), (DVec3, f64)> = BTreeMap::new();
    for (index, position) in mesh.positions.iter().enumerate() {
        let sum = sums.entry(key(index)).or_default();
        *sum = (sum.0 + *position, sum.1 + 1.0);
    }
    // The vertex nearest to the cluster's mean represents the cluster, with its position and texture coordinates.
    let mut nearest: HashMap<(i32, i32, i32, u32), (f64, u32)> = HashMap::new(); // only looked up
    for (index, position) in mesh.positions.iter().enumerate() {
        let (sum, count) = sums[&key(index)];
        let distance = position.distance_squared(sum / count);
        let kept = nearest.entry(key(index)).or_insert((f64::INFINITY, 0));
        if distance < kept.0 {
            *kept = (distance, index as u32);
        }
    }
    let mut out = RawMesh::default();
    let mut places: HashMap<u32, u32> = HashMap::new(); // only looked up
    let mut seen = std::collections::HashSet::new(); // only looked up
    for triangle in &mesh.triangles {
        let kept = triangle.map(|index| nearest[&key(index as usize)].1);
        if kept[0] == kept[1] || kept[1] == kept[2] || kept[2] == kept[0] {
            continue;
        }
        let mut sorted = kept;
        sorted.sort_unstable();
        if !seen.insert(sorted) {
            continue;
        }
        out.triangles.push(kept.map(|index| {
            *places.entry(index).or_insert_with(|| {
                out.positions.push(mesh.positions[index as usize]);
                out.uvs.extend(mesh.uvs.get(index as usize));
                out.positions.len() as u32 - 1
            })
        }));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fine_ball_keeps_its_shape_with_fewer_triangles() {
        let (rows, columns) = (120_u32, 240_u32);
        let mut ball = RawMesh::default();
        for row in 0..=rows {
            for column in 0..columns {
                let (theta, phi) = (
                    std::f64::consts::PI * f64::from(row) / f64::from(rows),
                    std::f64::consts::TAU * f64::from(column) / f64::from(columns),
                );
                ball.positions.push(DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let (a, b) = (row * columns + column, row * columns + (column + 1) % columns);
                ball.triangles.extend([[a, a + columns, b], [b, a + columns, b + columns]]);
            }
        }
        let small = reduced(&ball, 3000);
        assert!((1000..=3000).contains(&small.triangles.len()), "{}", small.triangles.len());
        assert!(small.positions.iter().all(|p| (p.length() - 1.0).abs() < 1e-9));
        let volume = crate::clean::signed_volume(&small);
        assert!((volume / 4.18879 - 1.0).abs() < 0.05, "{volume}");
    }
}

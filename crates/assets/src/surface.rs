//! Triangle surfaces from rings of points, with smooth normals and texture coordinates.

use std::collections::HashMap;
use std::f64::consts::TAU;

use genmanip_core::TriMesh;
use glam::{DQuat, DVec2, DVec3};

/// Faces that meet at a smaller angle are shaded as one smooth surface.
const CREASE_COSINE: f64 = 0.77; // 40 degrees

/// The surface through rings of equally many points, each counter-clockwise seen from the last ring.
///
/// Texture: u runs once around along the widest ring, v from 1 at the first ring to 0 at the last one, along the mean distance of the rings.
/// A ring of equal points closes the surface.
pub fn from_rings(rings: &[Vec<DVec3>]) -> TriMesh {
    let count = rings.first().map_or(0, Vec::len);
    let along = ring_distances(rings);
    let around = around_fractions(rings);
    let total = along.last().copied().unwrap_or(1.0).max(1e-9);
    let mut corners = Vec::with_capacity(rings.len() * count * 6);
    for (row, pair) in rings.windows(2).enumerate() {
        for i in 0..count {
            let at = |ring: usize, column: usize| {
                let uv = DVec2::new(around[column], 1.0 - along[row + ring] / total);
                (pair[ring][column % count], uv)
            };
            let (a, b, c, d) = (at(0, i), at(0, i + 1), at(1, i + 1), at(1, i));
            corners.push([a, b, c]);
            corners.push([a, c, d]);
        }
    }
    smooth(&corners)
}

/// Points of a horizontal circle, counter-clockwise from above; `phase` in steps.
pub fn circle(radius_height: DVec2, sides: usize, phase: f64) -> Vec<DVec3> {
    (0..sides)
        .map(|i| {
            let angle = (i as f64 + phase) / sides as f64 * TAU;
            DVec3::new(radius_height.x * angle.cos(), radius_height.x * angle.sin(), radius_height.y)
        })
        .collect()
}

/// Points of a rounded rectangle, counter-clockwise from above, starting on the +x side; `4 * per_corner` points.
pub fn rounded_rectangle(half: DVec2, corner: f64, height: f64, per_corner: usize) -> Vec<DVec3> {
    let corner = corner.min(half.min_element()).max(0.0);
    (0..4 * per_corner)
        .map(|i| {
            let (quadrant, step) = (i / per_corner, i % per_corner);
            let fraction = if per_corner > 1 { step as f64 / (per_corner - 1) as f64 } else { 0.5 };
            let angle = (quadrant as f64 + fraction) * TAU / 4.0;
            let sign = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]][quadrant];
            let center = (half - corner) * DVec2::from_array(sign);
            (center + DVec2::from_angle(angle) * corner).extend(height)
        })
        .collect()
}

/// Rings of elliptic cross-sections along a path. `half_widths` per station: across (horizontal) and upright.
pub fn tube_rings(path: &[DVec3], half_widths: &[DVec2], sides: usize) -> Vec<Vec<DVec3>> {
    let frames = path_frames(path);
    path.iter()
        .zip(half_widths)
        .zip(frames)
        .map(|((&center, half), frame)| {
            (0..sides)
                .map(|i| {
                    let angle = i as f64 / sides as f64 * TAU;
                    center + frame * DVec3::new(half.x * angle.cos(), half.y * angle.sin(), 0.0)
                })
                .collect()
        })
        .collect()
}

/// A frame per station: z along the path, y as upright as possible at the start, then carried along without twist.
fn path_frames(path: &[DVec3]) -> Vec<DQuat> {
    let tangent = |i: usize| {
        let (before, after) = (path[i.saturating_sub(1)], path[(i + 1).min(path.len() - 1)]);
        (after - before).normalize_or(DVec3::X)
    };
    let start = if path.len() > 1 { tangent(0) } else { DVec3::X };
    let up = if start.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
    let x = up.cross(start).normalize_or(DVec3::X);
    let mut frame = DQuat::from_mat3(&glam::DMat3::from_cols(x, start.cross(x), start));
    let mut frames = Vec::with_capacity(path.len());
    for i in 0..path.len() {
        frame = (DQuat::from_rotation_arc(frame * DVec3::Z, tangent(i)) * frame).normalize();
        frames.push(frame);
    }
    frames
}

/// A smooth curve through points (Catmull-Rom), kept within their bounds so that sizes stay exact.
pub fn smooth_curve(points: &[DVec3], steps: usize) -> Vec<DVec3> {
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else { return Vec::new() };
    if points.len() < 3 || steps < 2 {
        return points.to_vec();
    }
    let low = points.iter().fold(first, |low, point| low.min(*point));
    let high = points.iter().fold(first, |high, point| high.max(*point));
    let at = |i: isize| points[i.clamp(0, points.len() as isize - 1) as usize];
    let mut curve = Vec::with_capacity(points.len() * steps);
    for i in 0..points.len() as isize - 1 {
        let (p0, p1, p2, p3) = (at(i - 1), at(i), at(i + 1), at(i + 2));
        for step in 0..steps {
            let t = step as f64 / steps as f64;
            let point = p1
                + ((p2 - p0) + ((p0 * 2.0 - p1 * 5.0 + p2 * 4.0 - p3) + (p1 * 3.0 - p0 - p2 * 3.0 + p3) * t) * t)
                    * (t / 2.0);
            curve.push(point.clamp(low, high));
        }
    }
    curve.push(last);
    curve
}

/// [`smooth_curve`] of (radius, height) pairs.
pub fn smooth_profile(points: &[[f64; 2]], steps: usize) -> Vec<DVec2> {
    let points: Vec<DVec3> = points.iter().map(|&[r, h]| DVec3::new(r, h, 0.0)).collect();
    smooth_curve(&points, steps).into_iter().map(DVec3::truncate).collect()
}

/// Vertices with normals that are smooth except across creases, from loose triangles with texture coordinates.
pub fn smooth(corners: &[[(DVec3, DVec2); 3]]) -> TriMesh {
    let mut faces = Vec::with_capacity(corners.len());
    let mut around: HashMap<[i64; 3], Vec<usize>> = HashMap::new(); // only looked up, never iterated
    for triangle in corners {
        let [a, b, c] = triangle.map(|(position, _)| position);
        let weighted = (b - a).cross(c - a);
        if weighted.length_squared() > 1e-20 {
            for (position, _) in triangle {
                around.entry(key(*position)).or_default().push(faces.len());
            }
            faces.push((*triangle, weighted));
        }
    }
    let mut mesh = TriMesh::default();
    let mut known: HashMap<([i64; 3], [i64; 3], [i64; 2]), u32> = HashMap::new(); // only looked up
    for (triangle, weighted) in &faces {
        let own = weighted.normalize();
        let indices = triangle.map(|(position, uv)| {
            let sum = around[&key(position)]
                .iter()
                .map(|&face| faces[face].1)
                .filter(|other| other.normalize().dot(own) > CREASE_COSINE)
                .fold(DVec3::ZERO, |sum, normal| sum + normal);
            let normal = sum.normalize_or(own);
            let name = (key(position), key(normal * 1e-2), [(uv.x * 1e6) as i64, (uv.y * 1e6) as i64]);
            *known.entry(name).or_insert_with(|| {
                mesh.positions.push(position.as_vec3());
                mesh.normals.push(normal.as_vec3());
                mesh.uvs.push(uv.as_vec2());
                mesh.positions.len() as u32 - 1
            })
        });
        mesh.triangles.push(indices);
    }
    mesh
}

fn key(v: DVec3) -> [i64; 3] {
    (v * 1e6).round().to_array().map(|value| value as i64)
}

fn ring_distances(rings: &[Vec<DVec3>]) -> Vec<f64> {
    let mut along = vec![0.0];
    for pair in rings.windows(2) {
        let sum: f64 = pair[0].iter().zip(&pair[1]).map(|(a, b)| a.distance(*b)).sum();
        along.push(along[along.len() - 1] + sum / pair[0].len().max(1) as f64);
    }
    along
}

/// How far around each column lies, 0-1, on the longest ring; one more than columns.
fn around_fractions(rings: &[Vec<DVec3>]) -> Vec<f64> {
    let lengths = |ring: &Vec<DVec3>| {
        let mut sum = 0.0;
        let mut along = vec![0.0];
        for i in 0..ring.len() {
            sum += ring[i].distance(ring[(i + 1) % ring.len()]);
            along.push(sum);
        }
        along
    };
    let total = |along: &Vec<f64>| along.last().copied().unwrap_or(0.0);
    let longest = rings.iter().map(lengths).max_by(|a, b| total(a).total_cmp(&total(b))).unwrap_or_default();
    let whole = total(&longest).max(1e-9);
    longest.into_iter().map(|length| length / whole).collect()
}

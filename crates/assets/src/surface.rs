//! Triangle meshes from rings of points, with smooth normals and texture coordinates.

use std::collections::HashMap;
use std::f64::consts::TAU;

use genmanip_core::TriMesh;
use glam::{DQuat, DVec2, DVec3};

/// Cosine of the largest angle between faces that share smooth normals.
const CREASE_COSINE: f64 = 0.77; // 40 degrees

/// Maximum deviation of the rendering mesh from the full-resolution mesh, m. Chosen by hand: less than half a pixel of
/// a 1280x720 image at a distance of 0.2 m.
const FLAT_M: f64 = 1e-4;

/// Maximum length of a patch along the profile of a painted surface, m. Chosen by eye.
const PATCH_M: f64 = 0.012;

/// Level of detail of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Full resolution, for judging and planning; does not depend on rendering.
    Full,
    /// Simplified for rendering: as few triangles as stay within 0.1 mm of the shape.
    Simplified,
}

impl Detail {
    /// Number of chords, from 1 to `most`, of an arc with this radius (m) and angle (rad).
    pub fn chords(self, most: usize, radius: f64, angle: f64) -> usize {
        let widest = 2.0 * (1.0 - FLAT_M / radius.max(FLAT_M)).acos();
        match self {
            Self::Full => most,
            Self::Simplified => most.min((angle / widest).ceil() as usize).max(1),
        }
    }
}

/// Mesh through rings with the same number of points, each counter-clockwise seen from the last ring.
///
/// Texture coordinates: u covers the circumference once, measured along the longest ring; v runs from 1 at the first
/// ring to 0 at the last, proportional to the mean distance of the rings.
/// A ring of equal points closes the surface. Normals and texture coordinates are computed from all rings, even if a
/// rendering mesh omits some.
pub fn from_rings(rings: &[Vec<DVec3>], detail: Detail) -> TriMesh {
    let mut rings = rings.to_vec();
    rings.dedup();
    let count = rings.first().map_or(0, Vec::len);
    let along = ring_distances(&rings);
    let around = around_fractions(&rings);
    let total = along.last().copied().unwrap_or(1.0).max(1e-9);
    let position = |ring: usize, column: usize| rings[ring][column % count];
    let faces: Vec<[DVec3; 3]> = (1..rings.len())
        .flat_map(|row| (0..count).flat_map(move |column| patch(row - 1, row, column)))
        .map(|face| face.map(|(ring, column)| position(ring, column)))
        .collect();
    let normals = smooth_normals(&faces);
    let kept = match detail {
        Detail::Full => (0..rings.len()).collect(),
        Detail::Simplified => kept_rings(&rings),
    };
    let mut surface = MeshBuilder::default();
    for pair in kept.windows(2) {
        for column in 0..count {
            for (half, face) in patch(pair[0], pair[1], column).into_iter().enumerate() {
                let own = weighted_normal(face.map(|(ring, column)| position(ring, column)));
                if is_degenerate(own) {
                    continue;
                }
                surface.add([0, 1, 2].map(|corner| {
                    let (ring, at) = face[corner];
                    // Row of the full-resolution mesh that touches this end of the patch.
                    let row = if ring == pair[0] { ring } else { ring - 1 };
                    let normal = normals[(row * count + column) * 2 + half][corner].normalize_or(own.normalize());
                    (position(ring, at), normal, DVec2::new(around[at], 1.0 - along[ring] / total))
                }));
            }
        }
    }
    surface.mesh
}

/// Two triangles between neighbouring columns of two rings, as (ring, column) of their vertices.
fn patch(low: usize, high: usize, column: usize) -> [[(usize, usize); 3]; 2] {
    let (a, b, c, d) = ((low, column), (low, column + 1), (high, column + 1), (high, column));
    [[a, b, c], [a, c, d]]
}

/// Indices of the rings to keep: all others lie within [`FLAT_M`] of the segments between their neighbours.
fn kept_rings(rings: &[Vec<DVec3>]) -> Vec<usize> {
    let is_flat = |from: usize, to: usize| {
        let mut sides = rings[from].iter().zip(&rings[to]).enumerate();
        sides.all(|(i, (&a, &b))| {
            let strays = |ring: &Vec<DVec3>| distance_to_segment(ring[i], a, b) > FLAT_M;
            a.distance(b) <= PATCH_M && !rings[from + 1..to].iter().any(strays)
        })
    };
    let mut kept = vec![0];
    let mut from = 0;
    for to in 2..rings.len() {
        if !is_flat(from, to) {
            from = to - 1;
            kept.push(from);
        }
    }
    kept.extend((rings.len() > 1).then(|| rings.len() - 1));
    kept
}

fn distance_to_segment(point: DVec3, from: DVec3, to: DVec3) -> f64 {
    let along = to - from;
    let share = (point - from).dot(along) / along.length_squared().max(f64::MIN_POSITIVE);
    point.distance(from + along * share.clamp(0.0, 1.0))
}

/// Points of a horizontal circle given by (radius, height), counter-clockwise seen from above; `phase` is an angle in
/// steps between points.
pub fn circle(radius_height: DVec2, sides: usize, phase: f64) -> Vec<DVec3> {
    (0..sides)
        .map(|i| {
            let angle = (i as f64 + phase) / sides as f64 * TAU;
            DVec3::new(radius_height.x * angle.cos(), radius_height.x * angle.sin(), radius_height.y)
        })
        .collect()
}

/// Points of a horizontal rounded rectangle, counter-clockwise seen from above, starting on the +x side; `4 *
/// per_corner` points.
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

/// Rings of elliptic cross-sections along a path; `half_widths` has one (horizontal, vertical) pair per point of the
/// path.
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

/// Rotation-minimising frames along a path: z along the path, y as upright as possible at its start.
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

/// Catmull-Rom curve through points with `steps` segments between two points, clamped to their bounds so that sizes
/// stay exact.
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

/// Profile subdivided into segments of at most 12 mm, so that textures are mapped onto nearly square patches.
pub fn subdivided(profile: &[DVec2]) -> Vec<DVec2> {
    let mut fine: Vec<DVec2> = profile.first().copied().into_iter().collect();
    for pair in profile.windows(2) {
        let count = (pair[0].distance(pair[1]) / PATCH_M).ceil().clamp(1.0, 64.0) as usize;
        fine.extend((1..=count).map(|i| pair[0].lerp(pair[1], i as f64 / count as f64)));
    }
    fine
}

/// Mesh of loose triangles with texture coordinates; vertex normals are smoothed except across creases.
pub fn smooth(corners: &[[(DVec3, DVec2); 3]]) -> TriMesh {
    let faces: Vec<[DVec3; 3]> = corners.iter().map(|triangle| triangle.map(|(position, _)| position)).collect();
    let mut surface = MeshBuilder::default();
    for (triangle, normals) in
        corners.iter().zip(smooth_normals(&faces)).filter(|(_, normals)| normals[0] != DVec3::ZERO)
    {
        surface.add([0, 1, 2].map(|i| (triangle[i].0, normals[i], triangle[i].1)));
    }
    surface.mesh
}

/// Vertex normals of loose triangles, smoothed except across creases; zero for degenerate triangles.
fn smooth_normals(faces: &[[DVec3; 3]]) -> Vec<[DVec3; 3]> {
    let weighted: Vec<DVec3> = faces.iter().map(|&face| weighted_normal(face)).collect();
    let mut around: HashMap<[i64; 3], Vec<usize>> = HashMap::new(); // only looked up, never iterated
    for (index, face) in faces.iter().enumerate().filter(|(index, _)| !is_degenerate(weighted[*index])) {
        for &position in face {
            around.entry(key(position)).or_default().push(index);
        }
    }
    let normal = |index: usize, position: DVec3| {
        if is_degenerate(weighted[index]) {
            return DVec3::ZERO;
        }
        let own = weighted[index].normalize();
        let neighbours = around[&key(position)].iter().map(|&face| weighted[face]);
        let sum: DVec3 = neighbours.filter(|other| other.normalize().dot(own) > CREASE_COSINE).sum();
        sum.normalize_or(own)
    };
    faces.iter().enumerate().map(|(index, face)| face.map(|position| normal(index, position))).collect()
}

/// Normal of a triangle, with twice the triangle's area as length.
fn weighted_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

fn is_degenerate(weighted_normal: DVec3) -> bool {
    weighted_normal.length_squared() <= 1e-20
}

/// Quantised position, normal and texture coordinates of a vertex.
type CornerKey = ([i64; 3], [i64; 3], [i64; 2]);

/// Mesh builder that merges equal vertices.
#[derive(Default)]
struct MeshBuilder {
    mesh: TriMesh,
    known: HashMap<CornerKey, u32>, // only looked up
}

impl MeshBuilder {
    /// Adds a triangle of positions, normals and texture coordinates.
    fn add(&mut self, triangle: [(DVec3, DVec3, DVec2); 3]) {
        let Self { mesh, known } = self;
        let indices = triangle.map(|(position, normal, uv)| {
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

/// Fraction of the circumference, 0-1, at each column of the longest ring; one more entry than columns.
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

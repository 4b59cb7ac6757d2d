//! Convex hull vertices of a mesh, from STL (binary or text) and OBJ.

use genmanip_core::glam::DVec3;
use genmanip_core::limits::MESH;

use super::plausible::MAX_CORNERS;
use crate::hull::convex_hull;

/// A mesh file.
#[derive(Clone, Debug)]
pub struct MeshFile {
    /// File name; the extension determines the format (`stl`, `obj`).
    pub name: String,
    /// File contents.
    pub bytes: Vec<u8>,
}

/// Vertices of the mesh's convex hull, scaled; the error is a description.
pub(super) fn hull_corners(name: &str, bytes: &[u8], scale: DVec3) -> Result<Vec<DVec3>, String> {
    if bytes.len() as u64 > MESH.bytes {
        return Err(format!("{} bytes; at most {} are read", bytes.len(), MESH.human_readable()));
    }
    let extension = name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    let mut points = match extension.as_str() {
        "obj" => words_after("v", bytes)?,
        "stl" if bytes.starts_with(b"solid") && !is_binary(bytes) => words_after("vertex", bytes)?,
        "stl" if is_binary(bytes) => binary_stl(bytes),
        "stl" => return Err("neither text nor binary STL: its size does not match its number of triangles".into()),
        other => return Err(format!("expected a mesh in STL or OBJ, got the extension `{other}`")),
    };
    for point in &mut points {
        *point *= scale;
    }
    if !points.iter().all(|point| point.is_finite() && point.abs().max_element() < 1e3) {
        return Err("a vertex is not finite or more than 1 km away".into());
    }
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    points.dedup();
    if points.len() < 4 {
        return Err(format!("{} distinct vertices; a body needs at least 4", points.len()));
    }
    if points.len() > MAX_CORNERS {
        points = outermost(points);
    }
    if points.len() > MAX_CORNERS {
        return Err(format!("its convex hull has about {} vertices; at most {MAX_CORNERS} are allowed", points.len()));
    }
    convex_hull(&points).map(|(corners, _)| corners)
}

/// Removes points that are certainly inside the hull of the extreme points along sampled directions.
fn outermost(points: Vec<DVec3>) -> Vec<DVec3> {
    // Fibonacci lattice; chosen, sufficient for all but a few per cent of an even cloud.
    const DIRECTIONS: usize = 256;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let direction = |index: usize| {
        let z = 1.0 - (2.0 * index as f64 + 1.0) / DIRECTIONS as f64;
        let (sin, cos) = (golden * index as f64).sin_cos();
        DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    let farthest = |index: usize| {
        let along = direction(index);
        points.iter().copied().max_by(|a, b| a.dot(along).total_cmp(&b.dot(along)))
    };
    let mut extremes: Vec<DVec3> = (0..DIRECTIONS).filter_map(farthest).collect();
    extremes.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z)));
    extremes.dedup();
    let Ok((corners, triangles)) = convex_hull(&extremes) else { return points };
    let planes: Vec<(DVec3, f64)> = triangles
        .iter()
        .filter_map(|[a, b, c]| {
            let [a, b, c] = [a, b, c].map(|index| corners[*index as usize]);
            let outward = (b - a).cross(c - a).try_normalize()?;
            Some((outward, outward.dot(a)))
        })
        .collect();
    // Strictly inside: points in the planes may be vertices.
    let is_inside = |point: &DVec3| planes.iter().all(|(outward, reach)| outward.dot(*point) < reach - 1e-9);
    points.into_iter().filter(|point| !is_inside(point)).collect()
}

fn is_binary(bytes: &[u8]) -> bool {
    let count = bytes.get(80..84).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    count.is_some_and(|count| bytes.len() as u64 == 84 + 50 * u64::from(count))
}

fn binary_stl(bytes: &[u8]) -> Vec<DVec3> {
    let number = |bytes: &[u8]| f64::from(bytes.try_into().map_or(f32::NAN, f32::from_le_bytes));
    let corner = |bytes: &[u8]| DVec3::new(number(&bytes[..4]), number(&bytes[4..8]), number(&bytes[8..]));
    bytes[84..].chunks_exact(50).flat_map(|triangle| triangle[12..48].chunks_exact(12).map(corner)).collect()
}

/// The three numbers of every line that starts with `key`.
fn words_after(key: &str, bytes: &[u8]) -> Result<Vec<DVec3>, String> {
    let text = std::str::from_utf8(bytes).map_err(|error| format!("not text: {error}"))?;
    let mut points = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        if words.next() != Some(key) {
            continue;
        }
        let values: Vec<f64> = words.take(3).filter_map(|word| word.parse().ok()).collect();
        let &[x, y, z] = values.as_slice() else {
            return Err(format!("line {}: expected three numbers after `{key}`", index + 1));
        };
        points.push(DVec3::new(x, y, z));
    }
    Ok(points)
}

//! Meshes with per-triangle shading data and levels of detail, shared within a process.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, Weak};

use genmanip_core::{Pose, TriMesh};
use glam::{DVec3, Vec2, Vec3, Vec4};
use meshopt::{SimplifyOptions, simplify_scale_decoder, simplify_with_attributes_and_locks_decoder};

/// Largest surface error of each level of detail (m).
pub(crate) const ERRORS_M: [f32; 5] = [0.0005, 0.001, 0.002, 0.004, 0.008];
/// Largest surface error of shadow casters in large images and in small ones (m): about half a texel of the default
/// shadow map.
const CASTER_ERRORS_M: [f32; 2] = [0.001, 0.004];
/// Surface error of shadow casters in large images as a share of the mesh radius, if that is smaller. Measured: with 1
/// mm for all meshes, shadows of small objects show corners and a bowl shadows itself.
const CASTER_SHARE: f32 = 0.01;

/// Largest error of the unit normals of a level of detail, as the length of the difference vector. Chosen by hand:
/// 8-bit colours change by a few levels.
const NORMAL_ERROR: f32 = 0.1;

/// Triangle mesh in the frame of its body.
#[derive(Debug)]
pub struct Mesh {
    /// Vertex positions (m).
    pub positions: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Attributes of each triangle.
    pub faces: Vec<Face>,
    /// Quantised normal of each triangle; anti-aliasing treats triangles of different codes as different surfaces.
    pub directions: Vec<u8>,
    /// Centre of the bounding sphere (m).
    pub bounds_center: Vec3,
    /// Radius of the bounding sphere (m).
    pub bounds_radius: f32,
    /// True if the mesh is watertight and consistently wound, so that back faces are invisible from outside.
    pub closed: bool,
    /// Vertex normals and texture coordinates, from which levels of detail are made.
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    coarser: [OnceLock<Arc<Mesh>>; ERRORS_M.len()],
    casters: [OnceLock<Arc<Mesh>>; CASTER_ERRORS_M.len()],
}

/// Attributes of a triangle as linear functions of the position in the body's frame.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub struct Face {
    /// Columns of the map from `[x, y, z, 1]` to the interpolated normal and texture coordinate u.
    pub columns: [Vec4; 4],
    /// Texture coordinate v as a dot product with `[x, y, z, 1]`.
    pub v: Vec4,
    /// Unit normal (zero for a degenerate triangle), and texture area per surface area (1/m²).
    pub plane: Vec4,
}

impl Mesh {
    /// Surface area (m²).
    pub fn area(&self) -> f32 {
        let area = |triangle| {
            let [a, b, c] = self.corners(triangle);
            0.5 * (b - a).cross(c - a).length()
        };
        (0..self.triangles.len()).map(area).sum()
    }

    /// True if the surface mostly faces away from the centre of its bounding sphere, as a closed mesh or the outer wall
    /// of a vessel does; an inner wall faces towards it.
    pub fn faces_out(&self) -> bool {
        let (mut out, mut all) = (0.0, 0.0);
        for triangle in 0..self.triangles.len() {
            let [a, b, c] = self.corners(triangle);
            let (area, from_middle) = ((b - a).cross(c - a), (a + b + c) / 3.0 - self.bounds_center);
            out += area.dot(from_middle);
            all += area.length() * from_middle.length();
        }
        // More than 0, since a flat part such as a rim faces neither inwards nor outwards.
        out > 0.25 * all
    }

    /// Mesh of a visual part, cached while `source` lives; indices must be valid and positions finite.
    pub fn shared(source: &Arc<TriMesh>, body_from_part: &Pose) -> Arc<Self> {
        type Key = (usize, [u64; 7]);
        type Known = BTreeMap<Key, (Weak<TriMesh>, Arc<Mesh>)>;
        static KNOWN: Mutex<Known> = Mutex::new(BTreeMap::new());
        let [x, y, z] = body_from_part.position.to_array();
        let [i, j, k, w] = body_from_part.rotation.to_array();
        let key = (Arc::as_ptr(source) as usize, [x, y, z, i, j, k, w].map(f64::to_bits));
        // The map is consistent even if a thread panicked while it held the lock.
        let known = || KNOWN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((from, made)) = known().get(&key)
            && from.strong_count() > 0
        {
            return Arc::clone(made);
        }
        let made = Arc::new(Self::new(source, body_from_part));
        let mut known = known();
        known.retain(|_, (from, _)| from.strong_count() > 0);
        known.insert(key, (Arc::downgrade(source), Arc::clone(&made)));
        made
    }

    fn new(source: &TriMesh, body_from_part: &Pose) -> Self {
        let corners = source.positions.len();
        let place = |point: Vec3| body_from_part.transform_point(point.as_dvec3()).as_vec3();
        let turn = |vector: Vec3| body_from_part.transform_vector(vector.as_dvec3()).as_vec3();
        let positions: Vec<Vec3> = source.positions.iter().copied().map(place).collect();
        let normals = if source.normals.len() == corners {
            source.normals.iter().copied().map(turn).collect()
        } else {
            smooth_normals(&positions, &source.triangles)
        };
        let uvs = if source.uvs.len() == corners { source.uvs.clone() } else { vec![Vec2::ZERO; corners] };
        Self::of(positions, normals, uvs, source.triangles.clone(), is_closed(source))
    }

    fn of(positions: Vec<Vec3>, normals: Vec<Vec3>, uvs: Vec<Vec2>, triangles: Vec<[u32; 3]>, closed: bool) -> Self {
        let (low, high) = positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &point| (low.min(point), high.max(point)));
        let bounds_center = if positions.is_empty() { Vec3::ZERO } else { (low + high) * 0.5 };
        let bounds_radius = positions.iter().map(|point| point.distance(bounds_center)).fold(0.0, f32::max);
        let corner = |index: u32| index as usize;
        let face = |triangle: &[u32; 3]| {
            Face::new(
                triangle.map(|index| positions[corner(index)]),
                triangle.map(|index| normals[corner(index)]),
                triangle.map(|index| uvs[corner(index)]),
            )
        };
        let faces: Vec<Face> = triangles.iter().map(face).collect();
        let directions = faces.iter().map(|face| direction_code(face.plane.truncate())).collect();
        Self {
            positions,
            triangles,
            faces,
            directions,
            bounds_center,
            bounds_radius,
            closed,
            normals,
            uvs,
            coarser: Default::default(),
            casters: Default::default(),
        }
    }

    /// Mesh at a level of detail: level 0 is the mesh itself, level `n` is within `ERRORS_M[n - 1]` of it.
    pub fn at_level(&self, level: usize) -> &Self {
        match level.checked_sub(1).and_then(|index| Some((*ERRORS_M.get(index)?, self.coarser.get(index)?))) {
            Some((error_m, copy)) => {
                copy.get_or_init(|| Arc::new(self.simplified(error_m, NORMAL_ERROR, SimplifyOptions::None)))
            }
            None => self,
        }
    }

    /// Simplified shadow caster for large or small images, without valid normals and texture coordinates.
    pub fn caster(&self, is_small: bool) -> &Self {
        let index = usize::from(is_small);
        let share = if is_small { f32::INFINITY } else { CASTER_SHARE };
        let error_m = CASTER_ERRORS_M[index].min(share * self.bounds_radius);
        self.casters[index]
            .get_or_init(|| Arc::new(self.simplified(error_m, f32::INFINITY, SimplifyOptions::Permissive)))
    }

    /// Mesh simplified by edge collapse within a surface error and a normal error (Garland and Heckbert, "Surface
    /// Simplification Using Quadric Error Metrics", 1997). Closed meshes stay closed; vertices keep their attributes,
    /// and seams remain unless the options allow otherwise.
    fn simplified(&self, error_m: f32, normal_error: f32, options: SimplifyOptions) -> Self {
        let corners: Vec<u32> = self.triangles.iter().flatten().copied().collect();
        let positions: Vec<[f32; 3]> = self.positions.iter().map(Vec3::to_array).collect();
        let normals: Vec<f32> = self.normals.iter().flat_map(Vec3::to_array).collect();
        let extent_m = simplify_scale_decoder(&positions);
        // meshopt measures positions relative to the extent and adds weighted errors of normals: with this weight an
        // error of `normal_error` counts as much as one of `error_m`.
        let weight = if extent_m > 0.0 { error_m / extent_m / normal_error } else { 0.0 };
        let mut kept = simplify_with_attributes_and_locks_decoder(
            &corners,
            &positions,
            &normals,
            &[weight; 3],
            size_of::<[f32; 3]>(),
            &vec![false; positions.len()],
            0,
            error_m,
            options | SimplifyOptions::ErrorAbsolute,
            None,
        );
        // Renumbers the vertices that are still in use.
        let mut numbers = vec![0; positions.len()];
        kept.iter().for_each(|&corner| numbers[corner as usize] = 1);
        let own: Vec<usize> = (0..positions.len()).filter(|&corner| numbers[corner] > 0).collect();
        (0..).zip(&own).for_each(|(number, &corner)| numbers[corner] = number);
        kept.iter_mut().for_each(|corner| *corner = numbers[*corner as usize]);
        let triangles = kept.as_chunks().0.to_vec();
        let [positions, normals] = [&self.positions, &self.normals].map(|all| own.iter().map(|&at| all[at]).collect());
        let uvs = own.iter().map(|&corner| self.uvs[corner]).collect();
        Self::of(positions, normals, uvs, triangles, self.closed)
    }

    /// Positions of a triangle's vertices in the body's frame (m).
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|index| self.positions[index as usize])
    }
}

impl Face {
    /// Attributes of a triangle. Computed in double precision, since small triangles have steep gradients.
    fn new(corners: [Vec3; 3], normals: [Vec3; 3], uvs: [Vec2; 3]) -> Self {
        /// Height below which a triangle counts as degenerate (m): about ten times the spacing of single-precision
        /// numbers at one metre.
        const LINE_M: f64 = 1e-6;
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let (ab, ac, bc) = (b - a, c - a, c - b);
        let area = ab.cross(ac);
        let longest = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
        let normal = area.normalize_or_zero();
        let is_line = area.length_squared() <= longest * LINE_M * LINE_M;
        let inverse = if is_line { 0.0 } else { area.length_squared().recip() };
        let (weight1, weight2) = (ac.cross(area) * inverse, area.cross(ab) * inverse);
        // Gradient and constant of the linear function with these values at the vertices.
        let linear = |values: [f32; 3]| -> (DVec3, f64) {
            let [first, second, third] = values.map(f64::from);
            let gradient = weight1 * (second - first) + weight2 * (third - first);
            (gradient, first - gradient.dot(a))
        };
        let component = |axis: usize| linear(normals.map(|normal| normal[axis]));
        let outputs = [component(0), component(1), component(2), linear(uvs.map(|uv| uv.x))];
        let row = |pick: &dyn Fn(&(DVec3, f64)) -> f64| Vec4::from_array(outputs.each_ref().map(|o| pick(o) as f32));
        let (v, v0) = linear(uvs.map(|uv| uv.y));
        let uv_area = (uvs[1] - uvs[0]).perp_dot(uvs[2] - uvs[0]).abs();
        let density = uv_area / (area.length() as f32).max(1e-12);
        Self {
            columns: [row(&|o| o.0.x), row(&|o| o.0.y), row(&|o| o.0.z), row(&|o| o.1)],
            v: v.as_vec3().extend(v0 as f32),
            plane: normal.as_vec3().extend(density),
        }
    }
}

/// Code 0-149 of a normal's direction: a face of the cube, and one of 5×5 cells on it, each about 20 degrees wide.
fn direction_code(normal: Vec3) -> u8 {
    let size = normal.abs();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    let field = |other: usize| ((normal[(axis + other) % 3] / size[axis].max(1e-12) * 2.0 + 2.5) as u8).min(4);
    (axis * 2 + usize::from(normal[axis] < 0.0)) as u8 * 25 + field(1) * 5 + field(2)
}

fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for &triangle in triangles {
        let [a, b, c] = triangle.map(|index| positions[index as usize]);
        let area = (b - a).cross(c - a);
        triangle.iter().for_each(|&index| normals[index as usize] += area);
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// True if every edge, after welding vertices, is used equally often in both directions, and the signed volume is
/// positive.
fn is_closed(mesh: &TriMesh) -> bool {
    // Vertices and edges are represented by integers, for sorting.
    let key = |position: &Vec3| {
        let [x, y, z] = position.to_array().map(|value| u128::from((value + 0.0).to_bits()));
        x << 64 | y << 32 | z
    };
    let mut corners: Vec<u128> =
        mesh.positions.iter().zip(0..).map(|(place, index)| key(place) << 32 | index).collect();
    corners.sort_unstable();
    let mut joined = vec![0_u64; corners.len()];
    let mut place = 0;
    for (rank, corner) in corners.iter().enumerate() {
        if rank > 0 && corners[rank - 1] >> 32 != corner >> 32 {
            place += 1;
        }
        joined[*corner as u32 as usize] = place;
    }
    // Each edge is stored once per use, with its direction in the lowest bit.
    let mut edges: Vec<u64> = mesh
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|edge| edge.map(|index| joined[index as usize]))
        .filter(|[from, to]| from != to)
        .map(|[from, to]| if from < to { from << 32 | to << 1 | 1 } else { to << 32 | from << 1 })
        .collect();
    edges.sort_unstable();
    let forwards = |same: &[u64]| same.iter().filter(|edge| *edge & 1 == 1).count();
    let balanced = edges.chunk_by(|a, b| a >> 1 == b >> 1).all(|same| forwards(same) * 2 == same.len());
    let volume: f64 = mesh.corners().map(|[a, b, c]| a.dot(b.cross(c))).sum();
    balanced && volume > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::fixture::{ball, block};

    /// Levels of detail of a ball of radius 5 cm: surface error, normal error, closedness and triangle count.
    #[test]
    fn coarser_copies_stay_close() {
        let radius = 0.05;
        let mesh = Mesh::new(&ball(radius, 48), &Pose::IDENTITY);
        let levels = ERRORS_M.iter().enumerate().map(|(index, &error_m)| (mesh.at_level(index + 1), error_m, true));
        let casters =
            [false, true].map(|is_small| (mesh.caster(is_small), CASTER_ERRORS_M[usize::from(is_small)], false));
        for (copy, error_m, has_normals) in levels.chain(casters) {
            let count = copy.triangles.len();
            assert!(count * 10 < mesh.triangles.len(), "{count} triangles within {error_m}");
            let own =
                TriMesh { positions: copy.positions.clone(), triangles: copy.triangles.clone(), ..TriMesh::default() };
            assert!(is_closed(&own), "not closed within {error_m}");
            for triangle in 0..count {
                let corners = copy.corners(triangle);
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                // The quadric error is a mean over the neighbourhood of a triangle.
                assert!(radius - middle.length() < 2.0 * error_m, "{} within {error_m}", middle.length());
                let [a, b, c] = copy.triangles[triangle].map(|corner| copy.normals[corner as usize]);
                let turned = ((a + b + c).normalize() - middle.normalize()).length();
                assert!(!has_normals || turned < 2.0 * NORMAL_ERROR, "{turned} within {error_m}");
            }
        }
        let block = Mesh::new(&block(Vec3::splat(0.1)), &Pose::IDENTITY);
        assert_eq!(block.at_level(ERRORS_M.len()).triangles.len(), block.triangles.len());
    }
}

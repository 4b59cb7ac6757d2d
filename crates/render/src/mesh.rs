//! Meshes ready for drawing, shared by all scenarios of a process.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, Weak};

use genmanip_core::{Pose, TriMesh};
use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::raster::Planes;

/// Cells of the coarser copies of a mesh, metres; a copy is drawn where its cell is smaller than one and a half pixels.
pub(crate) const CELLS_M: [f32; 5] = [0.0015, 0.003, 0.006, 0.012, 0.02];

/// A mesh in the frame of its body, with what shading wants to know of each triangle.
#[derive(Debug)]
pub(crate) struct Mesh {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    pub faces: Vec<Face>,
    pub planes: Planes,
    /// Coarse direction of each triangle's normal: triangles of different directions are different surfaces to
    /// anti-aliasing.
    pub directions: Vec<u8>,
    pub bounds_center: Vec3,
    pub bounds_radius: f32,
    /// Closed and consistently wound: its back faces can never be seen from outside.
    pub closed: bool,
    /// Corners' normals and texture coordinates, for the coarser copies.
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    coarser: [OnceLock<Arc<Mesh>>; CELLS_M.len()],
}

/// A triangle: what is interpolated over it as linear functions of the place in the body's frame.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(crate) struct Face {
    /// Columns of the map from `[x, y, z, 1]` to the normal between the corners' normals, and u.
    pub columns: [Vec4; 4],
    /// v is the scalar product with `[x, y, z, 1]`.
    pub v: Vec4,
    /// Unit normal of the plane, zero for a triangle without area, and square texture units per square metre.
    pub plane: Vec4,
}

impl Mesh {
    /// Area of all triangles, square metres.
    pub fn area(&self) -> f32 {
        let area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| self.positions[corner as usize]);
            0.5 * (b - a).cross(c - a).length()
        };
        self.triangles.iter().map(area).sum()
    }

    /// The mesh of a part, made once per process while its source lives; indices must be valid and places finite.
    pub fn shared(source: &Arc<TriMesh>, body_from_part: &Pose) -> Arc<Self> {
        type Key = (usize, [u64; 7]);
        type Known = BTreeMap<Key, (Weak<TriMesh>, Arc<Mesh>)>;
        static KNOWN: Mutex<Known> = Mutex::new(BTreeMap::new());
        let [x, y, z] = body_from_part.position.to_array();
        let [i, j, k, w] = body_from_part.rotation.to_array();
        let key = (Arc::as_ptr(source) as usize, [x, y, z, i, j, k, w].map(f64::to_bits));
        // A thread that panicked while it held the lock left a whole map behind.
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
            planes: Planes::new(faces.iter().zip(&triangles).map(|(face, triangle)| {
                let normal = face.plane.truncate();
                (normal.to_array(), normal.dot(positions[corner(triangle[0])]))
            })),
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
        }
    }

    /// The copy for a level: 0 is the mesh itself, `n` the one with cells of `CELLS_M[n - 1]`.
    pub fn at_level(&self, level: usize) -> &Self {
        match level.checked_sub(1).and_then(|index| Some((&CELLS_M[index..], self.coarser.get(index)?))) {
            Some((cells, copy)) => copy.get_or_init(|| Arc::new(self.clustered(cells[0]))),
            None => self,
        }
    }

    /// All corners in one cell of a grid move to one place (Rossignac and Borrel, 1993), so that what was closed stays
    /// closed; corners whose normals point elsewhere keep their own, so that edges stay sharp.
    fn clustered(&self, cell_m: f32) -> Self {
        let mut cells: BTreeMap<[i32; 3], (Vec3, f32)> = BTreeMap::new();
        let cell_of = |position: Vec3| (position / cell_m).round().to_array().map(|value| value as i32);
        for &position in &self.positions {
            let (sum, count) = cells.entry(cell_of(position)).or_default();
            (*sum, *count) = (*sum + position, *count + 1.0);
        }
        let mut clusters: BTreeMap<([i32; 3], u8), u32> = BTreeMap::new();
        let (mut positions, mut normals, mut uvs) = (Vec::new(), Vec::<Vec3>::new(), Vec::new());
        let mut cluster_of = Vec::with_capacity(self.positions.len());
        for (index, &position) in self.positions.iter().enumerate() {
            let cell = cell_of(position);
            let cluster =
                *clusters.entry((cell, direction_octant(self.normals[index]))).or_insert(normals.len() as u32);
            if cluster as usize == normals.len() {
                let (sum, count) = cells.get(&cell).copied().unwrap_or((position, 1.0));
                positions.push(sum / count);
                normals.push(Vec3::ZERO);
                // The first texture coordinate is kept: a mean across a seam would be nowhere.
                uvs.push(self.uvs[index]);
            }
            normals[cluster as usize] += self.normals[index];
            cluster_of.push(cluster);
        }
        normals.iter_mut().for_each(|normal| *normal = normal.normalize_or_zero());
        let place = |index: u32| cell_of(self.positions[index as usize]);
        let triangles = self.triangles.iter().filter(|[a, b, c]| {
            let [a, b, c] = [place(*a), place(*b), place(*c)];
            a != b && b != c && c != a
        });
        let triangles = triangles.map(|triangle| triangle.map(|index| cluster_of[index as usize])).collect();
        Self::of(positions, normals, uvs, triangles, self.closed)
    }

    /// Corners of a triangle in the body's frame.
    #[cfg(test)]
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|index| self.positions[index as usize])
    }
}

impl Face {
    /// In double precision: small triangles have large gradients.
    fn new(corners: [Vec3; 3], normals: [Vec3; 3], uvs: [Vec2; 3]) -> Self {
        /// A triangle lower than this is taken for a line, metres: beyond single precision at a metre's distance.
        const LINE_M: f64 = 1e-6;
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let (ab, ac, bc) = (b - a, c - a, c - b);
        let area = ab.cross(ac);
        let longest = ab.length_squared().max(ac.length_squared()).max(bc.length_squared());
        let normal = area.normalize_or_zero();
        let is_line = area.length_squared() <= longest * LINE_M * LINE_M;
        let inverse = if is_line { 0.0 } else { area.length_squared().recip() };
        let (weight1, weight2) = (ac.cross(area) * inverse, area.cross(ab) * inverse);
        // Value at the corners → gradient and constant.
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

/// One of 150 directions: the side of a cube and a field of 5×5 on it, each about 20 degrees wide.
fn direction_code(normal: Vec3) -> u8 {
    let size = normal.abs();
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    let field = |other: usize| ((normal[(axis + other) % 3] / size[axis].max(1e-12) * 2.0 + 2.5) as u8).min(4);
    (axis * 2 + usize::from(normal[axis] < 0.0)) as u8 * 25 + field(1) * 5 + field(2)
}

fn direction_octant(normal: Vec3) -> u8 {
    direction_code(normal) / 25
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

/// Whether every edge, after joining corners at equal places, is walked as often forwards as backwards,
/// and the mesh is not inside out.
fn is_closed(mesh: &TriMesh) -> bool {
    // Corners by their place, and edges, each as one number, which is quickly sorted.
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
    // The lowest bit tells the direction.
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

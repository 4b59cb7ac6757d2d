//! Geometry of prims: polygon meshes with texture coordinates and colours, and primitive shapes.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_core::{Piece, Pose, Shape};
use glam::{DMat4, DQuat, DVec3};

use super::material::Bound;
use super::value::At;
use crate::formats::{PLAIN, glb::srgb, solid};
use crate::raw::{MAX_TRIANGLES, RawCollision, RawMesh, Surface};
use crate::vertex_colors;

/// Number of vertices around the base of a cone.
const AROUND: usize = 32;
/// Largest relative difference of scales at which a shape counts as uniformly scaled, and largest cosine of the angle
/// between two axes at which it counts as not sheared.
const EVEN: f64 = 1e-6;

/// Types of the geometric prims that are supported.
pub const GEOMETRY: [&str; 8] = ["Mesh", "Cube", "Sphere", "Cylinder", "Capsule", "Cone", "Cylinder_1", "Capsule_1"];

/// Geometry of a prim in its own frame, in the stage's unit of length.
pub enum Geometry {
    /// Polygon mesh.
    Mesh(Polygons),
    /// Primitive shape along z, and the rotation that turns z to the prim's axis.
    Shape(Shape, DQuat),
    /// Points whose convex hull is the shape, here a cone.
    Hull(Vec<DVec3>),
}

impl Geometry {
    /// Reads a prim of one of the types in [`GEOMETRY`].
    ///
    /// # Errors
    /// If a face refers to a vertex that does not exist, the face sizes do not add up to the number of corners, or
    /// there are too many triangles.
    pub fn read(at: &At, notes: &mut Vec<String>) -> Result<Self, String> {
        let size =
            |name: &str, otherwise: f64| at.number(name).filter(|size| size.is_finite()).unwrap_or(otherwise).abs();
        let axis = match at.text("axis").as_deref() {
            Some("X") => DVec3::X,
            Some("Y") => DVec3::Y,
            _ => DVec3::Z,
        };
        let turn = DQuat::from_rotation_arc(DVec3::Z, axis);
        let kind = at.kind();
        let default_radius = if kind == "Capsule_1" { 0.5 } else { 1.0 };
        let (low, high) = (size("radiusBottom", default_radius), size("radiusTop", default_radius));
        if kind.ends_with("_1") && low != high {
            notes.push(format!("{}: its two radii are read as their mean", at.prim.path()));
        }
        Ok(match kind.as_str() {
            "Cube" => Self::Shape(Shape::Box { half_extents: DVec3::splat(size("size", 2.0) / 2.0) }, DQuat::IDENTITY),
            "Sphere" => Self::Shape(Shape::Sphere { radius: size("radius", 1.0) }, DQuat::IDENTITY),
            "Cylinder" | "Cylinder_1" => {
                let radius = if kind == "Cylinder" { size("radius", 1.0) } else { (low + high) / 2.0 };
                Self::Shape(Shape::Cylinder { radius, half_height: size("height", 2.0) / 2.0 }, turn)
            }
            "Capsule" | "Capsule_1" => {
                let radius = if kind == "Capsule" { size("radius", 0.5) } else { (low + high) / 2.0 };
                Self::Shape(Shape::Capsule { radius, half_length: size("height", 1.0) / 2.0 }, turn)
            }
            "Cone" => {
                let (radius, half) = (size("radius", 1.0), size("height", 2.0) / 2.0);
                let around = (0..AROUND).map(|i| std::f64::consts::TAU * i as f64 / AROUND as f64);
                let base = around.map(|angle| DVec3::new(radius * angle.cos(), radius * angle.sin(), -half));
                Self::Hull(base.chain([DVec3::Z * half]).map(|point| turn * point).collect())
            }
            _ => Self::Mesh(Polygons::read(at, notes)?),
        })
    }

    /// Visual surfaces, one per material, transformed by `world` (`world_from_prim`). `subsets` are face indices with
    /// their material, and `whole` is the material of the other faces; shapes and hulls have `whole` alone.
    pub fn surfaces(&self, at: &At, world: &DMat4, subsets: &[(Vec<u32>, Bound)], whole: &Bound) -> Vec<Surface> {
        let name = at.name();
        let parts = match self {
            Self::Mesh(polygons) => polygons.parts(at, subsets, whole),
            Self::Shape(shape, turn) => {
                vec![(solid::mesh(shape).transformed(&DMat4::from_quat(*turn)), plain(at, whole))]
            }
            Self::Hull(points) => vec![(solid::mesh(&Shape::Hull { points: points.clone() }), plain(at, whole))],
        };
        let surface = |(mesh, bound): (RawMesh, Bound)| Surface {
            name: name.clone(),
            mesh: mesh.transformed(world),
            material: bound.material,
        };
        parts.into_iter().filter(|(mesh, _)| !mesh.triangles.is_empty()).map(surface).collect()
    }

    /// Collision geometry, transformed by `world` (`world_from_prim`). `approximation` is the one of
    /// `PhysicsMeshCollisionAPI`; it applies to meshes only.
    pub fn collision(&self, world: &DMat4, approximation: &str) -> RawCollision {
        match self {
            Self::Shape(shape, turn) => {
                let placed = *world * DMat4::from_quat(*turn);
                match scaled(shape, &placed) {
                    Some(piece) => RawCollision::Piece(piece),
                    None => RawCollision::HullOf(solid::mesh(shape).transformed(&placed).positions),
                }
            }
            Self::Hull(points) => RawCollision::HullOf(points.iter().map(|p| world.transform_point3(*p)).collect()),
            Self::Mesh(polygons) => {
                let mesh = polygons.bare().transformed(world);
                match approximation {
                    "convexHull" => RawCollision::HullOf(mesh.positions),
                    "boundingCube" | "boundingSphere" => bounding(polygons, world, approximation == "boundingSphere"),
                    _ => RawCollision::Mesh(mesh),
                }
            }
        }
    }
}

/// Bounding box of a mesh along the prim's axes, or the smallest sphere around that box's centre that contains the
/// mesh.
fn bounding(polygons: &Polygons, world: &DMat4, is_ball: bool) -> RawCollision {
    let bounds = genmanip_core::Aabb::from_points(polygons.points.iter().copied());
    let placed = *world * DMat4::from_translation(bounds.center());
    if is_ball {
        let center = placed.w_axis.truncate();
        let distances = polygons.points.iter().map(|point| world.transform_point3(*point).distance(center));
        let shape = Shape::Sphere { radius: distances.fold(0.0, f64::max) };
        return RawCollision::Piece(Piece { shape, link_from_piece: Pose::from_position(center) });
    }
    let shape = Shape::Box { half_extents: bounds.size() / 2.0 };
    match scaled(&shape, &placed) {
        Some(piece) => RawCollision::Piece(piece),
        None => RawCollision::HullOf(solid::mesh(&shape).transformed(&placed).positions),
    }
}

/// A shape after an affine transform; `None` if the result is not a [`Shape`] again.
fn scaled(shape: &Shape, placed: &DMat4) -> Option<Piece> {
    let axes = [placed.x_axis, placed.y_axis, placed.z_axis].map(|axis| axis.truncate());
    let size = DVec3::from_array(axes.map(|axis| axis.length()));
    let is_sheared = (0..3).any(|i| axes[i].dot(axes[(i + 1) % 3]).abs() > EVEN * size[i] * size[(i + 1) % 3]);
    if is_sheared || size.min_element() <= 0.0 {
        return None;
    }
    let alike = |a: f64, b: f64| (a - b).abs() <= EVEN * a.max(b);
    let shape = match shape {
        Shape::Box { half_extents } => Shape::Box { half_extents: *half_extents * size },
        Shape::Sphere { radius } if alike(size.x, size.y) && alike(size.y, size.z) => {
            Shape::Sphere { radius: radius * size.x }
        }
        Shape::Sphere { radius } => Shape::Ellipsoid { radii: size * *radius },
        Shape::Cylinder { radius, half_height } if alike(size.x, size.y) => {
            Shape::Cylinder { radius: radius * size.x, half_height: half_height * size.z }
        }
        Shape::Capsule { radius, half_length } if alike(size.x, size.y) && alike(size.y, size.z) => {
            Shape::Capsule { radius: radius * size.x, half_length: half_length * size.x }
        }
        _ => return None,
    };
    Some(Piece { shape, link_from_piece: rigid(placed) })
}

/// Position and rotation of an affine transform, without scale and shear; of a mirroring one, all axes are reversed
/// first.
pub fn rigid(transform: &DMat4) -> Pose {
    let sign = if transform.determinant() < 0.0 { -1.0 } else { 1.0 };
    let x = (transform.x_axis.truncate() * sign).normalize_or(DVec3::X);
    let y = transform.y_axis.truncate() * sign;
    let y = (y - x * x.dot(y)).normalize_or(x.any_orthonormal_vector());
    let rotation = DQuat::from_mat3(&glam::DMat3::from_cols(x, y, x.cross(y)));
    Pose { position: transform.w_axis.truncate(), rotation: rotation.normalize() }
}

/// Material of a shape or hull; if it is painted, its colour is the first `displayColor` of the prim.
fn plain(at: &At, bound: &Bound) -> Bound {
    let mut bound = bound.clone();
    if bound.is_painted {
        let color = at.vectors("primvars:displayColor").first().map(|color| color.as_vec3().to_array().map(srgb));
        bound.material.base_color = color.unwrap_or(PLAIN);
    }
    bound
}

/// A primvar of a mesh.
struct OnMesh<T> {
    values: Vec<T>,
    indices: Vec<u32>,
    interpolation: String,
}

impl<T: Copy> OnMesh<T> {
    fn new(at: &At, name: &str, values: Vec<T>) -> Self {
        Self { values, indices: at.indices(&format!("{name}:indices")), interpolation: at.interpolation(name) }
    }

    /// True if the face corners at one vertex can have different values.
    fn is_per_corner(&self) -> bool {
        matches!(self.interpolation.as_str(), "faceVarying" | "uniform") && self.values.len() > 1
    }

    fn get(&self, face: usize, corner: usize, point: u32) -> Option<T> {
        let place = match self.interpolation.as_str() {
            "uniform" => face,
            "vertex" | "varying" => point as usize,
            "faceVarying" => corner,
            _ => 0,
        };
        let place = if self.indices.is_empty() { place } else { *self.indices.get(place)? as usize };
        self.values.get(place).copied()
    }
}

/// A polygon mesh.
pub struct Polygons {
    points: Vec<DVec3>,
    /// Index into `points` of each corner, face by face (`faceVertexIndices`).
    corners: Vec<u32>,
    /// Triangles as indices into `corners`, with the index of the face.
    triangles: Vec<([usize; 3], usize)>,
}

impl Polygons {
    fn read(at: &At, notes: &mut Vec<String>) -> Result<Self, String> {
        let path = at.prim.path();
        let points = at.vectors("points");
        let (counts, corners) = (at.indices("faceVertexCounts"), at.indices("faceVertexIndices"));
        if let Some(wrong) = corners.iter().find(|&&index| index as usize >= points.len()) {
            return Err(format!("{path}: a face refers to vertex {wrong} of {}", points.len()));
        }
        let total: u64 = counts.iter().map(|&count| u64::from(count)).sum();
        if total != corners.len() as u64 {
            return Err(format!("{path}: its faces have {total} corners; it lists {}", corners.len()));
        }
        if corners.len() > 4 * MAX_TRIANGLES {
            return Err(format!("{path}: more than {MAX_TRIANGLES} triangles"));
        }
        if at.text("subdivisionScheme").is_some_and(|scheme| scheme != "none") {
            notes.push("subdivision surfaces are read as their control meshes".into());
        }
        let is_left_handed = at.text("orientation").as_deref() == Some("leftHanded");
        let holes: BTreeSet<u32> = at.indices("holeIndices").into_iter().collect();
        let (mut triangles, mut first) = (Vec::new(), 0);
        for (face, &count) in counts.iter().enumerate() {
            let count = count as usize;
            if !holes.contains(&(face as u32)) {
                triangles.extend((2..count).map(|last| match is_left_handed {
                    false => ([first, first + last - 1, first + last], face),
                    true => ([first, first + last, first + last - 1], face),
                }));
            }
            first += count;
        }
        Ok(Self { points, corners, triangles })
    }

    /// Mesh of all triangles, without texture coordinates.
    fn bare(&self) -> RawMesh {
        let triangles = self.triangles.iter().map(|(corners, _)| corners.map(|corner| self.corners[corner])).collect();
        RawMesh { positions: self.points.clone(), uvs: Vec::new(), triangles }
    }

    /// Meshes with their materials: one per subset, then the faces outside all subsets; some may be empty.
    fn parts(&self, at: &At, subsets: &[(Vec<u32>, Bound)], whole: &Bound) -> Vec<(RawMesh, Bound)> {
        let mut subset_of: BTreeMap<u32, usize> = BTreeMap::new();
        for (index, (faces, _)) in subsets.iter().enumerate() {
            faces.iter().for_each(|face| _ = subset_of.insert(*face, index));
        }
        let mut groups: Vec<Vec<usize>> = vec![Vec::new(); subsets.len() + 1];
        for (number, (_, face)) in self.triangles.iter().enumerate() {
            let group = subset_of.get(&(*face as u32)).copied().unwrap_or(subsets.len());
            groups[group].push(number);
        }
        let bounds = subsets.iter().map(|(_, bound)| bound).chain([whole]);
        groups.iter().zip(bounds).map(|(triangles, bound)| self.part(at, triangles, bound)).collect()
    }

    fn part(&self, at: &At, triangles: &[usize], bound: &Bound) -> (RawMesh, Bound) {
        let mut bound = bound.clone();
        let coordinates = bound.material.texture.is_some().then(|| {
            let name = format!("primvars:{}", bound.coordinates);
            OnMesh::new(at, &name, at.pairs(&name))
        });
        let colors = bound.is_painted.then(|| {
            let name = "primvars:displayColor";
            OnMesh::new(at, name, at.vectors(name))
        });
        let is_per_corner = coordinates.as_ref().is_some_and(OnMesh::is_per_corner)
            || colors.as_ref().is_some_and(OnMesh::is_per_corner);
        // New vertex index by corner, or by point if corners of one vertex share their values.
        let (mut known, mut places) = (BTreeMap::new(), Vec::new());
        let mut made = Vec::new();
        for &number in triangles {
            let (corners, face) = self.triangles[number];
            made.push(corners.map(|corner| {
                let key = if is_per_corner { corner } else { self.corners[corner] as usize };
                *known.entry(key).or_insert_with(|| {
                    places.push((face, corner, self.corners[corner]));
                    places.len() as u32 - 1
                })
            }));
        }
        let positions = places.iter().map(|(.., point)| self.points[*point as usize]).collect();
        let mut mesh = RawMesh { positions, uvs: Vec::new(), triangles: made };
        if let Some(coordinates) = coordinates {
            let uvs: Option<Vec<[f32; 2]>> =
                places.iter().map(|&(f, c, p)| Some(bound.placed(coordinates.get(f, c, p)?))).collect();
            mesh.uvs = uvs.unwrap_or_default();
        }
        let Some(colors) = colors else { return (mesh, bound) };
        let seen: Option<Vec<[f32; 3]>> =
            places.iter().map(|&(f, c, p)| Some(colors.get(f, c, p)?.as_vec3().to_array().map(srgb))).collect();
        match seen {
            None => bound.material.base_color = PLAIN,
            Some(seen) => {
                bound.material.base_color = [1.0; 3];
                mesh = vertex_colors::paint(mesh, &seen, &mut bound.material);
            }
        }
        (mesh, bound)
    }
}

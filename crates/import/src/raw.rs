//! An object as described by its files, before cleaning and guessing.

use genmanip_core::{Joint, MassProperties, Material, Piece, Pose};
use glam::{DMat4, DVec3};

/// Maximum number of triangles of an object; larger files are rejected. As many in random order take 9 s of CPU time.
pub const MAX_TRIANGLES: usize = 400_000;
/// Maximum number of links of an object. Bounds the time of the import.
pub const MAX_LINKS: usize = 64;

/// Up axis of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// +y points up, as in glTF.
    Y,
    /// +z points up, as in URDF and MJCF.
    Z,
    /// Not specified by the format.
    Unknown,
}

/// Length unit that a file format specifies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Metres, as in glTF, URDF and MJCF.
    Metre,
    /// Not specified by the format.
    Unknown,
    /// None: the library (PartNet-Mobility) scales every object to the same size.
    Normalised,
}

/// An object as described by its files.
#[derive(Clone, Debug)]
pub struct RawObject {
    /// Name in the file; empty if there is none.
    pub name: String,
    /// Links, parents first.
    pub links: Vec<RawLink>,
    /// Length unit of the file.
    pub unit: Unit,
    /// Up axis of the file.
    pub up: Up,
    /// Licence; `None` if the file states none.
    pub licence: Option<String>,
    /// Author; `None` if the file states none.
    pub creator: Option<String>,
    /// Repairs and omissions while reading, one sentence each.
    pub notes: Vec<String>,
}

/// A link of an object, as described by its files.
#[derive(Clone, Debug, Default)]
pub struct RawLink {
    /// Name, unique in the object.
    pub name: String,
    /// Joint to the parent; `None` for the root.
    pub joint: Option<Joint>,
    /// Visual surfaces, in the link's frame.
    pub surfaces: Vec<Surface>,
    /// Collision geometry, in the link's frame; empty if unspecified.
    pub collision: Vec<RawCollision>,
    /// Mass properties in the link's frame; `None` if unspecified.
    pub mass: Option<MassProperties>,
    /// Sliding friction coefficient; `None` if unspecified.
    pub friction: Option<f64>,
}

/// A visual surface with one material.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name of the part.
    pub name: String,
    /// Triangle mesh in the link's frame.
    pub mesh: RawMesh,
    /// Material with its texture.
    pub material: Material,
}

/// Collision geometry of a link.
#[derive(Clone, Debug)]
pub enum RawCollision {
    /// A convex primitive or polytope.
    Piece(Piece),
    /// Convex hull of points, as MJCF interprets meshes.
    HullOf(Vec<DVec3>),
    /// A possibly non-convex mesh.
    Mesh(RawMesh),
}

/// A triangle mesh in a link's frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RawMesh {
    /// Vertices, m or in the file's unit.
    pub positions: Vec<DVec3>,
    /// Texture coordinates per vertex, (0, 0) is the first pixel of the first row; empty if there are none.
    pub uvs: Vec<[f32; 2]>,
    /// Three vertex indices per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl RawMesh {
    /// Vertex positions of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.map(|index| self.positions[index as usize]))
    }

    /// Applies a transform; flips the triangles if it mirrors.
    #[must_use]
    pub fn transformed(mut self, transform: &DMat4) -> Self {
        for position in &mut self.positions {
            *position = transform.transform_point3(*position);
        }
        if transform.determinant() < 0.0 {
            self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        self
    }

    /// Appends the triangles of another mesh in the same frame.
    pub fn append(&mut self, other: &Self) {
        let offset = self.positions.len() as u32;
        if !self.uvs.is_empty() || !other.uvs.is_empty() {
            self.uvs.resize(self.positions.len(), [0.0; 2]);
            self.uvs.extend(&other.uvs);
        }
        self.positions.extend(&other.positions);
        if !self.uvs.is_empty() {
            self.uvs.resize(self.positions.len(), [0.0; 2]);
        }
        self.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|index| index + offset)));
    }
}

impl RawObject {
    /// All visual triangles in the object's frame with joints at 0.
    pub fn all_surfaces(&self) -> RawMesh {
        let mut all = RawMesh::default();
        for (link, pose) in self.links.iter().zip(self.link_poses()) {
            let transform = DMat4::from_rotation_translation(pose.rotation, pose.position);
            for surface in &link.surfaces {
                all.append(&surface.mesh.clone().transformed(&transform));
            }
        }
        all
    }

    /// Removes a root without geometry and makes its child the root, repeatedly: an empty root cannot stand on a table.
    pub fn drop_empty_root(&mut self) {
        while self.links.len() > 1 && self.links[0].surfaces.is_empty() && self.links[0].collision.is_empty() {
            self.links.remove(0);
            let first = self.links[0].joint.take();
            let name = first.as_ref().map_or("", |joint| joint.name.as_str()).to_owned();
            self.notes.push(format!("its base has no geometry: the child of joint {name} becomes the base"));
            let old_from_first = first.map_or(Pose::IDENTITY, |joint| joint.parent_from_joint);
            for joint in self.links.iter_mut().filter_map(|link| link.joint.as_mut()) {
                if joint.parent == 0 {
                    joint.parent_from_joint = old_from_first.inverse() * joint.parent_from_joint;
                }
                joint.parent = joint.parent.saturating_sub(1);
            }
        }
    }

    /// `object_from_link` of each link with joints at 0.
    pub fn link_poses(&self) -> Vec<Pose> {
        let mut poses: Vec<Pose> = Vec::new();
        for link in &self.links {
            let pose = link.joint.as_ref().map_or(Pose::IDENTITY, |joint| {
                poses.get(joint.parent).copied().unwrap_or_default() * joint.parent_from_joint
            });
            poses.push(pose);
        }
        poses
    }
}

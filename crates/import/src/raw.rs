//! An object as its files describe it, before anything is cleaned or guessed.

use genmanip_core::{Joint, MassProperties, Material, Piece, Pose};
use glam::{DMat4, DVec3};

/// Most triangles of an object that are read: beyond, the file is refused. As many without any order in them need 9 s of
/// processor time.
pub const MOST_TRIANGLES: usize = 400_000;
/// Most links of an object.
pub const MOST_LINKS: usize = 64;

/// Which way is up in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// +y, as the glTF standard says.
    Y,
    /// +z, as URDF and MJCF have it.
    Z,
    /// The format does not say.
    Unknown,
}

/// What lengths are in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Metres, as glTF, URDF and MJCF say.
    Metre,
    /// Something that the format does not say.
    Unknown,
    /// None: every object of the library is scaled to the same size.
    Normalised,
}

/// An object as its files describe it.
#[derive(Clone, Debug)]
pub struct RawObject {
    /// What the file calls it; empty where it does not.
    pub name: String,
    /// Bodies, parents first.
    pub links: Vec<RawLink>,
    /// What its lengths are.
    pub unit: Unit,
    /// Which way is up.
    pub up: Up,
    /// Licence, where the file says it.
    pub licence: Option<String>,
    /// Who made it, where the file says so.
    pub creator: Option<String>,
    /// What was repaired or left out while reading.
    pub notes: Vec<String>,
}

/// One body.
#[derive(Clone, Debug, Default)]
pub struct RawLink {
    /// Name, unique in the object.
    pub name: String,
    /// How it moves; none for the root.
    pub joint: Option<Joint>,
    /// What is drawn, in the link's frame.
    pub surfaces: Vec<Surface>,
    /// What touches, in the link's frame; empty where the file leaves it open.
    pub collision: Vec<RawCollision>,
    /// Mass, where the file says it.
    pub mass: Option<MassProperties>,
    /// Density of what touches where the file says it, kg/m³.
    pub density: Option<f64>,
    /// Sliding friction coefficient, where the file says it.
    pub friction: Option<f64>,
}

/// A drawn surface.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Name of the part.
    pub name: String,
    /// Its triangles.
    pub mesh: RawMesh,
    /// How it reflects.
    pub material: Material,
}

/// What touches.
#[derive(Clone, Debug)]
pub enum RawCollision {
    /// A convex shape.
    Piece(Piece),
    /// The convex hull of points, as MJCF means its meshes.
    HullOf(Vec<DVec3>),
    /// A surface that need not be convex.
    Mesh(RawMesh),
}

/// Triangles in the frame of a link.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RawMesh {
    /// Corners.
    pub positions: Vec<DVec3>,
    /// Texture coordinate per corner, (0, 0) the first pixel of the first row; empty without.
    pub uvs: Vec<[f32; 2]>,
    /// Three corners per triangle, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl RawMesh {
    /// The corners of each triangle.
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> + '_ {
        self.triangles.iter().map(|triangle| triangle.map(|index| self.positions[index as usize]))
    }

    /// Moved; a mirror image is turned inside out again.
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

    /// Both together.
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
    /// All drawn triangles in the frame of the object with joints at 0.
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

    /// Makes the first link that hangs on an empty root the root: what has no shape cannot stand on a table.
    pub fn drop_empty_root(&mut self) {
        while self.links.len() > 1 && self.links[0].surfaces.is_empty() && self.links[0].collision.is_empty() {
            self.links.remove(0);
            let first = self.links[0].joint.take();
            let name = first.as_ref().map_or("", |joint| joint.name.as_str()).to_owned();
            self.notes.push(format!("its base has no shape: what hangs on joint {name} is taken as the base"));
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

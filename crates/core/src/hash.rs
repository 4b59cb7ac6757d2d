//! Content hashes of an asset: physics, judging inputs, appearance.
//!
//! A hash is its version (`v2:`) and sixteen hexadecimal digits of the SHA-256 of a canonical byte sequence.
//! Numbers are quantised to 1e-9 of their unit (so that the last bits of platform arithmetic do not matter), strings
//! and lists are preceded by their length, enums are written as numbers, and of the two quaternions of a rotation the
//! one whose first non-zero component is positive is used.
//! No hash depends on the asset's name.

use glam::DVec3;
use sha2::{Digest, Sha256};

use crate::{Joint, JointKind, JointState, Material, ObjectLink, ObjectModel, Piece, Pose, Shape, TriMesh};

/// Quantisation steps per unit; the same in version 1.
const PARTS: f64 = 1e9;

/// The hashes of one asset; [`crate::PlacedObject`] documents the fields that store them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AssetHashes {
    /// Physics inputs: collision pieces, mass, joints, friction.
    pub physics: String,
    /// Further inputs of the judge: cavities, named states, link frames, and area and centroid of the measured
    /// surface.
    pub judging: String,
    /// Rendering inputs: meshes and materials.
    pub looks: String,
}

impl ObjectModel {
    /// All hashes of the current version. Large textures take milliseconds, so keep the result.
    pub fn hashes(&self) -> AssetHashes {
        AssetHashes { physics: self.physics_hash(), judging: self.judging_hash(), looks: self.looks_hash() }
    }

    /// Hash of the physics inputs, see [`AssetHashes::physics`].
    pub fn physics_hash(&self) -> String {
        let mut bytes = Canonical::default();
        bytes.numbers(&[self.friction]);
        bytes.list(&self.links, Canonical::physics);
        bytes.finish()
    }

    /// Hash of further judging inputs, see [`AssetHashes::judging`].
    pub fn judging_hash(&self) -> String {
        let mut bytes = Canonical::default();
        bytes.list(&self.links, Canonical::judging);
        bytes.list(&self.joint_states, Canonical::state);
        bytes.finish()
    }

    /// Hash of the rendering inputs, see [`AssetHashes::looks`].
    pub fn looks_hash(&self) -> String {
        let mut bytes = Canonical::default();
        bytes.list(&self.links, Canonical::looks);
        bytes.finish()
    }

    /// True if a hash of any supported version matches these physics.
    pub fn has_physics(&self, hash: &str) -> bool {
        match hash.split_once(':') {
            Some(("v1", digits)) => digits == self.physics_hash_v1(),
            _ => hash == self.physics_hash(),
        }
    }

    /// Version 1 of the physics hash, without its prefix, to verify old documents. It depends on the uid and ignores
    /// the rotation of joint frames.
    pub fn physics_hash_v1(&self) -> String {
        let mut text = format!("{} {}", self.card.uid, rounded(&[self.friction]));
        for link in &self.links {
            let m = &link.mass;
            text += &format!(
                "|{} {} {} {}",
                link.name,
                rounded(&[m.mass_kg]),
                rounded(&m.center.to_array()),
                rounded(&m.inertia.to_cols_array())
            );
            if let Some(joint) = &link.joint {
                text += &format!(
                    "~{} {:?} {} {} {}",
                    joint.parent,
                    joint.kind,
                    rounded(&joint.parent_from_joint.position.to_array()),
                    rounded(&joint.axis.to_array()),
                    rounded(&dynamics(joint))
                );
            }
            for piece in &link.pieces {
                let pose = &piece.link_from_piece;
                text += &format!(";{} {}", rounded(&pose.position.to_array()), rounded(&pose.to_wxyz_array()));
                text += &match &piece.shape {
                    Shape::Box { half_extents } => format!("box{}", rounded(&half_extents.to_array())),
                    Shape::Sphere { radius } => format!("sphere{}", rounded(&[*radius])),
                    Shape::Ellipsoid { radii } => format!("ellipsoid{}", rounded(&radii.to_array())),
                    Shape::Cylinder { radius, half_height } => format!("cylinder{}", rounded(&[*radius, *half_height])),
                    Shape::Capsule { radius, half_length } => format!("capsule{}", rounded(&[*radius, *half_length])),
                    Shape::Hull { points } => {
                        points.iter().fold(String::from("hull"), |text, point| text + &rounded(&point.to_array()))
                    }
                };
            }
        }
        hexadecimal(&Sha256::digest(text.as_bytes())[..6])
    }
}

fn rounded(values: &[f64]) -> String {
    values.iter().fold(String::new(), |text, value| text + &format!("{},", (value * PARTS).round() as i64))
}

/// Range, damping, friction and spring parameters.
fn dynamics(joint: &Joint) -> [f64; 6] {
    let [least, most] = joint.range;
    [least, most, joint.damping, joint.friction_loss, joint.stiffness, joint.spring_reference]
}

/// Bytes as lower-case hexadecimal digits, as hashes are written in files.
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 hasher of the canonical byte sequence.
#[derive(Default)]
pub(crate) struct Canonical(Sha256);

impl Canonical {
    pub(crate) fn finish(self) -> String {
        format!("v2:{}", hexadecimal(&self.0.finalize()[..8]))
    }

    pub(crate) fn whole(&mut self, value: u64) {
        self.0.update(value.to_le_bytes());
    }

    pub(crate) fn numbers(&mut self, values: &[f64]) {
        for value in values {
            self.0.update(((value * PARTS).round() as i64).to_le_bytes());
        }
    }

    /// Single-precision numbers, quantised to 1e-6.
    fn singles(&mut self, values: &[f32]) {
        for value in values {
            self.0.update(((f64::from(*value) * 1e6).round() as i32).to_le_bytes());
        }
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.whole(text.len() as u64);
        self.0.update(text.as_bytes());
    }

    pub(crate) fn list<T>(&mut self, items: &[T], mut write: impl FnMut(&mut Self, &T)) {
        self.whole(items.len() as u64);
        items.iter().for_each(|item| write(self, item));
    }

    pub(crate) fn vector(&mut self, vector: &DVec3) {
        self.numbers(&vector.to_array());
    }

    pub(crate) fn pose(&mut self, pose: &Pose) {
        self.vector(&pose.position);
        let turn = pose.to_wxyz_array();
        let first = turn.iter().map(|value| (value * PARTS).round()).find(|value| *value != 0.0);
        let sign = if first.is_some_and(|value| value < 0.0) { -1.0 } else { 1.0 };
        self.numbers(&turn.map(|value| sign * value));
    }

    pub(crate) fn joint_kind(&mut self, kind: JointKind) {
        self.whole(match kind {
            JointKind::Revolute => 0,
            JointKind::Prismatic => 1,
        });
    }

    fn physics(&mut self, link: &ObjectLink) {
        self.numbers(&[link.mass.mass_kg]);
        self.vector(&link.mass.center);
        self.numbers(&link.mass.inertia.to_cols_array());
        self.frame(link.joint.as_ref());
        if let Some(joint) = &link.joint {
            self.numbers(&dynamics(joint));
        }
        self.list(&link.pieces, Self::piece);
    }

    fn judging(&mut self, link: &ObjectLink) {
        self.text(&link.name);
        self.text(link.joint.as_ref().map_or("", |joint| &joint.name));
        self.frame(link.joint.as_ref());
        self.list(&link.cavity, Self::piece);
        self.list(&link.visual, |bytes, part| {
            let (area, middle) = surface(&part.mesh, &part.link_from_part);
            bytes.numbers(&[area]);
            bytes.vector(&middle);
        });
    }

    /// Kinematics of a link relative to its parent.
    fn frame(&mut self, joint: Option<&Joint>) {
        self.whole(u64::from(joint.is_some()));
        let Some(joint) = joint else { return };
        self.whole(joint.parent as u64);
        self.joint_kind(joint.kind);
        self.pose(&joint.parent_from_joint);
        self.vector(&joint.axis);
    }

    fn state(&mut self, state: &JointState) {
        self.text(&state.name);
        self.list(&state.intervals, |bytes, (joint, interval)| {
            bytes.text(joint);
            bytes.numbers(interval);
        });
        self.list(&state.nominal, |bytes, position| bytes.numbers(&[*position]));
    }

    pub(crate) fn piece(&mut self, piece: &Piece) {
        self.pose(&piece.link_from_piece);
        let mut kind = |number: u64, sizes: &[f64]| {
            self.whole(number);
            self.numbers(sizes);
        };
        match &piece.shape {
            Shape::Box { half_extents } => kind(0, &half_extents.to_array()),
            Shape::Sphere { radius } => kind(1, &[*radius]),
            Shape::Ellipsoid { radii } => kind(2, &radii.to_array()),
            Shape::Cylinder { radius, half_height } => kind(3, &[*radius, *half_height]),
            Shape::Capsule { radius, half_length } => kind(4, &[*radius, *half_length]),
            Shape::Hull { points } => {
                kind(5, &[]);
                self.list(points, Self::vector);
            }
        }
    }

    fn looks(&mut self, link: &ObjectLink) {
        self.list(&link.visual, |bytes, part| {
            bytes.pose(&part.link_from_part);
            bytes.mesh(&part.render_mesh);
            bytes.material(&part.material);
        });
    }

    fn mesh(&mut self, mesh: &TriMesh) {
        self.list(&mesh.positions, |bytes, position| bytes.singles(&position.to_array()));
        self.list(&mesh.normals, |bytes, normal| bytes.singles(&normal.to_array()));
        self.list(&mesh.uvs, |bytes, uv| bytes.singles(&uv.to_array()));
        self.list(&mesh.triangles, |bytes, corners| corners.iter().for_each(|&corner| bytes.whole(u64::from(corner))));
    }

    fn material(&mut self, material: &Material) {
        self.singles(&material.base_color);
        self.singles(&[material.roughness, material.metallic, material.opacity, material.ior]);
        self.whole(u64::from(material.thin_walled));
        self.whole(u64::from(material.texture.is_some()));
        if let Some(texture) = &material.texture {
            self.whole(u64::from(texture.width));
            self.whole(u64::from(texture.height));
            self.whole(texture.rgb.len() as u64);
            self.0.update(&texture.rgb);
        }
    }
}

/// Area and centroid of a measured surface in its link's frame.
fn surface(mesh: &TriMesh, link_from_part: &Pose) -> (f64, DVec3) {
    let area = mesh.corners().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum();
    (area, link_from_part.transform_point(mesh.centroid()))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DQuat, Vec2, Vec3};

    use super::*;
    use crate::{AssetRef, MassProperties, ObjectCard, Texture, VisualPart};

    /// A model with every hashed feature: a box with a lid, and one piece of every shape.
    fn model_with_every_feature() -> ObjectModel {
        let mass =
            MassProperties { mass_kg: 0.3, center: DVec3::new(0.0, 0.01, 0.02), inertia: DMat3::IDENTITY * 0.001 };
        let mesh = TriMesh {
            positions: vec![Vec3::ZERO, Vec3::X * 0.1, Vec3::Y * 0.1],
            normals: vec![Vec3::Z; 3],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y],
            triangles: vec![[0, 1, 2]],
        };
        let texture = Texture { width: 1, height: 1, rgb: vec![1, 2, 3] };
        let material = Material { texture: Some(Arc::new(texture)), ..Material::plain([0.1, 0.2, 0.3], 0.5) };
        let visual = VisualPart::new("skin", mesh, material, Pose::IDENTITY);
        let shapes = [
            Shape::Box { half_extents: DVec3::splat(0.05) },
            Shape::Sphere { radius: 0.02 },
            Shape::Ellipsoid { radii: DVec3::new(0.01, 0.02, 0.03) },
            Shape::Cylinder { radius: 0.02, half_height: 0.03 },
            Shape::Capsule { radius: 0.02, half_length: 0.03 },
            Shape::Hull { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z] },
        ];
        let body = ObjectLink {
            name: "body".into(),
            joint: None,
            visual: vec![visual],
            pieces: shapes.into_iter().map(|shape| Piece::at(DVec3::ZERO, shape)).collect(),
            cavity: vec![Piece::at(DVec3::Z * 0.1, Shape::Sphere { radius: 0.04 })],
            mass,
        };
        let joint = Joint {
            name: "hinge".into(),
            parent: 0,
            kind: JointKind::Revolute,
            parent_from_joint: Pose::from_position(DVec3::Z * 0.1),
            axis: DVec3::Y,
            range: [0.0, 1.5],
            damping: 0.1,
            friction_loss: 0.2,
            stiffness: 0.3,
            spring_reference: 0.4,
        };
        let lid = ObjectLink { name: "lid".into(), joint: Some(joint), ..body.clone() };
        let card = serde_json::json!({
            "uid": "007", "asset": {"source": "builtin", "uid": "007", "version": 2}, "name": "Box", "description": "",
            "category": "box", "general_category": "", "colors": [], "materials": [], "shape": "",
            "size_m": [0.1, 0.1, 0.1], "mass_kg": 0.6, "is_container": true, "is_articulated": true,
            "states": ["open"], "can_grasp": false,
        });
        let open =
            JointState { name: "open".into(), intervals: vec![("hinge".into(), [1.0, 1.5])], nominal: vec![1.2] };
        ObjectModel {
            card: serde_json::from_value::<ObjectCard>(card).unwrap(),
            family: "box".into(),
            asset: AssetRef::builtin("007", 2),
            links: vec![body, lid],
            friction: 0.6,
            joint_states: vec![open],
        }
    }

    fn joint(model: &mut ObjectModel) -> &mut Joint {
        model.links[1].joint.as_mut().unwrap()
    }

    fn piece(model: &mut ObjectModel, index: usize) -> &mut Piece {
        &mut model.links[0].pieces[index]
    }

    fn part(model: &mut ObjectModel) -> &mut VisualPart {
        &mut model.links[0].visual[0]
    }

    fn mesh(model: &mut ObjectModel) -> &mut TriMesh {
        Arc::make_mut(&mut part(model).mesh)
    }

    fn render_mesh(model: &mut ObjectModel) -> &mut TriMesh {
        Arc::make_mut(&mut part(model).render_mesh)
    }

    /// A mutation and the hashes it must change (physics, judging, looks); the others must not.
    type Mutation = (&'static str, [bool; 3], fn(&mut ObjectModel));

    const PHYSICS: [bool; 3] = [true, false, false];
    const JUDGING: [bool; 3] = [false, true, false];
    const LOOKS: [bool; 3] = [false, false, true];
    const FRAME: [bool; 3] = [true, true, false];
    const SURFACE: [bool; 3] = [false, true, true];
    const NOTHING: [bool; 3] = [false; 3];

    const MUTATIONS: &[Mutation] = &[
        ("uid", NOTHING, |m| m.card.uid = "008".into()),
        ("asset", NOTHING, |m| m.asset = AssetRef::builtin("008", 9)),
        ("name", NOTHING, |m| m.card.name = "Crate".into()),
        ("family", NOTHING, |m| m.family = "crate".into()),
        ("a picometre", NOTHING, |m| m.links[0].mass.center.x += 1e-12),
        ("the other quaternion", NOTHING, |m| {
            let turn = &mut joint(m).parent_from_joint.rotation;
            *turn = -*turn;
        }),
        ("friction", PHYSICS, |m| m.friction = 0.61),
        ("mass", PHYSICS, |m| m.links[0].mass.mass_kg = 0.31),
        ("centre of mass", PHYSICS, |m| m.links[0].mass.center.z = 0.03),
        ("inertia", PHYSICS, |m| m.links[0].mass.inertia.x_axis.y = 1e-4),
        ("joint parent", FRAME, |m| joint(m).parent = 1),
        ("joint kind", FRAME, |m| joint(m).kind = JointKind::Prismatic),
        ("joint frame position", FRAME, |m| joint(m).parent_from_joint.position.x = 0.01),
        ("joint frame rotation", FRAME, |m| joint(m).parent_from_joint.rotation = DQuat::from_rotation_z(0.1)),
        ("joint axis", FRAME, |m| joint(m).axis = DVec3::X),
        ("no joint", [true, true, false], |m| m.links[1].joint = None),
        ("least position", PHYSICS, |m| joint(m).range[0] = -0.1),
        ("largest position", PHYSICS, |m| joint(m).range[1] = 1.6),
        ("damping", PHYSICS, |m| joint(m).damping = 0.11),
        ("friction loss", PHYSICS, |m| joint(m).friction_loss = 0.21),
        ("stiffness", PHYSICS, |m| joint(m).stiffness = 0.31),
        ("spring reference", PHYSICS, |m| joint(m).spring_reference = 0.41),
        ("piece position", PHYSICS, |m| piece(m, 0).link_from_piece.position.x = 0.01),
        ("piece rotation", PHYSICS, |m| piece(m, 0).link_from_piece.rotation = DQuat::from_rotation_x(0.1)),
        ("one piece less", PHYSICS, |m| drop(m.links[0].pieces.pop())),
        ("a piece of another link", PHYSICS, |m| {
            let moved = m.links[1].pieces.remove(0);
            m.links[0].pieces.push(moved);
        }),
        ("box", PHYSICS, |m| piece(m, 0).shape = Shape::Box { half_extents: DVec3::new(0.05, 0.05, 0.06) }),
        ("sphere", PHYSICS, |m| piece(m, 1).shape = Shape::Sphere { radius: 0.021 }),
        ("ellipsoid", PHYSICS, |m| piece(m, 2).shape = Shape::Ellipsoid { radii: DVec3::new(0.02, 0.01, 0.03) }),
        ("box as ellipsoid", PHYSICS, |m| piece(m, 0).shape = Shape::Ellipsoid { radii: DVec3::splat(0.05) }),
        ("cylinder radius", PHYSICS, |m| piece(m, 3).shape = Shape::Cylinder { radius: 0.021, half_height: 0.03 }),
        ("cylinder height", PHYSICS, |m| piece(m, 3).shape = Shape::Cylinder { radius: 0.02, half_height: 0.031 }),
        ("cylinder as capsule", PHYSICS, |m| piece(m, 3).shape = Shape::Capsule { radius: 0.02, half_length: 0.03 }),
        ("capsule radius", PHYSICS, |m| piece(m, 4).shape = Shape::Capsule { radius: 0.021, half_length: 0.03 }),
        ("capsule length", PHYSICS, |m| piece(m, 4).shape = Shape::Capsule { radius: 0.02, half_length: 0.031 }),
        ("hull", PHYSICS, |m| piece(m, 5).shape = Shape::Hull { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y] }),
        ("link name", JUDGING, |m| m.links[1].name = "cover".into()),
        ("joint name", JUDGING, |m| joint(m).name = "pin".into()),
        ("cavity size", JUDGING, |m| m.links[0].cavity[0].shape = Shape::Sphere { radius: 0.05 }),
        ("cavity position", JUDGING, |m| m.links[0].cavity[0].link_from_piece.position.z = 0.11),
        ("cavity rotation", JUDGING, |m| m.links[0].cavity[0].link_from_piece.rotation = DQuat::from_rotation_x(0.1)),
        ("no cavity", JUDGING, |m| m.links[0].cavity.clear()),
        ("state name", JUDGING, |m| m.joint_states[0].name = "ajar".into()),
        ("state joint", JUDGING, |m| m.joint_states[0].intervals[0].0 = "pin".into()),
        ("state from", JUDGING, |m| m.joint_states[0].intervals[0].1[0] = 0.9),
        ("state to", JUDGING, |m| m.joint_states[0].intervals[0].1[1] = 1.4),
        ("state nominal", JUDGING, |m| m.joint_states[0].nominal[0] = 1.3),
        ("no state", JUDGING, |m| m.joint_states.clear()),
        ("surface", JUDGING, |m| mesh(m).positions[1].x = 0.2),
        ("surface place", SURFACE, |m| part(m).link_from_part.position.x = 0.1),
        ("no surface", SURFACE, |m| m.links[0].visual.clear()),
        ("triangles", JUDGING, |m| mesh(m).triangles.clear()),
        ("rendered vertex", LOOKS, |m| render_mesh(m).positions[1].x = 0.2),
        ("rendered triangles", LOOKS, |m| render_mesh(m).triangles.clear()),
        ("normal", LOOKS, |m| render_mesh(m).normals[0] = Vec3::X),
        ("texture coordinate", LOOKS, |m| render_mesh(m).uvs[0] = Vec2::ONE),
        ("colour", LOOKS, |m| part(m).material.base_color[2] = 0.4),
        ("roughness", LOOKS, |m| part(m).material.roughness = 0.6),
        ("metal", LOOKS, |m| part(m).material.metallic = 1.0),
        ("opacity", LOOKS, |m| part(m).material.opacity = 0.5),
        ("refraction", LOOKS, |m| part(m).material.ior = 1.4),
        ("thin walls", LOOKS, |m| part(m).material.thin_walled = true),
        ("no texture", LOOKS, |m| part(m).material.texture = None),
        ("texture", LOOKS, |m| {
            let texture = Texture { width: 1, height: 1, rgb: vec![1, 2, 4] };
            part(m).material.texture = Some(Arc::new(texture));
        }),
    ];

    #[test]
    fn each_field_changes_the_hashes_of_what_depends_on_it() {
        let before = model_with_every_feature().hashes();
        for (what, expected, mutate) in MUTATIONS {
            let mut model = model_with_every_feature();
            mutate(&mut model);
            let after = model.hashes();
            let got = [before.physics != after.physics, before.judging != after.judging, before.looks != after.looks];
            assert_eq!(got, *expected, "{what}");
        }
    }

    #[test]
    fn version_1_hashes_are_recognised_by_their_prefix() {
        let mut model = model_with_every_feature();
        let old = format!("v1:{}", model.physics_hash_v1());
        assert!(model.has_physics(&old) && model.has_physics(&model.physics_hash()));
        assert!(!model.has_physics(&model.physics_hash_v1()), "a hash without a version prefix is invalid");
        joint(&mut model).parent_from_joint.rotation = DQuat::from_rotation_z(0.1);
        assert!(model.has_physics(&old), "version 1 ignored the rotation of joint frames");
        model.card.uid = "008".into();
        assert!(!model.has_physics(&old), "version 1 depended on the uid");
    }
}

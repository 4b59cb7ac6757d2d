//! Meshes and objects for the tests.

use std::sync::Arc;

use genmanip_core::glam::{DMat3, DVec3, Vec2, Vec3};
use genmanip_core::{
    Annotations, AssetRef, MassProperties, Material, ObjectCard, ObjectLink, ObjectModel, Pose, TriMesh, VisualPart,
};

/// Sphere of `rings` × `2 rings` quads with exact normals; `radius` in m.
pub fn ball(radius: f32, rings: u32) -> TriMesh {
    let mut mesh = TriMesh::default();
    let segments = 2 * rings;
    for ring in 0..=rings {
        let polar = ring as f32 / rings as f32 * std::f32::consts::PI;
        for segment in 0..=segments {
            let around = (segment % segments) as f32 / segments as f32 * std::f32::consts::TAU;
            let sine = if ring == rings { 0.0 } else { polar.sin() };
            let normal = Vec3::new(sine * around.cos(), sine * around.sin(), polar.cos());
            mesh.positions.push(normal * radius);
            mesh.normals.push(normal);
            mesh.uvs.push(Vec2::new(segment as f32 / segments as f32, ring as f32 / rings as f32));
        }
    }
    let at = |ring: u32, segment: u32| ring * (segments + 1) + segment;
    for ring in 0..rings {
        for segment in 0..segments {
            let [a, b] = [at(ring, segment), at(ring, segment + 1)];
            let [c, d] = [at(ring + 1, segment), at(ring + 1, segment + 1)];
            if ring > 0 {
                mesh.triangles.push([a, c, b]);
            }
            if ring + 1 < rings {
                mesh.triangles.push([b, c, d]);
            }
        }
    }
    mesh
}

/// Box with these half extents (m), one normal per face and no texture coordinates.
pub fn block(half: Vec3) -> TriMesh {
    let mut mesh = TriMesh::default();
    for axis in 0..3 {
        for sign in [-1.0_f32, 1.0] {
            let mut normal = Vec3::ZERO;
            normal[axis] = sign;
            let first = mesh.positions.len() as u32;
            for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let mut corner = normal;
                (corner[(axis + 1) % 3], corner[(axis + 2) % 3]) = (u, v);
                mesh.positions.push(corner * half);
                mesh.normals.push(normal);
                mesh.uvs.push(Vec2::ZERO);
            }
            let quad = if sign > 0.0 { [[0, 1, 2], [0, 2, 3]] } else { [[0, 2, 1], [0, 3, 2]] };
            mesh.triangles.extend(quad.map(|triangle| triangle.map(|index| first + index)));
        }
    }
    mesh
}

/// Rigid object that consists of one mesh.
pub fn object(uid: &str, mesh: TriMesh, material: Material) -> Arc<ObjectModel> {
    let text = || uid.to_string();
    Arc::new(ObjectModel {
        card: ObjectCard {
            uid: uid.into(),
            asset: AssetRef::builtin(uid, 1),
            name: text(),
            description: text(),
            category: text(),
            general_category: text(),
            colors: Vec::new(),
            materials: Vec::new(),
            shape: text(),
            size_m: DVec3::ONE,
            mass_kg: 1.0,
            is_container: false,
            is_articulated: false,
            states: Vec::new(),
            can_grasp: true,
            annotations: Annotations::default(),
        },
        family: text(),
        asset: AssetRef::builtin(uid, 1),
        links: vec![ObjectLink {
            name: text(),
            joint: None,
            visual: vec![VisualPart::new(uid, mesh, material, Pose::IDENTITY)],
            pieces: Vec::new(),
            cavity: Vec::new(),
            mass: MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY },
        }],
        friction: 0.5,
        joint_states: Vec::new(),
    })
}

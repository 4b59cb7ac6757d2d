//! A toy scene, and an independent ray caster as reference.

use std::sync::Arc;

use genmanip_core::glam::{DMat3, DVec3, Vec2, Vec3};
use genmanip_core::{
    Annotations, AssetRef, Camera, Gripper, Intrinsics, JointKind, MassProperties, Material, ObjectCard, ObjectLink,
    ObjectModel, Pose, RobotJoint, RobotLink, RobotModel, Texture, TriMesh, VisualPart,
};

use crate::job::FrameState;
use crate::scene::assets::{Part, RenderAssets};

pub const NO_MASS: MassProperties = MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY };

/// A ball of `rings` × `2 rings` quads with true normals.
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

/// A box with flat faces.
pub fn block(half: Vec3) -> TriMesh {
    let mut mesh = TriMesh::default();
    crate::scene::fixtures::push_box(&mut mesh, -half, half);
    mesh
}

/// A mesh of one material at the origin of its link.
pub fn part(name: &str, mesh: TriMesh, material: Material) -> VisualPart {
    VisualPart::new(name, mesh, material, Pose::IDENTITY)
}

/// A rigid object of one mesh.
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
            visual: vec![part(uid, mesh, material)],
            pieces: Vec::new(),
            cavity: Vec::new(),
            mass: NO_MASS,
        }],
        friction: 0.5,
        joint_states: Vec::new(),
    })
}

/// A post with one turning arm of 0.5 m that carries a block as its hand.
pub fn robot() -> Arc<RobotModel> {
    let link = |name: &str, parent, at: DVec3, joint, half: Vec3| RobotLink {
        name: name.into(),
        parent,
        parent_from_link: Pose::from_position(at),
        joint,
        visual: vec![VisualPart {
            link_from_part: Pose::from_position(DVec3::X * f64::from(half.x)),
            ..part(name, block(half), Material::plain([0.9; 3], 0.35))
        }],
        pieces: Vec::new(),
        mass: NO_MASS,
    };
    let joint = |kind, axis| {
        Some(RobotJoint {
            name: "joint".into(),
            kind,
            axis,
            lower: -1.0,
            upper: 1.0,
            max_velocity: 1.0,
            max_acceleration: 1.0,
            max_jerk: 1.0,
            max_effort: 1.0,
            continuous: false,
            mimic: None,
        })
    };
    let turn = joint(JointKind::Revolute, DVec3::Z);
    let slide = |sign: f64| joint(JointKind::Prismatic, DVec3::Y * sign);
    Arc::new(RobotModel {
        name: "post".into(),
        links: vec![
            link("base", None, DVec3::Z * 0.25, None, Vec3::new(0.05, 0.05, 0.25)),
            link("arm", Some(0), DVec3::Z * 0.25, turn, Vec3::new(0.25, 0.03, 0.03)),
            link("hand", Some(1), DVec3::X * 0.5, None, Vec3::new(0.03, 0.1, 0.03)),
            link("finger1", Some(2), DVec3::Z * -0.05, slide(1.0), Vec3::new(0.01, 0.01, 0.03)),
            link("finger2", Some(2), DVec3::Z * -0.05, slide(-1.0), Vec3::new(0.01, 0.01, 0.03)),
        ],
        hand: 2,
        hand_from_tcp: Pose::IDENTITY,
        gripper: Gripper { fingers: [3, 4], max_width: 0.08, max_force: 70.0, pad_size: DVec3::splat(0.02) },
        home: vec![0.3],
        drives: None,
        reach: None,
        hand_from_wrist_camera: None,
        never_colliding: Vec::new(),
    })
}

/// A checkered texture.
pub fn checker() -> Arc<Texture> {
    let rgb = (0..64 * 64).flat_map(|i| if (i / 8 + i / 64 / 8) % 2 == 0 { [250, 250, 250] } else { [40, 60, 140] });
    Arc::new(Texture { width: 64, height: 64, rgb: rgb.collect() })
}

/// Block, ball, metal ball, glass block: everything the shading knows.
pub fn objects() -> Vec<Arc<ObjectModel>> {
    let checked = Material { texture: Some(checker()), ..Material::plain([1.0; 3], 0.6) };
    let glass = Material { opacity: 0.3, thin_walled: true, ..Material::plain([0.85, 0.95, 0.9], 0.1) };
    vec![
        object("block", block(Vec3::new(0.04, 0.05, 0.03)), Material::plain([0.8, 0.15, 0.1], 0.5)),
        object("ball", ball(0.045, 24), checked),
        object("metal", ball(0.04, 24), Material::metal([0.95, 0.85, 0.6], 0.25)),
        object("glass", block(Vec3::new(0.03, 0.03, 0.06)), glass),
    ]
}

/// The toy scene at rest.
pub fn frame(assets: &RenderAssets) -> FrameState {
    let at = |x, y, z, yaw| (Pose::from_position_yaw(DVec3::new(x, y, z), yaw), [].as_slice());
    let objects =
        [at(0.5, -0.12, 0.03, 0.6), at(0.5, 0.1, 0.045, 0.0), at(0.62, 0.0, 0.04, 0.0), at(0.4, 0.0, 0.06, 0.4)];
    assets.frame_state(&[0.9], 0.04, objects).unwrap()
}

/// Camera in front of the toy scene, with a vertical field of view of 0.75 rad.
pub fn camera(width: u32, height: u32) -> Camera {
    let intrinsics = Intrinsics::from_vertical_fov(width, height, 0.75);
    Camera::looking_at("test", DVec3::new(1.1, 0.3, 0.6), DVec3::new(0.45, 0.0, 0.05), intrinsics)
}

/// Distance along the optical axis and instance id of the nearest triangle under a pixel, in double precision.
pub fn cast(assets: &RenderAssets, frame: &FrameState, camera: &Camera, pixel: [u32; 2]) -> Option<(f64, u16)> {
    let world_from_camera = camera.world_from_camera(&assets.world_from_hand(frame));
    let at = genmanip_core::glam::DVec2::new(f64::from(pixel[0]), f64::from(pixel[1]));
    let ray = world_from_camera.transform_vector(camera.intrinsics.unproject(at, 1.0));
    let hits = assets.parts.iter().flat_map(|part| {
        let world_from_body = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
        let body_from_world = world_from_body.inverse();
        let origin = body_from_world.transform_point(world_from_camera.position);
        hits_of(part, origin, body_from_world.transform_vector(ray)).map(|depth| (depth, part.instance))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

fn hits_of(part: &Part, origin: DVec3, ray: DVec3) -> impl Iterator<Item = f64> {
    let to_center = part.mesh.bounds_center.as_dvec3() - origin;
    let off_axis = (to_center - ray * (to_center.dot(ray) / ray.length_squared())).length();
    let may_hit = off_axis <= f64::from(part.mesh.bounds_radius) + 1e-6;
    (0..if may_hit { part.mesh.triangles.len() } else { 0 }).filter_map(move |triangle| {
        let [a, b, c] = part.mesh.corners(triangle).map(Vec3::as_dvec3);
        let (ab, ac) = (b - a, c - a);
        let across = ray.cross(ac);
        let determinant = ab.dot(across);
        if determinant.abs() < 1e-18 {
            return None;
        }
        let from_a = origin - a;
        let u = from_a.dot(across) / determinant;
        let second = from_a.cross(ab);
        let v = ray.dot(second) / determinant;
        let depth = ac.dot(second) / determinant;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && depth > 0.01).then_some(depth)
    })
}

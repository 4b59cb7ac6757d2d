//! Hand-built test objects: light, thin, heavy, round, hollow, articulated.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{
    Aabb, Annotations, AssetRef, Joint, JointKind, MassProperties, ObjectCard, ObjectLink, ObjectModel, Piece, Pose,
    Shape,
};

/// `w`ide (y) × `d`eep (x) × `h`igh.
pub fn cuboid(d: f64, w: f64, h: f64) -> Piece {
    Piece::at(DVec3::Z * (h / 2.0), Shape::Box { half_extents: DVec3::new(d, w, h) / 2.0 })
}

pub fn can(radius: f64, height: f64) -> Piece {
    Piece::at(DVec3::Z * (height / 2.0), Shape::Cylinder { radius, half_height: height / 2.0 })
}

pub fn ball(radius: f64) -> Piece {
    Piece::at(DVec3::Z * radius, Shape::Sphere { radius })
}

/// A pen lying along x.
pub fn pen(radius: f64, length: f64) -> Piece {
    let shape = Shape::Capsule { radius, half_length: length / 2.0 - radius };
    let pose = Pose::new(DVec3::Z * radius, DQuat::from_rotation_y(TAU / 4.0));
    Piece { shape, link_from_piece: pose }
}

/// A shell of `sectors` wedge hulls on a round base.
pub fn mug(radius: f64, height: f64, wall: f64, sectors: usize) -> Vec<Piece> {
    let mut pieces = vec![can(radius, wall)];
    for sector in 0..sectors {
        let angles = [sector, sector + 1].map(|index| TAU * index as f64 / sectors as f64);
        let points = angles
            .iter()
            .flat_map(|angle| [radius, radius - wall].map(|r| (angle.cos() * r, angle.sin() * r)))
            .flat_map(|(x, y)| [wall, height].map(|z| DVec3::new(x, y, z)))
            .collect();
        pieces.push(Piece::at(DVec3::ZERO, Shape::Hull { points }));
    }
    pieces
}

pub fn rigid(name: &str, mass_kg: f64, friction: f64, pieces: Vec<Piece>) -> Arc<ObjectModel> {
    let bounds = Aabb::from_pieces(&Pose::IDENTITY, &pieces);
    let links = vec![body("body", mass_kg, None, pieces)];
    Arc::new(model(name, bounds.size(), mass_kg, friction, links))
}

/// A heavy cabinet with a drawer that slides out towards -x.
pub fn cabinet() -> Arc<ObjectModel> {
    let walls = [
        ([0.0, 0.0, 0.005], [0.2, 0.2, 0.01]),
        ([0.0, 0.095, 0.08], [0.2, 0.01, 0.14]),
        ([0.0, -0.095, 0.08], [0.2, 0.01, 0.14]),
        ([0.0, 0.0, 0.155], [0.2, 0.2, 0.01]),
    ];
    let walls = walls.map(|(center, size)| {
        Piece::at(DVec3::from_array(center), Shape::Box { half_extents: DVec3::from_array(size) / 2.0 })
    });
    let joint = Joint {
        name: "slide".into(),
        parent: 0,
        kind: JointKind::Prismatic,
        parent_from_joint: Pose::from_position(DVec3::new(0.0, 0.0, 0.02)),
        axis: DVec3::NEG_X,
        range: [0.0, 0.12],
        damping: 5.0,
        friction_loss: 2.0,
        stiffness: 0.0,
        spring_reference: 0.0,
    };
    let links =
        vec![body("case", 8.0, None, walls.to_vec()), body("drawer", 0.5, Some(joint), vec![cuboid(0.18, 0.16, 0.08)])];
    Arc::new(model("cabinet", DVec3::new(0.2, 0.2, 0.16), 8.5, 0.8, links))
}

fn body(name: &str, mass_kg: f64, joint: Option<Joint>, pieces: Vec<Piece>) -> ObjectLink {
    let bounds = Aabb::from_pieces(&Pose::IDENTITY, &pieces);
    let s = bounds.size();
    let inertia = DVec3::new(s.y * s.y + s.z * s.z, s.x * s.x + s.z * s.z, s.x * s.x + s.y * s.y) * (mass_kg / 12.0);
    let mass = MassProperties { mass_kg, center: bounds.center(), inertia: DMat3::from_diagonal(inertia) };
    ObjectLink { name: name.into(), joint, visual: vec![], pieces, cavity: vec![], mass }
}

fn model(name: &str, size_m: DVec3, mass_kg: f64, friction: f64, links: Vec<ObjectLink>) -> ObjectModel {
    let card = ObjectCard {
        uid: name.into(),
        asset: AssetRef::builtin(name, 1),
        name: name.into(),
        description: String::new(),
        category: String::new(),
        general_category: String::new(),
        colors: vec![],
        materials: vec![],
        shape: String::new(),
        size_m,
        mass_kg,
        is_container: false,
        is_articulated: links.len() > 1,
        states: vec![],
        can_grasp: true,
        annotations: Annotations::default(),
    };
    ObjectModel {
        card,
        family: "test".into(),
        asset: AssetRef::builtin(name, 1),
        links,
        friction,
        joint_states: vec![],
    }
}

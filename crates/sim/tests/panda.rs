//! A Panda of boxes and capsules for tests: the maker's kinematics and limits, identified masses.

use genmanip_core::glam::{DMat3, DQuat, DVec3};
use genmanip_core::{
    Gripper, JointKind, MassProperties, Piece, Pose, RobotJoint, RobotLink, RobotModel, Shape,
};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

const LIMITS: [(f64, f64, f64, f64); 7] = [
    (-2.8973, 2.8973, 2.175, 87.0),
    (-1.7628, 1.7628, 2.175, 87.0),
    (-2.8973, 2.8973, 2.175, 87.0),
    (-3.0718, -0.0698, 2.175, 87.0),
    (-2.8973, 2.8973, 2.61, 12.0),
    (-0.0175, 3.7525, 2.61, 12.0),
    (-2.8973, 2.8973, 2.61, 12.0),
];

/// Offset and turn about x from the parent; mass; centre; inertia xx yy zz.
const ARM: [([f64; 3], f64, f64, [f64; 3], [f64; 3]); 7] = [
    ([0.0, 0.0, 0.333], 0.0, 4.97, [0.004, 0.002, -0.048], [0.0703, 0.0706, 0.0091]),
    ([0.0, 0.0, 0.0], -FRAC_PI_2, 0.647, [-0.003, -0.029, 0.003], [0.008, 0.0281, 0.026]),
    ([0.0, -0.316, 0.0], FRAC_PI_2, 3.229, [0.0275, 0.039, -0.0665], [0.0372, 0.0361, 0.0108]),
    ([0.0825, 0.0, 0.0], FRAC_PI_2, 3.588, [-0.053, 0.104, 0.027], [0.0259, 0.0196, 0.0283]),
    ([-0.0825, 0.384, 0.0], -FRAC_PI_2, 1.226, [-0.012, 0.041, -0.038], [0.0355, 0.0295, 0.0086]),
    ([0.0, 0.0, 0.0], FRAC_PI_2, 1.667, [0.06, -0.014, -0.0105], [0.002, 0.0044, 0.0054]),
    ([0.088, 0.0, 0.0], FRAC_PI_2, 0.736, [0.0105, -0.004, 0.0616], [0.0125, 0.01, 0.0048]),
];

pub fn panda() -> RobotModel {
    let mut links = vec![link("link0", None, Pose::IDENTITY, None, 2.0, [0.0; 3], [0.01; 3], vec![cuboid(
        [-0.04, 0.0, 0.07],
        [0.1, 0.09, 0.07],
    )])];
    for (index, &(offset, turn, mass, center, inertia)) in ARM.iter().enumerate() {
        let (lower, upper, max_velocity, max_effort) = LIMITS[index];
        let joint = RobotJoint {
            name: format!("joint{}", index + 1),
            kind: JointKind::Revolute,
            axis: DVec3::Z,
            lower,
            upper,
            max_velocity,
            max_acceleration: 10.0,
            max_jerk: 5000.0,
            max_effort,
        };
        let pose = Pose::new(DVec3::from_array(offset), DQuat::from_rotation_x(turn));
        let pieces = match index {
            0 => vec![capsule([0.0, 0.0, -0.1], 0.06, 0.08)],
            2 => vec![capsule([0.0, 0.0, -0.12], 0.055, 0.07)],
            4 => vec![capsule([0.0, 0.0, -0.22], 0.055, 0.08)],
            6 => vec![capsule([0.0, 0.0, 0.05], 0.045, 0.02)],
            _ => vec![],
        };
        links.push(link(&format!("link{}", index + 1), Some(index), pose, Some(joint), mass, center, inertia, pieces));
    }
    let hand = Pose::new(DVec3::new(0.0, 0.0, 0.107), DQuat::from_rotation_z(-FRAC_PI_4));
    let palm = cuboid([0.0, 0.0, 0.033], [0.02, 0.1, 0.033]);
    links.push(link("hand", Some(7), hand, None, 0.73, [-0.01, 0.0, 0.03], [0.001, 0.0025, 0.0017], vec![palm]));
    for (name, turn) in [("finger1", 0.0), ("finger2", PI)] {
        let joint = RobotJoint {
            name: format!("{name}_joint"),
            kind: JointKind::Prismatic,
            axis: DVec3::Y,
            lower: 0.0,
            upper: 0.04,
            max_velocity: 0.1,
            max_acceleration: 1.0,
            max_jerk: 100.0,
            max_effort: 70.0,
        };
        let pose = Pose::new(DVec3::new(0.0, 0.0, 0.0584), DQuat::from_rotation_z(turn));
        let pad = cuboid([0.0, 0.004, 0.045], [0.0105, 0.004, 0.0105]);
        let body = cuboid([0.0, 0.018, 0.022], [0.0105, 0.008, 0.022]);
        links.push(link(name, Some(8), pose, Some(joint), 0.015, [0.0, 0.01, 0.025], [4e-6, 4e-6, 1e-6], vec![pad, body]));
    }
    let mut never: Vec<(usize, usize)> = (0..8).map(|index| (index, index + 1)).collect();
    never.extend([(8, 9), (8, 10), (5, 7), (6, 8), (5, 8), (7, 9), (7, 10)]);
    RobotModel {
        name: "panda".into(),
        links,
        hand: 8,
        hand_from_tcp: Pose::from_position(DVec3::new(0.0, 0.0, 0.1034)),
        gripper: Gripper {
            fingers: [9, 10],
            max_width: 0.08,
            max_force: 70.0,
            pad_size: DVec3::new(0.008, 0.021, 0.021),
        },
        home: vec![0.0, -0.3, 0.0, -2.2, 0.0, 2.0, FRAC_PI_4],
        never_colliding: never,
    }
}

#[allow(clippy::too_many_arguments, reason = "a table of figures")]
fn link(
    name: &str,
    parent: Option<usize>,
    parent_from_link: Pose,
    joint: Option<RobotJoint>,
    mass_kg: f64,
    center: [f64; 3],
    inertia: [f64; 3],
    pieces: Vec<Piece>,
) -> RobotLink {
    let mass = MassProperties {
        mass_kg,
        center: DVec3::from_array(center),
        inertia: DMat3::from_diagonal(DVec3::from_array(inertia)),
    };
    RobotLink { name: name.into(), parent, parent_from_link, joint, visual: vec![], pieces, mass }
}

fn cuboid(center: [f64; 3], half_extents: [f64; 3]) -> Piece {
    Piece::at(DVec3::from_array(center), Shape::Box { half_extents: DVec3::from_array(half_extents) })
}

fn capsule(center: [f64; 3], radius: f64, half_length: f64) -> Piece {
    Piece::at(DVec3::from_array(center), Shape::Capsule { radius, half_length })
}

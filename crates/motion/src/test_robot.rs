//! A test robot with the Panda's kinematics and simple boxes and capsules.

use std::sync::Arc;

use genmanip_core::{
    Gripper, JointKind, MassProperties, Piece, Pose, RobotJoint, RobotLink, RobotModel, Shape,
    glam::{DMat3, DQuat, DVec3},
};

fn capsule(from: DVec3, to: DVec3, radius: f64) -> Piece {
    let along = to - from;
    let rotation = DQuat::from_rotation_arc(DVec3::Z, along.normalize());
    let shape = Shape::Capsule { radius, half_length: along.length() / 2.0 };
    Piece { shape, link_from_piece: Pose::new((from + to) / 2.0, rotation) }
}

fn cuboid(center: DVec3, half_extents: DVec3) -> Piece {
    Piece::at(center, Shape::Box { half_extents })
}

/// Seven joints, a hand and two fingers.
pub(crate) fn test_panda() -> Arc<RobotModel> {
    let quarter = std::f64::consts::FRAC_PI_2;
    let v = DVec3::new;
    // Twist, offset, lower, upper, velocity, acceleration, collision pieces of the link behind the joint.
    let rows: [(f64, DVec3, [f64; 4], Vec<Piece>); 7] = [
        (
            0.0,
            v(0.0, 0.0, 0.333),
            [-2.8973, 2.8973, 2.175, 15.0],
            vec![capsule(v(0.0, 0.0, -0.15), v(0.0, -0.0, 0.0), 0.06)],
        ),
        (
            -quarter,
            DVec3::ZERO,
            [-1.7628, 1.7628, 2.175, 7.5],
            vec![capsule(v(0.0, 0.0, 0.0), v(0.0, -0.12, 0.0), 0.06)],
        ),
        (
            quarter,
            v(0.0, -0.316, 0.0),
            [-2.8973, 2.8973, 2.175, 10.0],
            vec![capsule(v(0.0, 0.0, -0.1), v(0.05, 0.0, 0.0), 0.06)],
        ),
        (
            quarter,
            v(0.0825, 0.0, 0.0),
            [-3.0718, -0.0698, 2.175, 12.5],
            vec![capsule(v(0.0, 0.0, 0.0), v(-0.08, 0.08, 0.0), 0.06)],
        ),
        (
            -quarter,
            v(-0.0825, 0.384, 0.0),
            [-2.8973, 2.8973, 2.61, 15.0],
            vec![capsule(v(0.0, 0.03, -0.22), v(0.0, 0.05, -0.05), 0.055)],
        ),
        (quarter, DVec3::ZERO, [-0.0175, 3.7525, 2.61, 20.0], vec![capsule(v(0.0, 0.0, 0.0), v(0.08, 0.0, 0.0), 0.05)]),
        (
            quarter,
            v(0.088, 0.0, 0.0),
            [-2.8973, 2.8973, 2.61, 20.0],
            vec![capsule(v(0.0, 0.0, -0.02), v(0.0, 0.0, 0.06), 0.045)],
        ),
    ];
    let mass = MassProperties { mass_kg: 1.0, center: DVec3::ZERO, inertia: DMat3::IDENTITY };
    let link = |name: &str, parent, parent_from_link, joint, pieces| RobotLink {
        name: name.into(),
        parent,
        parent_from_link,
        joint,
        visual: vec![],
        pieces,
        mass,
    };
    let joint = |name: &str, kind, axis, [lower, upper, max_velocity, max_acceleration]: [f64; 4]| RobotJoint {
        name: name.into(),
        kind,
        axis,
        lower,
        upper,
        max_velocity,
        max_acceleration,
        max_jerk: 5000.0,
        max_effort: 50.0,
        continuous: false,
        mimic: None,
    };
    let base = capsule(v(-0.05, 0.0, 0.06), v(0.0, 0.0, 0.1), 0.06);
    let mut links = vec![link("link0", None, Pose::IDENTITY, None, vec![base])];
    for (index, (twist, offset, limits, pieces)) in rows.into_iter().enumerate() {
        let pose = Pose::new(offset, DQuat::from_rotation_x(twist));
        let name = format!("joint{}", index + 1);
        let joint = joint(&name, JointKind::Revolute, DVec3::Z, limits);
        links.push(link(&format!("link{}", index + 1), Some(index), pose, Some(joint), pieces));
    }
    let flange = Pose::new(v(0.0, 0.0, 0.107), DQuat::from_rotation_z(-quarter / 2.0));
    let hand = vec![cuboid(v(0.0, 0.0, 0.033), v(0.0316, 0.102, 0.033))];
    links.push(link("hand", Some(7), flange, None, hand));
    for (name, side) in [("left_finger", 1.0), ("right_finger", -1.0)] {
        let slide = joint(name, JointKind::Prismatic, DVec3::Y * side, [0.0, 0.04, 0.2, 10.0]);
        let pieces = vec![
            cuboid(v(0.0, 0.0037 * side, 0.045), v(0.0105, 0.0037, 0.0085)),
            cuboid(v(0.0, 0.015 * side, 0.018), v(0.0105, 0.009, 0.018)),
        ];
        links.push(link(name, Some(8), Pose::from_position(v(0.0, 0.0, 0.0584)), Some(slide), pieces));
    }
    let adjacent = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (5, 7), (6, 7), (6, 8), (6, 9), (6, 10)];
    let far = [(0, 2), (1, 3), (2, 4), (3, 5), (4, 6), (1, 4), (2, 5), (4, 7)];
    Arc::new(RobotModel {
        name: "test panda".into(),
        links,
        hand: 8,
        hand_from_tcp: Pose::from_position(v(0.0, 0.0, 0.1034)),
        gripper: Gripper { fingers: [9, 10], max_width: 0.08, max_force: 140.0, pad_size: v(0.008, 0.021, 0.017) },
        home: vec![0.0, -quarter / 2.0, 0.0, -1.5 * quarter, 0.0, quarter, quarter / 2.0],
        drives: None,
        reach: None,
        hand_from_wrist_camera: None,
        never_colliding: adjacent.into_iter().chain(far).collect(),
    })
}

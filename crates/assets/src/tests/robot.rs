//! The Panda matches its published kinematics, limits and outline.

use genmanip_core::{Aabb, Pose, RobotModel, Seed};
use glam::DVec3;
use rand::RngExt;

use super::{gap, uncovered};
use crate::panda;

/// Arm joint positions; hand position, y axis and z axis.
type HandPose = ([f64; 7], [f64; 3], [f64; 3], [f64; 3]);

/// Hand poses computed from the manufacturer's URDF by plain matrix products.
const URDF_HAND: [HandPose; 3] = [
    ([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.30702, 0.0, 0.59027], [0.000398, -1.0, 0.0], [0.0, 0.0, -1.0]),
    (
        [0.3, -0.5, 0.7, -1.9, -1.1, 2.4, -0.6],
        [0.174934, 0.455052, 0.750768],
        [-0.19107, 0.922194, 0.336231],
        [0.973119, 0.222832, -0.058176],
    ),
    (
        [-2.1, 1.2, -0.9, -0.4, 2.5, 0.2, 1.7],
        [-0.316559, -0.554242, 0.498589],
        [-0.411257, 0.582983, -0.700713],
        [0.859612, 0.50376, -0.085396],
    ),
];

/// Bounds of the public collision meshes in their link frames, m: link, smallest and largest corner.
const OUTLINES: [(&str, [f64; 3], [f64; 3]); 9] = [
    ("link0", [-0.154, -0.095, 0.0], [0.072, 0.095, 0.14]),
    ("link1", [-0.055, -0.129, -0.192], [0.055, 0.055, 0.055]),
    ("link2", [-0.055, -0.194, -0.055], [0.055, 0.055, 0.129]),
    ("link3", [-0.055, -0.055, -0.121], [0.138, 0.111, 0.055]),
    ("link4", [-0.138, -0.055, -0.055], [0.055, 0.124, 0.111]),
    ("link5", [-0.055, -0.055, -0.265], [0.055, 0.13, 0.052]),
    ("link6", [-0.048, -0.051, -0.044], [0.132, 0.082, 0.056]),
    ("link7", [-0.044, -0.044, 0.052], [0.081, 0.081, 0.107]),
    ("left_finger", [-0.01, 0.0, 0.0], [0.01, 0.026, 0.054]),
];

#[test]
fn kinematics_match_the_urdf() {
    let robot = panda();
    for (arm, position, y, z) in URDF_HAND {
        let hand = robot.link_poses(&arm, 0.0)[robot.hand];
        assert!(hand.position.distance(DVec3::from_array(position)) < 2e-6, "{hand:?}");
        assert!(hand.transform_vector(DVec3::Y).distance(DVec3::from_array(y)) < 2e-6, "{hand:?}");
        assert!(hand.transform_vector(DVec3::Z).distance(DVec3::from_array(z)) < 2e-6, "{hand:?}");
    }
}

#[test]
fn the_home_position_points_straight_down_above_the_table() {
    let robot = panda();
    let tcp = robot.tcp_pose(&robot.home);
    assert!(tcp.transform_vector(DVec3::Z).distance(DVec3::NEG_Z) < 1e-6, "{tcp:?}");
    assert!((tcp.position - DVec3::new(0.4, 0.0, 0.4)).length() < 0.005, "{tcp:?}");
    for (joint, &position) in robot.arm_joints().zip(&robot.home) {
        let margin = (position - joint.lower).min(joint.upper - position);
        assert!(margin > 0.3, "{} has {margin:.2} rad left", joint.name);
    }
    assert!(self_collision(&robot, &robot.home, 0.08).is_none());
}

#[test]
fn limits_match_published_values() {
    let robot = panda();
    let joints: Vec<_> = robot.arm_joints().collect();
    assert_eq!(joints.len(), 7);
    let rows = |pick: fn(&genmanip_core::RobotJoint) -> f64| joints.iter().map(|joint| pick(joint)).collect::<Vec<_>>();
    assert_eq!(rows(|j| j.lower), [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]);
    assert_eq!(rows(|j| j.upper), [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]);
    assert_eq!(rows(|j| j.max_velocity), [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]);
    assert_eq!(rows(|j| j.max_effort), [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]);
    assert_eq!(rows(|j| j.max_acceleration), [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]);
}

#[test]
fn pads_meet_at_the_tcp_and_open_to_the_full_width() {
    let robot = panda();
    for width in [0.0, 0.03, robot.gripper.max_width] {
        let poses = robot.link_poses(&robot.home, width);
        let tcp_from_world = robot.tcp_pose(&robot.home).inverse();
        let bounds = robot.gripper.fingers.map(|finger| {
            let pad = &robot.links[finger].pieces[1];
            Aabb::from_pieces(&(tcp_from_world * poses[finger]), [pad])
        });
        assert!((bounds[0].min.y - width / 2.0).abs() < 1e-9 && (bounds[1].max.y + width / 2.0).abs() < 1e-9);
        assert!((bounds[0].center().z).abs() < 1e-9, "pads are centred on the TCP");
        let size = bounds[0].size();
        assert!((DVec3::new(size.y, size.x, size.z) - robot.gripper.pad_size).length() < 1e-9);
    }
}

#[test]
fn shapes_follow_the_outline_of_the_robot() {
    let robot = panda();
    let mut flaws = Vec::new();
    for (name, min, max) in OUTLINES {
        let link = robot.links.iter().find(|link| link.name == name).unwrap();
        let bounds = Aabb::from_pieces(&Pose::IDENTITY, &link.pieces);
        let off = (bounds.min - DVec3::from_array(min)).abs().max((bounds.max - DVec3::from_array(max)).abs());
        if off.max_element() > 0.018 {
            flaws.push(format!("{name}: {} … {}", bounds.min, bounds.max));
        }
    }
    for link in &robot.links {
        let out = uncovered(&link.visual, &link.pieces, 23);
        if out > 0.003 {
            flaws.push(format!("{}: the surface stands out by {:.1} mm", link.name, out * 1e3));
        }
    }
    assert!(flaws.is_empty(), "{}", flaws.join("\n"));
}

#[test]
fn self_collisions_are_rare_and_excluded_pairs_never_collide() {
    let robot = panda();
    let mut rng = Seed::new(1).fork("self collision").rng();
    let (mut colliding, samples) = (0, 60);
    let neighbours = |a: usize, b: usize| {
        robot.links[b].parent == Some(a) || robot.links[a].parent == Some(b) || robot.gripper.fingers == [a, b]
    };
    for _ in 0..samples {
        let arm: Vec<f64> = robot.arm_joints().map(|j| j.lower + (j.upper - j.lower) * rng.random::<f64>()).collect();
        colliding += usize::from(self_collision(&robot, &arm, 0.08).is_some());
        let poses = robot.link_poses(&arm, 0.04);
        for &(a, b) in robot.never_colliding.iter().filter(|&&(a, b)| !neighbours(a, b)) {
            let depth = -gap(&robot.links[a].pieces, &poses[a], &robot.links[b].pieces, &poses[b]);
            assert!(depth < 0.012, "{a} and {b} overlap by {:.1} mm at {arm:?}", depth * 1e3);
        }
    }
    assert!(colliding * 100 <= samples * 30, "{colliding} of {samples} random positions are in self-collision");
}

/// The first pair of links that overlap by more than the search's numerical error.
fn self_collision(robot: &RobotModel, arm: &[f64], width: f64) -> Option<(usize, usize)> {
    let poses = robot.link_poses(arm, width);
    let pairs = (0..robot.links.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    pairs
        .filter(|pair| !robot.never_colliding.contains(pair))
        .find(|&(a, b)| gap(&robot.links[a].pieces, &poses[a], &robot.links[b].pieces, &poses[b]) < -5e-4)
}

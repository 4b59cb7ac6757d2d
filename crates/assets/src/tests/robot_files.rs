//! Robots as data: composing, the UR5e against its published figures, and refusals of wrong files.

use genmanip_core::{Aabb, JointKind, RobotModel, Seed};
use glam::DVec3;
use proptest::prelude::*;
use rand::RngExt;
use serde_json::{Value, json};

use super::{gap, uncovered};
use crate::robots::{self, PartKind, compose};
use crate::{AssetError, panda};

/// Hashes of the physics of released robots: results recorded with them stay valid.
const HASHES: [(&str, &str); 2] = [("panda", "v2:b1cf8b6b79622b1e"), ("panda_2f85", "v2:86aee4263263d64b")];

#[test]
fn released_robots_keep_their_physics() {
    for (name, hash) in HASHES {
        assert_eq!(robots::named(name).unwrap().physics_hash(), hash, "{name}");
    }
}

/// Every built-in file is a robot of the name of the file, with what the expert and the renderer need.
#[test]
fn built_in_robots_are_sound() {
    // Other tests register robots of their own.
    let names: Vec<String> = robots::names().into_iter().filter(|name| !name.contains("test")).collect();
    assert_eq!(names, ["fr3", "panda", "panda_2f85", "ur5e_2f85"]);
    for name in names {
        let robot = robots::named(&name).unwrap();
        assert_eq!(robot.name, name);
        assert!(robot.hand_from_wrist_camera.is_some() && robot.reach.is_some(), "{name}");
        let mut flaws = Vec::new();
        for link in &robot.links {
            let out = uncovered(&link.visual, &link.pieces, 41);
            if out > 0.003 {
                flaws.push(format!("{}: the surface stands out by {:.1} mm", link.name, out * 1e3));
            }
        }
        assert!(flaws.is_empty(), "{name}: {}", flaws.join("\n"));
        let tcp = robot.tcp_pose(&robot.home);
        let down = tcp.transform_vector(DVec3::Z);
        assert!(down.distance(DVec3::NEG_Z) < 1e-3 && tcp.position.z > 0.3, "{name} starts at {tcp:?}");
        check_pads(&robot);
        check_excluded_pairs(&robot);
    }
}

/// Pads meet at the tool centre point and open to the full width.
fn check_pads(robot: &RobotModel) {
    for width in [0.0, 0.03, robot.gripper.max_width] {
        let poses = robot.link_poses(&robot.home, width);
        let tcp_from_world = robot.tcp_pose(&robot.home).inverse();
        let inner = robot.gripper.fingers.map(|finger| {
            let link = &robot.links[finger];
            let bounds = link.pieces.iter().map(|piece| Aabb::from_pieces(&(tcp_from_world * poses[finger]), [piece]));
            bounds.map(|bounds| bounds.min.y.abs().min(bounds.max.y.abs())).fold(f64::INFINITY, f64::min)
        });
        assert!(inner.iter().all(|inner| (inner - width / 2.0).abs() < 1e-9), "{} at {width}: {inner:?}", robot.name);
    }
}

/// Pairs that are never tested against each other never overlap, neighbours apart.
fn check_excluded_pairs(robot: &RobotModel) {
    let mut rng = Seed::new(1).fork("self collision").rng();
    let neighbours = |a: usize, b: usize| {
        robot.links[b].parent == Some(a) || robot.links[a].parent == Some(b) || robot.gripper.fingers == [a, b]
    };
    for _ in 0..20 {
        let arm: Vec<f64> = robot.arm_joints().map(|j| j.lower + (j.upper - j.lower) * rng.random::<f64>()).collect();
        let poses = robot.link_poses(&arm, 0.5 * robot.gripper.max_width);
        for &(a, b) in robot.never_colliding.iter().filter(|&&(a, b)| !neighbours(a, b)) {
            let depth = -gap(&robot.links[a].pieces, &poses[a], &robot.links[b].pieces, &poses[b]);
            let (first, second) = (&robot.links[a].name, &robot.links[b].name);
            assert!(depth < 0.012, "{first} and {second} overlap by {:.1} mm at {arm:?}", depth * 1e3);
        }
    }
}

/// Tool flange of the UR5e by the maker's Denavit-Hartenberg parameters, for joint positions of no symmetry.
#[test]
fn the_ur5e_has_the_makers_kinematics() {
    // a, d, alpha of each joint.
    const DH: [[f64; 3]; 6] = [
        [0.0, 0.1625, std::f64::consts::FRAC_PI_2],
        [-0.425, 0.0, 0.0],
        [-0.3922, 0.0, 0.0],
        [0.0, 0.1333, std::f64::consts::FRAC_PI_2],
        [0.0, 0.0997, -std::f64::consts::FRAC_PI_2],
        [0.0, 0.0996, 0.0],
    ];
    let robot = robots::named("ur5e_2f85").unwrap();
    assert_eq!(robot.arm_dof(), 6);
    for arm in [[0.0; 6], [0.3, -1.2, 1.7, -0.4, 2.1, -0.8], [-2.5, 0.7, -1.1, 3.0, -0.6, 5.0]] {
        // The maker's base frame looks the other way than ours.
        let mut pose = genmanip_core::Pose::new(DVec3::ZERO, glam::DQuat::from_rotation_z(std::f64::consts::PI));
        for (q, [a, d, alpha]) in arm.into_iter().zip(DH) {
            let turn = genmanip_core::Pose::new(DVec3::Z * d, glam::DQuat::from_rotation_z(q));
            pose = pose * turn * genmanip_core::Pose::new(DVec3::X * a, glam::DQuat::from_rotation_x(alpha));
        }
        let flange = robot.links.iter().position(|link| link.name == "wrist_3").unwrap();
        let ours = robot.link_poses(&arm, 0.0)[flange];
        assert!(ours.position.distance(pose.position) < 1e-9 && ours.angle_to(&pose) < 1e-7, "{arm:?}: {ours:?}");
    }
    let rows = |pick: fn(&genmanip_core::RobotJoint) -> f64| robot.arm_joints().map(pick).collect::<Vec<_>>();
    let (turn, half) = (std::f64::consts::TAU, std::f64::consts::PI);
    assert_eq!(rows(|j| j.upper), [turn, turn, half, turn, turn, turn]);
    assert_eq!(rows(|j| j.max_velocity), [half; 6]);
    assert_eq!(rows(|j| j.max_effort), [150.0, 150.0, 150.0, 28.0, 28.0, 28.0]);
    let mass: f64 = robot.links[..7].iter().map(|link| link.mass.mass_kg).sum();
    assert!((mass - 21.7).abs() < 0.01, "{mass} kg");
    assert_eq!(robot.gripper.max_width, 0.085);
}

/// The FR3 stands, reaches and grips as the Panda, and keeps to what both arms' makers allow.
#[test]
fn the_fr3_is_a_panda_within_the_limits_of_both() {
    let (fr3, panda) = (robots::named("fr3").unwrap(), panda());
    for arm in [[0.0, -0.5, 0.0, -2.38, 0.0, 1.88, 0.8], [1.1, 0.7, -2.0, -1.0, 2.5, 3.1, -2.6]] {
        assert_eq!(fr3.tcp_pose(&arm), panda.tcp_pose(&arm));
    }
    // Position, velocity and acceleration limits in the maker's specification of the FR3.
    const FR3: [[f64; 4]; 7] = [
        [-2.7437, 2.7437, 2.62, 10.0],
        [-1.7837, 1.7837, 2.62, 10.0],
        [-2.9007, 2.9007, 2.62, 10.0],
        [-3.0421, -0.1518, 2.62, 10.0],
        [-2.8065, 2.8065, 5.26, 10.0],
        [0.5445, 4.5169, 4.18, 10.0],
        [-3.0159, 3.0159, 5.26, 10.0],
    ];
    for ((joint, other), [lower, upper, velocity, acceleration]) in fr3.arm_joints().zip(panda.arm_joints()).zip(FR3) {
        assert_eq!((joint.lower, joint.upper), (other.lower.max(lower), other.upper.min(upper)), "{}", joint.name);
        assert_eq!(joint.max_velocity, other.max_velocity.min(velocity), "{}", joint.name);
        assert_eq!(joint.max_acceleration, other.max_acceleration.min(acceleration), "{}", joint.name);
        assert_eq!(joint.max_jerk, other.max_jerk.min(5000.0), "{}", joint.name);
    }
}

/// Values of the robot file replace those of arm and gripper.
#[test]
fn a_robot_reads_all_that_it_says_about_its_parts() {
    let plain = robots::named("ur5e_2f85").unwrap();
    let robot = composed(&json!({
        "schema": "genmanip.robot/1", "name": "mine", "on": "ur5e", "gripper": "panda_hand",
        "mount": {"position": [0, 0, 0.02], "rpy_deg": [0, 0, 45]},
        "home": [0, -1.5, 1.5, -1.5, -1.5, 0],
        "reach": {"max_m": 0.8, "from_above_m": [0.3, 0.7]},
        "wrist_camera": {"position": [0.1, 0, 0], "tilt_deg": 0},
        "gains": {"kp": [1000], "kv": [50, 20]},
        "limits": {"wrist_2": {"lower": -2.0, "max_velocity": 1.0}},
        "never_colliding": [["wrist_3", "gripper"], ["hand", "base"]],
    }))
    .unwrap();
    assert_eq!((robot.name.as_str(), robot.arm_dof(), robot.gripper.max_width), ("mine", 6, 0.08));
    assert_eq!(robot.links[robot.hand].parent_from_link.position, DVec3::Z * 0.02);
    assert_eq!(robot.home[1], -1.5);
    assert_eq!(robot.reach.unwrap().from_above_m, [0.3, 0.7]);
    assert_eq!(robot.hand_from_wrist_camera.unwrap().position, DVec3::X * 0.1);
    let drives = robot.drives.as_ref().unwrap();
    assert_eq!((drives.arm_kp.as_slice(), drives.arm_kv.as_slice()), ([1000.0].as_slice(), [50.0, 20.0].as_slice()));
    assert_eq!(drives.grip_force_n, panda().drives.as_ref().unwrap().grip_force_n);
    let wrist = robot.arm_joints().nth(4).unwrap();
    assert_eq!((wrist.lower, wrist.max_velocity), (-2.0, 1.0));
    assert_eq!(wrist.upper, plain.arm_joints().nth(4).unwrap().upper);
    assert_eq!(robot.gripper.fingers, [robot.hand + 1, robot.hand + 2]);
    assert!(robot.never_colliding.contains(&(0, robot.hand)) && robot.never_colliding.contains(&(6, robot.hand + 2)));
    assert!(robot.never_colliding.is_sorted());
}

fn composed(robot: &Value) -> Result<RobotModel, AssetError> {
    compose("mine.json", &robot.to_string(), &robots::find)
}

/// A small text that composes, to be broken.
fn sound(kind: PartKind) -> Value {
    let text = match kind {
        PartKind::Robot => include_str!("../../data/robots/ur5e_2f85.json"),
        PartKind::Arm => include_str!("../../data/robots/arms/ur5e.json"),
        PartKind::Gripper => include_str!("../../data/robots/grippers/robotiq_2f85.json"),
    };
    serde_json::from_str(text).unwrap()
}

/// Composes the UR5e with one of its files changed.
fn with_changed(kind: PartKind, changed: &Value) -> Result<RobotModel, AssetError> {
    let find = |wanted: PartKind, name: &str| {
        if wanted == kind { Ok(changed.to_string()) } else { robots::find(wanted, name) }
    };
    let robot = if kind == PartKind::Robot { changed.clone() } else { sound(PartKind::Robot) };
    compose("robot mine", &robot.to_string(), &find)
}

#[test]
fn wrong_files_are_refused_with_place_and_expected_value() {
    use PartKind::{Arm, Gripper, Robot};
    let cases: Vec<(PartKind, &str, Value, &[&str])> = vec![
        (Robot, "/schema", json!("genmanip.robot/9"), &["robot mine", "schema", "genmanip.robot/1"]),
        (Robot, "/name", json!("My Robot"), &["name", "lower-case"]),
        (Robot, "/on", json!("ur7"), &["no arm is called \"ur7\"", "panda, ur5e"]),
        (Robot, "/gripper", json!("claw"), &["no gripper is called \"claw\"", "robotiq_2f85"]),
        (Robot, "/mount/rpy_deg", json!([0, 0]), &["mount.rpy_deg"]),
        (Robot, "/mount/position/2", json!(80), &["mount", "metres"]),
        (Robot, "/home", json!([0.0]), &["home", "6 positions", "got 1"]),
        (Robot, "/home", json!([0, 0, 4.0, 0, 0, 0]), &["home[2]", "limits of elbow", "got 4"]),
        (Robot, "/gains", json!({"kp": [1, 2, 3, 4, 5, 6, 7]}), &["kp", "1 to 6 positive gains"]),
        (Robot, "/limits", json!({"joint9": {}}), &["limits.joint9", "shoulder_pan"]),
        (Robot, "/limits", json!({"elbow": {"upper": 9}}), &["limits.elbow.upper", "as the arm allows", "got 9"]),
        (Robot, "/limits", json!({"elbow": {"max_effort": 0}}), &["limits.elbow.max_effort", "positive"]),
        (Robot, "/never_colliding/0/0", json!("leg"), &["never_colliding[0]", "leg"]),
        (Robot, "/color", json!("red"), &["unknown field `color`"]),
        (Arm, "/links/1/parent", json!("wrist_3"), &["arm ur5e", "links[1] (shoulder).parent", "earlier link: base"]),
        (Arm, "/links/0/parent", json!("base"), &["links[0] (base).parent", "none"]),
        (Arm, "/links/1/name", json!("base"), &["links[1] (base).name", "a unique name"]),
        (Arm, "/links/2/mass_kg", json!("heavy"), &["links[2].mass_kg"]),
        (Arm, "/links/2/mass_kg", json!(-1), &["links[2] (upper_arm).mass_kg", "positive", "-1"]),
        (Arm, "/links/2/inertia", json!([1, 1, -1, 0, 0, 0]), &["links[2] (upper_arm).inertia", "positive definite"]),
        (Arm, "/links/3/position", json!([425, 0, 0]), &["links[3] (forearm).position", "metres"]),
        (Arm, "/links/1/joint/axis", json!([0, 0, 2]), &["links[1] (shoulder).joint.axis", "unit vector"]),
        (Arm, "/links/1/joint/upper", json!(360), &["links[1] (shoulder).joint.upper", "radians"]),
        (Arm, "/links/1/joint/upper", json!(-7), &["joint.upper", "more than lower"]),
        (Arm, "/links/1/joint/max_velocity", json!(0), &["joint.max_velocity", "positive"]),
        (Arm, "/links/2/joint/name", json!("shoulder_pan"), &["links[2] (upper_arm).joint.name", "a unique name"]),
        (Arm, "/links/2/parts/0", json!({"block": {"size": [0, 0, 0], "finish": {"color": "#fff"}}}), &["parts[0]"]),
        (Arm, "/tool_link", json!("hand"), &["tool_link", "wrist_3", "\"hand\""]),
        (Arm, "/tool_link", json!("forearm"), &["tool_link", "behind all 6 joints", "behind 3"]),
        (Arm, "/sources", json!({}), &["sources", "origin"]),
        (Arm, "/drives/armature", json!(-1), &["drives.armature"]),
        (Arm, "/reach/from_above_m", json!([0.8, 0.2]), &["reach", "from_above_m[0] < from_above_m[1]"]),
        (Gripper, "/fingers/0", json!("thumb"), &["gripper robotiq_2f85", "fingers[0]", "left_finger, right_finger"]),
        (Gripper, "/fingers", json!(["right_finger", "left_finger"]), &["joint.axis", "frame of the hand"]),
        (Gripper, "/max_width", json!(85), &["max_width", "metres"]),
        (Gripper, "/max_width", json!(0.1), &["joint.upper", "half of max_width"]),
        (Gripper, "/drives/force_n", json!(300), &["drives.force_n", "max_force, 235"]),
        (Gripper, "/links/1/joint/kind", json!("revolute"), &["joint.kind", "prismatic"]),
        (Gripper, "/links/1/parts/2/block/at/1", json!(0.02), &["links[1] (left_finger).parts", "y = 0", "0.0050 m"]),
        (Gripper, "/links/0/name", json!("gripper"), &["another name"]),
    ];
    for (kind, pointer, value, places) in cases {
        let mut file = sound(kind);
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match file.pointer_mut(pointer) {
            Some(place) => *place = value.clone(),
            None => {
                let map = file.pointer_mut(parent).unwrap().as_object_mut().unwrap();
                map.insert(key.to_owned(), value.clone());
            }
        }
        let error = with_changed(kind, &file).map(|robot| robot.name).unwrap_err();
        let text = error.to_string();
        for place in places {
            assert!(text.contains(place), "{pointer} = {value}: {text:?} does not name {place:?}");
        }
    }
}

#[test]
fn a_registered_robot_is_found_and_keeps_its_name_to_itself() {
    let mut file = sound(PartKind::Robot);
    file["name"] = json!("registered_for_a_test");
    let robot = composed(&file).unwrap();
    assert!(robots::named("registered_for_a_test").is_err());
    robots::register("mine.json", robot.clone()).unwrap();
    assert_eq!(robots::named("registered_for_a_test").unwrap().physics_hash(), robot.physics_hash());
    assert!(robots::names().contains(&"registered_for_a_test".to_owned()));
    robots::register("mine.json", robot).unwrap();
    file["name"] = json!("panda");
    let error = robots::register("mine.json", composed(&file).unwrap()).unwrap_err().to_string();
    assert!(error.contains("mine.json") && error.contains("a unique name"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any number anywhere in a file gives a usable robot or a refusal that names the file, and never a panic.
    #[test]
    fn any_number_is_used_or_refused(which in 0usize..3, place in any::<prop::sample::Index>(), value in prop_oneof![
        Just(0.0), Just(-1.0), Just(1e-9), Just(1e300), -10.0..10.0f64,
    ]) {
        let kind = [PartKind::Robot, PartKind::Arm, PartKind::Gripper][which];
        let mut file = sound(kind);
        let mut numbers = Vec::new();
        collect_numbers(&file, String::new(), &mut numbers);
        let pointer = place.get(&numbers).clone();
        *file.pointer_mut(&pointer).unwrap() = json!(value);
        match with_changed(kind, &file) {
            Ok(robot) => {
                let poses = robot.link_poses(&robot.home, robot.gripper.max_width);
                prop_assert!(poses.iter().all(|pose| pose.position.is_finite()), "{pointer} = {value}");
                let sliding = |finger: usize| robot.links[finger].joint.as_ref().map(|joint| joint.kind);
                prop_assert!(robot.gripper.fingers.into_iter().all(|it| sliding(it) == Some(JointKind::Prismatic)));
            }
            Err(AssetError::Data { file, message }) => prop_assert!(!file.is_empty() && !message.is_empty()),
            Err(other) => prop_assert!(false, "{pointer} = {value}: {other}"),
        }
    }
}

/// JSON pointers of all numbers but those of shapes, which have checks of their own.
fn collect_numbers(value: &Value, pointer: String, found: &mut Vec<String>) {
    match value {
        Value::Number(_) => found.push(pointer),
        Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                collect_numbers(item, format!("{pointer}/{index}"), found);
            }
        }
        Value::Object(map) => {
            for (key, item) in map.iter().filter(|(key, _)| *key != "parts") {
                collect_numbers(item, format!("{pointer}/{key}"), found);
            }
        }
        _ => {}
    }
}

use std::sync::Arc;

use genmanip_core::{Seed, glam::DVec3};
use rand::RngExt;

use super::*;
use crate::{IkSettings, InverseKinematics, Planner, PlannerSettings, PlanningScene};

/// Six joints like those of many industrial arms, one with a different axis, plus a rail and a tool.
const ARM: &str = r#"<robot name="six">
  <link name="world"/>
  <link name="base"><collision><geometry><cylinder radius="0.08" length="0.1"/></geometry></collision></link>
  <joint name="foot" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0 0 0.05"/></joint>
  <link name="shoulder"><collision><geometry><sphere radius="0.07"/></geometry></collision></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="shoulder"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2"/></joint>
  <link name="upper"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.08 0.08 0.3"/></geometry></collision></link>
  <joint name="j2" type="revolute"><parent link="shoulder"/><child link="upper"/><origin xyz="0 0 0.1" rpy="0 0.1 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2"/></joint>
  <link name="fore"><collision><origin xyz="0.2 0 0"/><geometry><mesh filename="fore.obj" scale="1 1 1"/></geometry></collision></link>
  <joint name="j3" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 2 0"/><limit lower="-2.5" upper="2.5" velocity="2"/></joint>
  <link name="roll"/>
  <joint name="j4" type="continuous"><parent link="fore"/><child link="roll"/><origin xyz="0.4 0 0"/><axis xyz="1 0 0"/></joint>
  <link name="pitch"/>
  <joint name="j5" type="revolute"><parent link="roll"/><child link="pitch"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2"/></joint>
  <link name="flange"/>
  <joint name="j6" type="revolute"><parent link="pitch"/><child link="flange"/><origin xyz="0.1 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-3" upper="3" velocity="2"/></joint>
</robot>"#;

const BRICK: &str = "v -0.15 -0.03 -0.03\nv 0.15 -0.03 -0.03\nv -0.15 0.03 -0.03\nv 0.15 0.03 -0.03\n\
                     v -0.15 -0.03 0.03\nv 0.15 -0.03 0.03\nv -0.15 0.03 0.03\nv 0.15 0.03 0.03\nv 0 0 0\n";

fn file(bytes: Vec<u8>) -> Result<MeshFile, String> {
    Ok(MeshFile { name: "fore.obj".into(), bytes })
}

fn brick(name: &str) -> Result<MeshFile, String> {
    if name == "fore.obj" { file(BRICK.into()) } else { Err("no such file".into()) }
}

fn six() -> RobotModel {
    read_robot(ARM, None, None, &mut brick).unwrap()
}

#[test]
fn another_arm_is_read_and_moved() {
    let robot = six();
    assert_eq!((robot.arm_dof(), robot.links[robot.hand].name.as_str()), (6, "flange (tool)"));
    let planner = Planner::new(Arc::new(robot), PlannerSettings::default()).unwrap();
    let chain = crate::Chain::new(planner.robot()).unwrap();
    let ik = InverseKinematics::new(chain.clone(), IkSettings::default());
    assert!(!ik.is_analytic());
    let mut rng = Seed::new(5).rng();
    for _ in 0..20 {
        let config: Vec<f64> = (0..6).map(|_| rng.random_range(-1.2..1.2)).collect();
        let wanted = planner.tcp_pose(&config);
        let solutions = planner.ik(&wanted, &planner.robot().home);
        assert!(!solutions.is_empty(), "{config:?}");
        for solution in &solutions {
            let found = planner.tcp_pose(solution);
            assert!(found.position.distance(wanted.position) < 1e-9 && found.angle_to(&wanted) < 1e-8);
        }
        // Each column of the Jacobian against central differences.
        for (joint, column) in chain.jacobian(&config).iter().enumerate() {
            let moved = |step: f64| {
                let mut config = config.clone();
                config[joint] += step;
                chain.tcp_pose(&config)
            };
            let (before, after) = (moved(-1e-6), moved(1e-6));
            let linear = (after.position - before.position) / 2e-6;
            let turn = (after.rotation * before.rotation.inverse()).to_scaled_axis() / 2e-6;
            let expected = [linear.x, linear.y, linear.z, turn.x, turn.y, turn.z];
            assert!(column.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-7), "{column:?} {expected:?}");
        }
    }
    let (world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
    let around = PlanningScene { world: &world, attached: None, allowed: &allowed, gripper_width: 0.0 };
    let (start, goal) = (vec![0.0; 6], vec![1.5, 0.5, 0.5, 1.0, -0.5, 1.0]);
    let path = planner.plan_joint(&around, &start, &[goal], Seed::new(1)).unwrap();
    assert!(path.states(0.02).iter().all(|state| planner.check(&around, state).is_none()));
}

#[test]
fn the_balls_of_a_loaded_robot_hold_its_meshes() {
    let robot = six();
    let shape = RobotShape::new(&robot).unwrap();
    let fore = robot.links.iter().position(|link| link.name == "fore").unwrap();
    let mut rng = Seed::new(6).rng();
    for _ in 0..500 {
        let t = DVec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
        let point = DVec3::new(0.2, 0.0, 0.0) + t * DVec3::new(0.15, 0.03, 0.03);
        let outside = shape.links[fore].cover.iter().map(|b| b.ball.center.distance(point) - b.ball.radius);
        assert!(outside.fold(f64::MAX, f64::min) < 1e-9, "{point}");
    }
}

#[test]
fn every_flaw_has_its_own_message() {
    let cases: [(&str, &str, &str); 13] = [
        ("<robot name", "<rowboat name", "not well-formed XML"),
        (
            "<parent link=\"base\"/>",
            "<parent link=\"bass\"/>",
            "joint j1, as parent, refers to link bass, which does not exist",
        ),
        ("<link name=\"roll\"/>", "<link name=\"roll\"/><link name=\"roll\"/>", "there are two links named roll"),
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"/><link name=\"loose\"/>",
            "a tree with one base: loose, world have",
        ),
        ("<parent link=\"world\"/>", "<parent link=\"flange\"/>", "a tree with one base: base is part of a cycle"),
        ("<child link=\"roll\"/>", "<child link=\"upper\"/>", "link upper is the child of two joints"),
        ("xyz=\"0 0 0.4\"", "xyz=\"0 0 nan\"", "joint j3: xyz should be three finite numbers, got \"0 0 nan\""),
        ("lower=\"-2.5\"", "lower=\"inf\"", "joint j3: lower should be a finite number, got \"inf\""),
        ("lower=\"-2.5\"", "lower=\"2.6\"", "joint j3: limit should be an interval, got \"2.6..2.5\""),
        ("xyz=\"0 2 0\"", "xyz=\"0 0 0\"", "joint j3: axis should be a direction"),
        ("fore.obj", "gone.obj", "mesh gone.obj of link fore: no such file"),
        (
            "type=\"continuous\"",
            "type=\"floating\"",
            "joint j4: type should be fixed, revolute, continuous or prismatic",
        ),
        (
            "radius=\"0.07\"",
            "radius=\"-0.07\"",
            "link shoulder: size of the collision geometry should be 1e-6 to 10.0 m, got -0.14",
        ),
    ];
    for (old, new, message) in cases {
        assert!(ARM.contains(old), "{old}");
        let error = read_robot(&ARM.replacen(old, new, 1), None, None, &mut brick).unwrap_err().to_string();
        assert!(error.contains(message), "{old} -> {new}: {error}");
    }
    let error = |urdf: &str, tip, mesh: &mut dyn FnMut(&str) -> Result<MeshFile, String>| {
        read_robot(urdf, None, tip, mesh).unwrap_err().to_string()
    };
    assert!(error(ARM, Some("claw"), &mut brick).contains("refers to link claw, which does not exist"));
    assert!(error(ARM, None, &mut |_| file(vec![0; limits::MESH.bytes as usize + 1])).contains("at most"));
    assert!(error(ARM, None, &mut |_| file(b"v 1 2\n".to_vec())).contains("line 1: expected three numbers"));
    assert!(error(ARM, None, &mut |_| file(b"v 1 2 3\n".to_vec())).contains("a body needs at least 4"));
    assert!(error(ARM, None, &mut |_| file(b"v nan 2 3\n".to_vec())).contains("not finite"));
    let many = "<link name=\"x\"/>".repeat(MAX_LINKS + 1);
    assert!(error(&format!("<robot>{many}</robot>"), None, &mut brick).contains("at most 512 are allowed"));
    assert_eq!(error("<robot><link name=\"a\"/></robot>", None, &mut brick), "no joint moves");
}

/// Invalid robots: each cost minutes, gigabytes or a panic before descriptions were validated.
#[test]
fn robots_that_cannot_be_are_refused_with_a_hint() {
    let cases = [
        // In millimetres.
        ("xyz=\"0 0 0.4\"", "xyz=\"0 0 400\"", "link fore: origin should be -10.0 to 10.0 m, got 400.0", "millimetres"),
        ("radius=\"0.08\"", "radius=\"80\"", "link base: size of the collision geometry", "millimetres"),
        ("length=\"0.1\"", "length=\"300\"", "link base: size of the collision geometry", "millimetres"),
        ("radius=\"0.08\"", "radius=\"1e200\"", "link base: size of the collision geometry", "millimetres"),
        ("radius=\"0.08\"", "radius=\"1e5\"", "link base: size of the collision geometry", "millimetres"),
        ("radius=\"0.08\"", "radius=\"1e-300\"", "link base: size of the collision geometry", "without extent"),
        ("scale=\"1 1 1\"", "scale=\"1000 1000 1000\"", "link fore: size of the collision geometry", "scale="),
        ("xyz=\"0 0 0.2\"/>\n    <axis", "xyz=\"0 0 9.9\"/>\n    <axis", "reach should be at most 10 m", "millimetres"),
        // Joints.
        ("lower=\"-2.5\" upper=\"2.5\"", "lower=\"-1e308\" upper=\"1e308\"", "joint j3: limit should be", "degrees"),
        ("lower=\"-2.5\" upper=\"2.5\"", "lower=\"-143\" upper=\"143\"", "joint j3: limit should be", "degrees"),
        ("lower=\"-2.5\" upper=\"2.5\"", "lower=\"0\" upper=\"1e-320\"", "joint j3: range of the limits", "fixed"),
        ("upper=\"2.5\" velocity=\"2\"", "upper=\"2.5\" velocity=\"1e-6\"", "joint j3: velocity", "within 1000 s"),
        ("upper=\"2.5\" velocity=\"2\"", "upper=\"2.5\" velocity=\"1e-5\"", "joint j3: velocity", "within 1000 s"),
        ("upper=\"2.5\" velocity=\"2\"", "upper=\"2.5\" velocity=\"1e30\"", "joint j3: velocity", "within 1000 s"),
        ("upper=\"2.5\" velocity=\"2\"", "upper=\"2.5\" effort=\"-1\" velocity=\"2\"", "joint j3: effort", "N·m"),
        // Values that planning does not use but the reader can validate.
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"><inertial><mass value=\"-1\"/></inertial></link>",
            "link roll: mass should be 0.0 to 100000.0 kg",
            "masses are in kg",
        ),
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"><inertial><mass value=\"1\"/><inertia ixx=\"1e300\"/></inertial></link>",
            "link roll: inertia should be",
            "masses are in kg",
        ),
    ];
    for (old, new, message, hint) in cases {
        assert!(ARM.contains(old), "{old}");
        let error = read_robot(&ARM.replacen(old, new, 1), None, None, &mut brick).unwrap_err();
        assert!(
            error.to_string().contains(message) && error.hint().contains(hint),
            "{new}: {error} ({})",
            error.hint()
        );
    }
    // Too many elements.
    let joint = |index: usize| {
        format!(
            "<link name=\"l{}\"/><joint name=\"j{index}\" type=\"revolute\"><parent link=\"l{index}\"/>\
             <child link=\"l{}\"/><limit lower=\"-1\" upper=\"1\"/></joint>",
            index + 1,
            index + 1
        )
    };
    let chain: String = (0..510).map(joint).collect();
    let piece = "<collision><geometry><sphere radius=\"0.01\"/></geometry></collision>".repeat(MAX_PIECES + 1);
    for (inside, message) in [
        (format!("<link name=\"l0\"/>{chain}"), "the robot has 510 moving joints, at most 64 are allowed"),
        (format!("<link name=\"l0\">{piece}</link>{}", joint(0)), "the robot has 513 collision pieces"),
    ] {
        let error = read_robot(&format!("<robot>{inside}</robot>"), None, None, &mut brick).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// Triangles without common vertices, spread over a sphere: all their vertices are hull vertices.
#[test]
fn a_mesh_whose_hull_has_too_many_corners_is_refused_at_once() {
    let mut rng = Seed::new(3).rng();
    let mut binary = vec![0; 80];
    binary.extend(10_000_u32.to_le_bytes());
    for _ in 0..10_000 {
        binary.extend([0; 12]);
        for _ in 0..3 {
            let direction = DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
            binary.extend((direction.normalize() * 0.1).as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes));
        }
        binary.extend([0; 2]);
    }
    let error = mesh::hull_corners("ball.stl", &binary, DVec3::ONE).unwrap_err();
    assert!(error.contains("vertices") && error.contains("at most"), "{error}");
}

#[test]
fn meshes_are_read_in_every_spelling() {
    let tetrahedron = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    let mut text = String::from("solid t\n");
    let mut binary = vec![0; 80];
    binary.extend(4_u32.to_le_bytes());
    for face in faces {
        binary.extend([0; 12]);
        for corner in face.map(|index: usize| tetrahedron[index]) {
            text += &format!("vertex {} {} {}\n", corner.x, corner.y, corner.z);
            binary.extend(corner.as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes));
        }
        binary.extend([0; 2]);
    }
    for bytes in [text.into_bytes(), binary] {
        let corners = mesh::hull_corners("t.STL", &bytes, DVec3::splat(0.5)).unwrap();
        assert_eq!(corners.len(), 4);
        assert!(tetrahedron.iter().all(|corner| corners.contains(&(*corner * 0.5))), "{corners:?}");
    }
    assert!(mesh::hull_corners("t.dae", b"", DVec3::ONE).unwrap_err().contains("STL or OBJ"));
}

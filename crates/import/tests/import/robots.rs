//! Robots from URDF: every kind of geometry and joint, where meshes are found, and what is refused or noted.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, RobotModel, Seed, Shape};
use genmanip_import::robots::{self, Choices, MAX_LINKS, MAX_PIECES, PlannedRobot, Settings, add};
use genmanip_motion::{AllowedCollisions, Chain, CollisionWorld, Planner, PlannerSettings, PlanningScene};

/// Six joints like those of many industrial arms, one with a different axis, plus a rail and a tool.
pub const ARM: &str = r#"<robot name="six">
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

pub const BRICK: &str = "v -0.15 -0.03 -0.03\nv 0.15 -0.03 -0.03\nv -0.15 0.03 -0.03\nv 0.15 0.03 -0.03\n\
                     v -0.15 -0.03 0.03\nv 0.15 -0.03 0.03\nv -0.15 0.03 0.03\nv 0.15 0.03 0.03\nv 0 0 0\n";

/// Reads a robot from files in a folder, the first of which is the URDF.
pub fn read_files(files: &[(&str, &[u8])], choices: Choices) -> Result<PlannedRobot, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
    robots::read(&folder.path().join(files[0].0), &Settings { choices, ..Settings::default() }).map_err(|error| {
        let cause = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
        format!("{cause} ({})", error.hint().unwrap_or_default())
    })
}

pub fn read(urdf: &str) -> Result<PlannedRobot, String> {
    read_files(&[("arm.urdf", urdf.as_bytes()), ("fore.obj", BRICK.as_bytes())], Choices::default())
}

fn six() -> RobotModel {
    read(ARM).unwrap().model
}

pub fn with(old: &str, new: &str) -> Result<PlannedRobot, String> {
    assert!(ARM.contains(old), "{old}");
    read(&ARM.replacen(old, new, 1))
}

/// Checks the notes, and the planner's path between configurations: its joint distance, or the refusal.
fn plan(robot: RobotModel, start: &[f64], goal: &[f64]) -> Result<f64, String> {
    let planner = Planner::new(Arc::new(robot), PlannerSettings::default()).unwrap();
    let (world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
    let around = PlanningScene { world: &world, attached: None, allowed: &allowed, gripper_width: 0.0 };
    let path = planner.plan_joint(&around, start, &[goal.to_vec()], Seed::new(1)).map_err(|error| error.to_string())?;
    assert!(path.states(0.01).iter().all(|state| planner.check(&around, state).is_none()));
    Ok(path.length())
}

#[test]
fn another_arm_is_read_and_moved() {
    let robot = six();
    assert_eq!((robot.arm_dof(), robot.links[robot.hand].name.as_str()), (6, "flange (tool)"));
    let planner = Planner::new(Arc::new(robot.clone()), PlannerSettings::default()).unwrap();
    for step in 0..20 {
        let config: Vec<f64> = (0..6).map(|joint| (f64::from(step * 7 + joint * 3)).sin()).collect();
        let wanted = planner.tcp_pose(&config);
        let solutions = planner.ik(&wanted, &planner.robot().home);
        assert!(!solutions.is_empty(), "{config:?}");
        for solution in solutions {
            assert!(planner.tcp_pose(&solution).position.distance(wanted.position) < 1e-6);
        }
    }
    plan(robot, &[0.0; 6], &[1.5, 0.5, 0.5, 1.0, -0.5, 1.0]).unwrap();
}

#[test]
fn every_flaw_has_its_own_message() {
    let cases = [
        ("<robot name", "<rowboat name", "not XML: expected 'rowboat' tag"),
        ("<parent link=\"base\"/>", "<parent link=\"bass\"/>", "a joint refers to the unknown link `bass`"),
        ("<link name=\"roll\"/>", "<link name=\"roll\"/><link name=\"roll\"/>", "duplicate link name"),
        ("<link name=\"roll\"/>", "<link name=\"roll\"/><link name=\"loose\"/>", "exactly one root link, got 2"),
        ("<parent link=\"world\"/>", "<parent link=\"flange\"/>", "some links form a loop"),
        ("<child link=\"roll\"/>", "<child link=\"upper\"/>", "link `upper` has two parent joints"),
        ("xyz=\"0 0 0.4\"", "xyz=\"0 0 nan\"", "xyz=\"0 0 nan\": expected numbers"),
        ("lower=\"-2.5\"", "lower=\"nan\"", "lower=\"nan\": expected numbers"),
        ("lower=\"-2.5\"", "lower=\"2.6\"", "<joint \"j3\">: expected an increasing range, got 2.6 to 2.5"),
        ("xyz=\"0 2 0\"", "xyz=\"0 0 0\"", "<joint \"j3\">: its axis has no length"),
        ("fore.obj", "gone.obj", "`gone.obj`: no such file (paths are relative"),
        ("fore.obj", "package://gone/none.obj", "no such file (name the package's folder: --package gone=DIR"),
        ("radius=\"0.07\"", "radius=\"-0.07\"", "radius: expected a positive length"),
        ("<link name=\"roll\"/>", "<xacro:roll/>", "must be expanded first (expand it: `xacro"),
        // In millimetres.
        (
            "xyz=\"0 0 0.4\"",
            "xyz=\"0 0 400\"",
            "link fore: origin should be -10.0 to 10.0 m, got 400.0 (is this in millim",
        ),
        ("radius=\"0.08\"", "radius=\"80\"", "link base: size of the collision geometry should be"),
        ("radius=\"0.08\"", "radius=\"1e-300\"", "(remove pieces without extent)"),
        ("scale=\"1 1 1\"", "scale=\"1000 1000 1000\"", "link fore: size of the collision geometry"),
        ("xyz=\"0 0 0.2\"/>\n    <axis", "xyz=\"0 0 9.9\"/>\n    <axis", "reach should be at most 10 m"),
        // Joints.
        (
            "lower=\"-2.5\" upper=\"2.5\"",
            "lower=\"-143\" upper=\"143\"",
            "joint j3: limit should be -100.0 to 100.0 rad, got -143.0 (is this in degrees",
        ),
        ("upper=\"2.5\" velocity=\"2\"", "upper=\"2.5\" velocity=\"1e-6\"", "within 1000 s"),
        ("upper=\"2.5\" velocity=\"2\"", "upper=\"2.5\" effort=\"-1\" velocity=\"2\"", "joint j3: effort"),
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"><inertial><mass value=\"-1\"/></inertial></link>",
            "<mass>: value should be 0.0 to",
        ),
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"><inertial><mass value=\"1\"/><inertia ixx=\"1e8\"/></inertial></link>",
            "<inertia>: ixx should be",
        ),
    ];
    for (old, new, message) in cases {
        let error = with(old, new).unwrap_err();
        assert!(error.contains(message), "{old} -> {new}: {error}");
    }
    let refused = |files: &[(&str, &[u8])], tip: Option<&str>| {
        read_files(files, Choices { tip: tip.map(str::to_owned), ..Choices::default() }).unwrap_err()
    };
    let brick = ("fore.obj", BRICK.as_bytes());
    let arm = ("arm.urdf", ARM.as_bytes());
    assert!(refused(&[arm, brick], Some("claw")).contains("refers to link claw, which does not exist"));
    assert!(refused(&[arm, ("fore.obj", b"v 1 2\n")], None).contains("line 1"));
    let error = refused(&[arm, ("fore.obj", b"v nan 2 3\n")], None);
    assert!(error.contains("fore.obj"), "{error}");
    let one = |text: &str| read(text).unwrap_err();
    assert!(one(&format!("<robot>{}</robot>", "<link name='x'/>".repeat(MAX_LINKS + 1))).contains("513 links"));
    assert!(one("<robot><link name='a'/></robot>").contains("no joint moves"));
    let still = "<robot><link name='a'/><link name='b'/><joint name='j' type='revolute'><parent link='a'/>\
                 <child link='b'/><limit lower='0' upper='0'/></joint></robot>";
    assert!(one(still).contains("no joint moves (the range of every joint is empty"), "{}", one(still));
    assert!(one("<robot name='a'><link").contains("not XML"));
    let joint = |index: usize| {
        let next = index + 1;
        format!(
            "<link name='l{next}'/><joint name='j{index}' type='revolute'><parent link='l{index}'/>\
             <child link='l{next}'/><limit lower='-1' upper='1'/></joint>"
        )
    };
    let chain: String = (0..510).map(joint).collect();
    let piece = "<collision><geometry><sphere radius='0.01'/></geometry></collision>".repeat(MAX_PIECES + 1);
    let error = one(&format!("<robot><link name='l0'/>{chain}</robot>"));
    assert!(error.contains("510 moving joints, at most 128"), "{error}");
    let error = one(&format!("<robot><link name='l0'>{piece}</link>{}</robot>", joint(0)));
    assert!(error.contains("513 collision pieces"), "{error}");
}

/// Flaws of other people's files that are repaired, each with a note.
#[test]
fn common_flaws_are_read_and_noted() {
    let cases: [(&str, &str, &str); 10] = [
        ("velocity=\"2\"", "velocity=\"0\"", "joint j1 states the velocity 0: 1 is assumed"),
        ("velocity=\"2\"", "velocity=\"1e5\"", "joint j1 states the velocity 100000: 1000 is assumed"),
        ("radius=\"0.07\"", "radius=\"0\"", "geometry without extent is left out"),
        ("velocity=\"2\"", "velocity=\"2\" effort=\"0\"", "joint j1 states the effort 0: 1 is assumed"),
        ("lower=\"-2.5\" upper=\"2.5\"", "lower=\"0\" upper=\"0\"", "joint j3 has an empty range: taken as fixed at 0"),
        ("<limit lower=\"-2.5\" upper=\"2.5\" velocity=\"2\"/>", "", "joint j3 states no limits"),
        ("type=\"continuous\"", "type=\"floating\"", "joint of type `floating` to roll treated as fixed"),
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"><visual><geometry><sphere radius=\"0.01\"/></geometry></visual></link>",
            "without collision geometry, so nothing stops: roll",
        ),
        ("<link name=\"roll\"/>", "<link name=\"roll\"/><gz:plugin/>", "tool frame: link flange"),
        (
            "<link name=\"roll\"/>",
            "<link name=\"roll\"><collision><geometry><heightmap/></geometry></collision></link>",
            "unknown kind is left out",
        ),
    ];
    for (old, new, note) in cases {
        let notes = with(old, new).unwrap_or_else(|error| panic!("{new}: {error}")).notes;
        assert!(notes.iter().any(|found| found.contains(note)), "{new}: {notes:?}");
    }
    let visible = ARM.replacen("<link name=\"roll\"/>", cases[7].1, 1);
    let files: [(&str, &[u8]); 2] = [("arm.urdf", visible.as_bytes()), ("fore.obj", BRICK.as_bytes())];
    let robot = read_files(&files, Choices { visuals_collide: true, ..Choices::default() }).unwrap();
    assert!(robot.model.links.iter().any(|link| link.name == "roll" && link.pieces.len() == 1), "{:?}", robot.notes);
}

#[test]
fn meshes_are_found_where_ros_keeps_them() {
    let mesh = "fore.obj";
    for (named, urdf, at) in [
        (
            "package://arm_description/meshes/fore.obj",
            "arm_description/urdf/arm.urdf",
            "arm_description/meshes/fore.obj",
        ),
        ("package://arm_description/meshes/fore.obj", "robots/arm.urdf", "arm_description/meshes/fore.obj"),
        ("package://arm_description/meshes/fore.obj", "src/urdf/arm.urdf", "src/meshes/fore.obj"),
        ("model://arm_description/fore.obj", "a/b/c/arm.urdf", "a/arm_description/fore.obj"),
        ("../meshes/fore.obj", "urdf/arm.urdf", "meshes/fore.obj"),
        ("meshes/fore.obj", "urdf/arm.urdf", "meshes/fore.obj"),
    ] {
        let text = ARM.replace(mesh, named);
        let robot = read_files(&[(urdf, text.as_bytes()), (at, BRICK.as_bytes())], Choices::default());
        assert!(robot.is_ok(), "{named} in {urdf}: {}", robot.unwrap_err());
    }
    // Of two packages with the same path inside, the named one is taken.
    let text = ARM.replace(mesh, "package://other/meshes/fore.obj");
    let files: [(&str, &[u8]); 3] = [
        ("own/urdf/arm.urdf", text.as_bytes()),
        ("own/meshes/fore.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"),
        ("other/meshes/fore.obj", BRICK.as_bytes()),
    ];
    assert_eq!(corners(&read_files(&files, Choices::default()).unwrap().model, "fore"), 8);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("fore.obj"), BRICK).unwrap();
    let place = tempfile::tempdir().unwrap();
    let urdf = place.path().join("arm.urdf");
    fs::write(&urdf, ARM.replace(mesh, "package://far/fore.obj")).unwrap();
    let named = Settings::new(&[("far".to_owned(), folder.path().to_owned())], Choices::default());
    assert!(robots::read(&urdf, &named).is_ok() && robots::read(&urdf, &Settings::default()).is_err());
}

fn corners(robot: &RobotModel, link: &str) -> usize {
    let link = robot.links.iter().find(|found| found.name == link).unwrap();
    let count = |shape: &Shape| if let Shape::Hull { points } = shape { points.len() } else { 0 };
    link.pieces.iter().map(|piece| count(&piece.shape)).sum()
}

#[test]
fn meshes_are_read_in_every_spelling() {
    let tetrahedron = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|corner| corner * 0.2);
    let faces = [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]];
    let (mut text, mut binary) = (String::from("solid t\n"), vec![0; 80]);
    binary.extend(4_u32.to_le_bytes());
    for face in faces {
        binary.extend([0; 12]);
        for corner in face.map(|index: usize| tetrahedron[index]) {
            text += &format!("vertex {} {} {}\n", corner.x, corner.y, corner.z);
            binary.extend(corner.as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes));
        }
        binary.extend([0; 2]);
    }
    let with_tail = [binary.as_slice(), b"made by a program"].concat();
    let dae = r##"<COLLADA version="1.4.1"><asset><unit meter="0.1"/></asset><library_geometries><geometry id="g"><mesh>
        <source id="p"><float_array id="a" count="12">0 0 0 2 0 0 0 2 0 0 0 2</float_array></source>
        <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
        <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2 0 1 3</p></triangles>
        </mesh></geometry></library_geometries></COLLADA>"##;
    let empty = [vec![0; 84], vec![]].concat();
    for (name, bytes, expected) in [
        ("t.STL", text.as_bytes(), 4),
        ("t.stl", binary.as_slice(), 4),
        ("t.stl", with_tail.as_slice(), 4),
        ("t.dae", dae.as_bytes(), 4),
        ("t.stl", empty.as_slice(), 0),
    ] {
        let urdf = ARM.replace("fore.obj", name);
        let robot = read_files(&[("arm.urdf", urdf.as_bytes()), (name, bytes)], Choices::default()).unwrap();
        assert_eq!(corners(&robot.model, "fore"), expected, "{name}: {:?}", robot.notes);
        assert!(expected > 0 || robot.notes.iter().any(|note| note.contains("no triangles")), "{:?}", robot.notes);
    }
}

/// All vertices of a mesh of 30,000 are hull vertices: the hull is simplified outwards, with a note.
#[test]
fn a_dense_hull_is_simplified_with_a_note() {
    let point = |index: usize| {
        let z = 1.0 - (2.0 * index as f64 + 1.0) / 30_000.0;
        let (sin, cos) = (2.4 * index as f64).sin_cos();
        [(1.0 - z * z).sqrt() * cos * 0.1, (1.0 - z * z).sqrt() * sin * 0.1, z * 0.1]
    };
    let obj: String = (0..30_000).map(point).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    let robot = read_files(&[("arm.urdf", ARM.as_bytes()), ("fore.obj", obj.as_bytes())], Choices::default()).unwrap();
    assert!((32..=robots::hulls::MAX_CORNERS).contains(&corners(&robot.model, "fore")));
    assert!(robot.notes.iter().any(|note| note.contains("simplified outwards")), "{:?}", robot.notes);
}

const SMALL: &str = r#"<robot name="small"><link name="base"/><link name="a"/><link name="b"/><link name="hand"/><link name="finger"/>
  <joint name="one" type="continuous"><parent link="base"/><child link="a"/><origin xyz="0 0 0.2"/><axis xyz="0 0 1"/></joint>
  <joint name="two" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="2" effort="9"/></joint>
  <joint name="three" type="revolute"><parent link="b"/><child link="hand"/><origin xyz="0 0 0.2"/><axis xyz="0 1 0"/>
    MIMIC</joint>
  <joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.012" velocity="0.1" effort="20"/></joint></robot>"#;

#[test]
fn a_coupled_joint_follows_and_a_continuous_one_takes_the_short_way() {
    let limits = "<limit lower=\"-2\" upper=\"2\" velocity=\"2\" effort=\"9\"/>";
    let coupled = format!("<mimic joint=\"two\" multiplier=\"-0.5\" offset=\"0.1\"/>{limits}");
    let robot = read(&SMALL.replace("MIMIC", &coupled)).unwrap().model;
    assert_eq!((robot.arm_dof(), robot.links[robot.hand].name.as_str()), (3, "hand (tool)"));
    let chain = Chain::new(&robot).unwrap();
    let config = [0.3, 0.8, 0.004];
    let pose = chain.tcp_pose(&config);
    assert!(pose.position.distance(robot.tcp_pose(&config).position) < 1e-12);
    assert!(
        (pose.rotation.to_scaled_axis().length() - 0.5).abs() > 1e-3,
        "the turn is 0.8 - 0.3 about y, after 0.3 about z"
    );
    let column = chain.jacobian(&config)[1];
    let moved = |step: f64| chain.tcp_pose(&[0.3, 0.8 + step, 0.004]);
    let turn = (moved(1e-6).rotation * moved(-1e-6).rotation.inverse()).to_scaled_axis() / 2e-6;
    assert!(DVec3::new(column[3], column[4], column[5]).distance(turn) < 1e-6 && (turn.length() - 0.5).abs() < 1e-6);

    let robot = read(&SMALL.replace("MIMIC", limits)).unwrap().model;
    let length = plan(robot.clone(), &[3.0, 0.3, 0.3, 0.0], &[-3.0, 0.3, 0.3, 0.0]).unwrap();
    assert!((length - 0.2832).abs() < 1e-3, "{length}");
    let length = plan(robot, &[3.5, 0.3, 0.3, 0.0], &[3.4 - 4.0 * std::f64::consts::PI, 0.3, 0.3, 0.01]).unwrap();
    assert!((length - 0.1).abs() < 2e-3, "{length}");
}

/// Poses of a short slide are found, and its fingers are behind the tool frame.
#[test]
fn a_short_slide_keeps_most_of_its_range() {
    let limits = "<limit lower=\"-2\" upper=\"2\" velocity=\"2\" effort=\"9\"/>";
    let robot = read(&SMALL.replace("MIMIC", limits)).unwrap();
    assert!(robot.notes.iter().any(|note| note.contains("tool frame: link hand; another one by --tip")));
    let planner = Planner::new(Arc::new(robot.model), PlannerSettings::default()).unwrap();
    let range = &planner.ranges()[3];
    assert!(*range.start() < 0.001 && *range.end() > 0.011, "{range:?}");
    let wanted = planner.tcp_pose(&[0.5, 0.7, -0.4, 0.006]);
    assert!(!planner.ik(&wanted, &planner.robot().home).is_empty());
}

/// The upper arm always passes 2 mm beside the base: without an SRDF, no motion would keep 3 mm.
#[test]
fn links_that_are_always_near_are_not_checked() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/robots/close_links");
    // The base of the second arm as exporters of meshes make it: a prism of 24 sides.
    let corner = |side: u32, z: f64| {
        let (sin, cos) = (f64::from(side) * std::f64::consts::TAU / 24.0).sin_cos();
        format!("v {} {} {z}\n", 0.07 * cos, 0.07 * sin)
    };
    let base: String = (0..24).map(|side| corner(side, 0.0) + &corner(side, 0.3)).collect();
    for name in ["arm.urdf", "arm_prism.urdf"] {
        let urdf = fs::read(folder.join(name)).unwrap();
        let robot = read_files(&[(name, &urdf), ("base.obj", base.as_bytes())], Choices::default()).unwrap();
        let note = robot.notes.iter().find(|note| note.contains("SRDF")).unwrap();
        assert!(note.contains("base and upper"), "{note}");
        for (start, goal) in
            [([0.0, 0.4, 0.5, 0.0], [1.2, 1.0, 0.9, 0.5]), ([0.0, 0.2, 0.5, 0.0], [-1.2, -0.7, 0.9, 0.5])]
        {
            plan(robot.model.clone(), &start, &goal).unwrap();
        }
    }
}

/// Five joints meet every pose that points down, and small tilts nearly; large ones are out of reach.
/// Upright arm with five joints, each so far above the one before, m.
fn five(up: [f64; 5]) -> String {
    let turn = |name: &str, parent: &str, child: &str, up: f64, axis: &str| {
        format!(
            "<link name='{child}'/><joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='0 0 {up}'/><axis xyz='{axis}'/><limit lower='-2.8' upper='2.8' velocity='2' effort='9'/></joint>"
        )
    };
    let joints = [
        turn("pan", "base", "a", up[0], "0 0 1"),
        turn("lift", "a", "b", up[1], "0 1 0"),
        turn("elbow", "b", "c", up[2], "0 1 0"),
        turn("flex", "c", "d", up[3], "0 1 0"),
        turn("roll", "d", "e", up[4], "0 0 1"),
    ];
    format!("<robot name='five'><link name='base'/>{}</robot>", joints.concat())
}

/// The gripper of a desk arm points down only near the table: its home lies there.
#[test]
fn a_desk_arm_gets_a_home() {
    let found = add::propose(read(&five([0.04, 0.04, 0.1, 0.1, 0.06])).unwrap(), "desk", None).unwrap();
    assert!(!found.notes.iter().any(|note| note.contains("no posture")), "{:?}", found.notes);
    let tool = found.model.tcp_pose(&found.model.home);
    // Too short to point down above the objects, it looks ahead.
    let approach = tool.transform_vector(DVec3::Z);
    assert!(tool.position.z > 0.19 && approach.z < -0.1 && approach.x > 0.3, "{tool:?}");
}

#[test]
fn an_arm_with_five_joints_meets_what_it_can() {
    let robot = read(&five([0.1, 0.05, 0.2, 0.2, 0.05])).unwrap().model;
    let planner = Planner::new(Arc::new(robot), PlannerSettings::default()).unwrap();
    let down = DQuat::from_rotation_x(std::f64::consts::PI);
    for (yaw, sideways, reached) in [(0.0, 0.0, true), (1.0, 0.0, true), (0.4, 0.03, true), (0.4, 0.4, false)] {
        let tilt = DQuat::from_axis_angle(DVec3::new(0.25, 0.15, 0.0).normalize(), sideways);
        let pose = Pose::new(DVec3::new(0.25, 0.15, 0.12), tilt * DQuat::from_rotation_z(yaw) * down);
        let found = planner.ik(&pose, &planner.robot().home);
        assert_eq!(!found.is_empty(), reached, "yaw {yaw}, tilt {sideways}");
        for config in found {
            let at = planner.tcp_pose(&config);
            let turn = (at.rotation * pose.rotation.inverse()).to_scaled_axis().length();
            assert!(at.position.distance(pose.position) < 3e-4 && turn < 0.061, "{at:?} for {pose:?}");
        }
    }
}

/// `robot add` keeps joints without end stops, and refuses an arm with a joint that follows another one.
#[test]
fn proposed_files_keep_continuous_joints_and_refuse_coupled_ones() {
    let found = add::propose(read(ARM).unwrap(), "six", None).unwrap();
    let is_continuous: Vec<bool> = found.model.arm_joints().map(|joint| joint.continuous).collect();
    assert_eq!(is_continuous, [false, false, false, true, false, false]);
    let joint = |file: &serde_json::Value, name: &str| {
        let links = file["links"].as_array().unwrap();
        links.iter().find(|link| link["joint"]["name"] == name).unwrap()["joint"]["continuous"].clone()
    };
    assert_eq!((joint(&found.arm, "j4"), joint(&found.arm, "j3")), (true.into(), serde_json::Value::Null));
    let coupled = ARM.replace("<limit lower=\"-2.5\"", "<mimic joint=\"j2\" multiplier=\"-1\"/><limit lower=\"-2.5\"");
    let error = add::propose(read(&coupled).unwrap(), "six", None).unwrap_err();
    let cause = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
    assert!(cause.contains("j3 follows j2"), "{error}: {cause}");
}

/// Flaws of public files that leave no doubt about the robot: read, with a note.
#[test]
fn flaws_without_doubt_are_read_with_a_note() {
    let noted = |old: &str, new: &str, note: &str| {
        let read = with(old, new).unwrap_or_else(|error| panic!("{old} -> {new}: {error}"));
        assert!(read.notes.iter().any(|said| said.contains(note)), "{old} -> {new}: {:?}", read.notes);
        read.model
    };
    let joint = |model: &RobotModel, name: &str| {
        model.arm_joints().find(|joint| joint.name == name).unwrap_or_else(|| panic!("{name}")).clone()
    };
    // What a joint follows does not exist: it keeps its own limits.
    let limits = "<limit lower=\"-2.5\" upper=\"2.5\" velocity=\"2\"/>";
    let model = noted(limits, &format!("{limits}<mimic joint=\"j9\"/>"), "joint j3 follows j9, which does not exist");
    let found = joint(&model, "j3");
    assert_eq!((found.lower, found.upper, found.mimic), (-2.5, 2.5, None));
    // Limits that mean none.
    let endless = "lower=\"-1e+16\" upper=\"1e+16\"";
    let model = noted("lower=\"-2.5\" upper=\"2.5\"", endless, "joint j3 has limits of more than 1000 rad");
    assert!(joint(&model, "j3").continuous);
    let slide = [
        "type=\"fixed\"><parent link=\"world\"/>",
        "type=\"prismatic\"><limit lower=\"-999999\" upper=\"999999\"/><parent link=\"world\"/>",
    ];
    let model = noted(slide[0], slide[1], "joint foot has limits of more than 50000 m: -5 to 5 m are assumed");
    assert_eq!((joint(&model, "foot").lower, joint(&model, "foot").upper), (-5.0, 5.0));
    // A part of a robot hangs from a link of the whole.
    let model = noted("<link name=\"world\"/>", "", "link world is not described: it is taken as an empty base");
    assert_eq!(model.links[0].name, "world");
    assert_eq!(model.arm_dof(), 6);
}

/// An SRDF may name links of another gripper.
#[test]
fn pairs_of_links_that_do_not_exist_are_left_out_of_an_srdf() {
    let srdf = r#"<robot name="six"><disable_collisions link1="base" link2="upper"/>
        <disable_collisions link1="base" link2="claw"/></robot>"#;
    let files = [("arm.urdf", ARM.as_bytes()), ("fore.obj", BRICK.as_bytes()), ("arm.srdf", srdf.as_bytes())];
    let read = read_files(&files, Choices::default()).unwrap();
    assert!(read.notes.iter().any(|note| note.ends_with("are left out: claw")), "{:?}", read.notes);
    let index = |name: &str| read.model.links.iter().position(|link| link.name == name).unwrap();
    assert!(read.model.never_colliding.contains(&(index("base"), index("upper"))));
}

/// The reach of a mesh whose origin and vertices cancel is that of its vertices.
#[test]
fn meshes_modelled_in_the_frame_of_the_base_do_not_count_twice() {
    let far: String = BRICK
        .lines()
        .map(|line| {
            let [x, y, z] = line.split(' ').skip(1).map(|value| value.parse::<f64>().unwrap()).collect::<Vec<_>>()[..]
            else {
                panic!("{line}")
            };
            format!("v {} {y} {z}\n", x + 6.0)
        })
        .collect();
    let text = ARM.replace("<origin xyz=\"0.2 0 0\"/>", "<origin xyz=\"-5.8 0 0\"/>");
    read_files(&[("arm.urdf", text.as_bytes()), ("fore.obj", far.as_bytes())], Choices::default()).unwrap();
}

/// Jaws of the URDF give way to a gripper whose fingertips meet where they met; a small arm gets a small one.
#[test]
fn a_gripper_takes_the_place_of_the_jaws() {
    let jaws = r#"<link name="tip"/>
  <joint name="tip_joint" type="fixed"><parent link="flange"/><child link="tip"/><origin xyz="0.2 0 0"/></joint>
  <link name="jaw"/>
  <joint name="jaw_joint" type="revolute"><parent link="flange"/><child link="jaw"/><origin xyz="0.05 0.02 0"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1" velocity="2"/></joint>
</robot>"#;
    let shape = "<link name=\"flange\"><collision><geometry><sphere radius=\"0.03\"/></geometry></collision></link>";
    let whole = ARM.replace("</robot>", jaws).replace("<link name=\"flange\"/>", shape);
    let proposed = |text: &str, gripper: Option<&str>| {
        let read = read(text).unwrap();
        let flange = read.model.links.iter().position(|link| link.name == "flange").unwrap();
        let tool = read.model.link_poses(&read.model.home, 0.0)[flange] * Pose::from_position(DVec3::X * 0.2);
        let found = add::propose(read, "six", gripper).unwrap();
        let zero = vec![0.0; found.model.arm_dof()];
        let tcp = found.model.link_poses(&zero, 0.0)[found.model.hand] * found.model.hand_from_tcp;
        (found, tcp.position.distance(tool.position))
    };
    let (found, off_m) = proposed(&whole, None);
    assert!(off_m < 1e-6 && found.robot["gripper"] == "panda_hand", "{off_m}: {}", found.robot);
    let flange = found.model.links.iter().find(|link| link.name == "flange").unwrap();
    assert!(flange.pieces.is_empty() && found.model.arm_dof() == 6);
    assert!(found.notes.iter().any(|note| note.ends_with("shapes are left out: flange")), "{:?}", found.notes);
    assert!(proposed(&whole, Some("robotiq_2f85")).1 < 1e-6);
    // Without jaws, the gripper stands on the flange, whose shape stays, or at the tool frame if nothing is ahead of it.
    let stands = |shape: &str| {
        let (found, _) = proposed(&ARM.replace("<link name=\"flange\"/>", shape), None);
        let position = &found.robot["mount"]["position"];
        (position[0].as_f64().unwrap() * 1e3).round()
    };
    let block = |x: f64, y: f64| {
        format!(
            "<link name=\"flange\"><collision><origin xyz=\"{x} {y} 0\"/><geometry><box size=\"0.08 0.04 0.04\"/>\
             </geometry></collision></link>"
        )
    };
    let mounts = [shape, &block(0.05, 0.0), &block(0.05, 0.05), &block(-0.035, 0.0)].map(stands);
    assert_eq!(
        mounts,
        [30.0, 90.0, 0.0, 0.0],
        "a sphere, a block ahead, one beside the axis, one that ends at the frame"
    );
    let (found, _) = proposed(&ARM.replace("<link name=\"flange\"/>", shape), None);
    assert!(found.model.links.iter().any(|link| link.name == "flange" && !link.pieces.is_empty()));
    let small = ARM.replace("xyz=\"0 0 0.4\"", "xyz=\"0 0 0.15\"").replace("xyz=\"0.4 0 0\"", "xyz=\"0.1 0 0\"");
    let small = small.replace("xyz=\"0 0 0.2\"/>\n    <axis", "xyz=\"0 0 0.05\"/>\n    <axis");
    assert_eq!(proposed(&small, None).0.robot["gripper"], "small_jaws");
}

/// A camera behind the flange is no tool frame.
#[test]
fn sensors_are_no_tool_frames() {
    let camera = r#"<link name="end_effector_link"/>
  <joint name="end" type="fixed"><parent link="flange"/><child link="end_effector_link"/></joint>
  <link name="camera_link"/>
  <joint name="eye" type="fixed"><parent link="end_effector_link"/><child link="camera_link"/></joint>
  <link name="camera_color_frame"/>
  <joint name="colour" type="fixed"><parent link="camera_link"/><child link="camera_color_frame"/></joint>
</robot>"#;
    let model = read(&ARM.replace("</robot>", camera)).unwrap().model;
    assert_eq!(model.links[model.hand].name, "end_effector_link");
}

//! URDFs of unusual spelling: encodings, unlimited values, joints that cannot move.

use genmanip_core::glam::DVec3;
use genmanip_core::{Pose, RobotModel};
use genmanip_import::robots::{Choices, add};

use crate::robots::{ARM, BRICK, read, read_files, with};

/// XML in the encodings and with the beginnings that editors and generators leave.
#[test]
fn every_encoding_is_read() {
    const DECLARED: &str = "<?xml version=\"1.0\" encoding=\"UTF-16\"?>\n";
    let text = format!("{DECLARED}{ARM}");
    let wide =
        |unit: fn(u16) -> [u8; 2]| [0xfeff].into_iter().chain(text.encode_utf16()).flat_map(unit).collect::<Vec<u8>>();
    let marked = [b"\xef\xbb\xbf", text.as_bytes()].concat();
    let late = format!("\n\n{text}").into_bytes();
    let commented = format!("<!-- made by hand --> <!-- twice -->\n{text}").into_bytes();
    let latin = [b"<?xml version=\"1.0\" encoding=\"ISO-8859-1\"?><!-- Gr\xf6\xdfe -->", ARM.as_bytes()].concat();
    for (name, bytes) in [
        ("UTF-16 LE", wide(u16::to_le_bytes)),
        ("UTF-16 BE", wide(u16::to_be_bytes)),
        ("UTF-8 with a mark", marked),
        ("blank lines before", late),
        ("comments before", commented),
        ("Latin-1", latin),
    ] {
        let files = [("arm.urdf", bytes.as_slice()), ("fore.obj", b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\n")];
        let read = read_files(&files, Choices::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(read.model.arm_dof(), 6, "{name}");
    }
    let error = read(&format!("\n\n<?xml version=\"1.0\"?>\n{}", ARM.replace("0 0 0.4", "0 0 x"))).unwrap_err();
    assert!(error.contains("line 15"), "lines keep their numbers: {error}");
}

/// Values that mean "unlimited", and a turntable that is slow but has no end stops.
#[test]
fn unlimited_values_are_read_with_a_note() {
    let limits = "lower=\"-2.5\" upper=\"2.5\" velocity=\"2\"";
    for (new, note) in [
        ("lower=\"-2.5\" upper=\"2.5\" velocity=\"inf\"", "joint j3 states the velocity 1000000000: 1000 is assumed"),
        ("lower=\"-2.5\" upper=\"2.5\" velocity=\"1e10\"", "joint j3 states the velocity 1000000000: 1000 is assumed"),
        ("lower=\"-2.5\" upper=\"2.5\" velocity=\"2\" effort=\"inf\"", "joint j3 states the effort 1000000000"),
        (
            "lower=\"-inf\" upper=\"inf\" velocity=\"2\"",
            "joint j3 has limits of more than 1000 rad: taken as continuous",
        ),
    ] {
        let notes = with(limits, new).unwrap_or_else(|error| panic!("{new}: {error}")).notes;
        assert!(notes.iter().any(|found| found.contains(note)), "{new}: {notes:?}");
    }
    with("<axis xyz=\"1 0 0\"/></joint>", "<axis xyz=\"1 0 0\"/><limit velocity=\"0.02\"/></joint>").unwrap();
}

/// Soft limits narrow the range, as MoveIt takes them; those that are wider, absent or contradictory do not.
#[test]
fn soft_limits_narrow_the_range() {
    let limits = "<limit lower=\"-2.5\" upper=\"2.5\" velocity=\"2\"/>";
    for (soft, expected, is_said) in [
        ("soft_lower_limit=\"-2.25\" soft_upper_limit=\"2\"", [-2.25, 2.0], true),
        ("soft_upper_limit=\"2\"", [-2.5, 2.0], true),
        ("soft_lower_limit=\"-2.5\" soft_upper_limit=\"3\"", [-2.5, 2.5], false),
        ("soft_lower_limit=\"0\" soft_upper_limit=\"0\"", [-2.5, 2.5], false),
        ("k_velocity=\"10\"", [-2.5, 2.5], false),
    ] {
        let read = with(limits, &format!("{limits}<safety_controller {soft}/>")).unwrap();
        let joint = read.model.arm_joints().find(|joint| joint.name == "j3").unwrap();
        assert_eq!([joint.lower, joint.upper], expected, "{soft}");
        assert_eq!(read.notes.iter().any(|note| note.contains("soft limits")), is_said, "{soft}: {:?}", read.notes);
    }
    let error = with(limits, &format!("{limits}<safety_controller soft_lower_limit=\"low\"/>")).unwrap_err();
    assert!(error.contains("soft_lower_limit"), "{error}");
}

/// Pose of the flange with j3 at a position and all other joints at 0; without j3 if it does not move.
fn flange(robot: &RobotModel, j3: f64) -> Pose {
    let config: Vec<f64> = robot.arm_joints().map(|joint| if joint.name == "j3" { j3 } else { 0.0 }).collect();
    let flange = robot.links.iter().position(|link| link.name == "flange").unwrap();
    robot.link_poses(&config, 0.0)[flange]
}

/// A joint with an empty range is held at its only position, and what follows it, or a fixed joint, stands where it is
/// put.
#[test]
fn joints_that_cannot_move_are_held_where_they_are() {
    let moving = read(ARM).unwrap().model;
    let limits = "<limit lower=\"-2.5\" upper=\"2.5\" velocity=\"2\"/>";
    let held = "<limit lower=\"0.5\" upper=\"0.5\" velocity=\"2\"/>";
    let side = |limit: &str| {
        format!(
            "<link name=\"side\"/><joint name=\"side\" type=\"revolute\"><parent link=\"world\"/><child \
             link=\"side\"/>{limit}</joint><link name=\"roll\"/>"
        )
    };
    let follow = |leader: &str, side: &str| {
        let follows = format!("{limits}<mimic joint=\"{leader}\" multiplier=\"2\" offset=\"-0.3\"/>");
        read(&ARM.replace(limits, &follows).replace("<link name=\"roll\"/>", side)).unwrap()
    };
    for (name, robot, expected) in [
        ("held", with(limits, held).unwrap(), 0.5),
        ("follows a fixed joint", follow("foot", "<link name=\"roll\"/>"), -0.3),
        ("follows a held joint", follow("side", &side(held)), 0.7),
    ] {
        assert_eq!(robot.model.arm_dof(), 5, "{name}");
        let [found, wanted] = [flange(&robot.model, 0.0), flange(&moving, expected)];
        let turn = found.rotation.angle_between(wanted.rotation);
        assert!(found.position.distance(wanted.position) < 1e-9 && turn < 1e-7, "{name}: {found:?}, not {wanted:?}");
        assert!(
            robot.notes.iter().any(|note| note.contains(&format!("fixed at {expected}"))),
            "{name}: {:?}",
            robot.notes
        );
    }
}

/// Percent-encoded file names of meshes are decoded; a mesh that cannot be read is refused with the reason.
#[test]
fn file_names_of_meshes_are_decoded_or_refused_with_the_reason() {
    let named = |named: &str, file: &str, text: &str| {
        let urdf = ARM.replace("fore.obj", named);
        read_files(&[("arm.urdf", urdf.as_bytes()), (file, text.as_bytes())], Choices::default()).map(drop)
    };
    assert_eq!(named("my%20fore.obj", "my fore.obj", BRICK), Ok(()));
    for (mesh, file, text, message) in [
        ("100%.obj", "fore.obj", BRICK, "`100%.obj`: no such file"),
        ("FORE.OBJ", "fore.obj", BRICK, "fore.obj differs from it in upper and lower case only"),
        ("$(find six)/fore.obj", "fore.obj", BRICK, "an expression of xacro (expand the file first"),
        ("fore.obj", "fore.obj", "version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "a pointer of Git LFS"),
    ] {
        let error = named(mesh, file, text).unwrap_err();
        assert!(error.contains(message), "{mesh}: {error}");
    }
}

/// Other forms are refused with what to do, or read with a note.
#[test]
fn other_forms_are_named() {
    for (old, new, message) in [
        ("xyz=\"0 0 0.4\"", "xyz=\"0 0 ${length}\"", "expected numbers (expand the file first: `xacro FILE"),
        ("xyz=\"0 0 0.4\"", "xyz=\"0, 0, 0.4\"", "(numbers are separated by blanks"),
        ("<link name=\"roll\"/>", "<link name=\"roll\"/><link name=\"eye\"/>", "got 2: eye, world (attach"),
    ] {
        let error = with(old, new).unwrap_err();
        assert!(error.contains(message), "{new}: {error}");
    }
    for (tag, message) in [("sdf", "this is SDF"), ("mujoco", "this is MJCF")] {
        let error = read(&format!("<{tag}/>")).unwrap_err();
        assert!(error.contains(message), "{error}");
    }
    for (old, new, note) in [
        ("rpy=\"0 0.1 0\"", "rpy=\"0 90 0\"", "joint j2 is turned by more than two turns: is its rpy in degrees?"),
        ("lower=\"-2.5\" upper=\"2.5\"", "lower=\"-90\" upper=\"90\"", "joint j3 has limits of more than two turns"),
        ("<sphere radius=\"0.07\"/>", "<sphere radius=\"0.07\"/><box size=\"1 1 1\"/>", "only the first of 2 shapes"),
    ] {
        let notes = with(old, new).unwrap_or_else(|error| panic!("{new}: {error}")).notes;
        assert!(notes.iter().any(|found| found.contains(note)), "{new}: {notes:?}");
    }
}

/// A rotation may be a quaternion, since URDF 1.1; it stands for the same pose as its angles.
#[test]
fn rotations_are_angles_or_quaternions() {
    let turned = |rotation: &str| read(&ARM.replace("rpy=\"0 0.1 0\"", rotation));
    let half = 0.05_f64;
    let quaternion = format!("quat_xyzw=\"0 {} 0 {}\"", 2.0 * half.sin(), 2.0 * half.cos());
    let [angles, quaternion] =
        ["rpy=\"0 0.1 0\"", &quaternion].map(|rotation| flange(&turned(rotation).unwrap().model, 0.5));
    assert!(angles.position.distance(quaternion.position) < 1e-9, "{angles:?} {quaternion:?}");
    assert!(angles.rotation.angle_between(quaternion.rotation) < 1e-6, "{angles:?} {quaternion:?}");
    for (wrong, message) in
        [("rpy=\"0 0 0\" quat_xyzw=\"0 0 0 1\"", "got both"), ("quat_xyzw=\"0 0 0 0\"", "got zeros")]
    {
        let error = turned(wrong).unwrap_err();
        assert!(error.contains(message) && error.contains("line"), "{error}");
    }
}

/// A loop of joints is named as such.
#[test]
fn joints_in_a_loop_are_refused_as_such() {
    let closed = "<joint name=\"back\" type=\"fixed\"><parent link=\"flange\"/><child link=\"world\"/></joint></robot>";
    let error = read(&ARM.replace("</robot>", closed)).unwrap_err();
    assert!(error.contains("form a loop") && error.contains("closes the loop"), "{error}");
}

/// Arms whose tool hangs from a slide, as of SCARA arms: the gripper points down, whichever way the axes point.
#[test]
fn the_gripper_of_a_scara_points_down() {
    let joint = |name: &str, kind: &str, parent: &str, child: &str, origin: &str, axis: &str, limit: &str| {
        format!(
            "<link name='{child}'/><joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='{origin}'/><axis xyz='{axis}'/><limit {limit} velocity='1' effort='50'/></joint>"
        )
    };
    for (axis, limit) in [("0 0 -1", "lower='0' upper='0.3'"), ("0 0 1", "lower='-0.3' upper='0'")] {
        let joints = [
            joint("one", "revolute", "base", "a", "0 0 0.35", "0 0 1", "lower='-2.5' upper='2.5'"),
            joint("two", "revolute", "a", "b", "0.35 0 0", "0 0 1", "lower='-2.5' upper='2.5'"),
            joint("three", "prismatic", "b", "quill", "0.3 0 0", axis, limit),
            joint("four", "revolute", "quill", "tool", "0 0 0", axis, "lower='-3' upper='3'"),
        ];
        let read = read(&format!("<robot name='scara'><link name='base'/>{}</robot>", joints.concat())).unwrap();
        let found = add::propose(read, "scara", None).unwrap();
        let approach = found.model.tcp_pose(&found.model.home).transform_vector(DVec3::Z);
        assert!(approach.z < -0.99 && found.model.reach.is_some(), "{axis}: {approach}, {:?}", found.notes);
    }
}

//! `genmanip-lab motion`: problems from the user's file, for the built-in robot and for one from a folder.

use crate::lab;

/// A motion around a post over a table; then the same with the goal inside the post.
const PROBLEMS: &str = r#"{"seed": 3, "problems": [
  {"id": 0, "start": [0.9, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8], "goal": [-0.9, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8], "obstacles": [
    {"type": "box", "pos": [0.6, 0.0, -0.02], "size": [0.8, 1.2, 0.04], "yaw": 0.0},
    {"type": "cylinder", "pos": [0.55, 0.0, 0.2], "radius": 0.04, "length": 0.4, "yaw": 0.0}]},
  {"id": 1, "start": [0.9, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8], "goal": [0.0, 0.3, 0.0, -2.0, 0.0, 2.3, 0.8], "obstacles": [
    {"type": "box", "pos": [0.55, 0.0, 0.2], "size": [0.2, 0.2, 0.6], "yaw": 0.3}]}]}"#;

const TURNTABLE: &str = r#"<robot name="turntable"><link name="base"/>
  <link name="arm"><collision><origin xyz="0.3 0 0.1"/><geometry><mesh filename="package://m/bar.obj"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1"/></joint>
  <link name="tool"/>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="tool"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" velocity="1"/></joint></robot>"#;

const BAR: &str = "v -.2 -.02 -.02\nv .2 -.02 -.02\nv -.2 .02 -.02\nv .2 .02 -.02\n\
                   v -.2 -.02 .02\nv .2 -.02 .02\nv -.2 .02 .02\nv .2 .02 .02\n";

#[test]
fn lab_motion_plans_and_tests_again() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("problems.json"), PROBLEMS).unwrap();
    let arguments = "motion --problems problems.json --paths paths.json --ik-poses 200 --json";
    let arguments: Vec<&str> = arguments.split(' ').collect();
    let measured = lab(folder.path(), &arguments).json(0);
    assert_eq!((&measured["problems"], &measured["solved"]), (&2.into(), &1.into()), "{measured}");
    assert_eq!((&measured["invalid_paths"], &measured["limits_exceeded"]), (&0.into(), &0.into()), "{measured}");
    assert!(measured["failures"][0].as_str().unwrap().contains("every goal is in collision"), "{measured}");
    assert_eq!((&measured["ik"]["solved"], &measured["ik"]["poses"]), (&200.into(), &200.into()), "{measured}");
    for key in ["time_scaling_ms", "ik_us"] {
        assert!(measured[key].as_f64().unwrap() > 0.0, "{measured}");
    }
    // The camera sees post and box; inside the box, seen from outside, the goal touches no visible point.
    let depth = &measured["depth"];
    assert_eq!((&depth["problems"], &depth["touching_cloud"]), (&2.into(), &0.into()), "{measured}");
    let counted = |key: &str| depth[key].as_u64().unwrap();
    assert_eq!(counted("planned") + counted("start_or_goal_in_cloud"), 2, "{measured}");
    assert!(counted("solved") >= 1 && depth["points"].as_f64().unwrap() > 100.0, "{measured}");
    assert!(measured["depth_to_path_ms"]["p95"].as_f64().unwrap() > 0.0, "{measured}");
    // The post blocks the straight path of 1.8 rad.
    let length = measured["path_length_rad"]["median"].as_f64().unwrap();
    assert!(length > 1.81 && length < 8.0 && measured["cpu_ms"]["median"].as_f64().unwrap() > 0.0, "{measured}");
    let paths: serde_json::Value = serde_json::from_slice(&std::fs::read(at("paths.json")).unwrap()).unwrap();
    assert!(paths[0].as_array().unwrap().len() > 90 && paths[1].is_null(), "{paths}");
    // Only the first problem.
    let first = lab(folder.path(), &[&arguments[..], &["--count", "1"]].concat()).json(0);
    assert_eq!((&first["problems"], &first["solved"]), (&1.into(), &1.into()), "{first}");

    std::fs::create_dir(at("robot")).unwrap();
    std::fs::write(at("robot/turntable.urdf"), TURNTABLE).unwrap();
    let turn = r#"{"problems": [{"start": [-1, 0], "goal": [1, 0.2], "obstacles": []}]}"#;
    std::fs::write(at("turn.json"), turn).unwrap();
    let arguments = ["motion", "--problems", "turn.json", "--robot", "robot", "--json"];
    let missing = ["turntable.urdf is not a robot", "mesh `package://m/bar.obj`: no such file"];
    lab(folder.path(), &arguments).assert_refused(&missing);
    std::fs::write(at("robot/bar.obj"), BAR).unwrap();
    let measured = lab(folder.path(), &arguments).json(0);
    assert_eq!((&measured["solved"], &measured["robot"]), (&1.into(), &"turntable".into()), "{measured}");
    let length = measured["path_length_rad"]["median"].as_f64().unwrap();
    assert!((length - 2.0_f64.hypot(0.2)).abs() < 1e-6, "a straight way is straight: {length}");

    std::fs::write(at("bad.json"), turn.replace("[]", r#"[{"type": "torus", "pos": [0, 0, 0]}]"#)).unwrap();
    for (file, robot, wanted) in [
        ("none.json", "robot", ["cannot read none.json", "check the path"]),
        ("bad.json", "robot", ["bad.json is not a file of motion problems", "torus"]),
        ("turn.json", "nowhere", ["cannot read nowhere", "check the path"]),
        ("turn.json", ".", [". contains 0 URDF files", "expected one"]),
    ] {
        let arguments = ["motion", "--problems", file, "--robot", robot];
        lab(folder.path(), &arguments).assert_refused(&wanted);
    }
}

/// Generated problems read back as they were planned, with collision-free starts and goals.
#[test]
fn lab_motion_makes_problems() {
    let folder = tempfile::tempdir().unwrap();
    let measure = |arguments: [&str; 4]| {
        let more = ["--count", "7", "--out", "made.json"];
        let more = if arguments[0] == "--generate" { &more[..] } else { &[] };
        let arguments = [&["motion", "--json", "--ik-poses", "200"], &arguments[..], more].concat();
        let measured = lab(folder.path(), &arguments).json(0);
        assert_eq!((&measured["problems"], &measured["invalid_paths"]), (&7.into(), &0.into()), "{measured}");
        assert!(!measured["failures"].to_string().contains("in collision"), "{measured}");
        measured["path_length_rad"].clone()
    };
    for (kind, obstacles) in [("easy", 6..=13), ("hard", 14..=18)] {
        let fresh = measure(["--generate", kind, "--seed", "5"]);
        let text = std::fs::read(folder.path().join("made.json")).unwrap();
        let written: serde_json::Value = serde_json::from_slice(&text).unwrap();
        let problems = written["problems"].as_array().unwrap();
        assert_eq!(problems[0]["goal"], problems[1]["start"], "a chain of motions");
        for problem in problems {
            let count = problem["obstacles"].as_array().unwrap().len();
            assert!(obstacles.contains(&count), "{kind}: {count} obstacles");
        }
        if kind == "hard" {
            assert_eq!(measure(["--problems", "made.json", "--seed", "5"]), fresh);
        }
    }
    let refused = lab(folder.path(), &["motion", "--rrt-range", "0"]);
    assert_eq!(refused.code, Some(2), "{refused:?}");
}

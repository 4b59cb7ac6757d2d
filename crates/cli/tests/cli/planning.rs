//! `plan`: one motion in a scenario that was laid out, drawn and filmed.

use crate::genmanip;

const TASK: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/tasks/017_pick_and_place.json");

#[test]
fn plan_reaches_grasps_points_and_joint_positions() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    genmanip(folder.path(), &["layout", TASK, "--seed", "5", "--out", "s", "--json"]).json(0);
    let scenario = "s/017_pick_and_place-000.json";
    let plan = |more: &[&str]| genmanip(folder.path(), &[&["plan", scenario], more].concat());

    let picked = plan(&["--pick", "red apple", "--picture", "p.png", "--animation", "p.mp4", "--json"]).json(0);
    assert_eq!((&picked["solved"], &picked["failure"]), (&true.into(), &serde_json::Value::Null), "{picked}");
    let steps = picked["trajectory"].as_array().unwrap().len();
    let seconds = picked["duration_s"].as_f64().unwrap();
    assert!(steps > 30 && (seconds * 60.0 - (steps as f64 - 1.0)).abs() < 1e-6, "{steps} steps in {seconds} s");
    assert!(picked["path_length_rad"].as_f64().unwrap() > 0.5, "{picked}");
    let begins = |name: &str| std::fs::read(at(name)).unwrap()[..8].to_vec();
    assert_eq!(begins("p.png"), *b"\x89PNG\r\n\x1a\n");
    assert_eq!(begins("p.mp4")[4..], *b"ftyp");
    assert_eq!(plan(&["--pick", "027", "--json"]).json(0)["trajectory"], picked["trajectory"], "uid and name are one");

    let reached = plan(&["--to", "0.5,-0.2,0.2", "--yaw", "-30", "--json"]).json(0);
    let last = reached["trajectory"].as_array().unwrap().last().unwrap().to_string();
    let joints = last.trim_matches(['[', ']']).to_owned();
    let again = plan(&["--joints", &joints, "--json"]).json(0);
    assert_eq!(again["trajectory"].as_array().unwrap().last(), reached["trajectory"].as_array().unwrap().last());

    let blocked = plan(&["--to", "0.5,-0.2,-0.1", "--picture", "no.jpg", "--json"]).json(1);
    assert!(blocked["failure"].as_str().unwrap().contains("inside table"), "{blocked}");
    assert_eq!(begins("no.jpg")[..2], [0xff, 0xd8]);

    for (more, wanted) in [
        (&["--pick", "unicorn"][..], ["no object `unicorn`", "027 (Red Apple)"]),
        (&["--to", "0.5,0.2"], ["--to has 2 numbers", "expected x,y,z"]),
        (&["--to", "2,0,0.2"], ["does not get to (2, 0, 0.2)", "base frame"]),
        (&["--joints", "0,0,0"], ["--joints has 3 numbers", "expected 7"]),
        (&["--pick", "027", "--gripper", "0.5"], ["--gripper 0.5 m", "expected 0 to 0.08"]),
        (&["--pick", "027", "--picture", "p.tiff"], ["cannot write p.tiff", ".png or .jpg"]),
        (&["--pick", "027", "--picture", "q.png", "--camera", "moon"], ["no such camera", "overview, left"]),
    ] {
        plan(more).assert_refused(&wanted);
    }
    assert!(!at("q.png").exists());
}

/// An arm from its URDF, without masses or drives.
#[test]
fn plan_takes_the_urdf_of_any_arm() {
    let folder = tempfile::tempdir().unwrap();
    let urdf = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/robots/six_axis.urdf");
    let plan = |more: &[&str]| genmanip(folder.path(), &[&["plan", "--robot", urdf], more].concat());
    let planned = plan(&["--joints=0.8,0.6,0.6,0,0.4,0", "--picture", "arm.png", "--json"]).json(0);
    assert_eq!(planned["solved"], true, "{planned}");
    let last = planned["trajectory"].as_array().unwrap().last().unwrap();
    assert!((last[0].as_f64().unwrap() - 0.8).abs() < 1e-6, "{last}");
    assert_eq!(std::fs::read(folder.path().join("arm.png")).unwrap()[..4], *b"\x89PNG");
    plan(&["--joints=0,0,0"]).assert_refused(&["--joints has 3 numbers", "expected 6"]);
    plan(&["--joints=0,0,0,0,0,0", "--tip", "claw"]).assert_refused(&["claw, which does not exist"]);
    genmanip(folder.path(), &["plan", "--robot", "no/such.urdf", "--joints", "0"])
        .assert_refused(&["no/such.urdf", "check the path"]);
}

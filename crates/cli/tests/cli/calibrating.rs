//! Cameras calibrated from views of a board.

use std::fs;

use serde_json::Value;

use crate::{REPOSITORY, genmanip};

#[test]
fn a_calibrated_camera_is_written_into_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let example = format!("{REPOSITORY}/examples/calibrate/wrist.json");
    assert_eq!(genmanip(here, &["world", "init", "--out", "world.toml"]).code, Some(0));
    let found = genmanip(here, &["calibrate", &example, "--world", "world.toml", "--json"]).json(0);
    assert_eq!(found["skipped"][0]["id"], "007", "{found}");
    let cameras = genmanip(here, &["camera", "list", "world.toml", "--json"]).json(0);
    let wrist = cameras.as_array().unwrap().iter().find(|camera| camera["name"] == "wrist").unwrap();
    assert_eq!(wrist["mount"], "hand");
    assert_eq!(wrist["mount_from_camera"], found["camera"]["mount_from_camera"]);
    assert_eq!(wrist["intrinsics"]["width"], 640);

    // The same views with another board, another mounting, too few of them, or joint positions of another arm.
    let views: Value = serde_json::from_str(&fs::read_to_string(&example).unwrap()).unwrap();
    let before = fs::read(here.join("world.toml")).unwrap();
    type Change = fn(&mut Value);
    let cases: [(Change, &str); 5] = [
        (|views| views["board"]["grid"]["spacing_m"] = 0.03.into(), "times as large as stated"),
        (|views| views["board"]["grid"]["spacing_m"] = 0.0.into(), "board.grid.spacing_m"),
        (|views| views["mounting"] = "eye_to_hand".into(), "the views fit a camera mounted as eye_in_hand"),
        (|views| views["robot"] = serde_json::json!({"000": views["robot"]["000"]}), "1 views have a robot state"),
        (|views| views["robot"]["000"] = serde_json::json!({"joints_rad": [0.0]}), "view 000: 1 joint positions"),
    ];
    for (change, said) in cases {
        let mut changed = views.clone();
        change(&mut changed);
        fs::write(here.join("views.json"), changed.to_string()).unwrap();
        genmanip(here, &["calibrate", "views.json", "--world", "world.toml"]).assert_refused(&[said]);
        assert_eq!(fs::read(here.join("world.toml")).unwrap(), before, "{said}");
    }
}

#[test]
fn proposed_poses_are_in_reach() {
    let folder = tempfile::tempdir().unwrap();
    let plan = ["calibrate", "plan", "--camera", "wrist", "--count", "6", "--json"];
    let planned = genmanip(folder.path(), &[&plan[..], &["--board-at", "0.5,0,0"]].concat()).json(0);
    assert_eq!(planned["joints_rad"].as_array().unwrap().len(), 6, "{planned}");
    assert_eq!(planned["joints_rad"][0].as_array().unwrap().len(), 7);
    genmanip(folder.path(), &[&plan[..], &["--board-at", "5,0,0"]].concat()).assert_refused(&["in reach", "nearer"]);
}

#[test]
fn a_board_is_printed_and_found_in_images() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let board = ["calibrate", "board", "--columns", "4", "--rows", "3", "--square-mm", "20", "--tag-mm", "15"];
    let written = genmanip(here, &[&board[..], &["--out", "board.png", "--json"]].concat()).json(0);
    assert_eq!(written["image_mm"], serde_json::json!([90.0, 70.0]), "{written}");
    let described: Value = serde_json::from_str(&fs::read_to_string(here.join("board.json")).unwrap()).unwrap();
    assert_eq!(described, written["board"]);
    assert_eq!(genmanip(here, &[&board[..], &["--out", "page.svg"]].concat()).code, Some(0));
    let page = fs::read_to_string(here.join("page.svg")).unwrap();
    assert!(page.contains("width=\"210mm\"") && page.contains("ids 0 to 5"), "{page}");
    genmanip(here, &["calibrate", "board", "--out", "x.svg", "--square-mm", "60"])
        .assert_refused(&["do not fit on a4"]);
    genmanip(here, &["calibrate", "board", "--out", "x.svg", "--tag-mm", "30"]).assert_refused(&["tag_m", "square_m"]);

    // The print itself as the image: all corners are there, but one view determines no camera.
    let [width, height] = [90.0, 70.0].map(|mm: f64| (mm * 23.622).round());
    let views = serde_json::json!({
        "schema": "genmanip.board_views/1",
        "camera": {
            "name": "wrist",
            "intrinsics": {"width": width as u32, "height": height as u32, "fx": 2000, "fy": 2000, "cx": 1000, "cy": 800},
        },
        "mounting": "eye_in_hand",
        "board": described,
        "robot": {"board": {"joints_rad": [0, -0.78, 0, -2.36, 0, 1.57, 0.78]}},
    });
    fs::write(here.join("views.json"), views.to_string()).unwrap();
    let refused = genmanip(here, &["calibrate", "."]);
    refused.assert_refused(&["board: 6 of 6 corners", "1 views have a robot state"]);
    let mut smaller = views.clone();
    smaller["camera"]["intrinsics"]["width"] = 640.into();
    fs::write(here.join("views.json"), smaller.to_string()).unwrap();
    genmanip(here, &["calibrate", "views.json"]).assert_refused(&["expected 640 x"]);
    let mut plain = views;
    plain["board"] = serde_json::json!({"grid": {"columns": 3, "rows": 2, "spacing_m": 0.02}});
    fs::write(here.join("views.json"), plain.to_string()).unwrap();
    genmanip(here, &["calibrate", "."]).assert_refused(&["has no detections", "`charuco`"]);
}

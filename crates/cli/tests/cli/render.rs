//! `render`: pictures of scenarios and episodes, as they were and in another look.

use std::fs;

use serde_json::Value;

use crate::{assert_same_tree, finished_run, genmanip, tree};

fn draw(folder: &std::path::Path, source: &str, out: &str, more: &[&str]) -> Value {
    let usual = ["render", source, "--out", out, "--size", "96x54", "--json"];
    genmanip(folder, &[&usual[..], more].concat()).json(0)
}

#[test]
fn a_scenario_is_drawn_as_its_cameras_see_it() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = finished_run().join("scenarios/021_spatial-000.json");
    let scenario = scenario.to_str().unwrap();
    let channels = ["--cameras", "static,wrist", "--channels", "rgb,depth,ids,normals"];
    let rows = draw(folder.path(), scenario, "usual", &channels);
    assert_eq!((&rows[0]["id"], &rows[0]["frames"]), (&"021_spatial-000".into(), &1.into()));
    let drawn = tree(&folder.path().join("usual/021_spatial-000"));
    let names: Vec<&str> = drawn.keys().map(String::as_str).collect();
    let of = |camera: &str| ["", "_depth", "_ids", "_normals"].map(|channel| format!("{camera}{channel}.png"));
    let mut expected = [of("static").to_vec(), of("wrist").to_vec(), vec!["render.json".into()]].concat();
    expected.sort();
    assert_eq!(names, expected);
    let previewed = ["camera", "preview", scenario, "static", "--size", "96x54", "--out", "preview"];
    assert_eq!(genmanip(folder.path(), &previewed).code, Some(0));
    assert_eq!(drawn["static.png"], fs::read(folder.path().join("preview/static.png")).unwrap());

    // Another look: other colours, the same geometry as long as the cameras stay where they are.
    let varied = |out: &str, seed: &str, vary: &str| {
        draw(folder.path(), scenario, out, &[&channels[..], &["--variation", seed, "--vary", vary]].concat());
        tree(&folder.path().join(out).join("021_spatial-000"))
    };
    let light = varied("light", "7", "light,material,objects,background");
    assert_ne!(light["static.png"], drawn["static.png"]);
    for name in ["static_depth.png", "static_ids.png", "static_normals.png"] {
        assert_eq!(light[name], drawn[name], "{name}");
    }
    assert_eq!(varied("again", "7", "background,objects,material,light"), light, "the same seed, the same bytes");
    assert_ne!(varied("other", "8", "light")["static.png"], light["static.png"]);
    let moved = varied("moved", "7", "camera");
    assert_ne!(moved["static_depth.png"], drawn["static_depth.png"]);
    let card: Value = serde_json::from_slice(&moved["render.json"]).unwrap();
    let usual: Value = serde_json::from_slice(&drawn["render.json"]).unwrap();
    assert_eq!(card["vary"], serde_json::json!(["camera"]));
    assert_ne!(card["cameras"][0]["mount_from_camera"], usual["cameras"][0]["mount_from_camera"]);
    assert_eq!((&usual["ids"]["1"], &usual["variation_seed"]), (&"table".into(), &Value::Null));
}

/// Traced colours differ from the usual ones and not by the number of threads; depth and ids stay.
#[test]
fn a_traced_picture_differs_in_colour_alone() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = finished_run().join("scenarios/021_spatial-000.json");
    let with = |out: &str, more: &[&str]| {
        let channels = ["--cameras", "static", "--channels", "rgb,depth,ids"];
        draw(folder.path(), scenario.to_str().unwrap(), out, &[&channels[..], more].concat());
        tree(&folder.path().join(out).join("021_spatial-000"))
    };
    let usual = with("usual", &[]);
    let traced = with("traced", &["--quality", "reference", "--paths", "2", "--workers", "1"]);
    assert_same_tree(&traced, &with("again", &["--quality", "reference", "--paths", "2", "--workers", "3"]));
    let differ: Vec<&String> = usual.keys().filter(|name| usual[*name] != traced[*name]).collect();
    assert_eq!(differ, ["render.json", "static.png"]);
    let card: Value = serde_json::from_slice(&traced["render.json"]).unwrap();
    assert_eq!(card["paths"], 2);
}

/// The composed scenarios of the guide still open: objects that have changed since would be refused.
#[test]
fn the_stills_can_be_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let stills = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/stills");
    let mut drawn = 0;
    for still in fs::read_dir(stills).unwrap() {
        let rows = draw(folder.path(), still.unwrap().path().to_str().unwrap(), "stills", &[]);
        assert_eq!(rows[0]["frames"], 1);
        drawn += 1;
    }
    assert_eq!(drawn, 5);
}

/// The films of the run itself, drawn again: the same, for any number of workers.
#[test]
fn episodes_are_drawn_again() {
    let folder = tempfile::tempdir().unwrap();
    let run = finished_run().to_str().unwrap();
    let more = ["--cameras", "wrist", "--fps", "10", "--variation", "episode"];
    let rows = draw(folder.path(), run, "one", &[&more[..], &["--workers", "1"]].concat());
    draw(folder.path(), run, "two", &[&more[..], &["--workers", "2"]].concat());
    let one = tree(&folder.path().join("one"));
    assert_same_tree(&one, &tree(&folder.path().join("two")));
    assert_eq!(rows.as_array().unwrap().len(), 2);
    assert_ne!(rows[0]["variation_seed"], rows[1]["variation_seed"]);
    assert!(one.keys().any(|name| name == "021_spatial-000/wrist.mp4"), "{:?}", one.keys());

    let open = [&more[..], &["--shutter", "0.03"]].concat();
    draw(folder.path(), run, "open", &[&open[..], &["--workers", "1"]].concat());
    draw(folder.path(), run, "open again", &[&open[..], &["--workers", "2"]].concat());
    let blurred = tree(&folder.path().join("open"));
    assert_same_tree(&blurred, &tree(&folder.path().join("open again")));
    assert_ne!(blurred["021_spatial-000/wrist.mp4"], one["021_spatial-000/wrist.mp4"]);

    let refused = |arguments: &[&str], wanted: &[&str]| {
        let usual = ["render", run, "--out", "refused"];
        genmanip(folder.path(), &[&usual[..], arguments].concat()).assert_refused(wanted);
    };
    refused(&["--cameras", "ceiling"], &["unknown camera `ceiling`", "static"]);
    refused(&["--cameras", "wrist", "--size", "95x54"], &["camera wrist has 95x54 pixels", "even"]);
    genmanip(folder.path(), &["render", "nowhere", "--out", "refused"]).assert_refused(&["no episodes at nowhere"]);
    assert!(!folder.path().join("refused").exists());
}

/// A device's noise and lens are part of the picture: the same twice, labels as they were without the noise.
#[test]
fn a_scenario_is_drawn_as_a_device_sees_it() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = finished_run().join("scenarios/021_spatial-000.json");
    let with = |out: &str, more: &[&str]| {
        let channels = ["--cameras", "static", "--channels", "rgb,depth,ids"];
        draw(folder.path(), scenario.to_str().unwrap(), out, &[&channels[..], more].concat());
        tree(&folder.path().join(out).join("021_spatial-000"))
    };
    let perfect = with("perfect", &[]);
    let device = with("device", &["--sensor", "d435"]);
    assert_eq!(with("again", &["--sensor", "d435"]), device);
    assert_eq!(device["static_ids.png"], perfect["static_ids.png"]);
    for name in ["static.png", "static_depth.png"] {
        assert_ne!(device[name], perfect[name], "{name}");
    }
    let card: Value = serde_json::from_slice(&device["render.json"]).unwrap();
    assert_eq!(card["cameras"][0]["sensor"]["depth"]["baseline_m"], 0.05);
    let open = with("open", &["--shutter", "0.02"]);
    assert_eq!(open["static.png"], perfect["static.png"], "nothing moves in a scenario");
    let card: Value = serde_json::from_slice(&open["render.json"]).unwrap();
    assert_eq!(card["cameras"][0]["sensor"]["color"]["shutter_s"], 0.02);
    let lens = with("lens", &["--distortion=-0.2,0.02,0,0"]);
    assert_ne!(lens["static_ids.png"], perfect["static_ids.png"]);
    let refused = ["render", scenario.to_str().unwrap(), "--out", "folded", "--distortion=-9,0,0,0"];
    let told = genmanip(folder.path(), &refused);
    assert_eq!(told.code, Some(1));
    let too_long = ["render", scenario.to_str().unwrap(), "--out", "long", "--shutter", "0.5"];
    let told_of_shutter = genmanip(folder.path(), &too_long);
    assert_eq!(told_of_shutter.code, Some(2));
    assert!(told_of_shutter.stderr.contains("0 to 0.1 seconds"), "{}", told_of_shutter.stderr);
    assert!(told.stderr.contains("distortion") && told.stderr.contains("k1"), "{}", told.stderr);
}

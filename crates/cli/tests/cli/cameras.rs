//! Cameras of world and scenario files: edited and edited back, looked through, refused.

use std::fs;

use genmanip_assets::worlds::DEFAULT_TEXT;
use serde_json::{Value, json};

use crate::{REPOSITORY, genmanip, tree};

/// A folder with a world in both formats and a scenario of version 1.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("world.toml", DEFAULT_TEXT);
    let world = genmanip_assets::worlds::default_world();
    write("world.json", &genmanip_core::Document::to_json(&*world));
    let stored = "crates/cli/testdata/version_1/scenarios/001_long_horizon-000.json";
    write("scenario.json", &fs::read_to_string(format!("{REPOSITORY}/{stored}")).unwrap());
    write("list.json", "{\"schema\": \"genmanip.grasps/1\"}");
    folder
}

#[test]
fn a_camera_comes_changes_and_goes_and_nothing_else_does() {
    let folder = workplace();
    let call = |line: &str| {
        let outcome = genmanip(folder.path(), &line.split(' ').collect::<Vec<_>>());
        assert_eq!(outcome.code, Some(0), "{line}: {outcome:?}");
        outcome
    };
    for file in ["world.toml", "world.json", "scenario.json"] {
        let text = || fs::read_to_string(folder.path().join(file)).unwrap();
        let cameras = || call(&format!("camera list {file} --json")).json(0)["cameras"].as_array().unwrap().clone();
        let (text_before, before) = (text(), cameras());
        call(&format!("camera add {file} top --preset d435 --size 64x36 --eye 0.55,0,1.4 --target 0.5,0,0"));
        assert_eq!(cameras()[..before.len()], before, "{file}");
        let added = cameras()[before.len()].clone();
        assert_eq!((&added["name"], &added["size_px"]), (&json!("top"), &json!([64, 36])), "{file}");
        assert!((added["horizontal_fov_deg"].as_f64().unwrap() - 69.4).abs() < 1e-9, "{file}: {added}");
        call(&format!("camera set {file} top --fov-deg 50 --eye 0.5,-0.25,1 --target 0.5,0,0.125"));
        let changed = cameras()[before.len()].clone();
        assert_eq!((&changed["position_m"], &changed["size_px"]), (&json!([0.5, -0.25, 1.0]), &json!([64, 36])));
        assert!((changed["vertical_fov_deg"].as_f64().unwrap() - 50.0).abs() < 1e-9, "{file}: {changed}");
        call(&format!("camera set {file} left --size 256x144"));
        assert_eq!(cameras()[1]["vertical_fov_deg"], before[1]["vertical_fov_deg"], "{file}: half the size, same view");
        call(&format!("camera set {file} left --size 512x288"));
        call(&format!("camera remove {file} top"));
        assert_eq!(cameras(), before, "{file}");
        let value = |text: &str| serde_json::from_str::<Value>(text).ok();
        assert_eq!(value(&text()), value(&text_before), "{file}");
        if file.ends_with("toml") {
            assert_eq!(text(), text_before, "comments and all");
        }
        let drawn = call(&format!("camera preview {file} wrist static --size 64x36 --out views --json")).json(0);
        assert_eq!(drawn[1], json!({"cameras": ["static"], "file": "views/static.png", "size_px": [64, 36]}));
        assert!(fs::read(folder.path().join("views/static.png")).unwrap().starts_with(b"\x89PNG"));
    }
}

const REFUSED: [&str; 17] = [
    "list missing.toml",
    "list list.json",
    "add world.toml static --preset d435 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --preset d436 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --preset d435",
    "add world.toml top --eye 1,0,1 --target 0.5,0,0",
    "add scenario.json top --fov-deg 60 --size 0x360 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --fov-deg 60 --size 9000x360 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --fov-deg NaN --size 640x360 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --preset d435 --eye NaN,0,1 --target 0.5,0,0",
    "add scenario.json top --preset d435 --eye 1,0,1 --target 1,0,1",
    "add world.toml a/b --preset d435 --eye 1,0,1 --target 0.5,0,0",
    "set world.toml statik --size 640x360",
    "set scenario.json static --mount hand",
    "set world.toml static",
    "remove world.toml ceiling",
    "preview world.toml --out views.gif",
];

#[test]
fn refusals_name_what_is_wrong_and_change_nothing() {
    let folder = workplace();
    let before = tree(folder.path());
    let mut said = String::new();
    for case in REFUSED {
        let arguments: Vec<&str> = ["camera"].into_iter().chain(case.split(' ')).collect();
        let outcome = genmanip(folder.path(), &arguments);
        outcome.assert_refused(&[]);
        said += &format!("$ genmanip camera {case}\n{}\n", outcome.stderr);
    }
    assert_eq!(tree(folder.path()), before, "a refusal changed a file");
    insta::assert_snapshot!("refusals", said);
}

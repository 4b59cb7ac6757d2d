//! Cameras of world and scenario files: edited and edited back, looked through, refused.

use std::fs;

use genmanip_assets::worlds::DEFAULT_TEXT;
use genmanip_core::glam::DVec3;
use serde_json::json;

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
        let cameras = || call(&format!("camera list {file} --json")).json(0).as_array().unwrap().clone();
        call(&format!("camera set {file} right --size 256x144"));
        call(&format!("camera set {file} right --size 512x288"));
        let (text_before, before) = (text(), cameras());
        call(&format!("camera add {file} top --preset d435 --size 64x36 --eye 0.55,0,1.4 --target 0.5,0,0"));
        let now = cameras();
        assert_eq!(now[..before.len()], before, "{file}");
        // 32 px to either side, 69.4 degrees in all.
        let (top, fx) = (&now[before.len()], 32.0 / 34.7_f64.to_radians().tan());
        assert_eq!((&top["name"], &top["intrinsics"]["width"]), (&json!("top"), &json!(64)), "{file}");
        assert!((top["intrinsics"]["fx"].as_f64().unwrap() - fx).abs() < 1e-9, "{file}: {top}");
        call(&format!("camera set {file} top --fov-deg 90 --eye 0.5,-0.25,1 --target 0.5,0,0.125"));
        let top = cameras()[before.len()].clone();
        assert_eq!(top["mount_from_camera"]["position_m"], json!([0.5, -0.25, 1.0]), "{file}");
        assert!((top["intrinsics"]["fy"].as_f64().unwrap() - 18.0).abs() < 1e-9, "{file}: {top}");
        // On the hand, --eye and --target are in its frame; x points to the upper edge of the image.
        call(&format!("camera set {file} top --hand --eye 0.08,0,0.03 --target 0,0,0.11"));
        call(&format!("camera set {file} top --eye 0.07,0,0.03 --target 0.07,0,0.11"));
        let top = cameras()[before.len()].clone();
        assert_eq!(top["mount"], "hand", "{file}");
        let pose: genmanip_core::Pose = serde_json::from_value(top["mount_from_camera"].clone()).unwrap();
        let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| pose.transform_vector(axis));
        let expected = [DVec3::Y, -DVec3::X, DVec3::Z];
        for (axis, expected) in axes.iter().zip(expected) {
            assert!(axis.distance(expected) < 1e-9, "{file}: right, down and forward are {axes:?} in the hand frame");
        }
        call(&format!("camera remove {file} top"));
        assert_eq!(cameras(), before, "{file}");
        assert_eq!(text().trim_end(), text_before.trim_end(), "{file}: comments and all");
        let drawn = call(&format!("camera preview {file} wrist static --size 64x36 --out views --json")).json(0);
        assert_eq!(drawn[1], json!({"cameras": ["static"], "file": "views/static.png"}));
        assert!(fs::read(folder.path().join("views/static.png")).unwrap().starts_with(b"\x89PNG"));
        call(&format!("camera preview {file} --size 64x36 --out sheet.jpg"));
        assert!(fs::read(folder.path().join("sheet.jpg")).unwrap().starts_with(b"\xff\xd8"));
    }
}

const REFUSED: [&str; 10] = [
    "list missing.toml",
    "list list.json",
    "add world.toml static --preset d435 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --preset d436 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --preset d435",
    "add scenario.json top --preset d435 --eye 1,0,1 --target 1,0,1",
    "add world.toml a/b --preset d435 --eye 1,0,1 --target 0.5,0,0",
    "set world.toml statik --size 640x360",
    "remove world.toml ceiling",
    "preview world.toml --out views.gif",
];

/// Values that no camera can have are refused where the call is read, which ends with 2.
const NOT_READ: [&str; 3] = [
    "add scenario.json top --fov-deg 60 --size 0x360 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --fov-deg NaN --size 640x360 --eye 1,0,1 --target 0.5,0,0",
    "add world.toml top --preset d435 --eye NaN,0,1 --target 0.5,0,0",
];

#[test]
fn refusals_name_what_is_wrong_and_change_nothing() {
    let folder = workplace();
    let before = tree(folder.path());
    let mut said = String::new();
    for case in REFUSED.iter().chain(&NOT_READ) {
        let arguments: Vec<&str> = ["camera"].into_iter().chain(case.split(' ')).collect();
        let outcome = genmanip(folder.path(), &arguments);
        let code = if NOT_READ.contains(case) || case.contains("--preset d436") { 2 } else { 1 };
        assert_eq!((outcome.code, outcome.stdout.as_str()), (Some(code), ""), "{case}: {outcome:?}");
        assert_eq!(outcome.stderr.matches("error:").count(), 1, "{case}: {outcome:?}");
        said += &format!("$ genmanip camera {case}\n{}\n", outcome.stderr);
    }
    assert_eq!(tree(folder.path()), before, "a refusal changed a file");
    insta::assert_snapshot!("refusals", said);
}

//! Damaged and hostile files: one clear error or a reported repair, never a panic.

use genmanip_import::{Given, ImportError, import};
use proptest::prelude::*;

use crate::described::{cabinet, drawer};
use crate::rigid::{Disk, crate_obj, disk, glb, import_from, png, upright_box};

fn refused(disk: &Disk, path: &str) -> ImportError {
    let error = import_from(disk, path, &Given::default()).map(|object| object.report).expect_err(path);
    assert!(!error.message.is_empty() && error.to_string().lines().count() == 1, "{error}");
    assert!(!error.hint.is_empty(), "{error}: no hint");
    error
}

#[test]
fn every_broken_file_has_one_clear_error() {
    let (corners, triangles) = upright_box([0.05, 0.2, 0.03]);
    let good = glb(&corners, &triangles, "");
    let mut nan = corners.clone();
    nan.iter_mut().for_each(|corner| corner[0] = f32::NAN);
    let mut beyond = triangles.clone();
    beyond[0][0] = 99;
    let mut many = String::from("v 0 0 0\nv 1 0 0\nv 0 1 0\n");
    many.push_str(&"f 1 2 3\n".repeat(1_000_001));
    let draco =
        r#","extensionsRequired":["KHR_draco_mesh_compression"],"extensionsUsed":["KHR_draco_mesh_compression"]"#;
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("cut.glb", good[..good.len() / 2].to_vec(), "its header says"),
        ("empty.glb", Vec::new(), "not a readable glTF"),
        ("nan.glb", glb(&nan, &triangles, ""), "12 of 12 triangles"),
        ("beyond.glb", glb(&corners, &beyond, ""), "vertex 99 of 8"),
        ("draco.glb", glb(&corners, &triangles, draco), "not a readable glTF"),
        ("words.obj", b"v 1 2\n".to_vec(), "line 1"),
        ("face.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n".to_vec(), "line 4"),
        ("empty.obj", b"# nothing\n".to_vec(), "no faces"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n".to_vec(), "no triangle"),
        ("many.obj", many.into_bytes(), "more than 400000 triangles"),
        ("short.stl", vec![7; 100], "STL"),
        ("short.msh", vec![0; 40], "MSH"),
        ("thing.zip", b"PK\x03\x04".to_vec(), "unpack archives"),
    ];
    for (path, bytes, expected) in cases {
        let error = refused(&disk(&[(path, &bytes)]), path);
        assert!(format!("{error} {}", error.hint).contains(expected), "{path}: {error} ({})", error.hint);
    }
    assert!(refused(&disk(&[]), "missing.glb").message.contains("no such file"));
}

/// The corpus that `genmanip-lab hostile --kind import-…` mutates.
#[test]
fn a_valid_file_of_every_format_imports_without_repairs() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/sound");
    for (format, name) in [
        ("glb", "carton.glb"),
        ("gltf", "carton.gltf"),
        ("obj", "crate.obj"),
        ("stl", "block.stl"),
        ("stl", "wedge.stl"),
        ("msh", "tin.msh"),
        ("urdf", "cabinet.urdf"),
        ("mjcf", "drawer.xml"),
        ("usda", "box.usda"),
        ("usdc", "box.usdc"),
        ("usdz", "box.usdz"),
    ] {
        let mut read = |path: &str, _| std::fs::read(folder.join(format).join(path)).map_err(|error| error.to_string());
        let object = import(name, &mut read, &Given::default(), None).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(object.report.repairs, Vec::<String>::new(), "{name}");
        assert!(object.model.links.iter().all(|link| !link.pieces.is_empty()), "{name}");
    }
}

/// Files of a folder of `testdata/sound`.
fn sound(format: &str) -> Disk {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/sound").join(format);
    let names = ["box.usda", "box.usdc", "box.usdz", "card.png", "parts/lid.usda"];
    let held = |name: &str| Some((name.to_owned(), std::fs::read(folder.join(name)).ok()?));
    names.into_iter().filter_map(held).collect()
}

/// A number that is far too large, at every place of a binary layer: the library would ask for as much memory.
#[test]
fn huge_counts_in_usd_cost_no_memory() {
    let whole = sound("usdc");
    let length = whole["box.usdc"].len();
    let mut refused = 0;
    for (index, place) in (8..length - 8).step_by(4).enumerate() {
        let mut files = whole.clone();
        let huge = [u64::MAX, 1 << 40, 1 << 32, 1 << 33 | 1 << 62, 1 << 63 | 1 << 40][index % 5];
        files.get_mut("box.usdc").unwrap()[place..place + 8].copy_from_slice(&u64::to_le_bytes(huge));
        refused += usize::from(import_from(&files, "box.usdc", &Given::default()).is_err());
    }
    assert!(refused > length / 16, "{refused} of {} refused", length / 4);
}

/// Found by `genmanip-lab hostile`: an image without a source, which the glTF library takes for granted.
#[test]
fn an_image_without_a_source_is_ignored() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/sound/gltf");
    let whole: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("carton.gltf")).unwrap()).unwrap();
    for image in [serde_json::json!({}), serde_json::json!({ "bufferView": 0 })] {
        let mut changed = whole.clone();
        changed["images"] = serde_json::json!([image]);
        let mut read = |path: &str, _| match path {
            "carton.gltf" => Ok(changed.to_string().into_bytes()),
            path => std::fs::read(folder.join(path)).map_err(|error| error.to_string()),
        };
        let object = import("carton.gltf", &mut read, &Given::default(), None).unwrap();
        assert!(object.report.repairs.iter().any(|repair| repair.contains("has no source")), "{image}");
    }
}

/// Found by `genmanip-lab hostile`: type and stride of an accessor, which the glTF library takes for granted.
#[test]
fn an_inconsistent_accessor_is_rejected() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/sound/gltf");
    let whole: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join("carton.gltf")).unwrap()).unwrap();
    let primitive = &whole["meshes"][0]["primitives"][0];
    let index = |value: &serde_json::Value| usize::try_from(value.as_u64().unwrap()).unwrap();
    let (positions, indices) = (index(&primitive["attributes"]["POSITION"]), index(&primitive["indices"]));
    let view = index(&whole["accessors"][positions]["bufferView"]);
    for (list, place, key, value, expected) in [
        ("accessors", indices, "componentType", 5126.into(), "Scalar of F32; expected Scalar of one of [U8, U16, U32]"),
        ("accessors", positions, "componentType", 5120.into(), "expected Vec3 of one of [F32]"),
        ("accessors", positions, "type", "VEC2".into(), "Vec2 of F32; expected Vec3"),
        ("bufferViews", view, "byteStride", 4.into(), "elements of 12 bytes are 4 bytes apart"),
        (
            "meshes",
            0,
            "primitives",
            serde_json::json!([{"attributes": {"POSITION": 3}}]),
            "mesh 0 refers to accessor 3 of 3",
        ),
    ] {
        let mut changed: serde_json::Value = whole.clone();
        changed[list][place][key] = value;
        let mut read = |path: &str, _| match path {
            "carton.gltf" => Ok(changed.to_string().into_bytes()),
            path => std::fs::read(folder.join(path)).map_err(|error| error.to_string()),
        };
        let error = import("carton.gltf", &mut read, &Given::default(), None).unwrap_err().to_string();
        assert!(error.contains(expected), "{key}: {error}");
    }
}

/// Found by `genmanip-lab hostile`: one line of a drawer repeated 600 times, which took physics 12 s.
#[test]
fn collision_shapes_are_deduplicated_and_bounded() {
    let of = |count: usize, apart: f64| {
        let shape = |index: usize| {
            let x = apart * index as f64;
            format!(r#"<collision><origin xyz="{x} 0 0"/><geometry><box size="0.001 0.1 0.1"/></geometry></collision>"#)
        };
        let shapes: String = (0..count).map(shape).collect();
        let visual = r#"<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>"#;
        let text = format!(r#"<robot name="comb"><link name="base">{visual}{shapes}</link></robot>"#);
        disk(&[("comb.urdf", text.as_bytes())])
    };
    let object = import_from(&of(600, 0.0), "comb.urdf", &Given::default()).unwrap();
    assert_eq!(object.model.links[0].pieces.len(), 1);
    assert!(object.report.repairs.iter().any(|repair| repair.contains("599")), "{:?}", object.report.repairs);
    assert_eq!(import_from(&of(200, 0.002), "comb.urdf", &Given::default()).unwrap().model.links[0].pieces.len(), 200);
    for count in [300, 3000] {
        let error = refused(&of(count, 0.002), "comb.urdf");
        assert!(error.message.contains(&format!("{count} collision shapes")), "{error}");
    }
}

#[test]
fn references_outside_the_folder_are_ignored_and_reported() {
    for (named, expected) in
        [("/etc/passwd", "absolute"), ("../../../secret.png", "outside"), ("missing.png", "no such file")]
    {
        let mut files = crate_obj();
        files.insert("boxes/crate.mtl".into(), format!("newmtl card\nKd 0 1 0\nmap_Kd {named}\n").into_bytes());
        let object = import_from(&files, "boxes/blorp.obj", &Given::default()).unwrap();
        let repair = object.report.repairs.iter().find(|repair| repair.contains("texture ignored"));
        assert!(repair.is_some_and(|repair| repair.contains(expected)), "{named}: {:?}", object.report.repairs);
        assert_eq!(object.model.card.colors, ["green"]);
    }
    let mut files = crate_obj();
    let text = String::from_utf8(files["boxes/blorp.obj"].clone()).unwrap().replace("crate.mtl", "/etc/hosts");
    files.insert("boxes/blorp.obj".into(), text.into_bytes());
    let object = import_from(&files, "boxes/blorp.obj", &Given::default()).unwrap();
    assert!(object.report.repairs.iter().any(|repair| repair.contains("materials ignored")));
}

#[test]
fn decompression_bombs_are_ignored_and_reported() {
    let mut bomb = png(4, 4, &[9; 48]);
    bomb[16..24].copy_from_slice(&[0, 0, 0x90, 0, 0, 0, 0x90, 0]);
    let mut files = crate_obj();
    files.insert("pictures/card.png".into(), bomb);
    let object = import_from(&files, "boxes/blorp.obj", &Given::default()).unwrap();
    assert!(
        object.report.repairs.iter().any(|repair| repair.contains("texture ignored")),
        "{:?}",
        object.report.repairs
    );
}

#[test]
fn cyclic_nodes_are_rejected() {
    let scene =
        r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"children":[1]},{"children":[0]}]}"#;
    let error = refused(&disk(&[("loop.gltf", scene.as_bytes())]), "loop.gltf");
    assert!(error.message.contains("contain each other"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, ..ProptestConfig::default() })]

    #[test]
    fn damaged_bytes_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12), cut in any::<prop::sample::Index>(), is_cut in any::<bool>(), which in 0_usize..8) {
        let (corners, triangles) = upright_box([0.05, 0.2, 0.03]);
        let (path, mut files) = match which {
            0 => ("a.glb", disk(&[("a.glb", &glb(&corners, &triangles, ""))])),
            1 => ("boxes/blorp.obj", crate_obj()),
            2 => ("boxes/blorp.obj", crate_obj()),
            3 => ("45132/mobility.urdf", cabinet()),
            4 => ("objects/drawer.xml", drawer()),
            5 => ("box.usda", sound("usda")),
            6 => ("box.usdc", sound("usdc")),
            _ => ("box.usdz", sound("usdz")),
        };
        let damaged = match which {
            2 => "boxes/crate.mtl",
            4 => "objects/assets/drawer_dependencies.xml",
            _ => path,
        };
        let bytes = files.get_mut(damaged).unwrap();
        for (index, value) in &changes {
            let index = index.index(bytes.len());
            bytes[index] = *value;
        }
        if is_cut {
            let cut = cut.index(bytes.len());
            bytes.truncate(cut);
        }
        // Any result is fine, as long as there is no panic.
        let _ = import_from(&files, path, &Given::default());
    }
}

//! Rigid objects: OBJ with materials and textures, GLB, STL.

use std::collections::BTreeMap;

use genmanip_core::limits::Limit;
use genmanip_core::{AssetRef, Shape};
use genmanip_import::raw::Up;
use genmanip_import::{Given, ImportError, Imported, import, pack};

/// An in-memory file system.
pub type Disk = BTreeMap<String, Vec<u8>>;

/// Imports a file of a disk.
pub fn import_from(disk: &Disk, path: &str, given: &Given) -> Result<Imported, ImportError> {
    let mut read = |path: &str, limit: Limit| {
        let bytes = disk.get(path).ok_or("there is no such file")?;
        if bytes.len() as u64 > limit.bytes {
            Err(format!("larger than {}", limit.human_readable()))
        } else {
            Ok(bytes.clone())
        }
    };
    import(path, &mut read, given, None)
}

/// A disk from names and contents.
pub fn disk(files: &[(&str, &[u8])]) -> Disk {
    files.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())).collect()
}

/// A box as OBJ, centimetres, +y up, textured.
pub fn crate_obj() -> Disk {
    let mut obj = String::from("mtllib crate.mtl\no crate\n");
    for (x, y, z) in
        [(-4, 0, -3), (4, 0, -3), (-4, 10, -3), (4, 10, -3), (-4, 0, 3), (4, 0, 3), (-4, 10, 3), (4, 10, 3)]
    {
        obj += &format!("v {x} {y} {z}\n");
    }
    obj += "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl card\n";
    for [a, b, c, d] in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        obj += &format!("f {a}/1 {b}/2 {c}/3 {d}/4\n");
    }
    disk(&[
        ("boxes/blorp.obj", obj.as_bytes()),
        ("boxes/crate.mtl", b"newmtl card\nKd 0 0 0\nNs 20\nmap_Kd ../pictures/card.png\n"),
        ("pictures/card.png", &png(2, 2, &[200, 30, 30].repeat(4))),
        ("LICENSE", b"Creative Commons Zero v1.0\n"),
    ])
}

/// A PNG of RGB pixels.
pub fn png(width: u32, height: u32, rgb: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(rgb).unwrap();
    bytes
}

/// A GLB of one triangle mesh.
pub fn glb(positions: &[[f32; 3]], triangles: &[[u32; 3]], extra: &str) -> Vec<u8> {
    let (json, binary) = gltf(positions, triangles, extra);
    glb_of(json, binary)
}

/// JSON and binary part of a glTF file with one mesh.
fn gltf(positions: &[[f32; 3]], triangles: &[[u32; 3]], extra: &str) -> (String, Vec<u8>) {
    let mut binary: Vec<u8> = positions.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let corners = binary.len();
    binary.extend(triangles.iter().flatten().flat_map(|index| index.to_le_bytes()));
    let bound = |pick: fn(f32, f32) -> f32| {
        let values: Vec<f32> =
            (0..3).map(|axis| positions.iter().map(|p| p[axis]).reduce(pick).unwrap_or(0.0)).collect();
        format!("{values:?}").replace("inf", "1e30").replace("NaN", "0")
    };
    let json = format!(
        r#"{{"asset":{{"version":"2.0","copyright":"CC-BY 4.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"mesh":0,"name":"thing"}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[0.0,0.2,1.0,1.0],"metallicFactor":0.0}}}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3","min":{},"max":{}}},
{{"bufferView":1,"componentType":5125,"count":{},"type":"SCALAR"}}],
"bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":{corners}}},{{"buffer":0,"byteOffset":{corners},"byteLength":{}}}],
"buffers":[{{"byteLength":{}}}]{extra}}}"#,
        positions.len(),
        bound(f32::min),
        bound(f32::max),
        3 * triangles.len(),
        binary.len() - corners,
        binary.len()
    );
    (json, binary)
}

fn glb_of(json: String, mut binary: Vec<u8>) -> Vec<u8> {
    let mut json = json.into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend((12 + 8 + json.len() as u32 + 8 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// Vertices and triangles of a box standing on y = 0.
pub fn upright_box(size: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let at = |i: u32, axis: usize| if i >> axis & 1 == 1 { size[axis] } else { 0.0 };
    let corners = (0..8).map(|i| [at(i, 0), at(i, 1), at(i, 2)]).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (corners, faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

#[test]
fn a_textured_obj_in_centimetres_is_imported_upright() {
    let object = import_from(&crate_obj(), "boxes/blorp.obj", &Given::default()).unwrap();
    let card = &object.model.card;
    assert_eq!(card.name, "Blorp");
    assert!(card.size_m.abs_diff_eq(glam::DVec3::new(0.08, 0.06, 0.10), 1e-6), "{}", card.size_m);
    let [piece] = object.model.links[0].pieces.as_slice() else { panic!("not one piece") };
    assert!(matches!(piece.shape, Shape::Box { .. }));
    assert_eq!(card.colors, ["red"], "from the texture");
    assert!(object.model.links[0].visual[0].material.texture.is_some());
    assert!(card.can_grasp && !card.is_container && card.mass_kg > 0.02 && card.mass_kg < 1.0, "{card:?}");
    assert!(object.origin.licence.starts_with("Creative Commons Zero"), "{}", object.origin.licence);
    assert!(object.origin.source.contains("pictures/card.png"), "{}", object.origin.source);
    let AssetRef::Imported { hash } = &card.asset else { panic!("{}", card.asset) };
    assert!(hash.len() == 16 && card.uid.as_str().starts_with("blorp-"));
    for what in ["unit", "up", "category", "mass", "friction", "collision", "materials", "can_grasp"] {
        assert!(object.report.guesses.iter().any(|guess| guess.what == what), "{what} is not reported as guessed");
    }
}

#[test]
fn given_values_are_not_guessed() {
    let given = Given { scale: Some(0.005), up: Some(Up::Z), ..Given::default() };
    let object = import_from(&crate_obj(), "boxes/blorp.obj", &given).unwrap();
    assert!(object.model.card.size_m.abs_diff_eq(glam::DVec3::new(0.04, 0.05, 0.03), 1e-6));
    let guess = object.report.guesses.iter().find(|guess| guess.what == "unit").unwrap();
    assert_eq!(guess.because, "given");
    let other = import_from(&crate_obj(), "boxes/blorp.obj", &Given::default()).unwrap();
    assert_ne!(object.model.asset, other.model.asset, "other choices make another object");
}

#[test]
fn toppling_objects_are_imported_lying() {
    let standing = import_from(&crate_obj(), "boxes/blorp.obj", &Given::default()).unwrap();
    let tipped = Given { tipped_up: Some(glam::DVec3::new(1.0, 0.0, 0.02)), ..Given::default() };
    let lying = import_from(&crate_obj(), "boxes/blorp.obj", &tipped).unwrap();
    let (size, was) = (lying.model.card.size_m, standing.model.card.size_m);
    assert!(size.abs_diff_eq(glam::DVec3::new(was.z, was.y, was.x), 3e-3), "{was} became {size}");
    let guess = lying.report.guesses.iter().find(|guess| guess.what == "upright").unwrap();
    assert_eq!(guess.value, "rotated by 89°");
    assert_eq!(lying.model.asset, standing.model.asset, "the same files make the same object");
    assert!(standing.report.guesses.iter().all(|guess| guess.what != "upright"));
}

#[test]
fn a_glb_is_metric_with_y_up() {
    let (corners, triangles) = upright_box([0.05, 0.2, 0.03]);
    let disk = disk(&[("carton.glb", &glb(&corners, &triangles, ""))]);
    let object = import_from(&disk, "carton.glb", &Given::default()).unwrap();
    let size = object.model.card.size_m;
    assert!((size.z - 0.2).abs() < 1e-6 && (size.x - 0.05).abs() < 1e-6, "{size}");
    assert_eq!(
        (object.model.card.colors.as_slice(), object.origin.licence.as_str()),
        (&["blue".to_owned()][..], "CC-BY 4.0")
    );
}

#[test]
fn an_imported_object_round_trips() {
    let object = import_from(&crate_obj(), "boxes/blorp.obj", &Given::default()).unwrap();
    let bytes = pack::to_bytes(&object);
    let again = pack::from_bytes(&bytes).unwrap();
    assert_eq!(again.model.hashes(), object.model.hashes());
    assert_eq!((&again.model.card, &again.report, &again.origin), (&object.model.card, &object.report, &object.origin));
    for length in [0, 7, 11, 300, bytes.len() - 1] {
        assert!(pack::from_bytes(&bytes[..length]).is_err(), "cut off after {length} bytes");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(pack::from_bytes(&longer).is_err());
}

#[test]
fn stl_of_both_kinds_is_read() {
    let (corners, triangles) = upright_box([0.05, 0.04, 0.03]);
    let mut binary = vec![0; 80];
    binary.extend((triangles.len() as u32).to_le_bytes());
    let mut text = String::from("solid x\n");
    for triangle in &triangles {
        binary.extend([0; 12]);
        for index in triangle {
            let [x, y, z] = corners[*index as usize];
            binary.extend([x, y, z].iter().flat_map(|value| value.to_le_bytes()));
            text += &format!("vertex {x} {y} {z}\n");
        }
        binary.extend([0; 2]);
    }
    let disk = disk(&[("a.stl", &binary), ("b.stl", text.as_bytes())]);
    for path in ["a.stl", "b.stl"] {
        let object = import_from(&disk, path, &Given::default()).unwrap();
        assert!((object.model.card.size_m.z - 0.03).abs() < 1e-6, "{path}");
    }
}

/// Colours of vertices, and the old extension by specular colour and glossiness, as in public bug reports.
#[test]
fn colours_of_vertices_and_of_old_materials_are_seen() {
    let material = |name: &str, bytes: &[u8]| {
        let object = import_from(&disk(&[(name, bytes)]), name, &Given::default()).unwrap();
        (object.model.links[0].visual[0].material.clone(), object.model.card.colors.clone())
    };
    let is_near = |one: [f32; 3], other: [f32; 3]| one.iter().zip(other).all(|(a, b)| (a - b).abs() < 0.01);
    let (corners, triangles) = upright_box([0.05, 0.2, 0.03]);
    let (json, mut binary) = gltf(&corners, &triangles, "");
    let start = binary.len();
    (0..corners.len()).for_each(|_| binary.extend([0.8_f32, 0.05, 0.05].iter().flat_map(|value| value.to_le_bytes())));
    let length = binary.len() - start;
    let json = json
        .replace(r#""POSITION":0"#, r#""POSITION":0,"COLOR_0":2"#)
        .replace(r#""baseColorFactor":[0.0,0.2,1.0,1.0],"#, "")
        .replace(
            r#""type":"SCALAR"}"#,
            &format!(
                r#""type":"SCALAR"}},{{"bufferView":2,"componentType":5126,"count":{},"type":"VEC3"}}"#,
                corners.len()
            ),
        )
        .replace(
            "}],\n\"buffers\"",
            &format!("}},{{\"buffer\":0,\"byteOffset\":{start},\"byteLength\":{length}}}],\n\"buffers\""),
        )
        .replace(
            &format!(r#""buffers":[{{"byteLength":{start}}}]"#),
            &format!(r#""buffers":[{{"byteLength":{}}}]"#, binary.len()),
        );
    let (painted, words) = material("soap.glb", &glb_of(json, binary));
    assert!(is_near(painted.base_color, [0.906, 0.247, 0.247]), "{painted:?}");
    assert_eq!(words, ["red"]);
    let (json, binary) = gltf(&corners, &triangles, r#","extensionsUsed":["KHR_materials_pbrSpecularGlossiness"]"#);
    let old = r#""extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0.05,0.1,0.7,1],"specularFactor":[0.1,0.1,0.1],"glossinessFactor":0.4}}"#;
    let json =
        json.replace(r#""pbrMetallicRoughness":{"baseColorFactor":[0.0,0.2,1.0,1.0],"metallicFactor":0.0}"#, old);
    let (glossy, words) = material("soap.glb", &glb_of(json, binary));
    assert!(is_near(glossy.base_color, [0.248, 0.349, 0.854]), "{glossy:?}");
    assert!((glossy.roughness - 0.6).abs() < 1e-6 && glossy.metallic == 0.0, "{glossy:?}");
    assert_eq!(words, ["blue"]);
    let half = "v 0 0 0 1 0 0\nv 0.1 0 0 1 0 0\nv 0 0.1 0 1 0 0\nv 0 0 0.1 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    let (painted, _) = material("half.obj", half.as_bytes());
    let texture = painted.texture.unwrap();
    assert!(texture.rgb.chunks_exact(3).any(|pixel| pixel == [255, 0, 0]), "{texture:?}");
    assert!(texture.rgb.chunks_exact(3).any(|pixel| pixel == [170, 0, 85]), "{texture:?}");
}

/// Lines continued by a backslash, several libraries in one line, and roughness and metalness of the newer MTL; what is
/// not used is said.
#[test]
fn obj_of_other_exporters_is_read() {
    let (corners, triangles) = upright_box([0.05, 0.2, 0.03]);
    let mut text = String::from("mtllib a.mtl b.mtl\nusemtl red\n");
    text.extend(corners.iter().map(|[x, y, z]| format!("v {x} \\\n {y} {z}\n")));
    text.extend(triangles.iter().map(|[a, b, c]| format!("f {} {} \\\r\n{}\n", a + 1, b + 1, c + 1)));
    let files = disk(&[
        ("soap.obj", text.as_bytes()),
        ("a.mtl", b"newmtl blue\nKd 0 0 1\n"),
        ("b.mtl", b"newmtl red\nKd 1 0 0\nPr 0.25\nPm 0.8\nbump dents.png\nmap_d holes.png\n"),
    ]);
    let object = import_from(&files, "soap.obj", &Given::default()).unwrap();
    let material = &object.model.links[0].visual[0].material;
    assert_eq!((material.roughness, material.metallic, object.model.card.colors[0].as_str()), (0.25, 0.8, "red"));
    let note = "b.mtl: not used: bump, map_d";
    assert!(object.report.repairs.iter().any(|said| said == note), "{:?}", object.report.repairs);
    let damaged = [text.as_bytes(), b"f 1 2 \\"].concat();
    let error = import_from(&disk(&[("soap.obj", &damaged)]), "soap.obj", &Given::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("a face with 2 vertices"), "{error}");
}

/// Scenes besides the default one are not read, which is said.
#[test]
fn other_scenes_are_noted() {
    let (corners, triangles) = upright_box([0.05, 0.2, 0.03]);
    let (json, binary) = gltf(&corners, &triangles, "");
    let json = json.replace(r#""scenes":[{"nodes":[0]}]"#, r#""scenes":[{"nodes":[0]},{"nodes":[]}]"#);
    let object = import_from(&disk(&[("a.glb", &glb_of(json, binary))]), "a.glb", &Given::default()).unwrap();
    assert!(
        object.report.repairs.iter().any(|note| note == "of its scenes 0 is read, not 1"),
        "{:?}",
        object.report.repairs
    );
}

/// The JSON part of a GLB with a patch applied.
fn patched(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    patch: impl FnOnce(&mut serde_json::Value, &mut Vec<u8>),
) -> Vec<u8> {
    let (json, mut binary) = gltf(positions, triangles, "");
    let mut json: serde_json::Value = serde_json::from_str(&json).unwrap();
    patch(&mut json, &mut binary);
    json["buffers"][0]["byteLength"] = binary.len().into();
    glb_of(json.to_string(), binary)
}

#[test]
fn quantised_meshes_have_their_size() {
    // Positions as 16-bit shares of 0.2 m, normalised, which a scale of the node restores.
    let (corners, triangles) = upright_box([0.06, 0.2, 0.04]);
    let bytes = patched(&corners, &triangles, |json, binary| {
        let start = binary.len();
        for corner in &corners {
            for value in corner {
                binary.extend(((value / 0.2 * 32767.0).round() as i16).to_le_bytes());
            }
            binary.extend([0, 0]);
        }
        let views = json["bufferViews"].as_array_mut().unwrap();
        views.push(serde_json::json!({
            "buffer": 0, "byteOffset": start, "byteLength": 8 * corners.len(), "byteStride": 8
        }));
        let view = views.len() - 1;
        json["accessors"][0] = serde_json::json!({
            "bufferView": view, "componentType": 5122, "normalized": true, "count": corners.len(), "type": "VEC3",
            "min": [0, 0, 0], "max": [9831, 32767, 6554],
        });
        json["nodes"][0]["scale"] = serde_json::json!([0.2, 0.2, 0.2]);
        json["extensionsUsed"] = serde_json::json!(["KHR_mesh_quantization"]);
        json["extensionsRequired"] = serde_json::json!(["KHR_mesh_quantization"]);
    });
    let object = import_from(&disk(&[("carton.glb", &bytes)]), "carton.glb", &Given::default()).unwrap();
    let size = object.model.card.size_m;
    assert!(size.abs_diff_eq(glam::DVec3::new(0.06, 0.04, 0.2), 1e-5), "{size}");
    // Without the extension such positions violate the standard.
    let plain = patched(&corners, &triangles, |json, _| json["accessors"][0]["componentType"] = 5122.into());
    assert!(import_from(&disk(&[("a.glb", &plain)]), "a.glb", &Given::default()).is_err());
}

#[test]
fn webp_textures_are_seen_and_other_scenes_are_named() {
    // 2 x 2 pixels of one colour, lossless, as libwebp writes them.
    let webp = include_bytes!("../../testdata/red.webp");
    let (corners, triangles) = upright_box([0.06, 0.1, 0.04]);
    let glb = |has_webp: bool| {
        patched(&corners, &triangles, |json, binary| {
            let uvs = binary.len();
            binary.extend(corners.iter().flat_map(|_| [0.5_f32, 0.5]).flat_map(f32::to_le_bytes));
            let image = binary.len();
            binary.extend(webp);
            let views = json["bufferViews"].as_array_mut().unwrap();
            let first = views.len();
            views.push(serde_json::json!({ "buffer": 0, "byteOffset": uvs, "byteLength": 8 * corners.len() }));
            views.push(serde_json::json!({ "buffer": 0, "byteOffset": image, "byteLength": webp.len() }));
            json["accessors"].as_array_mut().unwrap().push(serde_json::json!({
                "bufferView": first, "componentType": 5126, "count": corners.len(), "type": "VEC2"
            }));
            json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 2.into();
            json["images"] = serde_json::json!([{ "bufferView": first + 1, "mimeType": "image/webp" }]);
            json["textures"] = match has_webp {
                true => serde_json::json!([{ "extensions": { "EXT_texture_webp": { "source": 0 } } }]),
                false => serde_json::json!([{}]),
            };
            json["materials"][0]["pbrMetallicRoughness"] = serde_json::json!({ "baseColorTexture": { "index": 0 } });
            json["extensionsUsed"] = serde_json::json!(["EXT_texture_webp"]);
            json["extensionsRequired"] = serde_json::json!(["EXT_texture_webp"]);
            // The default scene is empty, as some exporters leave it.
            json["scenes"] = serde_json::json!([{ "nodes": [] }, { "name": "shown", "nodes": [0] }]);
        })
    };
    let object = import_from(&disk(&[("tin.glb", &glb(true))]), "tin.glb", &Given::default()).unwrap();
    let texture = object.model.links[0].visual[0].material.texture.as_ref().unwrap();
    assert_eq!((texture.width, texture.height, &texture.rgb[..3]), (2, 2, &[200, 20, 20][..]));
    assert!(
        object.report.repairs.iter().any(|note| note == "of its scenes shown is read, not 0"),
        "{:?}",
        object.report
    );
    let object = import_from(&disk(&[("tin.glb", &glb(false))]), "tin.glb", &Given::default()).unwrap();
    assert!(object.report.repairs.iter().any(|note| note.contains("has no image")), "{:?}", object.report.repairs);
}

#[test]
fn mirrored_nodes_keep_their_outside() {
    let (corners, triangles) = upright_box([0.06, 0.1, 0.04]);
    let bytes = patched(&corners, &triangles, |json, _| {
        // One copy mirrored, one not: flipping all triangles would repair neither.
        json["nodes"] = serde_json::json!([
            { "mesh": 0, "scale": [-1, 1, 1], "name": "left" }, { "mesh": 0, "translation": [0.1, 0, 0], "name": "right" }
        ]);
        json["scenes"] = serde_json::json!([{ "nodes": [0, 1] }]);
    });
    let object = import_from(&disk(&[("pair.glb", &bytes)]), "pair.glb", &Given::default()).unwrap();
    for part in &object.model.links[0].visual {
        let corner = |index: u32| part.mesh.positions[index as usize].as_dvec3();
        let middle =
            part.mesh.positions.iter().map(|at| at.as_dvec3()).sum::<glam::DVec3>() / part.mesh.positions.len() as f64;
        for triangle in &part.mesh.triangles {
            let [a, b, c] = triangle.map(corner);
            assert!((b - a).cross(c - a).dot(a - middle) > 0.0, "{} faces inwards", part.name);
        }
    }
}

//! USD: files of Pixar's library against what it says of them, and small stages with known contents.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use genmanip_core::{Aabb, JointKind, ObjectModel, Pose};
use genmanip_import::{Given, Imported};
use glam::DVec3;
use serde::Deserialize;

use crate::rigid::{Disk, disk, import_from, png};

/// Folder with files made by `python/tests/interop_usd.py`, in place of the recorded one.
const FOLDER: &str = "GENMANIP_USD_FILES";

/// Facts that Pixar's library states of its files.
#[derive(Deserialize)]
struct Expected {
    files: Vec<ExpectedFile>,
}

#[derive(Deserialize)]
struct ExpectedFile {
    file: String,
    joints: Vec<ExpectedJoint>,
    masses_kg: BTreeMap<String, f64>,
    poses: Vec<ExpectedPose>,
}

#[derive(Deserialize)]
struct ExpectedJoint {
    name: String,
    kind: String,
    range: [f64; 2],
}

#[derive(Deserialize)]
struct ExpectedPose {
    joints: BTreeMap<String, f64>,
    /// Lower and upper corner of each link's extent.
    links: BTreeMap<String, [[f64; 3]; 2]>,
}

#[test]
fn files_of_pixars_library_have_its_poses_sizes_joints_and_masses() {
    let recorded = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/usd");
    let folder = std::env::var_os(FOLDER).map_or(recorded, PathBuf::from);
    let files: Disk = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap()))
        .collect();
    let expected: Expected = serde_json::from_slice(&files["expected.json"]).unwrap();
    assert_eq!(expected.files.len(), 30);
    for file in &expected.files {
        let object = import_from(&files, &file.file, &Given::default()).unwrap();
        check(file, &object);
    }
}

fn check(expected: &ExpectedFile, object: &Imported) {
    let (model, file) = (&object.model, &expected.file);
    let joints: Vec<_> = model.links.iter().filter_map(|link| link.joint.as_ref()).collect();
    assert_eq!(joints.len(), expected.joints.len(), "{file}");
    for wanted in &expected.joints {
        let joint = joints.iter().find(|joint| joint.name == wanted.name).unwrap();
        let kind = if wanted.kind == "revolute" { JointKind::Revolute } else { JointKind::Prismatic };
        assert_eq!(joint.kind, kind, "{file} {}", wanted.name);
        for (got, wanted) in joint.range.iter().zip(wanted.range) {
            assert!((got - wanted).abs() < 1e-6, "{file}: {got} instead of {wanted}");
        }
    }
    for (name, wanted) in &expected.masses_kg {
        let link = model.links.iter().find(|link| link.name == *name).unwrap();
        assert!(
            (link.mass.mass_kg - wanted).abs() < 1e-6,
            "{file} {name}: {} instead of {wanted} kg",
            link.mass.mass_kg
        );
    }
    for pose in &expected.poses {
        let at = |name: &str| pose.joints.get(name).copied().unwrap_or(0.0);
        let positions: Vec<f64> = joints.iter().map(|joint| at(&joint.name)).collect();
        let extent = |name: &str| collision_extent(model, &positions, name);
        let corners = |[low, high]: [[f64; 3]; 2]| [DVec3::from_array(low), DVec3::from_array(high)];
        // Imported objects stand at the origin: extents are compared from that of the root.
        let root = &model.links[0].name;
        let wanted_root = corners(pose.links[root]);
        let moved = wanted_root[0] - extent(root).min;
        for (name, wanted) in &pose.links {
            let (got, [low, high]) = (extent(name), corners(*wanted));
            let off = (got.min + moved - low).abs().max((got.max + moved - high).abs()).max_element();
            assert!(off < 1e-6, "{file}: {name} is {off} m off at {:?}: {got:?}", pose.joints);
        }
    }
}

/// Extent of a link's collision pieces.
fn collision_extent(model: &ObjectModel, positions: &[f64], name: &str) -> Aabb {
    let index = model.links.iter().position(|link| link.name == name).unwrap();
    Aabb::from_pieces(&model.link_poses(positions)[index], &model.links[index].pieces)
}

/// A stage in metres, +z up, whose default prim contains this.
fn stage(body: &str) -> Vec<u8> {
    format!(
        "#usda 1.0\n(\n    defaultPrim = \"mug\"\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\n\
         def Xform \"mug\"\n{{\n{body}\n}}\n"
    )
    .into_bytes()
}

/// A square plate of 10 cm with one texture coordinate per corner.
const PLATE: &str = r#"
    def Mesh "plate" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
        point3f[] points = [(0,0,0), (0.1,0,0), (0,0.1,0), (0.1,0.1,0), (0,0,0.02), (0.1,0,0.02), (0,0.1,0.02), (0.1,0.1,0.02)]
        texCoord2f[] primvars:st = [(0.25, 0.75)] (interpolation = "constant")
        uniform token subdivisionScheme = "none"
        rel material:binding = </mug/paint>
    }
"#;

fn paint(file: &str) -> String {
    format!(
        r#"
    def Material "paint"
    {{
        token outputs:surface.connect = </mug/paint/surface.outputs:surface>
        def Shader "surface"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </mug/paint/image.outputs:rgb>
            float inputs:roughness = 0.25
            token outputs:surface
        }}
        def Shader "image"
        {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @{file}@
            float2 inputs:st.connect = </mug/paint/reader.outputs:result>
            float3 outputs:rgb
        }}
        def Shader "reader"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
    }}
"#
    )
}

fn notes(object: &Imported) -> String {
    object.report.repairs.join("\n")
}

#[test]
fn textures_are_anchored_to_the_layer_that_names_them() {
    // Rows from the top: red, green; the coordinate points into the upper row.
    let image = png(2, 2, &[[200, 0, 0], [200, 0, 0], [0, 200, 0], [0, 200, 0]].concat());
    let outer = stage("")
        .iter()
        .map(|&byte| byte as char)
        .collect::<String>()
        .replace("def Xform \"mug\"", "def Xform \"mug\" (prepend payload = @parts/look.usda@)");
    let files = disk(&[
        ("mug.usda", outer.as_bytes()),
        ("parts/look.usda", &stage(&(PLATE.to_owned() + &paint("./skin.png")))),
        ("parts/skin.png", &image),
    ]);
    let object = import_from(&files, "mug.usda", &Given::default()).unwrap();
    let part = &object.model.links[0].visual[0];
    let texture = part.material.texture.as_ref().unwrap();
    let uv = part.mesh.uvs[0];
    let pixel = (uv.y * texture.height as f32) as usize * 2 + (uv.x * texture.width as f32) as usize;
    assert_eq!(&texture.rgb[3 * pixel..3 * pixel + 3], [200, 0, 0], "{uv}");
    assert!((part.material.roughness - 0.25).abs() < 1e-6);
}

#[test]
fn what_is_missing_or_not_used_is_said() {
    let broken = PLATE.to_owned()
        + &paint("/home/somebody/skin.png")
        + r#"
    def Xform "handle" (prepend payload = @./handle.usd@) {}
    def Xform "spout" (prepend references = </mug/nowhere>) {}
    def Camera "eye" {}
    def Xform "lamp" { def SphereLight "bulb" {} }
    def PointInstancer "crumbs" { def Cube "crumb" {} }
    over "ghost" { def Cube "unseen" {} }
    def Mesh "spare" (active = false) {}
"#;
    let object = import_from(&disk(&[("mug.usda", &stage(&broken))]), "mug.usda", &Given::default()).unwrap();
    let said = notes(&object);
    for part in [
        "handle.usd",
        "/mug/spout is empty",
        "there is no such file",
        "/home/somebody/skin.png",
        "Camera (1)",
        "SphereLight (1)",
        "PointInstancer (1)",
    ] {
        assert!(said.contains(part), "{part} in {said}");
    }
    assert_eq!(object.model.links[0].visual.len(), 1, "{said}");
    let size = object.model.card.size_m;
    assert!(size.abs_diff_eq(DVec3::new(0.1, 0.1, 0.02), 1e-6), "{size}");
}

#[test]
fn units_up_axis_materials_and_subsets_of_a_plain_stage() {
    let text = r#"#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Xform "box"
{
    double3 xformOp:translate = (100, 3, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "sides"
    {
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 2, 3, 1, 4, 5, 7, 6, 0, 1, 5, 4, 2, 6, 7, 3, 0, 4, 6, 2, 1, 3, 7, 5]
        point3f[] points = [(0,0,0), (8,0,0), (0,4,0), (8,4,0), (0,0,6), (8,0,6), (0,4,6), (8,4,6)]
        color3f[] primvars:displayColor = [(0, 0, 1)]
        def GeomSubset "lid" (prepend apiSchemas = ["MaterialBindingAPI"])
        {
            uniform token elementType = "face"
            int[] indices = [3]
            rel material:binding = </box/red>
        }
    }
    def Material "red"
    {
        color3f inputs:tint = (1, 0, 0)
        token outputs:surface.connect = </box/red/surface.outputs:surface>
        def Shader "surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </box/red.inputs:tint>
            token outputs:surface
        }
    }
}
"#;
    let object = import_from(&disk(&[("a/box.usda", text.as_bytes())]), "a/box.usda", &Given::default()).unwrap();
    let model = &object.model;
    assert!(model.card.size_m.abs_diff_eq(DVec3::new(0.08, 0.06, 0.04), 1e-6), "{}", model.card.size_m);
    let colors: Vec<[f32; 3]> = model.links[0].visual.iter().map(|part| part.material.base_color).collect();
    for (color, wanted) in colors.iter().zip([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) {
        assert!(color.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{colors:?}");
    }
    assert_eq!(colors.len(), 2);
    let top = &model.links[0].visual[0].mesh;
    assert!(
        top.positions.iter().all(|at| (at.z - 0.04).abs() < 1e-6),
        "the fourth face is the top: {:?}",
        top.positions
    );
    // A stage that does not say its unit is in centimetres, by the standard, unless it would be tiny.
    for (unit, size, longest) in [("", 8.0, 0.08), ("", 0.08, 0.08)] {
        let text = text.replace("    metersPerUnit = 0.01\n", unit).replace("(100, 3, 0)", "(0, 0, 0)");
        let text = text.replace(
            "def Mesh",
            "float3 xformOp:scale = (S, S, S)\nuniform token[] xformOpOrder = [\"xformOp:scale\"]\ndef Mesh",
        );
        let text = text.replacen("uniform token[] xformOpOrder = [\"xformOp:translate\"]\n", "", 1);
        let text = text.replace("(S, S, S)", &format!("({0}, {0}, {0})", size / 8.0));
        let object = import_from(&disk(&[("box.usda", text.as_bytes())]), "box.usda", &Given::default()).unwrap();
        let got = object.model.card.size_m.max_element();
        assert!((got - longest).abs() < 1e-6, "{size}: {got}");
        assert!(notes(&object).contains("metersPerUnit is not stated"), "{}", notes(&object));
    }
}

/// Two boxes of 10 cm; the second is a body.
const SCENE: &str = r#"
    def Cube "floor" (prepend apiSchemas = ["PhysicsCollisionAPI"])
    {
        double size = 2
        double3 xformOp:translate = (0, 0, -1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "die" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI", "PhysicsMassAPI"])
    {
        double size = 0.1
        float physics:density = 500
        double3 xformOp:translate = (0, 0, 0.05)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"#;

#[test]
fn one_free_body_in_a_scene_is_the_object_and_several_are_refused() {
    let object = import_from(&disk(&[("die.usda", &stage(SCENE))]), "die.usda", &Given::default()).unwrap();
    assert!(object.model.card.size_m.abs_diff_eq(DVec3::splat(0.1), 1e-9));
    assert!((object.model.card.mass_kg - 0.5).abs() < 1e-9, "{}", object.model.card.mass_kg);
    assert!(notes(&object).contains("surrounding scene"), "{}", notes(&object));
    let two = SCENE.to_owned() + &SCENE.replace("\"floor\"", "\"ground\"").replace("\"die\"", "\"second\"");
    let error =
        import_from(&disk(&[("two.usda", &stage(&two))]), "two.usda", &Given::default()).map(|_| ()).unwrap_err();
    assert!(error.message.contains("/mug/second") && error.hint.contains("one object per file"), "{error}");
}

#[test]
fn damaged_and_hostile_stages_are_refused() {
    let deep = format!("#usda 1.0\n{}", "def \"a\" {\n".repeat(100_000));
    let bad_face = String::from_utf8(stage(PLATE)).unwrap().replace("[0, 2, 3, 1,", "[0, 2, 3, 99,");
    let around = "#usda 1.0\n(\n subLayers = [@loop.usda@]\n)\ndef \"a\" (references = @loop.usda@</a>) {}\n";
    for (what, file, bytes) in [
        ("nothing", "a.usda", Vec::new()),
        ("no USD", "a.usd", b"hello".to_vec()),
        ("cut off", "a.usda", stage(PLATE)[..400].to_vec()),
        ("empty", "a.usda", stage("")),
        ("nested deeply", "a.usda", deep.into_bytes()),
        ("a face without vertices", "a.usda", bad_face.into_bytes()),
        ("binary without contents", "a.usdc", b"PXR-USDC\0\x08\0\0\0\0\0\0".to_vec()),
        ("no archive", "a.usdz", b"PK\x03\x04".to_vec()),
        ("a loop", "loop.usda", around.as_bytes().to_vec()),
    ] {
        let error = import_from(&disk(&[(file, &bytes)]), file, &Given::default()).map(|_| ()).unwrap_err();
        assert!(error.file == file && !error.hint.is_empty(), "{what}: {error} / {}", error.hint);
    }
}

#[test]
fn joints_to_the_world_that_turn_have_a_still_base() {
    let door = r#"
    def Cube "frame" (prepend apiSchemas = ["PhysicsCollisionAPI"])
    {
        double size = 0.1
    }
    def Cube "door" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
    {
        double size = 0.1
        double3 xformOp:translate = (0.1, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def PhysicsRevoluteJoint "hinge" (prepend apiSchemas = ["PhysicsDriveAPI:angular"])
    {
        rel physics:body1 = </mug/door>
        point3f physics:localPos0 = (0.05, -0.05, 0)
        point3f physics:localPos1 = (-0.05, -0.05, 0)
        uniform token physics:axis = "Z"
        float physics:upperLimit = 90
        float drive:angular:physics:damping = 0.5
    }
    def PhysicsSphericalJoint "knob" { rel physics:body0 = </mug/door>
        rel physics:body1 = </nowhere> }
"#;
    let object = import_from(&disk(&[("door.usda", &stage(door))]), "door.usda", &Given::default()).unwrap();
    let joint = object.model.links[1].joint.as_ref().unwrap();
    assert_eq!((joint.name.as_str(), joint.kind, joint.axis), ("hinge", JointKind::Revolute, DVec3::Z));
    assert!(
        (joint.range[0] + std::f64::consts::PI).abs() < 1e-6 && (joint.range[1] - 90_f64.to_radians()).abs() < 1e-6
    );
    assert!((joint.damping - 0.5_f64.to_degrees()).abs() < 1e-6, "per radian: {}", joint.damping);
    // The joint's own place, from the lower corner of the two boxes at the origin.
    let at = object.model.link_poses(&[0.0])[1].position;
    assert!(at.abs_diff_eq(DVec3::new(0.0, -0.05, 0.05), 1e-6), "{at}");
    assert!(notes(&object).contains("knob: left out"), "{}", notes(&object));
    // Open, the door lies where the frame is.
    let turned = object.model.world_bounds(&Pose::IDENTITY, &[90_f64.to_radians()]);
    assert!(turned.size().abs_diff_eq(DVec3::splat(0.1), 1e-6), "{turned:?}");
}

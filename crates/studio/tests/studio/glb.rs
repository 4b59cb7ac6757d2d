//! Files read back by an independent reader, and by our own import.

use genmanip_assets::Catalogue;
use genmanip_core::glam::{DMat4, DVec3};
use genmanip_core::{ObjectModel, Pose};
use genmanip_import::{Given, import};
use genmanip_studio::scene::exported::scenario_file;
use genmanip_studio::scene::glb::link_glb;
use genmanip_studio::scene::meshes::{Body, MeshStore};
use genmanip_workspace::scenarios::read_scenario;

use crate::client::suite_scenario;

/// Textured, plain, transparent and metal objects, one with several parts, and articulated ones.
const OBJECTS: [&str; 8] = ["001", "004", "010", "019", "020", "032", "051", "060"];

#[test]
fn links_are_read_back_as_they_are() {
    for uid in OBJECTS {
        let model = Catalogue::builtin().build(uid).unwrap();
        for link in &model.links {
            let file = link_glb(&link.name, &link.visual).unwrap();
            let (document, buffers) = read(&file);
            let triangles: usize = link.visual.iter().map(|part| part.render_mesh.triangles.len()).sum();
            let (mut read_triangles, mut low, mut high) = (0, DVec3::INFINITY, DVec3::NEG_INFINITY);
            for primitive in document.meshes().flat_map(|mesh| mesh.primitives()) {
                let reader = primitive.reader(|_| Some(&buffers));
                let positions: Vec<DVec3> =
                    reader.read_positions().unwrap().map(|at| DVec3::from(at.map(f64::from))).collect();
                assert_eq!(reader.read_normals().unwrap().len(), positions.len(), "{uid}");
                let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
                assert!(indices.iter().all(|&corner| (corner as usize) < positions.len()), "{uid}");
                read_triangles += indices.len() / 3;
                (low, high) = positions.iter().fold((low, high), |(low, high), &at| (low.min(at), high.max(at)));
            }
            assert_eq!(read_triangles, triangles, "{uid} {}", link.name);
            let (expected_low, expected_high) = bounds(&link.visual);
            assert!((low - expected_low).length() < 1e-6 && (high - expected_high).length() < 1e-6, "{uid}");
        }
    }
}

/// Size and mean colour of objects that are imported from their own files.
#[test]
fn objects_are_imported_again() {
    for uid in ["001", "019", "020", "051"] {
        let model = Catalogue::builtin().build(uid).unwrap();
        let file = link_glb("body", &model.links[0].visual).unwrap();
        let mut read =
            |path: &str, _| if path == "own.glb" { Ok(file.clone()) } else { Err("no such file".to_owned()) };
        // Links stand z up, as `up: z` says.
        let given = Given { scale: Some(1.0), up: Some(genmanip_import::raw::Up::Z), ..Given::default() };
        let imported = import("own.glb", &mut read, &given, None).unwrap().model;
        let (own, other) = (model.visual_bounds(&[]).size(), imported.visual_bounds(&[]).size());
        assert!((own - other).abs().max_element() < 1e-4, "{uid}: {own} {other}");
        let (own, other) = (mean_color(&model), mean_color(&imported));
        let difference = own.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(difference < 0.02, "{uid}: {own:?} {other:?}");
    }
}

#[test]
fn a_scenario_stands_upright_in_its_file() {
    let scenario = read_scenario(&suite_scenario()).unwrap();
    let file = scenario_file(&scenario, Catalogue::all()).unwrap();
    let (document, _) = read(&file);
    let scene = document.default_scene().unwrap();
    let root = scene.nodes().next().unwrap();
    assert_eq!((root.name(), scene.nodes().len()), (Some(scenario.id.as_str()), 1));
    let y_up = DMat4::from_cols_array_2d(&root.transform().matrix().map(|column| column.map(f64::from)));
    assert!((y_up.transform_vector3(DVec3::Z) - DVec3::Y).length() < 1e-6);
    for placed in &scenario.objects {
        let node = root.children().find(|node| node.name().unwrap().starts_with(&format!("{} ", placed.id))).unwrap();
        let (at, [x, y, z, w], _) = node.transform().decomposed();
        let pose = Pose::from_wxyz_array(at.map(f64::from), [w, x, y, z].map(f64::from));
        assert!(pose.position.distance(placed.pose.position) < 1e-6 && pose.angle_to(&placed.pose) < 1e-3);
        assert!(node.children().any(|link| link.mesh().is_some()));
    }
    let cameras: Vec<&str> = document.cameras().filter_map(|camera| camera.name()).collect();
    let own: Vec<&str> = scenario.world.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(cameras, own);
}

#[test]
fn meshes_are_named_by_their_content_and_kept() {
    let store = MeshStore::default();
    let hashes = |uid: &str| store.hashes(&Body::Object(Catalogue::builtin().build(uid).unwrap())).unwrap();
    let (first, again, other) = (hashes("001"), hashes("001"), hashes("020"));
    assert_eq!(first, again);
    assert_ne!(first, other);
    let hash = first[0].as_deref().unwrap();
    let model = Catalogue::builtin().build("001").unwrap();
    let expected = link_glb(&model.links[0].name, &model.links[0].visual).unwrap();
    assert_eq!(*store.file(hash).unwrap(), *expected);
    assert!(store.file("0123").is_none());
}

/// Files are small enough to be loaded in a moment.
#[test]
fn files_are_small() {
    let size = |links: &mut dyn Iterator<Item = usize>| links.sum::<usize>();
    for card in Catalogue::builtin().cards() {
        let Ok(model) = Catalogue::builtin().build(&card.uid) else { continue };
        let bytes = size(&mut model.links.iter().map(|link| link_glb(&link.name, &link.visual).unwrap().len()));
        assert!(bytes <= 300_000, "{}: {bytes} bytes", card.uid);
    }
    let robot = genmanip_assets::panda();
    let bytes = size(&mut robot.links.iter().map(|link| link_glb(&link.name, &link.visual).unwrap().len()));
    assert!(bytes <= 800_000, "{bytes} bytes");
}

fn read(file: &[u8]) -> (gltf::Document, Vec<u8>) {
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(file).unwrap();
    (document, blob.unwrap())
}

fn bounds(visual: &[genmanip_core::VisualPart]) -> (DVec3, DVec3) {
    let points = visual.iter().flat_map(|part| {
        part.render_mesh.positions.iter().map(|at| part.link_from_part.transform_point(at.as_dvec3()))
    });
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
}

/// Mean sRGB colour of the surface, by area; textures by their mean pixel.
fn mean_color(model: &ObjectModel) -> [f32; 3] {
    let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
    for part in model.links.iter().flat_map(|link| &link.visual) {
        let area: f64 = part.render_mesh.corners().map(|[a, b, c]| (b - a).cross(c - a).length()).sum();
        let texture = part.material.texture.as_ref();
        for (index, sum) in sum.iter_mut().enumerate() {
            let mean = texture.map_or(1.0, |texture| {
                let pixels = texture.rgb.iter().skip(index).step_by(3);
                pixels.map(|&value| f32::from(value)).sum::<f32>() / (texture.rgb.len() / 3) as f32 / 255.0
            });
            *sum += mean * part.material.base_color[index] * area as f32;
        }
        total += area as f32;
    }
    sum.map(|value| value / total)
}

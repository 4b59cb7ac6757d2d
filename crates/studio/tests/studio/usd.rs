//! Exported USD, read back by our own import.

use genmanip_assets::Catalogue;
use genmanip_core::Aabb;
use genmanip_import::raw::Up;
use genmanip_import::{Given, import};
use genmanip_studio::scene::exported::{models, scenario_stage};

use crate::{CANS, DRAWER, scenario};

/// Every object of two scenarios, one of them articulated: size and place of each link's colliders, masses, joints.
#[test]
fn objects_of_a_scenario_are_read_back_as_they_are() {
    for name in [CANS, DRAWER] {
        let scenario = scenario(name);
        let models = models(&scenario, Catalogue::all()).unwrap();
        let stage = scenario_stage(&scenario, Catalogue::all(), "textures").unwrap();
        assert!(!stage.textures.is_empty() && stage.text.contains("@./textures/0.png@"), "{name}");
        for (placed, model) in scenario.objects.iter().zip(&models) {
            // A stage of this object alone, upright at the origin; names of prims start with a letter.
            let prim = placed.id.as_str().replace('-', "_");
            let prim = if prim.starts_with(|c: char| c.is_ascii_digit()) { format!("_{prim}") } else { prim };
            let single = format!(
                "#usda 1.0\n(\n defaultPrim = \"it\"\n metersPerUnit = 1\n upAxis = \"Z\"\n)\n\
                 def Xform \"it\" (prepend references = @scene.usda@</World/{}>)\n{{\n\
                 quatd xformOp:orient = (1, 0, 0, 0)\n double3 xformOp:translate = (0, 0, 0)\n}}\n",
                prim
            );
            let mut read = |path: &str, _| match path {
                "one.usda" => Ok(single.clone().into_bytes()),
                "scene.usda" => Ok(stage.text.clone().into_bytes()),
                _ => Err("there is no such file".to_owned()),
            };
            let given = Given { up: Some(Up::Z), ..Given::default() };
            let object = import("one.usda", &mut read, &given, None).unwrap();
            let (own, other) = (model, &object.model);
            assert_eq!(own.links.len(), other.links.len(), "{name} {}", placed.id);
            let place = format!("{name} {}", placed.id);
            let zero = vec![0.0; own.joint_count()];
            let extents = |model: &genmanip_core::ObjectModel| -> Vec<Aabb> {
                let poses = model.link_poses(&zero);
                model.links.iter().zip(poses).map(|(link, pose)| Aabb::from_pieces(&pose, &link.pieces)).collect()
            };
            for (index, (a, b)) in extents(own).iter().zip(extents(other)).enumerate() {
                let (link, again) = (&own.links[index], &other.links[index]);
                let off = (a.size() - b.size()).abs().max_element();
                assert!(off < 1e-5, "{place} {}: {off}", link.name);
                assert!((link.mass.mass_kg - again.mass.mass_kg).abs() < 1e-6, "{place} {}", link.name);
                let joints = link.joint.as_ref().zip(again.joint.as_ref());
                assert_eq!(link.joint.is_some(), joints.is_some(), "{place} {}", link.name);
                if let Some((a, b)) = joints {
                    assert_eq!(a.kind, b.kind, "{place}");
                    let off = (0..2).map(|end| (a.range[end] - b.range[end]).abs()).fold(0.0, f64::max);
                    assert!(off < 1e-6, "{place} {}: {:?} {:?}", a.name, a.range, b.range);
                    assert!((a.damping - b.damping).abs() < 1e-6 * a.damping.max(1.0), "{place} {}", a.name);
                }
            }
        }
    }
}

/// The image plane of each camera shows the same rays as its intrinsics, with pixels that are not square and the
/// principal point off the centre, too.
#[test]
fn cameras_keep_their_principal_point() {
    let mut scenario = scenario(CANS);
    let first = &mut scenario.world.cameras[0];
    let seen = &mut first.intrinsics;
    (seen.fx, seen.fy, seen.cx, seen.cy) = (401.5, 398.25, 0.4 * f64::from(seen.width), 0.63 * f64::from(seen.height));
    let stage = scenario_stage(&scenario, Catalogue::all(), "textures").unwrap();
    let (seen, name) = (scenario.world.cameras[0].intrinsics, scenario.world.cameras[0].name.clone());
    let text = stage.text.split(&format!("def Camera \"{name}\"")).nth(1).unwrap();
    let number = |key: &str| -> f64 {
        let rest = text.split(&format!("float {key} = ")).nth(1).unwrap();
        rest.split_whitespace().next().unwrap().parse().unwrap()
    };
    let [focal, wide, high] = ["focalLength", "horizontalAperture", "verticalAperture"].map(number);
    let off = ["horizontalApertureOffset", "verticalApertureOffset"].map(number);
    // Edges of the image in USD's camera frame (x right, y up) at unit distance, as UsdGeomCamera defines them.
    let left_and_right = [-0.5, 0.5].map(|side| (off[0] + side * wide) / focal);
    let top_and_bottom = [0.5, -0.5].map(|side| (off[1] + side * high) / focal);
    for (edge, wanted) in left_and_right.iter().zip([-0.5, f64::from(seen.width) - 0.5]) {
        assert!((edge - (wanted - seen.cx) / seen.fx).abs() < 1e-12, "{edge}");
    }
    for (edge, wanted) in top_and_bottom.iter().zip([-0.5, f64::from(seen.height) - 0.5]) {
        assert!((edge + (wanted - seen.cy) / seen.fy).abs() < 1e-12, "{edge}");
    }
}

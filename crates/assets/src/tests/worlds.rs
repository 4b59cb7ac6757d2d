//! Worlds from text: the default world, fault reports, and differences.

use genmanip_core::{CameraMount, Document, World, WorldPart};

use crate::worlds::{DEFAULT_TEXT, default_world, read};
use crate::{panda, robots};

#[test]
fn the_default_world_round_trips_through_json() {
    let (world, robot) = read(DEFAULT_TEXT).unwrap();
    assert_eq!(world, *default_world());
    assert_eq!((world.robot.name.as_str(), &world.robot.home), ("panda", &panda().home));
    assert_eq!(robot.home, panda().home);
    let wrist = world.camera("wrist").unwrap();
    assert_eq!((wrist.mount, Some(wrist.mount_from_camera)), (CameraMount::Hand, panda().hand_from_wrist_camera));
    assert_eq!(world.prompt_cameras().len(), 3);
    assert_eq!(World::from_json(&world.to_json()).unwrap(), world);
    assert_eq!(read(&world.to_json()).unwrap().0, world, "JSON is a world file too");
    let stored = include_str!("../../../core/testdata/world.json");
    assert_eq!(World::from_json(stored).unwrap().hashes().physics, world.hashes().physics, "the test world is stale");
}

/// Replaces text of the default world and returns the paths of all faults, in order.
fn faults(replacements: &[(&str, &str)]) -> Vec<String> {
    let text = replacements.iter().fold(DEFAULT_TEXT.to_owned(), |text, (old, new)| {
        assert!(text.contains(old), "the default world has no `{old}`");
        text.replacen(old, new, 1)
    });
    read(&text).unwrap_err().into_iter().map(|fault| fault.place).collect()
}

#[test]
fn all_faults_are_reported_with_their_path() {
    let check = |replacements: &[(&str, &str)], expected: &[&str]| {
        let found = faults(replacements);
        assert_eq!(found, expected, "{replacements:?}");
    };
    check(&[("genmanip.world/1", "genmanip.world/9")], &["schema"]);
    check(&[("[workspace]", "[workspace")], &["line 20"]);
    check(&[("name = \"panda\"", "name = \"pandas\"")], &["robot.name"]);
    check(&[("id = \"table\"", "id = \"desk\"")], &["surfaces[0].id"]);
    check(&[("top_center_m = [0.40, 0.0, 0.0]", "top_center_m = [0.40, 0.0, 0.1]")], &["surfaces[0].top_center_m[2]"]);
    check(&[("size_m = [1.40, 1.50, 0.04]", "size_m = [1.40, 0.50, 0.04]")], &["workspace"]);
    check(&[("x = [0.2, 0.9]", "x = [0.9, 0.2]")], &["workspace.x"]);
    check(&[("floor_z_m = -0.74", "floor_z_m = 0.0")], &["floor_z_m"]);
    check(&[("legs = true", "leg = true")], &["surfaces[0].leg", "surfaces"]);
    check(
        &[("gravity_m_s2 = 9.81", "gravity_m_s2 = nan"), ("inside_share = 0.5", "inside_share = 5.0")],
        &["physics.gravity_m_s2", "relations.inside_share"],
    );
    check(
        &[
            ("name = \"left\"", "name = \"overview\""),
            ("vertical_fov_deg = 58.0", "preset = \"d999\""),
            ("physics_rate_hz = 480", "physics_rate_hz = 500"),
        ],
        &["cameras[4].preset", "cameras[1].name", "physics.physics_rate_hz"],
    );
    check(&[("vertical_fov_deg = 58.0", "")], &["cameras[4]"]);
    check(&[("target_m = [0.46, 0.0, 0.08]", "")], &["cameras[0]"]);
    check(
        &[("vertical_fov_deg = 58.0", "vertical_fov_deg = 58.0\nmount_from_camara = 1")],
        &["cameras[4].mount_from_camara"],
    );
}

#[test]
fn worlds_differ_by_field_and_by_part() {
    let world = default_world();
    let check = |change: &dyn Fn(&mut World), field: &str, part: WorldPart| {
        let mut other = (*world).clone();
        change(&mut other);
        let differences = world.differences(&other);
        assert!(differences.iter().any(|found| found.field == field && found.part == part), "{field}: {differences:?}");
        for each in WorldPart::ALL {
            assert_eq!(world.hashes().of(each) == other.hashes().of(each), each != part, "{field}: {}", each.name());
        }
        assert_eq!(world.refusal(&other).is_some(), part != WorldPart::Looks, "{field}");
    };
    check(&|world| world.physics.gravity_m_s2 = 1.6, "physics.gravity_m_s2", WorldPart::Physics);
    check(&|world| world.surfaces[0].size_m.y = 1.2, "surfaces.0.size_m.1", WorldPart::Physics);
    check(&|world| world.robot.physics_hash = "x".into(), "robot.physics_hash", WorldPart::Physics);
    check(&|world| world.robot.home[0] = 0.1, "robot.home.0", WorldPart::Physics);
    check(&|world| world.relations.close_m = 0.2, "relations.close_m", WorldPart::Judging);
    check(&|world| world.workspace.x[1] = 0.8, "workspace.x.1", WorldPart::Judging);
    check(&|world| world.cameras[0].intrinsics.fx = 1.0, "cameras.0.intrinsics.fx", WorldPart::Looks);
    check(&|world| world.surfaces[0].legs = false, "surfaces.0.legs", WorldPart::Looks);
    let integer = |world: &mut World| {
        world.physics.engine.insert("impedance_ratio".into(), 30.into());
    };
    let mut spelled = (*world).clone();
    integer(&mut spelled);
    assert_eq!(world.hashes(), spelled.hashes(), "30 and 30.0 are the same number");
}

#[test]
fn robots_are_found_by_name_and_checked_by_field() {
    let error = robots::named("Pandas").unwrap_err().to_string();
    assert!(error.contains("near misses: panda"), "{error}");
    let mut world = (*default_world()).clone();
    world.robot.home[3] = -2.0;
    assert_eq!(robots::of_world(&world).unwrap().home[3], -2.0);
    world.robot.physics_hash = "v2:0".into();
    let error = robots::of_world(&world).unwrap_err().to_string();
    assert!(error.contains("robot.physics_hash"), "{error}");
}

#[test]
fn example_worlds_are_sound() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/worlds");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(read(&text).is_ok(), "{}: {:?}", path.display(), read(&text).unwrap_err());
        count += 1;
    }
    assert!(count >= 2);
}

//! Document round trips, rejected inputs, seeds and projections.

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{
    Aabb, AssetRef, Atom, AtomVerdict, BetweenReading, Distortion, Document, Ending, EpisodeResult, InstanceId,
    Intrinsics, Measurement, Piece, Pose, Projection, RgbdImage, Scenario, Seed, Shape, Task, Unit, World,
};
use proptest::prelude::*;

fn task_text() -> String {
    include_str!("../testdata/task.json").to_owned()
}

/// Asserts that a broken file is rejected with a message containing `expected`.
fn check_refused(text: &str, expected: &str) {
    let message = Task::from_json(text).expect_err("must be refused").to_string();
    assert!(message.contains(expected), "message `{message}` does not contain `{expected}`");
}

#[test]
fn a_task_survives_the_file() {
    let task = Task::from_json(&task_text()).unwrap();
    assert_eq!(Task::from_json(&task.to_json()).unwrap(), task);
    assert_eq!(task.to_json(), Task::from_json(&task.to_json()).unwrap().to_json());
    assert!(task.to_json().starts_with("{\n  \"schema\": \"genmanip.task/2\""));
}

/// Missing fields of version 1 are filled with the values fixed at the time.
#[test]
fn documents_of_version_1_open_and_name_instances_by_their_uid() {
    let old = include_str!("../testdata/v1/task.json");
    assert_eq!(Task::from_json(old).unwrap(), Task::from_json(&task_text()).unwrap());
    let moved = {
        let mut value: serde_json::Value = serde_json::from_str(old).unwrap();
        value["objects"].as_array_mut().unwrap().rotate_left(1);
        Task::from_value(value).unwrap()
    };
    assert_eq!(moved, Task::from_json(old).unwrap(), "cards were in any order");
    check_refused(&old.replacen("\"uid\": \"027\"", "\"uid\": \"7\"", 1), "a card of object 7");

    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../cli/testdata/version_1");
    let text = std::fs::read_to_string(folder.join("scenarios/001_long_horizon-000.json")).unwrap();
    let scenario = Scenario::from_json(&text).unwrap();
    for (node, placed) in scenario.task.scene_graph.nodes.iter().zip(&scenario.objects) {
        assert_eq!((&node.id, &*node.asset), (&placed.id, &AssetRef::builtin(placed.id.asset(), 2)));
        assert_eq!(placed.asset, *node.asset);
        assert_eq!(scenario.task.card(&node.id).unwrap().uid, node.id.asset());
        assert!(placed.physics_hash.starts_with("v1:") && placed.judging_hash.is_none());
    }
    assert_eq!(Scenario::from_json(&scenario.to_json()).unwrap(), scenario);
    let variant = Scenario::from_json(&text.replacen("\"seed\": 30", "\"seed\": 31", 1)).unwrap();
    assert!(matches!(&variant.objects[0].asset, AssetRef::Generated { family, .. } if family == "orange"));
    let broken = Scenario::from_json(&text.replacen("\"seed\": 30", "\"seed\": \"\"", 1)).unwrap_err().to_string();
    assert!(broken.contains("$.objects[0].seed"), "{broken}");
}

#[test]
fn broken_files_are_refused_with_the_place() {
    let good = task_text();
    check_refused("{", "line 1");
    check_refused("[]", "expected an object");
    check_refused(&good.replace("genmanip.task/2", "genmanip.task/7"), "genmanip.task/7");
    check_refused(&good.replace("\"pick_and_place\"", "\"juggling\""), "$.kind");
    check_refused(&good.replace("\"relation\": \"top\"", "\"relation\": \"above\""), "$.goal");
    check_refused(&good.replace("0.072", "NaN"), "not JSON");
    check_refused(&good.replace("0.072", "null"), "$.objects[0].size_m");
}

/// A result of version 1, with each cause that it could have.
#[test]
fn results_of_version_1_say_how_they_ended() {
    let old = include_str!("../testdata/result_1.json");
    let cases = [
        ("goal_missed", Some(Ending::Finished)),
        ("slipped", Some(Ending::Finished)),
        ("timeout", Some(Ending::Horizon)),
        ("planning", Some(Ending::GaveUp)),
        ("policy", Some(Ending::GaveUp)),
        ("layout", None),
    ];
    for (cause, ending) in cases {
        let result = EpisodeResult::from_json(&old.replace("goal_missed", cause)).unwrap();
        assert_eq!((result.ending, result.failures.len()), (ending, 1), "{cause}");
        assert_eq!(result.failure().map(|failure| failure.cause.name()), Some(cause));
        assert_eq!(EpisodeResult::from_json(&result.to_json()).unwrap(), result, "{cause}");
    }
    let mut value: serde_json::Value = serde_json::from_str(old).unwrap();
    value["failure"] = serde_json::Value::Null;
    let verified = EpisodeResult::from_value(value).unwrap();
    assert_eq!((verified.ending, verified.failure()), (Some(Ending::Finished), None));
    let refused = EpisodeResult::from_json(&old.replace("goal_missed", "bored")).unwrap_err().to_string();
    assert!(refused.contains("$.failure.cause") && refused.contains("bored"), "{refused}");
}

#[test]
fn poses_refuse_what_is_not_a_rotation() {
    for (text, expected) in [
        (r#"{"position_m":[0,0,0],"orientation_wxyz":[1,1,0,0]}"#, "length"),
        (r#"{"position_m":[0,0,null],"orientation_wxyz":[1,0,0,0]}"#, "null"),
        (r#"{"position_m":[0,0,1e999],"orientation_wxyz":[1,0,0,0]}"#, "out of range"),
        (r#"{"position_m":[0,0],"orientation_wxyz":[1,0,0,0]}"#, "length 2"),
    ] {
        let message = serde_json::from_str::<Pose>(text).unwrap_err().to_string();
        assert!(message.contains(expected), "{text}: {message}");
    }
}

#[test]
fn seeds_are_labelled_and_stay_exact_in_json() {
    let seed = Seed::new(7).fork("episode").fork_index(3);
    assert_eq!(seed.value(), 6_577_676_365_128_076);
    assert!(seed.value() < 1 << 53);
    assert_ne!(seed, Seed::new(7).fork("episode").fork_index(4));
}

/// A verdict decided by one measurement.
fn verdict(margin: f64, unit: Unit) -> AtomVerdict {
    let measurement =
        Measurement { quantity: "q".into(), value: 0.0, threshold: -margin, unit, met: margin >= 0.0, margin };
    AtomVerdict {
        atom: Atom::State { object: InstanceId::new(&"057".into(), 1), state: "open".into() },
        holds: margin >= 0.0,
        margin,
        measurements: vec![measurement],
        other_readings: Vec::new(),
        explanation: String::new(),
    }
}

#[test]
fn margins_of_different_units_are_compared_by_their_scale() {
    // Sorted by normalised margin.
    let ordered = [
        (-1.0, Unit::Fact),
        (-0.5, Unit::Metre),
        (-0.05, Unit::Metre),
        (-0.4, Unit::Share),
        (-0.03, Unit::Metre),
        (-0.25, Unit::Radian),
        (0.02, Unit::Metre),
        (0.3, Unit::Share),
        (0.04, Unit::Metre),
        (0.5, Unit::Radian),
    ];
    for pair in ordered.windows(2) {
        let [lower, higher] = [pair[0], pair[1]].map(|(margin, unit)| verdict(margin, unit).normalised_margin());
        assert!(lower < higher, "{pair:?}: {lower} and {higher}");
    }
    assert_eq!(verdict(0.03, Unit::Metre).normalised_margin(), Unit::Metre.normalise(0.03));
}

/// A world without the key means what was the only reading, and is written and hashed as before.
#[test]
fn a_world_of_before_reads_between_in_space() {
    let old = World::from_json(include_str!("../testdata/world.json")).unwrap();
    assert_eq!(old.relations.between, BetweenReading::Space);
    assert!(old.to_value()["relations"].get("between").is_none());
    let mut new = old.clone();
    new.relations.between = BetweenReading::Plane;
    assert_eq!(new.to_value()["relations"]["between"], "plane");
    assert_eq!(World::from_json(&new.to_json()).unwrap(), new);
    assert_eq!(new.hashes().physics, old.hashes().physics);
    assert_ne!(new.hashes().judging, old.hashes().judging);
}

#[test]
fn verdicts_of_before_are_read_and_units_are_written_as_before() {
    for (unit, symbol) in [(Unit::Metre, "m"), (Unit::Radian, "rad"), (Unit::Share, "1"), (Unit::Fact, "fact")] {
        let text = serde_json::to_string(&verdict(-0.1, unit)).unwrap();
        assert!(text.contains(&format!(r#""unit":"{symbol}""#)), "{text}");
        assert_eq!(serde_json::from_str::<AtomVerdict>(&text).unwrap(), verdict(-0.1, unit));
        assert_eq!(unit.symbol(), symbol);
    }
}

#[test]
fn schemas_on_disk_are_those_of_the_types() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../schemas");
    for (name, schema) in [
        ("task", schemars::schema_for!(Task)),
        ("scenario", schemars::schema_for!(Scenario)),
        ("world", schemars::schema_for!(World)),
        ("result", schemars::schema_for!(genmanip_core::EpisodeResult)),
        ("labels", schemars::schema_for!(genmanip_core::perception::ImageLabels)),
    ] {
        let path = folder.join(format!("{name}.schema.json"));
        let text = serde_json::to_string_pretty(&schema).unwrap() + "\n";
        if std::env::var_os("GENMANIP_UPDATE_SCHEMAS").is_some() {
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(&path, &text).unwrap();
        }
        let stored = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(stored == text, "schemas/{name}.schema.json is stale: run the tests with GENMANIP_UPDATE_SCHEMAS=1");
    }
}

fn any_pose() -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(-2.0..2.0), prop::array::uniform4(-1.0..1.0_f64))
        .prop_filter("needs a direction", |(_, q)| q.iter().map(|v| v * v).sum::<f64>() > 0.01)
        .prop_map(|(p, [x, y, z, w])| Pose::new(DVec3::from_array(p), DQuat::from_xyzw(x, y, z, w)))
}

proptest! {
    /// A pixel unprojected at any depth projects back to the same pixel and depth, for any camera and lens.
    /// The strongest lens folds over at a radius of 1.3 on the image plane; the farthest pixel of any of these is at
    /// 1.22.
    #[test]
    fn pixels_and_points_lead_to_each_other(
        world_from_camera in any_pose(),
        fov in 0.3..0.8_f64,
        shift in prop::array::uniform2(-40.0..40.0_f64),
        stretch in 0.8..1.25_f64,
        lens in prop::option::of((-0.06..0.1_f64, -0.006..0.01_f64, -2e-3..2e-3_f64, -2e-3..2e-3_f64)),
        pixel in (0.0..511.0_f64, 0.0..287.0_f64),
        depth_m in 0.05..5.0_f64,
    ) {
        let pinhole = Intrinsics::from_vertical_fov(512, 288, fov);
        let intrinsics =
            Intrinsics { fx: pinhole.fx * stretch, cx: pinhole.cx + shift[0], cy: pinhole.cy + shift[1], ..pinhole };
        let distortion = lens.map(|(k1, k2, p1, p2)| Distortion { k1, k2, p1, p2, k3: 0.0 });
        let projection = Projection { intrinsics, distortion, world_from_camera };
        let pixel = DVec2::new(pixel.0, pixel.1);
        let point = projection.point(pixel, depth_m).unwrap();
        let (back, depth_back_m) = projection.pixel(point).unwrap();
        prop_assert!(back.distance(pixel) < 1e-7, "{} -> {}", pixel, back);
        prop_assert!((depth_back_m - depth_m).abs() < 1e-12 * (1.0 + point.length()));
        prop_assert!(projection.to_world(projection.to_camera(point)).distance(point) < 1e-12);
        let ray = projection.ray(pixel).unwrap();
        prop_assert!(projection.pixel_of_ray(ray * 3.0).unwrap().distance(pixel) < 1e-7);
        prop_assert_eq!(projection.pixel_of_ray(-ray), None);
        let (eye, direction) = projection.view_ray(pixel).unwrap();
        prop_assert!((point - eye).normalize().distance(direction) < 1e-9);
        prop_assert!(projection.is_in_image(pixel) && !projection.is_in_image(pixel + DVec2::splat(512.0)));
    }

    #[test]
    fn inverse_undoes(pose in any_pose(), point in prop::array::uniform3(-3.0..3.0)) {
        let point = DVec3::from_array(point);
        prop_assert!((pose.inverse().transform_point(pose.transform_point(point)) - point).length() < 1e-12);
    }

    #[test]
    fn poses_survive_the_file_bit_for_bit(pose in any_pose()) {
        let text = serde_json::to_string(&pose).unwrap();
        prop_assert_eq!(serde_json::from_str::<Pose>(&text).unwrap(), pose);
    }

    #[test]
    fn euler_angles_are_about_fixed_axes(pose in any_pose()) {
        let [x, y, z] = pose.to_fixed_xyz_euler();
        let rebuilt = DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x);
        prop_assert!(rebuilt.dot(pose.rotation).abs() > 1.0 - 1e-9);
    }

    #[test]
    fn bounds_hold_every_corner(pose in any_pose(), half in prop::array::uniform3(0.01..0.3)) {
        let half = DVec3::from_array(half);
        let bounds = Aabb::from_pieces(&pose, [&Piece::at(DVec3::ZERO, Shape::Box { half_extents: half })]);
        for corner in 0..8 {
            let sign = |bit: i32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let point = pose.transform_point(half * DVec3::new(sign(0), sign(1), sign(2)));
            prop_assert!(point.cmpge(bounds.min - 1e-12).all() && point.cmple(bounds.max + 1e-12).all());
        }
    }

    #[test]
    fn resizing_keeps_pixels_where_they_were(u in 0.0..511.0, v in 0.0..287.0, depth in 0.1..5.0) {
        let k = Intrinsics::from_vertical_fov(512, 288, 0.8);
        let half = k.resized(256, 144);
        let pixel = half.project(k.unproject(DVec2::new(u, v), depth)).unwrap();
        prop_assert!((pixel - (DVec2::new(u, v) + 0.5) * 0.5 + 0.5).length() < 1e-9);
    }
}

proptest! {
    /// Undistortion inverts distortion for any lens that a world accepts.
    #[test]
    fn distortion_is_invertible(
        k1 in -0.35_f64..0.35, k2 in -0.05_f64..0.1, p in -0.005_f64..0.005, x in -0.6_f64..0.6, y in -0.4_f64..0.4,
    ) {
        let lens = Distortion { k1, k2, p1: p, p2: -0.5 * p, k3: 0.01 };
        let image = Intrinsics::from_vertical_fov(64, 36, 0.7);
        prop_assume!(lens.pinhole(&image).is_some());
        let shown = DVec2::new(x, y) * DVec2::new(0.65, 0.36 / 0.4);
        let back = lens.undistort(lens.distort(shown)).unwrap();
        prop_assert!(back.distance(shown) < 1e-10, "{shown} came back as {back}");
    }
}

/// Distorted and undistorted images agree on the world points of their pixels.
#[test]
fn distorted_images_project_their_own_points() {
    let k = Intrinsics::from_vertical_fov(65, 37, 0.7);
    let lens = Distortion { k1: -0.2, k2: 0.02, p1: 0.003, p2: 0.001, k3: 0.0 };
    let world_from_camera = Pose::new(DVec3::new(0.3, -0.2, 1.0), DQuat::from_rotation_x(2.0));
    let mut image = RgbdImage::of_depth(k, world_from_camera, vec![0.8; 65 * 37]);
    assert_eq!(image.pinhole_depth(), image);
    image.distortion = Some(lens);
    for index in [0, 700, 1202, 65 * 37 - 1] {
        let pixel = image.pixel_of(image.point(index).unwrap()).unwrap();
        assert!((pixel - DVec2::new((index % 65) as f64, (index / 65) as f64)).length() < 1e-6);
    }
    let straight = image.pinhole_depth();
    assert!(
        straight.distortion.is_none() && straight.depth_m.iter().all(|depth| *depth == 0.8),
        "barrel distortion widens the view"
    );
    assert!(image.pixel_of(world_from_camera.transform_point(DVec3::new(0.0, 0.0, -1.0))).is_none());
    // r (1 - 0.2 r²) falls beyond r = 1.29, and is 0.4 at 2.
    image.distortion = Some(Distortion { k1: -0.2, ..Distortion::default() });
    assert!(image.pixel_of(world_from_camera.transform_point(DVec3::new(2.0, 0.0, 1.0))).is_none(), "folded over");
}

/// Sensor models without shutter keep the byte format of files from before shutters were supported.
#[test]
fn a_shutter_that_does_not_blur_is_not_written() {
    use genmanip_core::{CameraSensor, ColorSensor, sensor::SensorPreset};
    let sharp = SensorPreset::named("d435").unwrap().sensor;
    let open = CameraSensor::with_shutter(Some(sharp), 0.02).unwrap();
    for (sensor, is_written) in [(sharp, false), (open, true)] {
        let text = serde_json::to_string(&sensor).unwrap();
        assert_eq!(text.contains("shutter_s"), is_written, "{text}");
        assert_eq!(serde_json::from_str::<CameraSensor>(&text).unwrap(), sensor);
    }
    assert_eq!(CameraSensor::with_shutter(Some(open), 0.0), Some(sharp));
    assert_eq!(CameraSensor::with_shutter(None, 0.0), None);
    let alone = CameraSensor::with_shutter(None, 0.01);
    assert_eq!(alone.unwrap().color, Some(ColorSensor::perfect(0.01)));
    assert_eq!(CameraSensor::with_shutter(alone, 0.0), None);
}

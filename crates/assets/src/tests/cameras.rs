//! Coverage of the default world's cameras, compared to version 1; camera and sensor presets.

use genmanip_core::camera::{CameraPreset, PRESETS};
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::sensor::{SENSORS, SensorPreset};
use genmanip_core::world::{camera_faults, read_camera};
use genmanip_core::{Camera, CameraMount, Distortion, Intrinsics, Reach, RobotModel};
use serde_json::json;

use crate::panda;
use crate::worlds::{DEFAULT_TEXT, default_world, read, text_for};

/// Minimum fraction of the image width that the workspace spans.
const MIN_WIDTH_SHARE: f64 = 0.70;
/// Minimum fraction of the workspace area inside the image: a strip of its near edge, beyond the reach of top-down
/// picks, may be cut off.
const MIN_AREA_SHARE: f64 = 0.93;
/// Magnification relative to the cameras of version 1: "about 1.4 times".
const ENLARGEMENT: std::ops::RangeInclusive<f64> = 1.35..=1.45;

/// A camera fixed in the world.
struct WorldCamera<'a>(&'a Camera);

impl WorldCamera<'_> {
    fn pixel(&self, point: DVec3) -> DVec2 {
        let in_camera = self.0.mount_from_camera.inverse().transform_point(point);
        self.0.intrinsics.project(in_camera).unwrap_or(DVec2::NAN)
    }

    fn sees(&self, point: DVec3) -> bool {
        let (pixel, k) = (self.pixel(point), &self.0.intrinsics);
        pixel.cmpge(DVec2::splat(-0.5)).all()
            && pixel.cmple(DVec2::new(f64::from(k.width) - 0.5, f64::from(k.height) - 0.5)).all()
    }

    /// Width in pixels of an 8 cm cube at the centre of the workspace.
    fn cube_px(&self) -> f64 {
        let middle = DVec3::new(0.55, 0.0, 0.04);
        0.08 * self.0.intrinsics.fx / self.0.mount_from_camera.inverse().transform_point(middle).z
    }
}

#[test]
fn the_default_cameras_cover_the_workspace_and_the_hand() {
    let old: Vec<Camera> =
        serde_json::from_str(include_str!("../../../core/src/upgrade/cameras_of_version_1.json")).unwrap();
    let world = default_world();
    let (robot, area) = (panda(), world.workspace);
    let links = robot.link_poses(&world.robot.home, robot.gripper.max_width);
    // From the flange to between the pads, and the width of the hand.
    let hand = [(-0.1, 0.0), (0.1, 0.0), (-0.1, 0.06), (0.1, 0.06), (0.0, 0.1034)]
        .map(|(y, z)| links[robot.hand].transform_point(DVec3::new(0.0, y, z)));
    for (name, sees_hand) in [("overview", true), ("left", false), ("right", false), ("static", true)] {
        let camera = world.camera(name).unwrap();
        assert_eq!((camera.mount, camera.intrinsics.width, camera.intrinsics.height), (CameraMount::World, 512, 288));
        let eye = WorldCamera(camera);
        let at = |i: usize, j: usize| {
            let part = |[low, high]: [f64; 2], index: usize| low + (high - low) * index as f64 / 40.0;
            DVec3::new(part(area.x, i), part(area.y, j), 0.0)
        };
        let grid = || (0..=40).flat_map(move |i| (0..=40).map(move |j| at(i, j)));
        let seen: Vec<DVec3> = grid().filter(|&point| eye.sees(point)).collect();
        let area_share = seen.len() as f64 / grid().count() as f64;
        assert!(area_share >= MIN_AREA_SHARE, "{name}: {area_share:.3} of the workspace is in the image");
        let columns = || seen.iter().map(|&point| eye.pixel(point).x);
        let span = columns().fold(f64::MIN, f64::max) - columns().fold(f64::MAX, f64::min);
        let share = span / f64::from(camera.intrinsics.width);
        assert!(share >= MIN_WIDTH_SHARE, "{name}: the workspace fills {share:.3} of the width");
        let before = WorldCamera(old.iter().find(|other| other.name == name).unwrap());
        let enlargement = eye.cube_px() / before.cube_px();
        assert!(ENLARGEMENT.contains(&enlargement), "{name}: {enlargement:.3} times as large as before");
        let missed = hand.iter().find(|&&point| sees_hand && !eye.sees(point));
        assert_eq!(missed, None, "{name}: cuts the hand at {:?}", missed.map(|&point| eye.pixel(point)));
    }
    let mirrored = |name: &str| world.camera(name).unwrap().mount_from_camera.position * DVec3::new(1.0, -1.0, 1.0);
    assert_eq!(mirrored("left"), world.camera("right").unwrap().mount_from_camera.position);
}

/// Published vertical fields of view, degrees.
#[test]
fn presets_match_published_values() {
    let vertical = [("d415", 42.5), ("d415_depth", 40.0), ("d435", 42.5), ("d435_depth", 58.0)];
    for (name, published_deg) in vertical {
        let got = CameraPreset::named(name).unwrap().intrinsics().vertical_fov().to_degrees();
        assert!((got - published_deg).abs() <= 3.0, "{name}: {got} instead of {published_deg} +- 3 degrees");
    }
    let focal = [("droid_exterior", 528.0), ("droid_wrist", 700.0), ("paper", 640.0), ("paper_small", 256.0)];
    for (name, focal_px) in focal {
        let got = CameraPreset::named(name).unwrap().intrinsics();
        assert!((got.fx - focal_px).abs() < 0.5 && got.fx == got.fy, "{name}: {} instead of {focal_px} px", got.fx);
    }
    let near = |a: &Intrinsics, b: &Intrinsics| {
        let sides = [(a.fx, b.fx), (a.fy, b.fy), (a.cx, b.cx), (a.cy, b.cy)];
        (a.width, a.height) == (b.width, b.height) && sides.iter().all(|(a, b)| (a - b).abs() < 1e-9)
    };
    for preset in PRESETS {
        let whole = preset.intrinsics();
        assert!(near(&whole.filling(512, 288), &whole.resized(512, 288)), "{}: 16:9 stays whole", preset.name);
        let narrow = whole.filling(640, 480);
        assert!((narrow.vertical_fov() - whole.vertical_fov()).abs() < 1e-12, "{}: cut at the sides", preset.name);
        assert!(narrow.fx == narrow.fy && (narrow.cx, narrow.cy) == (319.5, 239.5), "{narrow:?}");
    }
    assert!(near(
        &CameraPreset::named("paper").unwrap().intrinsics().filling(512, 288),
        &CameraPreset::named("paper_small").unwrap().intrinsics()
    ));
    assert_eq!(CameraPreset::named("d455"), None);
}

/// Image widths at which the devices measure depth, pixels.
const DEPTH_WIDTHS: [(&str, f64); 3] = [("d415", 1280.0), ("d435", 848.0), ("structured-light", 640.0)];

/// Sensor presets are valid, consistent, and accepted by name in files.
#[test]
fn sensor_presets_are_valid_and_named() {
    let entry = |sensor: serde_json::Value| {
        json!({"name": "c", "mount": "world", "eye_m": [1, 0, 1], "target_m": [0, 0, 0], "size_px": [64, 36],
               "vertical_fov_deg": 40, "sensor": sensor})
    };
    let read = |sensor| read_camera(entry(sensor), &panda(), "cameras[0]");
    for SensorPreset { name, sensor, .. } in SENSORS {
        let camera = read(json!(name)).unwrap();
        assert_eq!(camera.sensor, Some(sensor));
        assert_eq!(read(json!(sensor)).unwrap(), camera, "written out");
        assert!(camera_faults(&[camera]).is_empty(), "{name}");
        let depth = sensor.depth.unwrap();
        let half_fov = depth.field_of_view_deg[0].to_radians() / 2.0;
        let width_px = DEPTH_WIDTHS.iter().find(|(known, _)| *known == name).unwrap().1;
        let focal_px = width_px / 2.0 / half_fov.tan();
        assert!((focal_px / depth.focal_length_px - 1.0).abs() < 0.02, "{name}: {focal_px} px");
    }
    let unknown = read(json!("d999")).unwrap_err().to_string();
    assert!(unknown.contains("cameras[0].sensor") && unknown.contains("structured-light"), "{unknown}");
}

/// Every invalid lens or sensor parameter is reported with its path.
#[test]
fn invalid_lenses_and_sensors_are_rejected() {
    let intrinsics = Intrinsics::from_vertical_fov(64, 36, 0.7);
    let usual = Camera::looking_at("c", DVec3::new(1.0, 0.0, 1.0), DVec3::ZERO, intrinsics);
    let device = SensorPreset::named("d435").unwrap().sensor;
    let check = |change: &dyn Fn(&mut Camera), place: &str| {
        let mut camera = Camera { sensor: Some(device), ..usual.clone() };
        change(&mut camera);
        let faults: Vec<String> = camera_faults(&[camera]).iter().map(|fault| fault.place.clone()).collect();
        let expected: Vec<String> = (!place.is_empty()).then(|| format!("cameras[0].{place}")).into_iter().collect();
        assert_eq!(faults, expected);
    };
    let lens = |k1| Some(Distortion { k1, ..Distortion::default() });
    check(&|camera| camera.distortion = lens(-0.1), "");
    check(&|camera| camera.distortion = lens(-5.0), "distortion");
    check(&|camera| camera.distortion = lens(f64::NAN), "distortion");
    let depth = |camera: &mut Camera, change: &dyn Fn(&mut genmanip_core::DepthSensor)| {
        change(camera.sensor.as_mut().unwrap().depth.as_mut().unwrap());
    };
    check(&|camera| depth(camera, &|it| it.baseline_m = 0.0), "sensor.depth.baseline_m");
    check(&|camera| depth(camera, &|it| it.range_m = [2.0, 1.0]), "sensor.depth.range_m");
    check(&|camera| depth(camera, &|it| it.disparity_error_px = f64::NAN), "sensor.depth.disparity_error_px");
    check(
        &|camera| camera.sensor.as_mut().unwrap().color.as_mut().unwrap().full_well_e = 0.0,
        "sensor.color.full_well_e",
    );
    check(
        &|camera| camera.sensor.as_mut().unwrap().color.as_mut().unwrap().jpeg_quality = Some(0),
        "sensor.color.jpeg_quality",
    );
}

/// A robot of half the reach gets half the workspace, at the same place in every image.
#[test]
fn workspace_and_cameras_follow_a_short_reach() {
    assert_eq!(text_for(&panda()), DEFAULT_TEXT);
    let short = RobotModel { reach: Some(Reach { max_m: 0.45, from_above_m: [0.12, 0.35] }), ..(*panda()).clone() };
    let (usual, (small, _)) = (default_world(), read(&text_for(&short)).unwrap());
    let half = |range: [f64; 2]| range.map(|metres| metres / 2.0);
    assert_eq!([small.workspace.x, small.workspace.y], [half(usual.workspace.x), half(usual.workspace.y)]);
    for (before, after) in
        usual.cameras.iter().zip(&small.cameras).filter(|(before, _)| before.mount == CameraMount::World)
    {
        for corner in [DVec3::new(0.2, -0.5, 0.0), DVec3::new(0.9, 0.3, 0.1), DVec3::new(0.5, 0.0, 0.3)] {
            let moved_px = WorldCamera(before).pixel(corner).distance(WorldCamera(after).pixel(corner / 2.0));
            assert!(moved_px < 0.5, "{}: {moved_px} px", before.name);
        }
    }
}

//! What the cameras of the default world have in their pictures, beside those of version 1.

use genmanip_core::camera::{CameraPreset, PRESETS};
use genmanip_core::glam::{DVec2, DVec3};
use genmanip_core::{Camera, CameraMount, Intrinsics};

use crate::panda;
use crate::worlds::default_world;

/// Least share of the picture's width that the workspace spans.
const LEAST_WIDTH_SHARE: f64 = 0.70;
/// Least share of the workspace's area in the picture: a strip of its near edge, beyond the arm's reach from above,
/// may be cut off.
const LEAST_AREA_SHARE: f64 = 0.93;
/// How much larger things appear than through the cameras of version 1: "about 1.4 times".
const ENLARGEMENT: std::ops::RangeInclusive<f64> = 1.35..=1.45;

/// A camera fixed in the world that projects points of the world.
struct Eye<'a>(&'a Camera);

impl Eye<'_> {
    fn pixel(&self, point: DVec3) -> DVec2 {
        let in_camera = self.0.mount_from_camera.inverse().transform_point(point);
        self.0.intrinsics.project(in_camera).unwrap_or(DVec2::NAN)
    }

    fn sees(&self, point: DVec3) -> bool {
        let (pixel, k) = (self.pixel(point), &self.0.intrinsics);
        pixel.cmpge(DVec2::splat(-0.5)).all()
            && pixel.cmple(DVec2::new(f64::from(k.width) - 0.5, f64::from(k.height) - 0.5)).all()
    }

    /// Pixels that a length of 8 cm across the line of sight takes up at the middle of the workspace, as a cube stands
    /// there.
    fn cube_px(&self) -> f64 {
        let middle = DVec3::new(0.55, 0.0, 0.04);
        0.08 * self.0.intrinsics.fx / self.0.mount_from_camera.inverse().transform_point(middle).z
    }
}

#[test]
fn the_default_cameras_are_filled_with_the_workspace_and_see_the_hand() {
    let old: Vec<Camera> =
        serde_json::from_str(include_str!("../../../core/src/upgrade/cameras_of_version_1.json")).unwrap();
    let world = default_world();
    let (robot, area) = (panda(), world.workspace);
    let links = robot.link_poses(&world.robot.home, robot.gripper.max_width);
    // From the flange to between the pads, and as wide as the hand.
    let hand = [(-0.1, 0.0), (0.1, 0.0), (-0.1, 0.06), (0.1, 0.06), (0.0, 0.1034)]
        .map(|(y, z)| links[robot.hand].transform_point(DVec3::new(0.0, y, z)));
    for (name, sees_hand) in [("overview", true), ("left", false), ("right", false), ("static", true)] {
        let camera = world.camera(name).unwrap();
        assert_eq!((camera.mount, camera.intrinsics.width, camera.intrinsics.height), (CameraMount::World, 512, 288));
        let eye = Eye(camera);
        let at = |i: usize, j: usize| {
            let part = |[low, high]: [f64; 2], index: usize| low + (high - low) * index as f64 / 40.0;
            DVec3::new(part(area.x, i), part(area.y, j), 0.0)
        };
        let grid = || (0..=40).flat_map(move |i| (0..=40).map(move |j| at(i, j)));
        let seen: Vec<DVec3> = grid().filter(|&point| eye.sees(point)).collect();
        let area_share = seen.len() as f64 / grid().count() as f64;
        assert!(area_share >= LEAST_AREA_SHARE, "{name}: {area_share:.3} of the workspace is in the picture");
        let columns = || seen.iter().map(|&point| eye.pixel(point).x);
        let span = columns().fold(f64::MIN, f64::max) - columns().fold(f64::MAX, f64::min);
        let share = span / f64::from(camera.intrinsics.width);
        assert!(share >= LEAST_WIDTH_SHARE, "{name}: the workspace fills {share:.3} of the width");
        let before = Eye(old.iter().find(|other| other.name == name).unwrap());
        let enlargement = eye.cube_px() / before.cube_px();
        assert!(ENLARGEMENT.contains(&enlargement), "{name}: {enlargement:.3} times as large as before");
        let missed = hand.iter().find(|&&point| sees_hand && !eye.sees(point));
        assert_eq!(missed, None, "{name}: cuts the hand at {:?}", missed.map(|&point| eye.pixel(point)));
    }
    let mirrored = |name: &str| world.camera(name).unwrap().mount_from_camera.position * DVec3::new(1.0, -1.0, 1.0);
    assert_eq!(mirrored("left"), world.camera("right").unwrap().mount_from_camera.position);
}

/// Vertical fields of view as the makers publish them, degrees, where they do.
#[test]
fn presets_are_those_of_the_makers() {
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

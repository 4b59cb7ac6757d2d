//! Sensors on images of known geometry.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::glam::DVec2;
use genmanip_core::sensor::SensorPreset;
use genmanip_core::{Camera, CameraSensor, ColorSensor, DepthSensor, Distortion, Intrinsics, Seed};
use proptest::prelude::*;

use super::{color, depth, developed, needed, pinhole};
use crate::tests::continued;
use crate::tests::fixture::{camera, frame, objects, robot};
use crate::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer};

fn preset(name: &str) -> CameraSensor {
    SensorPreset::named(name).unwrap().sensor
}

fn stereo() -> DepthSensor {
    preset("d435").depth.unwrap()
}

/// An image of walls of part 1 that face the camera, from a depth per pixel.
fn walls([width, height]: [u32; 2], depth_m: impl Fn(u32, u32) -> f32) -> (Intrinsics, FrameBuffers) {
    let pixels = (width * height) as usize;
    let depth_m = (0..width * height).map(|index| depth_m(index % width, index / width)).collect();
    let picture = FrameBuffers {
        width,
        height,
        depth_m,
        normal: vec![[0, 0, -127]; pixels],
        parts: vec![1; pixels],
        ..FrameBuffers::default()
    };
    (Intrinsics::from_vertical_fov(width, height, 0.5), picture)
}

fn measure(settings: &DepthSensor, depth_m: f32, returned: f32, seed: u64) -> Vec<f32> {
    let (k, picture) = walls([80, 60], |_, _| depth_m);
    depth::measured(settings, &k, &picture, &[returned], Seed::new(seed))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_error_grows_with_the_square_of_the_depth(depth_m in 0.4_f32..5.0, preset_index in 0..2_usize, seed in 0..1000_u64) {
        let settings = preset(["d435", "structured-light"][preset_index]).depth.unwrap();
        let settings = DepthSensor { range_m: [0.1, 20.0], ..settings };
        let seen: Vec<f32> = measure(&settings, depth_m, 0.8, seed).into_iter().filter(|depth| *depth > 0.0).collect();
        prop_assert!(seen.len() > 4000, "{} of 4800 pixels have a depth", seen.len());
        let errors = seen.iter().map(|seen| f64::from(seen - depth_m));
        let rms = (errors.map(|error| error * error).sum::<f64>() / seen.len() as f64).sqrt();
        // Rounding to steps adds a variance of a twelfth of a step squared at most.
        let (error, step) = (settings.disparity_error_px, settings.disparity_step_px);
        let px_m = settings.focal_length_px * settings.baseline_m;
        let per_px = f64::from(depth_m).powi(2) / px_m;
        prop_assert!(rms > 0.8 * error * per_px && rms < 1.3 * error.hypot(step / 2.0) * per_px, "{rms} at {depth_m} m");
    }

    #[test]
    fn what_is_not_in_range_has_no_depth(depth_m in 0.01_f32..0.15) {
        prop_assert!(measure(&stereo(), depth_m, 0.8, 1).iter().all(|depth| *depth == 0.0));
        prop_assert!(measure(&stereo(), 50.0 * depth_m + 7.0, 0.8, 1).iter().all(|depth| *depth == 0.0));
    }
}

/// Surfaces that scatter back too little have holes, by share of pixels.
#[test]
fn glass_mirrors_and_black_things_have_holes() {
    let missing = |returned: f32| {
        let seen = measure(&stereo(), 0.8, returned, 5);
        seen.iter().filter(|depth| **depth == 0.0).count() as f32 / seen.len() as f32
    };
    for (what, returned, low, high) in
        [("paper", 0.8, 0.0, 0.0), ("black plastic", 0.015, 0.2, 0.8), ("glass", 0.001, 1.0, 1.0)]
    {
        assert!((low..=high).contains(&missing(returned)), "{what}: {}", missing(returned));
    }
}

/// A near strip before a wall: the partner on the right does not see the wall to the left of the strip, over
/// f · B · Δ(1/z) pixels; one on the left does not see it to the right.
#[test]
fn the_shadow_falls_on_the_proper_side() {
    let exact =
        DepthSensor { disparity_error_px: 0.0, disparity_step_px: 0.0, field_of_view_deg: [170.0; 2], ..stereo() };
    let (k, picture) = walls([240, 40], |x, _| if (100..160).contains(&x) { 0.5 } else { 1.0 });
    let width = k.fx * exact.baseline_m * (1.0 / 0.5 - 1.0);
    for (baseline_m, shadow, lit) in [(0.05, 85..99, 162..230), (-0.05, 161..175, 30..98)] {
        let settings = DepthSensor { baseline_m: f64::signum(baseline_m) * exact.baseline_m, ..exact };
        let seen = depth::measured(&settings, &k, &picture, &[0.8], Seed::new(1));
        let missing =
            |columns: std::ops::Range<usize>| columns.filter(|x| (0..40).all(|y| seen[y * 240 + x] == 0.0)).count();
        let all = missing(30..230);
        assert!((all as f64 - width).abs() <= 2.0, "{all} columns without depth, expected {width}");
        // Two columns of those at the edge may have taken the other side's depth.
        assert!(
            missing(shadow.clone()) + 2 >= all.min(shadow.len()),
            "{} of {all} in {shadow:?}",
            missing(shadow.clone())
        );
        assert_eq!(missing(lit.clone()), 0, "{lit:?}");
    }
}

#[test]
fn colour_noise_grows_with_the_light_and_the_corners_are_darker() {
    let settings = ColorSensor { vignetting: 0.3, ..preset("d435").color.unwrap() };
    let deviation = |grey: u8| {
        let flat = ColorSensor { vignetting: 0.0, ..settings };
        let seen = color::exposed(&flat, [100, 100], &vec![grey; 30_000], Seed::new(2)).unwrap();
        let light = |code: u8| f64::from(crate::scene::texture::linear_from_srgb8([code; 3]).x);
        let mean = seen.iter().map(|code| light(*code)).sum::<f64>() / 30_000.0;
        (seen.iter().map(|code| (light(*code) - mean).powi(2)).sum::<f64>() / 30_000.0).sqrt()
    };
    let (dark, bright) = (deviation(90), deviation(200));
    // Linear light of 0.102 and 0.578: the root of the ratio is 2.4.
    assert!((bright / dark - 2.4).abs() < 0.3, "{bright} against {dark}");
    let flat = vec![180; 100 * 100 * 3];
    let seen = color::exposed(&settings, [100, 100], &flat, Seed::new(2)).unwrap();
    let mean = |x: std::ops::Range<usize>| {
        let rows = x.clone().flat_map(|y| x.clone().map(move |x| (y * 100 + x) * 3));
        let values: Vec<f64> = rows.map(|index| f64::from(seen[index])).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    assert!(mean(0..10) < mean(45..55) - 15.0, "{} against {}", mean(0..10), mean(45..55));
    let jpeg = ColorSensor { jpeg_quality: Some(60), ..settings };
    let compressed = color::exposed(&jpeg, [100, 100], &flat, Seed::new(2)).unwrap();
    assert!(compressed.len() == flat.len() && compressed != seen);
}

/// The whole way, through the renderer.
fn shot(camera: &Camera, wanted: Channels, seed: u64) -> FrameBuffers {
    let assets = RenderAssets::new(robot(), &objects(), Some(&default_world())).unwrap();
    let state = frame(&assets);
    let seen = pinhole(camera).unwrap();
    let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
    let out = continued(&mut renderer, &state, &seen, needed(camera, wanted));
    developed(&renderer, camera, wanted, out, Seed::new(seed)).unwrap()
}

#[test]
fn without_sensors_pictures_are_perfect_and_with_them_the_seed_decides() {
    let perfect = camera(96, 54);
    let assets = RenderAssets::new(robot(), &objects(), Some(&default_world())).unwrap();
    let state = frame(&assets);
    let mut renderer = Renderer::new(assets, RenderVariation::default());
    let drawn = continued(&mut renderer, &state, &perfect, Channels::ALL);
    assert_eq!(shot(&perfect, Channels::ALL, 1), drawn);

    for name in SensorPreset::names() {
        let real = Camera { sensor: Some(preset(name)), ..perfect.clone() };
        let [one, again, other] = [1, 1, 2].map(|seed| shot(&real, Channels::ALL, seed));
        assert_eq!(one, again, "{name}");
        assert!(one.depth_m != other.depth_m && one.rgb != other.rgb, "{name}");
        assert_eq!((&one.instance, &one.normal), (&drawn.instance, &drawn.normal), "labels stay true");
        assert!(one.parts.is_empty());
        let alone = shot(&real, Channels { rgb: false, ..Channels::RGBD }, 1);
        assert_eq!(alone.depth_m, one.depth_m, "{name}: depth does not depend on what else is asked for");
        assert!(alone.normal.is_empty() && alone.rgb.is_empty());
    }
}

#[test]
fn a_lens_moves_pixels_where_its_formula_says() {
    let lens = Distortion { k1: -0.25, k2: 0.05, p1: 0.002, p2: -0.001, k3: 0.0 };
    let straight = camera(256, 144);
    let distorted = Camera { distortion: Some(lens), ..straight.clone() };
    let [straight_image, distorted_image] = [&straight, &distorted].map(|camera| shot(camera, Channels::GEOMETRY, 1));
    let (k, mut compared) = (straight.intrinsics, 0);
    for index in (0..256 * 144).step_by(7) {
        let at = DVec2::new(f64::from(index % 256), f64::from(index / 256));
        let point = lens.undistort(k.unproject(at, 1.0).truncate()).unwrap();
        let pixel = k.project(point.extend(1.0)).unwrap().round();
        let is_inside = pixel.cmpge(DVec2::ZERO).all() && pixel.x < 256.0 && pixel.y < 144.0;
        if is_inside {
            let from = pixel.y as usize * 256 + pixel.x as usize;
            assert_eq!(distorted_image.instance[index as usize], straight_image.instance[from]);
            assert!((distorted_image.depth_m[index as usize] - straight_image.depth_m[from]).abs() < 1e-4);
            compared += 1;
        }
    }
    assert!(compared > 1000);
    let folded = Camera { distortion: Some(Distortion { k1: -2.0, ..Distortion::default() }), ..straight };
    assert!(pinhole(&folded).unwrap_err().to_string().contains("its lens"));
}

/// The toy scene through a D435 behind a barrel lens: colour, depth and holes.
#[test]
fn the_picture_of_a_sensor_looks_like_the_stored_one() {
    let lens = Distortion { k1: -0.2, k2: 0.03, ..Distortion::default() };
    let real = Camera { sensor: Some(preset("d435")), distortion: Some(lens), ..camera(256, 144) };
    let seen = shot(&real, Channels::RGBD, 750_000);
    let grey = |depth: &f32| [if *depth > 0.0 { (255.0 - depth.min(2.0) * 110.0) as u8 } else { 0 }; 3];
    let picture: Vec<u8> = seen.rgb.iter().copied().chain(seen.depth_m.iter().flat_map(grey)).collect();
    crate::tests::check_golden("sensor.png", [256, 288], &picture);
}

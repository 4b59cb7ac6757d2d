//! The noise of a rendered camera is found again from images of a still scene.

use genmanip_assets::panda;
use genmanip_assets::worlds::default_world;
use genmanip_core::sensor::SensorPreset;
use genmanip_core::{Camera, CameraSensor, ColorSensor, Seed};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, sensor};
use genmanip_visual_matching::noise::{CameraNoise, DISPARITY, FULL_WELL, READ_NOISE};

const WIDTH: usize = 320;

/// Images of the default world through a sensor.
fn images(sensor: CameraSensor, count: u64) -> Vec<FrameBuffers> {
    let world = default_world();
    let own = world.camera("static").unwrap();
    let intrinsics = own.intrinsics.resized(WIDTH as u32, 180);
    let camera = Camera { intrinsics, sensor: Some(sensor), ..own.clone() };
    let assets = RenderAssets::new(panda(), &[], Some(&world)).unwrap();
    let frame = assets.frame_state(world.robot.start(), 0.08, []).unwrap();
    let mut out = [FrameBuffers::default()];
    let mut renderer = Renderer::new(assets, RenderVariation::default());
    let seen = sensor::pinhole(&camera).unwrap();
    renderer.render(&[ViewJob::new(&frame, &seen, sensor::needed(&camera, Channels::RGBD))], &mut out).unwrap();
    let [ideal] = out;
    let develop = |seed| sensor::developed(&renderer, &camera, Channels::RGBD, ideal.clone(), Seed::new(seed)).unwrap();
    (0..count).map(develop).collect()
}

#[test]
fn noise_of_colour_and_depth_is_found_again() {
    let device = SensorPreset::named("d435").unwrap().sensor;
    let depth = device.depth.unwrap();
    for (full_well_e, read_noise_e, disparity_error_px) in [(5_000.0, 12.0, 0.08), (1_500.0, 6.0, 0.2)] {
        let color = ColorSensor { full_well_e, read_noise_e, ..device.color.unwrap() };
        let truth = CameraSensor {
            color: Some(color),
            depth: Some(genmanip_core::DepthSensor { disparity_error_px, ..depth }),
        };
        let seen = images(truth, 12);
        let mut found = CameraNoise::default();
        found.add_color(WIDTH, &seen.iter().map(|it| it.rgb.clone()).collect::<Vec<_>>());
        // A depth file holds millimetres.
        let rounded = |it: &FrameBuffers| it.depth_m.iter().map(|depth| (1e3 * depth).round() / 1e3).collect();
        found.add_depth(WIDTH, &seen.iter().map(rounded).collect::<Vec<Vec<f32>>>(), &depth, 1e-3);
        for (name, truth, share) in
            [(FULL_WELL, full_well_e, 0.05), (READ_NOISE, read_noise_e, 0.2), (DISPARITY, disparity_error_px, 0.05)]
        {
            let it = found.estimates.iter().find(|it| it.name == name).unwrap();
            assert!((it.value - truth).abs() < share * truth, "{truth}: {it:?}");
            // Twice the half-width: the model of the noise is bounded, and its rounding is approximate.
            let half = 0.5 * (it.interval[1] - it.interval[0]);
            assert!((it.value - truth).abs() < 2.0 * half.max(0.01 * truth) && half < 0.3 * truth, "{truth}: {it:?}");
        }
    }
}

#[test]
fn images_without_noise_or_depth_determine_nothing() {
    let device = SensorPreset::named("d435").unwrap().sensor;
    let depth = device.depth.unwrap();
    let still = images(CameraSensor { color: None, depth: None }, 4);
    let mut found = CameraNoise::default();
    found.add_color(WIDTH, &still.iter().map(|it| it.rgb.clone()).collect::<Vec<_>>());
    found.add_depth(WIDTH, &still.iter().map(|it| it.depth_m.clone()).collect::<Vec<_>>(), &depth, 1e-3);
    found.add_depth(WIDTH, &vec![vec![0.0; WIDTH * 180]; 4], &depth, 1e-3);
    let named: Vec<&str> = found.unidentified.iter().map(|it| it.name).collect();
    assert_eq!(named, [FULL_WELL, READ_NOISE, DISPARITY, DISPARITY]);
    assert_eq!(found.estimates, []);
}

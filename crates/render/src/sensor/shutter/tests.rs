//! Motion blur of the toy scene.

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, CameraSensor, ColorSensor, Seed};

use super::{MOST_PICTURES, Past, mean, moments};
use crate::sensor::{developed, needed};
use crate::tests::continued;
use crate::tests::fixture::{camera, frame, objects, robot};
use crate::{Channels, FrameBuffers, FrameState, RenderAssets, RenderVariation, Renderer};

const STEP_S: f64 = 1.0 / 60.0;

fn assets() -> Arc<RenderAssets> {
    RenderAssets::new(robot(), &objects(), Some(&default_world())).unwrap()
}

fn exposed(shutter_s: f64) -> Camera {
    let color = Some(ColorSensor::perfect(shutter_s));
    Camera { sensor: Some(CameraSensor { color, depth: None }), ..camera(128, 72) }
}

/// Present and past states while the red block moves along y at a speed.
fn passing(assets: &RenderAssets, speed_m_s: f64) -> Vec<FrameState> {
    let now = frame(assets);
    let block = assets.body_count() - objects().len();
    let before = |step: u32| {
        let mut state = now.clone();
        state.body_poses[block].position -= DVec3::Y * (speed_m_s * f64::from(step) * STEP_S);
        state
    };
    (0..4).map(before).collect()
}

fn earlier(assets: &Arc<RenderAssets>, camera: &Camera, states: &[FrameState], shutter_s: f64) -> Vec<FrameState> {
    let mut renderer = Renderer::new(Arc::clone(assets), RenderVariation::default());
    let seen = continued(&mut renderer, &states[0], camera, needed(camera, Channels::RGB));
    moments(assets, camera, &seen, Past { moments: states, step_s: STEP_S }, shutter_s)
}

/// As many images as the motion has pixels, evenly spread, also over several steps.
#[test]
fn the_way_on_the_image_says_how_many_pictures_there_are() {
    let assets = assets();
    let block = assets.body_count() - objects().len();
    let camera = exposed(0.03);
    let count = |speed, shutter_s| 1 + earlier(&assets, &camera, &passing(&assets, speed), shutter_s).len();
    assert_eq!(count(0.0, 0.03), 1);
    assert_eq!(count(0.05, 0.001), 1, "less than half a pixel is sharp");
    assert_eq!(count(0.4, 0.0), 1);
    let (slow, fast) = (count(0.4, 0.03), count(0.8, 0.03));
    assert!(slow >= 2 && (2 * slow - 1..=2 * slow).contains(&fast), "{slow} and {fast}");
    assert_eq!(count(9.0, 0.03), MOST_PICTURES);
    let states = passing(&assets, 0.8);
    for (index, state) in earlier(&assets, &camera, &states, 0.03).iter().enumerate() {
        let ago_s = 0.03 * (index + 1) as f64 / fast as f64;
        let way = states[0].body_poses[block].position - state.body_poses[block].position;
        assert!((way - DVec3::Y * (0.8 * ago_s)).length() < 1e-9, "{way} after {ago_s} s");
    }
    // At rest before the first known state.
    let states = &passing(&assets, 4.0)[..2];
    let young = earlier(&assets, &camera, states, 0.03);
    assert_eq!(young.last().unwrap().body_poses[block], states[1].body_poses[block]);
    assert!(earlier(&assets, &camera, &states[..1], 0.03).is_empty());
}

/// A moving camera blurs everything, including the background.
#[test]
fn a_camera_on_the_hand_blurs_the_table() {
    let assets = assets();
    let states: Vec<FrameState> = (0..3)
        .map(|step| {
            let at = |object: usize| frame(&assets).body_poses[assets.body_count() - 4 + object];
            let placed = (0..4).map(|object| (at(object), [].as_slice()));
            assets.frame_state(&[0.9 - 0.02 * f64::from(step)], 0.04, placed).unwrap()
        })
        .collect();
    let hand = genmanip_core::CameraMount::Hand;
    let looking_down = Camera::pose_looking_at(DVec3::Z * -0.04, DVec3::new(0.05, 0.0, -1.0));
    let camera = Camera { mount: hand, mount_from_camera: looking_down, ..exposed(0.02) };
    assert!(earlier(&assets, &camera, &states, 0.02).len() >= 2);
}

/// In linear light: half a black and half a white image is a surface that reflects half of the light.
#[test]
fn the_mean_is_of_light() {
    assert_eq!(mean(&[vec![0, 0, 0], vec![255, 255, 255]]), [188, 188, 188]);
    let all: Vec<u8> = (0..=255).flat_map(|code| [code; 3]).collect();
    assert_eq!(mean(&[all.clone(), all.clone(), all.clone()]), all);
    let camera = exposed(0.02);
    let picture = FrameBuffers { width: 128, height: 72, rgb: all.repeat(36), ..FrameBuffers::default() };
    let renderer = Renderer::new(assets(), RenderVariation::default());
    let seen = developed(&renderer, &camera, Channels::RGB, picture.clone(), Seed::new(1)).unwrap();
    assert_eq!(seen, picture, "an imager with a shutter alone adds nothing");
}

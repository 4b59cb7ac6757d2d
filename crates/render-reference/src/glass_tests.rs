//! Glass of the catalogue: rasterised against path-traced images.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DVec3, Vec3A};
use genmanip_core::{Camera, Intrinsics, Pose, Seed};

use genmanip_render::color::linear_from_srgb8;
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob};

use crate::{ReferenceSettings, trace};

/// Mean linear display colour of an image.
fn mean(rgb: &[u8]) -> Vec3A {
    let sum: Vec3A = rgb.as_chunks::<3>().0.iter().map(|&rgb| linear_from_srgb8(rgb)).sum();
    sum / (rgb.len() / 3) as f32
}

/// Objects on the table in a narrow view: the mean colour is the path-traced one within a fifth of its brightest
/// channel.
fn check(what: &str, objects: &[(&str, [f64; 2])], target: [f64; 3]) {
    let models: Vec<_> = objects.iter().map(|&(uid, _)| Catalogue::full().build(uid).unwrap()).collect();
    let assets = RenderAssets::without_robot(&models, Some(&default_world())).unwrap();
    let placed = objects.iter().map(|(_, [x, y])| (Pose::from_position(DVec3::new(*x, *y, 0.0)), [].as_slice()));
    let state = assets.frame_state(&[], 0.0, placed).unwrap();
    let intrinsics = Intrinsics::from_vertical_fov(20, 16, 0.01);
    let camera = Camera::looking_at("close", DVec3::new(1.3, 0.0, 0.6), DVec3::from(target), intrinsics);
    let job = ViewJob::new(&state, &camera, Channels::RGB);
    let mut out = [FrameBuffers::default()];
    Renderer::new(Arc::clone(&assets), RenderVariation::default()).render(&[job], &mut out).unwrap();
    let settings = ReferenceSettings { paths: 64, seed: Seed::new(3), threads: 2 };
    let traced = trace(&assets, &RenderVariation::default(), &job, &settings).unwrap();
    let (got, expected) = (mean(&out[0].rgb), mean(&traced.develop(1.0)));
    let apart = (got - expected).abs().max_element() / expected.max_element();
    assert!(apart <= 0.2, "{what}: {got} instead of the traced {expected}");
}

#[test]
fn glass_colours_what_is_behind_it_as_traced_glass_does() {
    let (tumbler, goblet) = (("tumbler-6", [0.5, 0.0]), ("wine-glass-3", [0.5, 0.0]));
    check("two walls of a tumbler", &[tumbler], [0.5, 0.0, 0.06]);
    check("its floor on the table", &[tumbler], [0.5, 0.0, 0.0]);
    check("an amber floor", &[("tumbler-9", [0.5, 0.0])], [0.51, 0.01, 0.0]);
    check("the solid foot of a goblet", &[goblet], [0.515, 0.015, 0.004]);
    check("a clear foot", &[("wine-glass-1", [0.5, 0.0])], [0.515, 0.015, 0.004]);
    check("a cup", &[goblet], [0.5, 0.0, 0.13]);
    check("a cup before a green tumbler", &[goblet, ("tumbler-2", [0.4, 0.0])], [0.5, 0.0, 0.13]);
}

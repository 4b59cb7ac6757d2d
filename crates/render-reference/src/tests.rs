use std::sync::Arc;

use genmanip_core::glam::{DVec3, Vec2, Vec3};
use genmanip_core::{Camera, Intrinsics, Material, ObjectModel, Pose, TriMesh};

use super::*;
use crate::fixture::{ball, block, object};
use genmanip_render::{Channels, FrameState};

fn sheet() -> TriMesh {
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.0);
    TriMesh {
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        normals: vec![Vec3::Z; 4],
        uvs: vec![Vec2::ZERO; 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

fn white() -> Material {
    // No specular reflection at normal incidence (ior 1), and little elsewhere (rough).
    Material { ior: 1.0, ..Material::plain([1.0; 3], 1.0) }
}

fn placed(models: &[(Arc<ObjectModel>, DVec3)]) -> (Arc<RenderAssets>, FrameState) {
    let objects: Vec<_> = models.iter().map(|(model, _)| Arc::clone(model)).collect();
    let assets = RenderAssets::without_robot(&objects, None).unwrap();
    let poses = models.iter().map(|(_, at)| (Pose::from_position(*at), [].as_slice()));
    let state = assets.frame_state(&[], 0.0, poses).unwrap();
    (assets, state)
}

fn traced(
    scene: &(Arc<RenderAssets>, FrameState),
    eye: DVec3,
    variation: &RenderVariation,
    paths: u32,
    threads: usize,
) -> Exposed {
    let camera = Camera::looking_at("c", eye, DVec3::ZERO, Intrinsics::from_vertical_fov(8, 6, 0.05));
    let job = ViewJob::new(&scene.1, &camera, Channels::RGB);
    trace(&scene.0, variation, &job, &ReferenceSettings { paths, seed: Seed::new(3), threads }).unwrap()
}

/// Mean luminance before exposure.
fn mean(exposed: &Exposed) -> f32 {
    exposed.pixels.iter().map(|pixel| luminance(pixel.radiance)).sum::<f32>() / exposed.pixels.len() as f32
}

fn close(got: f32, expected: f32, what: &str) {
    assert!((got / expected - 1.0).abs() < 0.03, "{what}: {got}, expected {expected}");
}

/// A white surface under each light alone, against the documented brightness of the variation.
#[test]
fn a_white_sheet_is_as_bright_as_the_lights_say() {
    let sheet = placed(&[(object("sheet", sheet(), white()), DVec3::ZERO)]);
    let key = RenderVariation { light_color: [1.0; 3], ambient_intensity: 0.0, ..RenderVariation::default() };
    for (direction, angular_radius) in [([0.0, 0.0, 1.0], 0.075), ([1.0, 0.0, 1.0], 0.02), ([0.0, 0.6, 0.8], 0.3)] {
        let variation =
            RenderVariation { light_direction: direction, light_angular_radius: angular_radius, ..key.clone() };
        let cosine = Vec3::from(direction).normalize().z;
        let expected = 0.62 * cosine;
        close(mean(&traced(&sheet, DVec3::Z, &variation, 64, 1)), expected, "the key light");
    }
    let sky = RenderVariation { light_intensity: 0.0, ..RenderVariation::default() };
    close(mean(&traced(&sheet, DVec3::Z, &sky, 256, 1)), 0.42, "the sky");
}

#[test]
fn a_block_before_the_light_darkens_and_glass_only_a_little() {
    let light = RenderVariation {
        light_direction: [1.0, 0.0, 1.0],
        light_color: [1.0; 3],
        ambient_intensity: 0.0,
        ..RenderVariation::default()
    };
    let with = |material: Material| {
        let block = object("block", block(Vec3::new(0.2, 0.2, 0.01)), material);
        let scene = placed(&[(object("sheet", sheet(), white()), DVec3::ZERO), (block, DVec3::new(0.5, 0.0, 0.5))]);
        mean(&traced(&scene, DVec3::Z * 0.3, &light, 64, 1)) / (0.62 * std::f32::consts::FRAC_1_SQRT_2)
    };
    let open = with(Material { opacity: 0.0, ior: 1.0, ..white() });
    let glass = with(Material { opacity: 0.0, ior: 1.5, ..white() });
    let solid = with(white());
    // Glass of 1.5 mirrors about 5 % at each of its two sides at 45 degrees (Fresnel).
    assert!((open - 1.0).abs() < 0.03 && (glass - 0.9).abs() < 0.04, "{open}, {glass}");
    assert!(solid < 0.05, "only what is scattered between the two arrives: {solid}");
}

/// A metal ball from above, against numerical integration of the BSDF.
#[test]
fn a_metal_ball_gives_back_what_its_reflection_says() {
    let sky = RenderVariation { light_intensity: 0.0, ..RenderVariation::default() };
    let lighting = Lighting::new(&sky, None);
    for roughness in [0.3_f32, 0.8] {
        let metal = Material { metallic: 1.0, ..Material::plain([1.0; 3], roughness) };
        let scene = placed(&[(object("ball", ball(0.5, 64), metal), DVec3::ZERO)]);
        let top = reflection::Reflection { albedo: Vec3A::ZERO, f0: Vec3A::ONE, alpha: roughness * roughness };
        const DIRECTIONS: usize = 20_000;
        let arriving = |index: usize| {
            let z = (index as f32 + 0.5) / DIRECTIONS as f32;
            let flat = Vec2::from_angle(index as f32 * 2.399_963) * (1.0 - z * z).sqrt();
            let into = Vec3A::from(flat.extend(z));
            luminance(top.evaluate(Vec3A::Z, into).0 * lighting.sky.radiance(into))
        };
        let expected = (0..DIRECTIONS).map(arriving).sum::<f32>() * std::f32::consts::TAU / DIRECTIONS as f32;
        close(mean(&traced(&scene, DVec3::Z * 3.0, &sky, 512, 1)), expected, "a metal ball");
    }
    // A mirror shows the zenith.
    let metal = Material { metallic: 1.0, ..Material::plain([1.0; 3], 0.05) };
    let scene = placed(&[(object("ball", ball(0.5, 64), metal), DVec3::ZERO)]);
    let zenith = luminance(lighting.sky.radiance(Vec3A::Z));
    close(mean(&traced(&scene, DVec3::Z * 3.0, &sky, 64, 1)), zenith, "a mirror");
}

#[test]
fn pictures_depend_on_the_seed_and_not_on_threads() {
    let scene = placed(&[(object("ball", ball(0.5, 12), white()), DVec3::ZERO)]);
    let variation = RenderVariation::default();
    let one = traced(&scene, DVec3::Z * 2.0, &variation, 4, 1);
    assert_eq!(one, traced(&scene, DVec3::Z * 2.0, &variation, 4, 3));
    assert_eq!(one.develop(1.0).len(), 8 * 6 * 3);
    assert!(one.develop(1.0).iter().any(|&byte| byte > 60), "something is lit");
}

/// The exposure that matches an image to itself at another exposure.
#[test]
fn exposures_are_found_again() {
    let scene = placed(&[(object("ball", ball(0.5, 12), white()), DVec3::ZERO)]);
    let exposed = traced(&scene, DVec3::Z * 2.0, &RenderVariation::default(), 16, 1);
    for exposure in [0.5, 1.0, 1.3] {
        close(exposed.exposure_like(&exposed.develop(exposure)), exposure, "the exposure");
    }
}

/// The hierarchy against exhaustive search.
#[test]
fn the_tree_finds_what_a_search_finds() {
    let mut state = 7_u32;
    let mut draw = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    let mut point = || Vec3A::new(draw(), draw(), draw());
    let triangles: Vec<Triangle> = (0..500)
        .map(|index| {
            let (at, b, c) = (point(), point() * 0.2, point() * 0.2);
            Triangle::new([at, at + b, at + c], 0, index)
        })
        .collect();
    let single: Vec<Bvh> = triangles.iter().map(|triangle| Bvh::new(vec![*triangle])).collect();
    let tree = Bvh::new(triangles);
    let mut hits = 0;
    for _ in 0..2000 {
        let (origin, direction) = (point() * 2.0, point().normalize());
        let expected = single
            .iter()
            .enumerate()
            .filter_map(|(index, only)| only.nearest(origin, direction).map(|hit| (hit.distance, index)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let got = tree.nearest(origin, direction).map(|hit| (hit.distance, hit.triangle));
        assert_eq!(got.map(|hit| hit.0), expected.map(|hit| hit.0));
        hits += usize::from(got.is_some());
    }
    assert!(hits > 100, "only {hits} rays hit anything");
}

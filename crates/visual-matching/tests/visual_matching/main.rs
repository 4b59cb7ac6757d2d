//! A workspace is matched from rendered photographs of a hidden light, and unsuitable photographs are refused.

#![allow(clippy::unwrap_used)] // The exemption for tests does not reach helpers of an integration test.

mod materials;
mod noise;

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_assets::{Catalogue, panda};
use genmanip_core::glam::DVec3;
use genmanip_core::{Camera, CameraResponse, ObjectModel, Pose, World};
use genmanip_render::{CameraLook, Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, Response, ViewJob};
use genmanip_visual_matching::report::reports;
use genmanip_visual_matching::{MatchError, MatchRequest, ObjectScene, Photo, match_workspace, names};

const SIZE: [u32; 2] = [128, 72];

fn world() -> World {
    world_of(SIZE)
}

fn world_of(size: [u32; 2]) -> World {
    let mut world = (*default_world()).clone();
    world.cameras.retain(|camera| ["static", "left"].contains(&camera.name.as_str()));
    for camera in &mut world.cameras {
        *camera = Camera { intrinsics: camera.intrinsics.resized(size[0], size[1]), ..camera.clone() };
    }
    world
}

fn hidden() -> RenderVariation {
    let mut variation = RenderVariation {
        light_direction: [-0.5, 0.45, 1.0],
        light_intensity: 0.6,
        ambient_intensity: 0.35,
        exposure: 1.0,
        background: [90, 110, 130],
        table_base: Some([0.42, 0.36, 0.30]),
        ..RenderVariation::default()
    };
    for name in ["static", "left"] {
        let given = CameraResponse { exposure: 1.1, white_balance: [1.15, 0.98, 0.85], ..CameraResponse::default() };
        let response = Arc::new(Response::new(&given).unwrap());
        variation.looks.push(CameraLook { camera: name.into(), response, photograph: None });
    }
    variation
}

fn casters() -> Vec<(Arc<ObjectModel>, Pose)> {
    let catalogue = Catalogue::builtin();
    let tall = catalogue.cards().iter().filter(|card| card.size_m.z > 0.12 && card.size_m.max_element() < 0.3);
    let spots = [DVec3::new(0.5, 0.15, 0.0), DVec3::new(0.6, -0.12, 0.0)];
    let placed = tall.zip(spots).map(|(card, at)| {
        (catalogue.build(&card.uid).unwrap(), Pose::from_position(at + DVec3::Z * 0.5 * card.size_m.z))
    });
    placed.collect()
}

fn scene(objects: &[(Arc<ObjectModel>, Pose)], photos: Vec<Photo>) -> ObjectScene {
    ObjectScene {
        models: objects.iter().map(|(model, _)| Arc::clone(model)).collect(),
        poses: objects.iter().map(|(model, pose)| (*pose, vec![0.0; model.joint_count()])).collect(),
        photos,
    }
}

fn photo(world: &World, camera: usize, arm: Option<&[f64]>, objects: &[(Arc<ObjectModel>, Pose)]) -> Photo {
    photo_under(hidden(), world, camera, arm, objects)
}

fn photo_under(
    variation: RenderVariation,
    world: &World,
    camera: usize,
    arm: Option<&[f64]>,
    objects: &[(Arc<ObjectModel>, Pose)],
) -> Photo {
    let models: Vec<_> = objects.iter().map(|(model, _)| Arc::clone(model)).collect();
    let assets = match arm {
        Some(_) => RenderAssets::new(panda(), &models, Some(world)).unwrap(),
        None => RenderAssets::without_robot(&models, Some(world)).unwrap(),
    };
    let joints: Vec<Vec<f64>> = models.iter().map(|model| vec![0.0; model.joint_count()]).collect();
    let poses = objects.iter().zip(&joints).map(|((_, pose), joints)| (*pose, joints.as_slice()));
    let frame = assets.frame_state(arm.unwrap_or_default(), 0.08, poses).unwrap();
    let mut out = [FrameBuffers::default()];
    let job = ViewJob::new(&frame, &world.cameras[camera], Channels::RGB);
    Renderer::new(assets, variation).render(&[job], &mut out).unwrap();
    let [FrameBuffers { width, height, rgb, .. }] = out;
    Photo { camera: world.cameras[camera].name.clone(), width, height, rgb }
}

fn request(world: World, empty: Vec<Photo>) -> MatchRequest {
    MatchRequest {
        world,
        robot: panda(),
        empty,
        arm: None,
        charts: Vec::new(),
        objects: Vec::new(),
        table_color: Some([0.42, 0.36, 0.30]),
    }
}

/// From the empty table and two objects: the light's direction, the gains, and images nearer to the photographs.
#[test]
fn shadows_tell_the_light_and_images_come_nearer() {
    let world = world();
    let objects = casters();
    let mut request = request(world.clone(), vec![photo(&world, 0, None, &[])]);
    request.objects = vec![scene(&objects, vec![photo(&world, 0, None, &objects)])];
    let matched = match_workspace(&request).unwrap();
    let found = matched.light.as_ref().expect("a light");
    let truth = DVec3::from_array(hidden().light_direction.map(f64::from)).normalize();
    let degrees = found.light.direction.angle_between(truth).to_degrees();
    assert!(degrees < 8.0 && found.has_direction(), "{degrees} degrees: {found:?}");
    assert!(matched.unidentified.iter().all(|it| it.what != names::DIRECTION && it.what != names::EXPOSURE));
    let balance = matched.cameras[0].response.white_balance;
    let expected = 1.15 / 0.85 * warmth_of_hidden_light();
    assert!((balance[0] / balance[2] / expected - 1.0).abs() < 0.04, "{balance:?}, expected {expected}");
    for view in reports(&request, &matched).unwrap() {
        let (before, after) = (&view.before[0], &view.after[0]);
        assert!(after.delta_e < 0.5 * before.delta_e && after.delta_e < 3.0, "{before:?} {after:?}");
    }
    let appearance = matched.world.appearance.as_ref().unwrap();
    assert!(matched.world.faults(&panda()).is_empty() && appearance.cameras[0].photograph.is_some());
}

/// Red over blue of the hidden light on the open table.
fn warmth_of_hidden_light() -> f64 {
    let lighting = genmanip_render::internals::Lighting::new(&hidden(), None);
    let light = lighting.key * lighting.to_light.z + lighting.around(glam::Vec3A::Z);
    f64::from(light.x / light.z)
}

/// Parameters that photographs cannot show are named: the light without shadows, exposure without a known colour, and the response of
/// a camera that saw no chart.
#[test]
fn what_is_not_identifiable_is_named() {
    let world = world();
    let mut request = request(world.clone(), vec![photo(&world, 0, None, &[]), photo(&world, 1, None, &[])]);
    request.table_color = None;
    let matched = match_workspace(&request).unwrap();
    let named: Vec<&str> = matched.unidentified.iter().map(|it| it.what.as_str()).collect();
    for name in [names::DIRECTION, names::SOFTNESS, names::EXPOSURE, "colour matrix and tone curve of camera left"] {
        assert!(named.contains(&name), "{name} is not among {named:?}");
    }
    assert!(matched.light.is_none());
}

#[test]
fn unsuitable_photographs_are_refused() {
    let world = world();
    let good = photo(&world, 0, None, &[]);
    let other = |change: &dyn Fn(&mut Photo)| {
        let mut photo = good.clone();
        change(&mut photo);
        match_workspace(&request(world.clone(), vec![photo])).unwrap_err()
    };
    assert!(matches!(match_workspace(&request(world.clone(), Vec::new())), Err(MatchError::NoPhotograph)));
    let unknown = other(&|photo| photo.camera = "statik".into());
    assert!(unknown.to_string().contains("left, static"), "{unknown}");
    let small = other(&|photo| (photo.width, photo.height) = (72, 128));
    assert!(small.to_string().contains("128×72"), "{small}");
    assert!(matches!(other(&|photo| photo.rgb.fill(255)), MatchError::NoTable { .. }));
    let twice = match_workspace(&request(world.clone(), vec![good.clone(), good.clone()]));
    assert!(matches!(twice, Err(MatchError::TwoPhotographs { .. })));
}

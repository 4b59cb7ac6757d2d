//! Images with measured responses and photographs.

use std::sync::Arc;

use base64::Engine;
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DVec3, Vec3};
use genmanip_core::{
    Camera, CameraAppearance, CameraResponse, Intrinsics, Material, MeasuredMaterial, ObjectModel, Photograph, Pose,
    WorkspaceAppearance, WorkspaceLight, World,
};

use crate::color::linear_from_srgb8;
use crate::tests::fixture::{block, object};
use crate::{Channels, FrameBuffers, RenderAssets, RenderError, RenderVariation, Renderer, TABLE, ViewJob, encode};

const SIZE: [u32; 2] = [128, 72];

fn world(photograph: Option<Photograph>) -> World {
    let mut world = (*default_world()).clone();
    let intrinsics = Intrinsics::from_vertical_fov(SIZE[0], SIZE[1], 0.5);
    let seen = DVec3::new(0.5, 0.0, 0.0);
    world.cameras = vec![Camera::looking_at("real", DVec3::new(1.7, 0.3, 1.0), seen, intrinsics)];
    let response = CameraResponse {
        exposure: 0.9,
        white_balance: [1.2, 0.95, 0.9],
        contrast: 1.1,
        white: 1.5,
        ..CameraResponse::default()
    };
    let light =
        WorkspaceLight { direction: [0.3, 0.6, 1.0], angular_radius_rad: 0.02, key: [0.7; 3], ambient: [0.4; 3] };
    world.appearance = Some(WorkspaceAppearance {
        light: Some(light),
        table_color: Some([0.4, 0.35, 0.3]),
        materials: Vec::new(),
        cameras: vec![CameraAppearance { camera: "real".into(), response, photograph }],
    });
    world
}

fn drawn(world: &World, objects: &[(Arc<ObjectModel>, Pose)]) -> FrameBuffers {
    let models: Vec<_> = objects.iter().map(|(model, _)| Arc::clone(model)).collect();
    let assets = RenderAssets::without_robot(&models, Some(world)).unwrap();
    let frame = assets.frame_state(&[], 0.0, objects.iter().map(|(_, pose)| (*pose, &[][..]))).unwrap();
    let mut out = [FrameBuffers::default()];
    let job = ViewJob::new(&frame, &world.cameras[0], Channels { instance: true, ..Channels::RGB });
    Renderer::new(assets, RenderVariation::of_world(world).unwrap()).render(&[job], &mut out).unwrap();
    let [image] = out;
    image
}

/// A smooth image of colours that no rendering has.
fn painted() -> Vec<u8> {
    let [width, height] = SIZE;
    let pixel = |at: u32| {
        let (x, y) = (at % width * 2, at / width * 3);
        [40 + x as u8 / 2, 60 + y as u8 / 2, 120 - (x / 4) as u8]
    };
    (0..width * height).flat_map(pixel).collect()
}

fn photograph(rgb: &[u8], [width, height]: [u32; 2]) -> Photograph {
    let jpeg = encode::jpeg_rgb(width, height, rgb, 100).unwrap();
    Photograph { jpeg: base64::engine::general_purpose::STANDARD.encode(jpeg) }
}

/// The image of the empty workspace is its photograph; an object stands in front of it and darkens its table.
#[test]
fn objects_and_their_shadows_stand_on_the_photograph() {
    let paint = painted();
    let world = world(Some(photograph(&paint, SIZE)));
    let empty = drawn(&world, &[]);
    let off = |a: u8, b: u8| i32::from(a.abs_diff(b));
    let worst = empty.rgb.iter().zip(&paint).map(|(a, b)| off(*a, *b)).max();
    assert!(worst <= Some(6), "the photograph changed by {worst:?}");

    let brick = object("brick", block(Vec3::new(0.04, 0.04, 0.08)), Material::plain([0.9, 0.1, 0.1], 0.6));
    let with = drawn(&world, &[(brick, Pose::from_position(DVec3::new(0.5, 0.0, 0.08)))]);
    let brightness =
        |image: &FrameBuffers, at: usize| linear_from_srgb8(image.rgb[3 * at..][..3].try_into().unwrap()).y;
    let tables = || (0..with.instance.len()).filter(|&at| with.instance[at] == TABLE);
    let shadowed = tables().filter(|&at| brightness(&with, at) < 0.6 * brightness(&empty, at)).count();
    let same = tables().filter(|&at| (brightness(&with, at) / brightness(&empty, at) - 1.0).abs() < 0.05).count();
    assert!(shadowed > 20 && same > 10 * shadowed, "{shadowed} pixels in shadow, {same} as before");
    let red =
        (0..with.instance.len()).filter(|&at| with.instance[at] > TABLE && with.rgb[3 * at] > 2 * with.rgb[3 * at + 1]);
    assert!(red.count() > 100, "the object hides the photograph");
}

/// A camera without a photograph sees the table of another camera's.
#[test]
fn another_view_shows_the_photographed_table() {
    let mut world = world(Some(photograph(&painted(), SIZE)));
    let plain = self::world(None);
    let beside = |world: &World| {
        let eye = DVec3::new(1.5, -0.4, 0.9);
        let camera = Camera::looking_at("beside", eye, DVec3::new(0.5, 0.0, 0.0), world.cameras[0].intrinsics);
        let mut moved = world.clone();
        moved.cameras.insert(0, camera);
        drawn(&moved, &[])
    };
    let (with, without) = (beside(&world), beside(&plain));
    let changed = (0..with.instance.len()).filter(|&at| with.rgb[3 * at..][..3] != without.rgb[3 * at..][..3]).count();
    assert!(changed > with.instance.len() / 4, "{changed} pixels show the photograph");
    // Another table or background than the photographed one hides the photograph.
    world.look = Some(crate::AppearanceRandomisation::new(
        genmanip_core::Seed::new(3),
        vec![crate::AppearanceFactor::Background],
    ));
    assert!(RenderVariation::of_world(&world).unwrap().looks.iter().all(|look| look.photograph.is_none()));
}

/// A measured material replaces that of its part of its object, and of nothing else; texture and rest stay.
#[test]
fn measured_materials_replace_those_of_their_part() {
    let boxed = |name: &str| object(name, block(Vec3::new(0.04, 0.04, 0.08)), Material::plain([0.5; 3], 0.6));
    let scene = [(boxed("brick"), DVec3::new(0.5, 0.1, 0.08)), (boxed("stone"), DVec3::new(0.5, -0.1, 0.08))];
    let placed = scene.map(|(model, at)| (model, Pose::from_position(at)));
    let (part, uid) = (placed[0].0.links[0].visual[0].name.clone(), placed[0].0.card.uid.clone());
    let material = |object: &genmanip_core::AssetUid, part: &str| {
        let (object, part) = (object.clone(), part.to_owned());
        MeasuredMaterial { object, part, color_factor: [1.5, 0.5, 9.0], roughness: Some(0.2) }
    };
    let models = placed.each_ref().map(|(model, _)| Arc::clone(model));
    let assets = RenderAssets::without_robot(&models, None).unwrap();
    let under = |measured| RenderVariation { measured, ..RenderVariation::default() }.materials(&assets);
    let [plain, other, painted] =
        [vec![], vec![material(&uid, "no such part")], vec![material(&uid, &part)]].map(under);
    let looks = |it: &crate::scene::material::Material| (it.base.to_array(), it.roughness);
    assert_eq!(plain.iter().map(looks).collect::<Vec<_>>(), other.iter().map(looks).collect::<Vec<_>>());
    let half = plain[0].base.x;
    assert_eq!(looks(&painted[0]), ([1.5 * half, 0.5 * half, 1.0], 0.2), "nothing reflects more light than it gets");
    assert_eq!(looks(&painted[1]), looks(&plain[1]), "another object keeps its material");
}

/// The default response changes nothing but the tone curve, and its inverse gives the radiance back.
#[test]
fn responses_are_inverted() {
    let given = world(None).appearance.unwrap().cameras[0].response.clone();
    let response = crate::Response::new(&given).unwrap();
    for value in [0.02_f32, 0.18, 0.5, 0.8] {
        let radiance = glam::Vec3A::new(value, 0.7 * value, 0.5 * value);
        let rgb = crate::color::srgb8_from_linear(response.display(radiance));
        let back = response.radiance(&rgb)[0];
        assert!((back - radiance).abs().max_element() < 0.02 * value + 0.002, "{radiance} came back as {back}");
    }
}

#[test]
fn photographs_that_do_not_fit_are_refused() {
    let refused = |photograph: Photograph| match RenderVariation::of_world(&world(Some(photograph))) {
        Err(RenderError::BadCamera { camera, problem }) if camera == "real" => problem,
        other => panic!("{other:?}"),
    };
    assert!(refused(Photograph { jpeg: "%".into() }).contains("base64"));
    assert!(refused(Photograph { jpeg: "QUJD".into() }).contains("JPEG"));
    assert!(refused(photograph(&[9; 3 * 64 * 36], [64, 36])).contains("128×72"));
}

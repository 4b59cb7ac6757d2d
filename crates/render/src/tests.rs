//! The rasteriser against analytic geometry, an independent ray caster, the camera model and itself.

pub(crate) mod fixture;

use std::sync::Arc;

use fixture::{ball, block, camera, cast, frame, object, objects, robot};
use genmanip_assets::worlds::default_world;
use genmanip_core::glam::{DQuat, DVec2, DVec3, Vec3};
use genmanip_core::{Camera, CameraMount, Intrinsics, Material, ObjectModel, Pose};
use proptest::prelude::*;

use crate::{
    Channels, FIRST_OBJECT, FrameBuffers, FrameState, RenderAssets, RenderError, RenderVariation, Renderer, TABLE,
    ViewJob, encode,
};

fn toy() -> (Arc<RenderAssets>, FrameState) {
    let assets = RenderAssets::new(robot(), &objects(), Some(&default_world())).unwrap();
    let state = frame(&assets);
    (assets, state)
}

/// One object alone in front of a white background, without table and robot.
fn alone(model: Arc<ObjectModel>, pose: Pose) -> (Arc<RenderAssets>, FrameState) {
    let assets = RenderAssets::without_robot(&[model], None).unwrap();
    let state = assets.frame_state(&[], 0.0, [(pose, [].as_slice())]).unwrap();
    (assets, state)
}

fn draw(assets: &Arc<RenderAssets>, state: &FrameState, camera: &Camera, channels: Channels) -> FrameBuffers {
    continued(&mut Renderer::new(Arc::clone(assets), RenderVariation::default()), state, camera, channels)
}

/// Image by a renderer that may reuse the caches of its previous one; the bytes must equal those of a fresh renderer.
pub(crate) fn continued(
    renderer: &mut Renderer,
    state: &FrameState,
    camera: &Camera,
    channels: Channels,
) -> FrameBuffers {
    let mut out = [FrameBuffers::default()];
    renderer.render(&[ViewJob::new(state, camera, channels)], &mut out).unwrap();
    let [out] = out;
    out
}

fn percentile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

/// Depth of all pixels that show the object against a formula. `analytic` receives the camera position (m) and the view
/// ray, scaled to a depth of 1 m, both in the object's frame, and returns the depth (m).
fn check_depth(model: Arc<ObjectModel>, pose: Pose, viewpoint: DVec3, analytic: impl Fn(DVec3, DVec3) -> Option<f64>) {
    let k = Intrinsics::from_vertical_fov(256, 144, 0.7);
    let camera = Camera::looking_at("c", viewpoint, pose.position, k);
    let (assets, state) = alone(model, pose);
    let out = draw(&assets, &state, &camera, Channels::GEOMETRY);
    let world_from_camera = camera.world_from_camera(&Pose::IDENTITY);
    let object_from_camera = pose.inverse() * world_from_camera;
    let mut errors = Vec::new();
    for (pixel, &depth) in out.depth_m.iter().enumerate() {
        let at = DVec2::new((pixel % 256) as f64, (pixel / 256) as f64);
        let ray = object_from_camera.transform_vector(k.unproject(at, 1.0));
        if let Some(expected) = analytic(object_from_camera.position, ray).filter(|_| depth > 0.0) {
            errors.push((f64::from(depth) - expected).abs());
        }
    }
    assert!(errors.len() > 500, "only {} pixels", errors.len());
    let worst = percentile(errors, 0.999);
    assert!(worst < 0.5e-3, "p99.9 of the depth error is {:.3} mm", worst * 1e3);
}

fn slab(origin: DVec3, ray: DVec3, half: DVec3) -> Option<f64> {
    let (a, b) = ((-half - origin) / ray, (half - origin) / ray);
    let (near, far) = (a.min(b).max_element(), a.max(b).min_element());
    (near < far).then_some(near)
}

#[test]
fn depth_of_a_plane_is_exact() {
    let sheet = object("sheet", block(Vec3::new(2.0, 2.0, 0.01)), Material::plain([0.5; 3], 0.5));
    let pose = Pose::from_position(DVec3::new(0.2, 0.1, -0.01));
    check_depth(sheet, pose, DVec3::new(0.9, 0.3, 0.5), |origin, ray| slab(origin, ray, DVec3::new(2.0, 2.0, 0.01)));
}

#[test]
fn depth_of_a_turned_box_is_exact() {
    let half = Vec3::new(0.1, 0.15, 0.05);
    let pose = Pose::new(DVec3::new(0.4, 0.0, 0.2), DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 0.5).normalize(), 0.8));
    let model = object("box", block(half), Material::plain([0.5; 3], 0.5));
    check_depth(model, pose, DVec3::new(1.2, 0.5, 0.7), |origin, ray| slab(origin, ray, half.as_dvec3()));
}

#[test]
fn depth_of_a_sphere_is_exact_to_its_tessellation() {
    let model = object("ball", ball(0.1, 200), Material::plain([0.5; 3], 0.5));
    check_depth(model, Pose::from_position(DVec3::X), DVec3::new(1.7, 0.2, 0.4), |origin, ray| {
        let (a, b) = (ray.length_squared(), origin.dot(ray));
        let root = b * b - a * (origin.length_squared() - 0.01);
        (root > 1e-4).then(|| (-b - root.sqrt()) / a)
    });
}

#[test]
fn ids_and_depth_agree_with_a_ray_caster_away_from_silhouettes() {
    let (assets, _) = toy();
    for seed in 0..4_u64 {
        let turn = |k: u64| (seed * 7 + k) as f64 * 0.9;
        let place = |k: u64| {
            let at = DVec3::new(0.45 + 0.15 * turn(k).sin(), 0.25 * turn(k + 3).cos(), 0.05 + 0.02 * k as f64);
            (
                Pose::new(at, DQuat::from_euler(genmanip_core::glam::EulerRot::XYZ, turn(k), turn(k + 1), 0.3)),
                [].as_slice(),
            )
        };
        let state = assets.frame_state(&[turn(5).sin()], 0.03, (0..4).map(place)).unwrap();
        // Large enough for full detail.
        let camera = camera(256, 144);
        let out = draw(&assets, &state, &camera, Channels::GEOMETRY);
        let (mut wrong, mut judged, mut errors) = (0, 0, Vec::new());
        for y in (3..141).step_by(2) {
            for x in (3..253).step_by(2) {
                let pixel = (y * 256 + x) as usize;
                let around = [0_isize, -1, 1, -256, 256].map(|step| out.instance[(pixel as isize + step) as usize]);
                if around.iter().any(|&id| id != around[0]) {
                    continue;
                }
                let (depth, id) = cast(&assets, &state, &camera, [x, y]).unwrap_or((0.0, 0));
                judged += 1;
                wrong += usize::from(id != out.instance[pixel]);
                errors.push((depth - f64::from(out.depth_m[pixel])).abs());
            }
        }
        assert!(judged > 3000);
        assert_eq!(wrong, 0, "of {judged} pixels, scene {seed}");
        let worst = percentile(errors, 0.999);
        assert!(worst < 1e-4, "p99.9 of the depth error is {:.4} mm", worst * 1e3);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_marker_appears_where_the_camera_model_projects_it(x in 0.3..0.7, y in -0.2..0.2, z in 0.0..0.3) {
        let marker = object("marker", ball(0.012, 12), Material::plain([1.0, 0.0, 0.0], 1.0));
        let camera = camera(512, 288);
        let (assets, state) = alone(marker, Pose::from_position(DVec3::new(x, y, z)));
        let out = draw(&assets, &state, &camera, Channels::ALL);
        let in_camera = camera.mount_from_camera.inverse().transform_point(DVec3::new(x, y, z));
        let expected = camera.intrinsics.project(in_camera).unwrap();
        let centroid = |weight: &dyn Fn(usize) -> f64| {
            let (sum, total) = (0..512 * 288).fold((DVec2::ZERO, 0.0), |(sum, total), pixel| {
                let weight = weight(pixel);
                (sum + DVec2::new((pixel % 512) as f64, (pixel / 512) as f64) * weight, total + weight)
            });
            sum / total
        };
        let by_id = centroid(&|pixel| f64::from(out.instance[pixel] == FIRST_OBJECT));
        let by_color = centroid(&|pixel| f64::from(255 - out.rgb[pixel * 3 + 1]));
        prop_assert!(by_id.distance(expected) < 0.35, "ids: {by_id} instead of {expected}");
        prop_assert!(by_color.distance(expected) < 0.25, "colour: {by_color} instead of {expected}");
    }
}

#[test]
fn the_same_job_gives_the_same_bytes_whatever_came_before() {
    let (assets, state) = toy();
    let first = draw(&assets, &state, &camera(160, 90), Channels::ALL);
    let moved = assets.frame_state(
        &[0.0],
        0.0,
        (0..4).map(|i| (Pose::from_position(DVec3::X * 0.2 * f64::from(i)), [].as_slice())),
    );
    let moved = moved.unwrap();
    let (wide, small) = (camera(256, 144), camera(160, 90));
    let jobs = [
        ViewJob::new(&moved, &wide, Channels::ALL),
        ViewJob::new(&state, &small, Channels::ALL),
        ViewJob::new(&state, &wide, Channels::RGB),
        ViewJob::new(&state, &small, Channels::ALL),
    ];
    let mut out = vec![FrameBuffers::default(); 4];
    let mut renderer = Renderer::new(assets, RenderVariation::default());
    renderer.render(&jobs, &mut out).unwrap();
    assert!(out[1] == first && out[3] == first);
    // Cached shadow maps must belong to the rendered frame.
    for (job, expected) in jobs.iter().zip(&out) {
        assert!(continued(&mut renderer, job.frame, job.camera, job.channels) == *expected);
    }
}

/// Images whose size is no multiple of a tile, or smaller than one.
#[test]
fn pictures_of_any_size_continue_others() {
    let (assets, _) = toy();
    let frames = episode(&assets);
    for size in [[129, 73], [131, 74], [135, 79], [130, 65], [144, 17], [17, 80], [7, 5], [1, 1]] {
        let near = Pose::from_position(DVec3::Z * -0.3);
        let hand = Camera { mount: CameraMount::Hand, mount_from_camera: near, ..camera(size[0], size[1]) };
        let [mut renderer, mut judge] =
            [(); 2].map(|()| Renderer::new(Arc::clone(&assets), RenderVariation::default()));
        for frame in [&frames[2], &frames[3], &frames[3], &frames[12]] {
            for camera in [&camera(size[0], size[1]), &hand] {
                let out = continued(&mut renderer, frame, camera, Channels::ALL);
                judge.forget();
                assert!(out == continued(&mut judge, frame, camera, Channels::ALL), "{size:?}");
            }
        }
    }
}

/// An episode of the toy scene: the arm swings, rests and swings on, the block is carried, and everything jitters
/// slightly.
fn episode(assets: &RenderAssets) -> Vec<FrameState> {
    (0..14)
        .map(|step| {
            let swing = [0.0, 0.1, 0.2, 0.2, 0.2, 0.3, 0.4, 0.5, 0.5, 0.6, 0.7, 0.7, 0.7, 0.8][step];
            let lift = (step as f64 - 5.0).clamp(0.0, 4.0) * 0.02;
            let tremble = 1e-9 * (step as f64).sin();
            let at = |x: f64, y: f64, z: f64, yaw: f64| {
                (Pose::from_position_yaw(DVec3::new(x + tremble, y, z), yaw), [].as_slice())
            };
            let glass_x = 0.4 + if step > 10 { 0.03 } else { 0.0 };
            let objects = [
                at(0.5, -0.12, 0.03 + lift, 0.6),
                at(0.5, 0.1, 0.045, 0.0),
                at(0.62, 0.0, 0.04, 0.0),
                at(glass_x, 0.0, 0.06, 0.4),
            ];
            assets.frame_state(&[0.9 - swing], 0.04, objects).unwrap()
        })
        .collect()
}

#[test]
fn a_picture_that_continues_another_has_the_bytes_of_one_drawn_from_nothing() {
    let (assets, _) = toy();
    let fixed = camera(192, 108);
    let hand =
        Camera { mount: CameraMount::Hand, mount_from_camera: Pose::from_position(DVec3::Z * -0.3), ..camera(96, 54) };
    let small = camera(64, 36);
    // Drawn once per frame, from another pose each time; the others follow a still view of the same frame.
    let swift = Camera { intrinsics: camera(112, 63).intrinsics, ..hand.clone() };
    let without_normals = Channels { normal: false, parts: false, ..Channels::ALL };
    let twice = [&fixed, &hand, &small].map(|camera| [(camera, Channels::ALL), (camera, without_normals)]);
    // A large image.
    let large = camera(576, 324);
    let views = [twice.as_flattened(), &[(&swift, without_normals), (&large, without_normals)]].concat();
    let usual = RenderVariation::default();
    let low_lamp = RenderVariation { light_direction: [-1.0, 0.2, 0.5], light_angular_radius: 0.16, ..usual.clone() };
    for look in [usual, low_lamp] {
        let mut renderer = Renderer::new(Arc::clone(&assets), look.clone());
        let mut judge = Renderer::new(Arc::clone(&assets), look);
        let mut least = usize::MAX;
        for (index, frame) in episode(&assets).iter().enumerate() {
            for &(camera, channels) in &views {
                let out = continued(&mut renderer, frame, camera, channels);
                if channels.normal && std::ptr::eq(camera, &fixed) {
                    least = least.min(renderer.shaded_pixels());
                }
                judge.forget();
                let anew = continued(&mut judge, frame, camera, channels);
                assert!(out == anew, "frame {index}, camera of {} px, {channels:?}", out.width);
            }
        }
        assert_eq!(least, 0, "where only trembling is left, nothing is shaded again");
    }
}

#[test]
fn coarse_meshes_of_small_images_keep_their_shape() {
    let (assets, state) = toy();
    // The same view with and without full detail: 248 pixels are less than `FULL_DETAIL_PX` (256), 496 are more.
    let (small, large) = (camera(248, 140), camera(496, 280));
    let (coarse, fine) = (draw(&assets, &state, &small, Channels::ALL), draw(&assets, &state, &large, Channels::ALL));
    let fine_id = |pixel: usize| fine.instance[(pixel / 248 * 2 + 1) * 496 + pixel % 248 * 2 + 1];
    let differ = (0..248 * 140).filter(|&pixel| coarse.instance[pixel] != fine_id(pixel)).count();
    assert!(differ < 248 * 140 / 100, "{differ} pixels show another instance");
}

#[test]
fn geometry_does_not_depend_on_the_channels() {
    let (assets, state) = toy();
    let all = draw(&assets, &state, &camera(160, 90), Channels::ALL);
    let geometry = draw(&assets, &state, &camera(160, 90), Channels::GEOMETRY);
    assert_eq!(all.depth_m, geometry.depth_m);
    assert_eq!(all.instance, geometry.instance);
    assert!(geometry.rgb.is_empty() && geometry.normal.is_empty());
}

#[test]
fn the_background_is_exactly_white_and_white_things_are_not() {
    let white = object("white", block(Vec3::splat(0.1)), Material::plain([0.95; 3], 0.5));
    let (assets, state) = alone(white, Pose::from_position(DVec3::new(0.45, 0.0, 0.05)));
    let out = draw(&assets, &state, &camera(160, 90), Channels::ALL);
    let mut inside = 0;
    for y in 1..89 {
        for x in 1..159 {
            let pixel: usize = y * 160 + x;
            let around = [0, 1, 2, 160, 161, 162, 320, 321, 322].map(|step| out.instance[pixel + step - 161]);
            let rgb = &out.rgb[pixel * 3..][..3];
            if around == [0; 9] {
                assert_eq!(rgb, [255; 3]);
                assert_eq!(out.depth_m[pixel], 0.0);
            } else if around == [FIRST_OBJECT; 9] {
                inside += 1;
                assert!(rgb.iter().all(|&value| (90..=251).contains(&value)), "{rgb:?} at {x}, {y}");
            }
        }
    }
    assert!(inside > 200);
}

#[test]
fn a_floor_that_passes_under_the_camera_is_cut_at_the_near_plane() {
    // The camera sits 5 cm above the table and looks along it: the table's triangles reach behind it.
    let (assets, state) = toy();
    let k = Intrinsics::from_vertical_fov(256, 144, 1.0);
    let camera = Camera::looking_at("low", DVec3::new(0.9, 0.3, 0.05), DVec3::new(0.5, 0.2, 0.03), k);
    let out = draw(&assets, &state, &camera, Channels::GEOMETRY);
    for x in (0..256).step_by(5) {
        let pixel = 143 * 256 + x;
        let ray = camera.mount_from_camera.transform_vector(k.unproject(DVec2::new(x as f64, 143.0), 1.0));
        let expected = -0.05 / ray.z;
        assert_eq!(out.instance[pixel], TABLE);
        assert!(
            (f64::from(out.depth_m[pixel]) - expected).abs() < 1e-5,
            "{} instead of {expected}",
            out.depth_m[pixel]
        );
    }
}

#[test]
fn normals_face_the_camera() {
    let (assets, state) = toy();
    let camera = camera(160, 90);
    let out = draw(&assets, &state, &camera, Channels::ALL);
    let up = camera.mount_from_camera.inverse().transform_vector(DVec3::Z);
    for (pixel, (normal, &id)) in out.normal.iter().zip(&out.instance).enumerate() {
        let normal = DVec3::from_array(normal.map(f64::from)) / 127.0;
        let at = DVec2::new((pixel % 160) as f64, (pixel / 160) as f64);
        let in_camera = camera.intrinsics.unproject(at, f64::from(out.depth_m[pixel]));
        let is_table_top = id == TABLE && camera.mount_from_camera.transform_point(in_camera).z > -2e-6;
        assert!(if id == 0 { normal == DVec3::ZERO } else { (normal.length() - 1.0).abs() < 0.01 });
        assert!(!is_table_top || (normal - up).length() < 0.03, "{normal} instead of {up}");
        assert!(normal.dot(in_camera) <= 0.2 * in_camera.length(), "{normal} at {at} of {id} faces away: {in_camera}");
    }
}

#[test]
fn a_hand_camera_moves_with_the_hand() {
    let (assets, _) = toy();
    let mounted = Camera { mount: CameraMount::Hand, ..camera(96, 54) };
    for arm in [0.0, 0.7] {
        let objects = || (0..4).map(|_| (Pose::from_position(DVec3::X * 0.4), [].as_slice()));
        let state = assets.frame_state(&[arm], 0.04, objects()).unwrap();
        let fixed = Camera {
            mount: CameraMount::World,
            mount_from_camera: assets.world_from_hand(&state) * mounted.mount_from_camera,
            ..mounted.clone()
        };
        // Colours differ slightly: the gripper occludes ambient light for its own camera.
        let channels = Channels { rgb: false, ..Channels::ALL };
        assert!(draw(&assets, &state, &mounted, channels) == draw(&assets, &state, &fixed, channels));
    }
}

#[test]
fn the_default_cameras_frame_the_workspace_and_the_pads() {
    let world_from_hand = Pose::new(DVec3::new(0.4, 0.0, 0.4), DQuat::from_rotation_x(std::f64::consts::PI));
    for camera in &default_world().cameras {
        let camera_from_world = camera.world_from_camera(&world_from_hand).inverse();
        let pixel = |point: DVec3| camera.intrinsics.project(camera_from_world.transform_point(point)).unwrap();
        let is_inside = |pixel: DVec2| pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(DVec2::new(512.0, 288.0)).all();
        let pads = pixel(world_from_hand.transform_point(DVec3::Z * 0.1034));
        assert!(is_inside(pads), "{}: pads at {pads}", camera.name);
        if camera.mount == CameraMount::Hand {
            assert!(pads.y > 200.0, "the pads belong to the lower edge, not to {pads}");
            continue;
        }
        for (x, y) in [(0.3, -0.35), (0.3, 0.35), (0.75, -0.35), (0.75, 0.35)] {
            let corner = pixel(DVec3::new(x, y, 0.0));
            assert!(is_inside(corner), "{}: ({x}, {y}) at {corner}", camera.name);
        }
    }
}

#[test]
fn light_and_background_are_data() {
    let (assets, state) = toy();
    let camera = camera(96, 54);
    let mean = |variation: RenderVariation| {
        let rgb = continued(&mut Renderer::new(Arc::clone(&assets), variation), &state, &camera, Channels::RGB).rgb;
        rgb.iter().map(|&value| f64::from(value)).sum::<f64>() / rgb.len() as f64
    };
    let normal = mean(RenderVariation::default());
    assert!(mean(RenderVariation { exposure: 0.5, ..Default::default() }) < normal - 20.0);
    let slate = crate::TableTop::try_from("slate".to_owned()).unwrap();
    assert!(mean(RenderVariation { table_top: slate, ..Default::default() }) < normal - 20.0);
    assert!(mean(RenderVariation { table_color: [0.3; 3], ..Default::default() }) < normal - 20.0);
    assert!(mean(RenderVariation { shadow_resolution: 0, ..Default::default() }) > normal);
    assert!(mean(RenderVariation { occlusion_radius_m: 0.0, ..Default::default() }) > normal);
}

#[test]
fn wrong_requests_are_refused() {
    let (assets, state) = toy();
    let mut renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
    let good = camera(32, 18);
    let mut refused = |frame: &FrameState, camera: &Camera, buffers: usize| {
        let mut out = vec![FrameBuffers::default(); buffers];
        renderer.render(&[ViewJob::new(frame, camera, Channels::ALL)], &mut out).unwrap_err()
    };
    assert!(matches!(refused(&state, &good, 2), RenderError::BufferCount { expected: 1, got: 2 }));
    let mut short = state.clone();
    short.body_poses.pop();
    assert!(matches!(refused(&short, &good, 1), RenderError::BodyCount { expected: 9, got: 8 }));
    let mut broken = state.clone();
    broken.body_poses[2].position.x = f64::NAN;
    assert!(matches!(refused(&broken, &good, 1), RenderError::NotFinite { .. }));
    let mut flat = good.clone();
    flat.intrinsics.fx = 0.0;
    assert!(matches!(refused(&state, &flat, 1), RenderError::BadCamera { .. }));
    flat.intrinsics.width = 0;
    assert!(matches!(refused(&state, &flat, 1), RenderError::BadCamera { .. }));
    assert!(matches!(assets.frame_state(&[0.0], 0.0, []), Err(RenderError::ObjectCount { expected: 4, got: 0 })));
    let mut mesh = block(Vec3::ONE);
    mesh.triangles[3][1] = 99;
    let bad = object("bad", mesh, Material::plain([1.0; 3], 1.0));
    let error = RenderAssets::new(robot(), &[bad], Some(&default_world())).unwrap_err();
    assert_eq!(error.to_string(), "the mesh of part `bad` of `bad` names corner 99, but it has only 24 corners");
}

#[test]
fn closed_meshes_are_recognised() {
    let mut open = block(Vec3::ONE);
    open.triangles.pop();
    let mut inside_out = block(Vec3::ONE);
    inside_out.triangles.iter_mut().for_each(|triangle| triangle.swap(0, 1));
    let plain = || Material::plain([1.0; 3], 1.0);
    let glass = Material { opacity: 0.5, ..plain() };
    for (mesh, material, expected) in [
        (block(Vec3::ONE), plain(), true),
        (ball(1.0, 9), plain(), true),
        (open, plain(), false),
        (inside_out, plain(), false),
        (block(Vec3::ONE), glass, false),
    ] {
        let (assets, _) = alone(object("x", mesh, material), Pose::IDENTITY);
        let part = &assets.parts[0];
        assert_eq!(part.hides_back(&part.mesh), expected);
    }
    let table = RenderAssets::new(robot(), &[], Some(&default_world())).unwrap();
    assert!(table.parts.iter().all(|part| part.mesh.closed), "the surroundings are closed");
}

/// After intended changes run once with `GENMANIP_UPDATE_GOLDEN=1`, inspect the image and commit it.
#[test]
fn the_toy_scene_looks_as_it_did() {
    let (assets, state) = toy();
    let out = draw(&assets, &state, &camera(256, 144), Channels::RGB);
    check_golden("toy_scene.png", [256, 144], &out.rgb);
}

/// Compares an image with a stored one.
pub(crate) fn check_golden(name: &str, [width, height]: [u32; 2], rgb: &[u8]) {
    let path = &std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata").join(name);
    if std::env::var_os("GENMANIP_UPDATE_GOLDEN").is_some() {
        std::fs::write(path, encode::png_rgb(width, height, rgb).unwrap()).unwrap();
    }
    let golden = decode(&std::fs::read(path).unwrap());
    assert_eq!(golden.len(), rgb.len());
    let differences: Vec<f64> = golden.iter().zip(rgb).map(|(&a, &b)| f64::from(a.abs_diff(b))).collect();
    let mean = differences.iter().sum::<f64>() / differences.len() as f64;
    assert!(mean < 0.5, "the mean difference is {mean:.2} of 255");
    assert!(percentile(differences, 0.995) <= 8.0);
}

fn decode(png: &[u8]) -> Vec<u8> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let used = reader.next_frame(&mut bytes).unwrap().buffer_size();
    bytes.truncate(used);
    bytes
}

#[test]
fn pictures_survive_their_files() {
    let rgb: Vec<u8> = (0..8 * 4 * 3).map(|value| (value * 2) as u8).collect();
    assert_eq!(decode(&encode::png_rgb(8, 4, &rgb).unwrap()), rgb);
    let depth = [0.0_f32, 0.0004, 0.0006, 1.2344, 65.535, 65.6, f32::NAN, -1.0];
    let millimetres = [0_u16, 0, 1, 1234, 65535, 65535, 0, 0];
    let bytes: Vec<u8> = millimetres.iter().flat_map(|value| value.to_be_bytes()).collect();
    assert_eq!(decode(&encode::png_depth_mm(8, 1, &depth).unwrap()), bytes);
    assert!(encode::jpeg_rgb(8, 4, &rgb, 95).unwrap().starts_with(&[0xFF, 0xD8]));
    assert!(encode::png_rgb(8, 5, &rgb).is_err());
}

#[test]
fn resizing_averages_colours() {
    let grey: Vec<u8> = [10, 20, 30, 40, 50].iter().flat_map(|&value| [value; 3]).collect();
    // Five pixels to two: 2.5 each, (10 + 20 + 30 / 2) / 2.5 = 18 and (30 / 2 + 40 + 50) / 2.5 = 42.
    assert_eq!(encode::resize_rgb([5, 1], &grey, [2, 1]).unwrap(), [18, 18, 18, 42, 42, 42]);
    assert!(encode::resize_rgb([5, 1], &grey, [0, 1]).is_err());
}

use genmanip_core::{Camera, Intrinsics, Piece, Pose, RgbdImage, Seed, Shape, glam::DVec2, glam::DVec3};

use super::pixels::{Grid, View};
use crate::test_robot::test_panda;
use crate::{AllowedCollisions, CollisionWorld, Planner, PlannerSettings, PlanningScene};

const BALL: (DVec3, f64) = (DVec3::new(0.55, 0.0, 0.12), 0.1);

fn camera() -> Camera {
    let intrinsics = Intrinsics::from_vertical_fov(160, 120, 0.9);
    Camera::looking_at("test", DVec3::new(0.55, -0.9, 0.9), DVec3::new(0.5, 0.0, 0.1), intrinsics)
}

/// Depth image of a ball over the plane z = 0, and of the robot's hand at home, modelled as a ball.
fn picture(camera: &Camera, balls: &[(DVec3, f64)]) -> Vec<f32> {
    let k = camera.intrinsics;
    let eye = camera.mount_from_camera.position;
    let depth = |pixel: u32| {
        let at = DVec2::new(f64::from(pixel % k.width), f64::from(pixel / k.width));
        let ray = camera.mount_from_camera.transform_vector(k.unproject(at, 1.0));
        let ball = |(center, radius): &(DVec3, f64)| {
            let (to, square) = (*center - eye, ray.length_squared());
            let (half, rest) = (ray.dot(to) / square, (to.length_squared() - radius * radius) / square);
            (half * half > rest).then(|| half - (half * half - rest).sqrt())
        };
        let table = (ray.z < 0.0).then(|| -eye.z / ray.z);
        balls.iter().filter_map(ball).chain(table).fold(f64::INFINITY, f64::min) as f32
    };
    (0..k.width * k.height).map(depth).collect()
}

fn tables() -> CollisionWorld {
    let slab = Piece::at(DVec3::Z * -0.02, Shape::Box { half_extents: DVec3::new(1.5, 1.5, 0.02) });
    let mut world = CollisionWorld::new();
    world.add("table", &[slab], &Pose::IDENTITY).unwrap();
    world
}

fn image(camera: &Camera, depth_m: &[f32]) -> RgbdImage {
    RgbdImage::of_depth(camera.intrinsics, camera.mount_from_camera, depth_m.to_vec())
}

#[test]
fn paths_go_around_what_is_seen() {
    let planner = Planner::new(test_panda(), PlannerSettings::default()).unwrap();
    let (camera, tables, allowed) = (camera(), tables(), AllowedCollisions::none());
    let around = |world| PlanningScene { world, attached: None, allowed: &allowed, gripper_width: 0.08 };
    let home = planner.robot().home.clone();
    let side = |y: f64| {
        let down = genmanip_core::glam::DQuat::from_rotation_x(std::f64::consts::PI);
        planner.ik(&Pose::new(DVec3::new(0.55, y, 0.1), down), &home).remove(0)
    };
    let (start, goal) = (side(-0.3), side(0.3));
    let hand = (planner.tcp_pose(&start).position + DVec3::Z * 0.07, 0.025);
    let depth_m = picture(&camera, &[BALL, hand]);
    let seen = planner.world_seen(&around(&tables), &start, "seen", &[image(&camera, &depth_m)]).unwrap();
    assert_eq!(seen.names().collect::<Vec<_>>(), ["table", "seen"]);
    // Half of the ball in cells of 7 mm: neither table nor hand are among them.
    let count = seen.facet_count("seen").unwrap();
    assert!((300..2500).contains(&count), "{count}");
    assert!(planner.check(&around(&seen), &start).is_none(), "the hand is not its own obstacle");
    // The straight path crosses the ball; the planned path keeps clear of its visible half.
    let straight = planner.plan_joint(&around(&tables), &start, std::slice::from_ref(&goal), Seed::new(1)).unwrap();
    let path = planner.plan_joint(&around(&seen), &start, &[goal], Seed::new(1)).unwrap();
    let mut truth = CollisionWorld::new();
    truth.add("ball", &[Piece::at(BALL.0, Shape::Sphere { radius: BALL.1 })], &Pose::IDENTITY).unwrap();
    let touches =
        |path: &crate::Path| path.states(0.02).iter().any(|state| planner.check(&around(&truth), state).is_some());
    assert!(touches(&straight) && !touches(&path));
    // A second copy of the image adds nothing, nor does a fully known scene.
    let twice = [image(&camera, &depth_m), image(&camera, &depth_m)];
    let again = planner.world_seen(&around(&tables), &start, "seen", &twice).unwrap();
    assert_eq!(again.facet_count("seen"), Some(count));
    let mut known = tables.clone();
    known.add("ball", &[Piece::at(BALL.0, Shape::Sphere { radius: BALL.1 })], &Pose::IDENTITY).unwrap();
    let nothing = planner.world_seen(&around(&known), &start, "seen", &twice).unwrap();
    assert_eq!(nothing.facet_count("seen"), None);
}

#[test]
fn pixels_fall_into_the_cells_of_their_points() {
    let mut rng = Seed::new(21).rng();
    let camera = camera();
    let strange = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 0.0, -1.0];
    let depth = |k: usize, rng: &mut _| match k % 5 {
        0 => strange[k / 5 % strange.len()],
        1 => 1.0,
        _ => rand::RngExt::random_range(rng, 0.2..3.0),
    };
    let depth_m: Vec<f32> = (0..160 * 120).map(|k| depth(k, &mut rng)).collect();
    let view = View::new(&image(&camera, &depth_m));
    let grid = Grid { low: DVec3::splat(-1.2), cells_per_m: 1.0 / 0.007, count: 343 };
    let (mut cells, mut inside) = (Vec::new(), 0);
    for (row, depths) in depth_m.chunks_exact(160).enumerate() {
        grid.cells_of_row(&view, row, depths, &mut cells);
        let mut found = cells.iter().copied().peekable();
        let mut last = None;
        for (column, depth) in depths.iter().enumerate() {
            let at = (view.point(row, column, *depth) - grid.low) * grid.cells_per_m;
            let sees = *depth > 0.0 && depth.is_finite() && at.min_element() >= 0.0 && at.max_element() < 343.0;
            if let Some((_, cell)) = found.next_if(|(found, _)| *found == column) {
                let middle = DVec3::from_array(cell.map(f64::from)) + 0.5;
                // Rounding may put what is on the border of a cell on its other side.
                assert!((at - middle).abs().max_element() < 0.501, "{row} {column}: {at} is not in {cell:?}");
                last = Some(cell);
                inside += 1;
            } else {
                let is_last = last.is_some_and(|cell| {
                    (at - DVec3::from_array(cell.map(f64::from)) - 0.5).abs().max_element() < 0.501
                });
                let is_on_the_border = at.min_element() < 1e-3 || at.max_element() > 343.0 - 1e-3;
                assert!(!sees || is_last || is_on_the_border, "{row} {column}: {at} was left out");
            }
        }
        assert_eq!(found.next(), None);
    }
    assert!(inside > 5000, "{inside}");
}

#[test]
fn images_that_make_no_sense_are_refused() {
    let planner = Planner::new(test_panda(), PlannerSettings::default()).unwrap();
    let (camera, tables, allowed) = (camera(), tables(), AllowedCollisions::none());
    let around = PlanningScene { world: &tables, attached: None, allowed: &allowed, gripper_width: 0.08 };
    let home = planner.robot().home.clone();
    let depth_m = picture(&camera, &[BALL]);
    let good = image(&camera, &depth_m);
    let nothing = vec![f32::NAN; depth_m.len()];
    let nowhere = Pose::from_position(DVec3::NAN);
    let flat = Intrinsics { fx: 0.0, ..camera.intrinsics };
    let blind = "no pixel of 1 depth images has a depth, so obstacles are unknown";
    let no_camera = "the camera of depth image 0 has a pose or a projection that is not finite, or no focal length";
    let cases = [
        (
            RgbdImage { depth_m: depth_m[1..].to_vec(), ..good.clone() },
            "depth image 0 has 19199 depths, expected 160 x 120",
        ),
        (RgbdImage { depth_m: nothing, ..good.clone() }, blind),
        (RgbdImage { world_from_camera: nowhere, ..good.clone() }, no_camera),
        (RgbdImage { intrinsics: flat, ..good.clone() }, no_camera),
    ];
    for (image, message) in cases {
        assert_eq!(planner.world_seen(&around, &home, "seen", &[image]).unwrap_err().to_string(), message);
    }
    let error = planner.world_seen(&around, &home[..3], "seen", std::slice::from_ref(&good)).unwrap_err().to_string();
    assert!(error.starts_with("expected 7 finite joint positions of the robot in the images"), "{error}");
    let mut settings = PlannerSettings::default();
    settings.depth.cell_m = 0.0;
    let planner = Planner::new(test_panda(), settings).unwrap();
    let error = planner.world_seen(&around, &home, "seen", &[good]).unwrap_err().to_string();
    assert_eq!(error, "voxel size 0 m: expected 0.001 to 0.1 m");
}

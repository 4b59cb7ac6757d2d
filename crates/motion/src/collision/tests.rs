use genmanip_core::{Piece, Pose, Seed, Shape, glam::DVec3};
use rand::RngExt;

use super::*;
use crate::test_robot::test_panda;

fn slab() -> Piece {
    Piece::at(DVec3::new(0.0, 0.0, -0.02), Shape::Box { half_extents: DVec3::new(0.35, 0.5, 0.02) })
}

fn ball(radius: f64) -> Piece {
    Piece::at(DVec3::ZERO, Shape::Sphere { radius })
}

fn check(
    world: &CollisionWorld,
    attached: Option<&Attached>,
    allowed: &AllowedCollisions,
    padding: f64,
) -> Option<String> {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let checker = Checker::new(&shape, world, attached, allowed, 0.08, padding);
    let report = checker.check(&robot.home);
    assert_eq!(report.is_none(), checker.is_free(&robot.home), "the fast answer differs: {report:?}");
    report.map(|report| report.to_string())
}

#[test]
fn home_is_free_above_a_table() {
    let mut world = CollisionWorld::new();
    world.add("table", &[slab()], &Pose::from_position(DVec3::new(0.55, 0.0, 0.0))).unwrap();
    assert_eq!(check(&world, None, &AllowedCollisions::none(), 0.003), None);
}

#[test]
fn reports_name_the_worst_pair_and_its_distance() {
    let robot = test_panda();
    let tcp = robot.tcp_pose(&robot.home);
    let mut world = CollisionWorld::new();
    // The hand is 66 mm deep and ends 37.4 mm behind the TCP; a ball in the middle of the grasp touches nothing yet.
    world.add("ball", &[ball(0.02)], &tcp).unwrap();
    assert_eq!(check(&world, None, &AllowedCollisions::none(), 0.003), None);
    assert_eq!(check(&world, None, &AllowedCollisions::none(), 0.02).as_deref(), Some("hand is 17.4 mm from ball"));
    world.add("ball", &[ball(0.045)], &tcp).unwrap();
    assert_eq!(check(&world, None, &AllowedCollisions::none(), 0.003).as_deref(), Some("hand is 7.6 mm inside ball"));
    let touched = AllowedCollisions::none().and_gripper(&robot, "ball");
    assert_eq!(check(&world, None, &touched, 0.003), None);
}

#[test]
fn carried_objects_collide_but_may_rest_on_what_is_allowed() {
    let mut world = CollisionWorld::new();
    let robot = test_panda();
    let tcp = robot.tcp_pose(&robot.home);
    let board = Piece::at(DVec3::ZERO, Shape::Box { half_extents: DVec3::new(0.05, 0.05, 0.02) });
    world.add("shelf", &[board], &Pose::from_position(tcp.position - DVec3::Z * 0.07)).unwrap();
    let held = Attached::new("apple", &[ball(0.035)], &Pose::from_position(DVec3::Z * 0.02)).unwrap();
    let report = check(&world, Some(&held), &AllowedCollisions::none(), 0.003);
    assert_eq!(report.as_deref(), Some("apple is 5.0 mm inside shelf"));
    assert_eq!(check(&world, Some(&held), &AllowedCollisions::none().and_attached("shelf"), 0.003), None);
}

#[test]
fn relaxing_accepts_closeness_but_not_penetration() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let tcp = robot.tcp_pose(&robot.home);
    for (radius, free) in [(0.0364, true), (0.039, false)] {
        let mut world = CollisionWorld::new();
        world.add("ball", &[ball(radius)], &tcp).unwrap();
        let mut checker = Checker::new(&shape, &world, None, &AllowedCollisions::none(), 0.08, 0.003);
        assert!(!checker.is_free(&robot.home));
        assert_eq!(checker.relax(&robot.home, 0.001).is_ok(), free);
        if free {
            assert!(checker.is_free(&robot.home) && !checker.has_min_clearance(0.003));
            let firmer = checker.with_min_clearance(0.003);
            assert!(firmer.has_min_clearance(0.003) && !firmer.is_free(&robot.home));
        }
    }
}

/// 0.04 mm from a ball: touching it by as little is a contact, not just proximity.
#[test]
fn what_was_apart_may_come_close_but_not_touch() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let tcp = robot.tcp_pose(&robot.home);
    let mut world = CollisionWorld::new();
    world.add("ball", &[ball(0.02)], &tcp).unwrap();
    let gap =
        Checker::new(&shape, &world, None, &AllowedCollisions::none(), 0.08, 0.02).check(&robot.home).unwrap().distance;
    world.add("ball", &[ball(0.02 + gap - 4e-5)], &tcp).unwrap();
    let exact = Checker::new(&shape, &world, None, &AllowedCollisions::none(), 0.08, 0.0);
    let mut checker = Checker::new(&shape, &world, None, &AllowedCollisions::none(), 0.08, 0.003);
    checker.relax(&robot.home, 0.001).unwrap();
    assert!(exact.is_free(&robot.home) && checker.is_free(&robot.home));
    let mut touching = 0;
    for joint in 0..7 {
        for turn in [-2e-4, 2e-4] {
            let mut config = robot.home.clone();
            config[joint] += turn;
            assert_eq!(checker.is_free(&config), exact.is_free(&config), "joint {joint} turned by {turn}");
            touching += usize::from(!exact.is_free(&config));
        }
    }
    assert!(touching > 0);
}

#[test]
fn edges_are_free_exactly_when_their_states_are() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let mut rng = Seed::new(3).rng();
    let limits: Vec<(f64, f64)> = shape.chain().lower().zip(shape.chain().upper()).collect();
    let held = Attached::new("apple", &[ball(0.035)], &Pose::from_position(DVec3::Z * 0.02)).unwrap();
    let (mut free, mut blocked) = (0, 0);
    for _ in 0..60 {
        let mut world = CollisionWorld::new();
        world.add("table", &[slab()], &Pose::from_position(DVec3::new(0.55, 0.0, 0.0))).unwrap();
        for index in 0..8 {
            let mut draw = |low: f64, high: f64| rng.random_range(low..high);
            let place = DVec3::new(draw(0.2, 0.8), draw(-0.5, 0.5), draw(0.0, 0.6));
            let half_height = draw(0.02, 0.1);
            let shapes = [
                Shape::Cylinder { radius: 0.04, half_height },
                Shape::Capsule { radius: 0.03, half_length: half_height },
                Shape::Ellipsoid { radii: DVec3::new(0.03, 0.05, half_height) },
                Shape::Hull { points: [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ZERO].map(|p| p * 0.1).to_vec() },
            ];
            let piece = Piece::at(DVec3::ZERO, shapes[index % 4].clone());
            world.add(&format!("thing {index}"), &[piece], &Pose::from_position_yaw(place, draw(0.0, 3.0))).unwrap();
        }
        let checker = Checker::new(&shape, &world, Some(&held), &AllowedCollisions::none(), 0.05, 0.003);
        let mut config = || limits.iter().map(|(low, high)| rng.random_range(*low..*high) * 0.5).collect::<Vec<f64>>();
        let (from, to) =
            (robot.home.clone(), config().iter().zip(&robot.home).map(|(a, b)| b + 0.4 * a).collect::<Vec<_>>());
        let steps = checker.edge_steps(&from, &to, 0.006);
        let states = (1..=steps).map(|step| crate::path::lerp(&from, &to, step as f64 / steps as f64));
        let expected = states.into_iter().all(|state| checker.is_free(&state));
        assert_eq!(checker.edge_is_free(&from, &to, 0.006), expected);
        // The path check proves more, and fails only where something is too close.
        let clear = checker.polyline_is_free(&[from.clone(), to.clone()], 0.006);
        let exact = Checker::new(&shape, &world, Some(&held), &AllowedCollisions::none(), 0.05, 0.0);
        let mut dense = (0..=2000).map(|k| crate::path::lerp(&from, &to, f64::from(k) / 2000.0));
        if clear {
            assert!(dense.all(|state| exact.is_free(&state)));
        } else {
            assert!(dense.any(|state| !checker.is_free(&state)));
        }
        if expected { free += 1 } else { blocked += 1 }
    }
    assert!(free >= 5 && blocked >= 5, "the cases are one-sided: {free} free, {blocked} blocked");
}

#[test]
fn bodies_stay_in_their_room() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let held = Attached::new("apple", &[ball(0.035)], &Pose::from_position(DVec3::Z * 0.02)).unwrap();
    let limits: Vec<(f64, f64)> = shape.chain().lower().zip(shape.chain().upper()).collect();
    let mut rng = Seed::new(5).rng();
    for body in shape.bodies(Some(&held), 0.08) {
        let room = shape.reachable_ball(&body);
        let mut farthest = 0.0_f64;
        for _ in 0..300 {
            let config: Vec<f64> = limits.iter().map(|(low, high)| rng.random_range(*low..=*high)).collect();
            let ball = body.ball.moved(&shape.chain().frames(&config)[body.frame]);
            farthest = farthest.max(ball.center.distance(room.center) + ball.radius);
        }
        assert!(farthest <= room.radius + 1e-9, "{} leaves its room", body.name);
        assert!(farthest > 0.4 * room.radius, "{} has far too much room: {farthest} of {}", body.name, room.radius);
    }
}

/// Every kind of piece, none of them degenerate to a cube or a sphere.
pub(super) fn one_of_each_shape() -> [Shape; 6] {
    [
        Shape::Box { half_extents: DVec3::new(0.03, 0.1, 0.035) },
        Shape::Sphere { radius: 0.05 },
        Shape::Ellipsoid { radii: DVec3::new(0.03, 0.06, 0.1) },
        Shape::Cylinder { radius: 0.05, half_height: 0.12 },
        Shape::Capsule { radius: 0.04, half_length: 0.1 },
        Shape::Hull { points: [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::ONE].map(|p| p * 0.1).to_vec() },
    ]
}

#[test]
fn covers_hold_their_bodies() {
    let mut rng = Seed::new(4).rng();
    for shape in one_of_each_shape() {
        let body = convex::Convex::new("body", 0, &Piece::at(DVec3::new(0.1, 0.2, 0.3), shape.clone())).unwrap();
        let balls = cover::cover(&body);
        let mut draw =
            || DVec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
        for _ in 0..3000 {
            // Points between boundary points are inside, because the body is convex.
            let (a, b, t) = (body.support(draw()), body.support(draw()), (draw().x + 1.0) / 2.0);
            let point = a.lerp(b, t);
            let outside = balls
                .iter()
                .map(|cover| cover.ball.center.distance(point) - cover.ball.radius)
                .fold(f64::MAX, f64::min);
            assert!(outside < 1e-9, "{shape:?}: {point} is {outside} m outside its {} balls", balls.len());
            // Everything within the inscribed radius is inside: no support plane cuts it off.
            let outward = draw().normalize();
            for cover::CoverBall { ball, inner } in &balls {
                let room = (body.support(outward) - ball.center).dot(outward);
                assert!(*inner <= room.max(0.0) + 1e-9, "{shape:?}: {inner} m around {} are not inside", ball.center);
            }
        }
    }
}

#[test]
fn lane_sines_are_precise() {
    for index in -4000..=4000 {
        let x = index as f32 * 0.002;
        let (sin, cos) = lanes::Lanes::all(x).sin_cos();
        let (sine, cosine) = f64::from(x).sin_cos();
        for (got, wanted) in [(sin, sine), (cos, cosine)] {
            let error = (f64::from(got.to_array()[0]) - wanted).abs();
            assert!(error < 5e-7, "at {x}: {error}");
        }
    }
}

#[test]
fn bad_geometry_is_refused() {
    let flat = Piece::at(DVec3::ZERO, Shape::Box { half_extents: DVec3::new(0.1, 0.0, 0.1) });
    let error = CollisionWorld::new().add("plank", &[ball(0.1), flat], &Pose::IDENTITY).unwrap_err();
    assert_eq!(
        error.to_string(),
        "collision piece 1 of plank: sizes must be positive and finite, got Box { half_extents: DVec3(0.1, 0.0, 0.1) }"
    );
    let nowhere = Pose::from_position(DVec3::NAN);
    assert!(CollisionWorld::new().add("ghost", &[ball(0.1)], &nowhere).is_err());
}

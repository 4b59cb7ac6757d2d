use genmanip_core::{Piece, Pose, Shape, glam::DVec3};

use super::*;
use crate::test_robot::test_panda;

fn slab() -> Piece {
    Piece::at(DVec3::new(0.0, 0.0, -0.02), Shape::Box { half_extents: DVec3::new(0.35, 0.5, 0.02) })
}

fn ball(radius: f64) -> Piece {
    Piece::at(DVec3::ZERO, Shape::Sphere { radius })
}

fn check(world: &World, attached: Option<&Attached>, allowed: &Allowed, padding: f64) -> Option<String> {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let checker = Checker::new(&shape, world, attached, allowed, 0.08, padding);
    let report = checker.check(&robot.home);
    assert_eq!(report.is_none(), checker.is_free(&robot.home), "the fast answer differs: {report:?}");
    report.map(|report| report.to_string())
}

#[test]
fn home_is_free_above_a_table() {
    let mut world = World::new();
    world.add("table", &[slab()], &Pose::from_position(DVec3::new(0.55, 0.0, 0.0))).unwrap();
    assert_eq!(check(&world, None, &Allowed::none(), 0.003), None);
}

#[test]
fn reports_name_the_worst_pair_and_its_distance() {
    let robot = test_panda();
    let tcp = robot.tcp_pose(&robot.home);
    let mut world = World::new();
    // The hand is 66 mm deep and ends 37.4 mm behind the tcp; a ball in the middle of the grasp touches nothing yet.
    world.add("ball", &[ball(0.02)], &tcp).unwrap();
    assert_eq!(check(&world, None, &Allowed::none(), 0.003), None);
    assert_eq!(check(&world, None, &Allowed::none(), 0.02).as_deref(), Some("hand is 17.4 mm from ball"));
    world.add("ball", &[ball(0.045)], &tcp).unwrap();
    assert_eq!(check(&world, None, &Allowed::none(), 0.003).as_deref(), Some("hand is 7.6 mm inside ball"));
    let touched = Allowed::none().and_gripper(&robot, "ball");
    assert_eq!(check(&world, None, &touched, 0.003), None);
}

#[test]
fn carried_objects_collide_but_may_rest_on_what_is_allowed() {
    let mut world = World::new();
    let robot = test_panda();
    let tcp = robot.tcp_pose(&robot.home);
    let board = Piece::at(DVec3::ZERO, Shape::Box { half_extents: DVec3::new(0.05, 0.05, 0.02) });
    world.add("shelf", &[board], &Pose::from_position(tcp.position - DVec3::Z * 0.07)).unwrap();
    let held = Attached::new("apple", &[ball(0.035)], &Pose::from_position(DVec3::Z * 0.02)).unwrap();
    let report = check(&world, Some(&held), &Allowed::none(), 0.003);
    assert_eq!(report.as_deref(), Some("apple is 5.0 mm inside shelf"));
    assert_eq!(check(&world, Some(&held), &Allowed::none().and_attached("shelf"), 0.003), None);
}

#[test]
fn relaxing_accepts_closeness_but_not_penetration() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let tcp = robot.tcp_pose(&robot.home);
    for (radius, free) in [(0.0364, true), (0.039, false)] {
        let mut world = World::new();
        world.add("ball", &[ball(radius)], &tcp).unwrap();
        let mut checker = Checker::new(&shape, &world, None, &Allowed::none(), 0.08, 0.003);
        assert!(!checker.is_free(&robot.home));
        assert_eq!(checker.relax(&robot.home, 0.001).is_ok(), free);
        if free {
            assert!(checker.is_free(&robot.home));
        }
    }
}

#[test]
fn bad_geometry_is_refused() {
    let flat = Piece::at(DVec3::ZERO, Shape::Box { half_extents: DVec3::new(0.1, 0.0, 0.1) });
    let error = World::new().add("plank", &[ball(0.1), flat], &Pose::IDENTITY).unwrap_err();
    assert_eq!(
        error.to_string(),
        "collision piece 1 of plank: sizes must be positive and finite, got Box { half_extents: DVec3(0.1, 0.0, 0.1) }"
    );
    let nowhere = Pose::from_position(DVec3::NAN);
    assert!(World::new().add("ghost", &[ball(0.1)], &nowhere).is_err());
}

use genmanip_core::{
    Piece, Pose, Seed, Shape,
    glam::{DQuat, DVec3},
};
use rand::RngExt;

use super::*;
use crate::test_robot::test_panda;
use crate::{Planner, PlannerSettings};

/// Surface points of pieces by ray casting against the exact solid.
fn surface(pieces: &[Piece], count: usize) -> Vec<(DVec3, DVec3)> {
    let solid = solid::Solid::new(pieces).unwrap();
    let mut rng = Seed::new(9).rng();
    let mut points = Vec::new();
    while points.len() < count {
        let mut draw =
            || DVec3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
        let (direction, through) = (draw().normalize(), draw() * 0.15);
        let origin = through - direction;
        for chord in solid.chords(origin, direction, 1e-6) {
            points.push((origin + direction * chord.enter, chord.enter_normal));
            points.push((origin + direction * chord.leave, chord.leave_normal));
        }
    }
    points
}

fn wall(sides: usize, radius: f64, thickness: f64, height: f64) -> Vec<Piece> {
    let width = radius * (std::f64::consts::PI / sides as f64).tan();
    let ring = (0..sides).map(|side| {
        let turn = DQuat::from_rotation_z(std::f64::consts::TAU * side as f64 / sides as f64);
        let center = turn * DVec3::new(radius - thickness / 2.0, 0.0, height / 2.0);
        let shape = Shape::Box { half_extents: DVec3::new(thickness / 2.0, width, height / 2.0) };
        Piece { shape, link_from_piece: Pose::new(center, turn) }
    });
    let floor = Piece::at(DVec3::Z * 0.002, Shape::Cylinder { radius: radius - thickness, half_height: 0.002 });
    ring.chain([floor]).collect()
}

fn box_of(size: DVec3) -> Vec<Piece> {
    vec![Piece::at(DVec3::Z * size.z / 2.0, Shape::Box { half_extents: size / 2.0 })]
}

fn tube(radius: f64, height: f64) -> Vec<Piece> {
    vec![Piece::at(DVec3::Z * height / 2.0, Shape::Cylinder { radius, half_height: height / 2.0 })]
}

fn lying_rod(radius: f64, length: f64) -> Vec<Piece> {
    let pose = Pose::new(DVec3::Z * radius, DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2));
    vec![Piece { shape: Shape::Cylinder { radius, half_height: length / 2.0 }, link_from_piece: pose }]
}

fn planner() -> Planner {
    Planner::new(test_panda(), PlannerSettings::default()).unwrap()
}

fn check(name: &str, pieces: &[Piece], expected: impl Fn(&[Grasp])) {
    let planner = planner();
    let surface = surface(pieces, 3000);
    let center = surface.iter().map(|(point, _)| *point).sum::<DVec3>() / surface.len() as f64;
    let target = GraspTarget {
        surface: &surface,
        pieces,
        center_of_mass: center,
        world_from_object: Pose::from_position_yaw(DVec3::new(0.5, 0.1, 0.0), 0.7),
        table_height: 0.0,
    };
    let grasps = planner.grasps(&target, Seed::new(1)).unwrap();
    assert_eq!(grasps, planner.grasps(&target, Seed::new(1)).unwrap(), "{name}: not deterministic");
    assert!(grasps.windows(2).all(|pair| pair[0].score >= pair[1].score), "{name}: not sorted");
    let bench = assess::GraspEvaluator::new(&target, planner.gripper(), &planner.settings().grasp).unwrap();
    for grasp in &grasps {
        assert!((0.0..=1.0).contains(&grasp.score) && grasp.width <= 0.076, "{name}: {grasp:?}");
        assert!(bench.is_clear(grasp), "{name}: {grasp:?}");
    }
    assert_eq!(
        planner.fitting_grasps(&target, grasps.iter()).unwrap(),
        grasps,
        "{name}: all fit where they were found"
    );
    let deeper = GraspTarget { table_height: 0.4, ..target };
    assert!(
        planner.fitting_grasps(&deeper, grasps.iter()).unwrap().is_empty(),
        "{name}: nothing is taken through the table"
    );
    let over = DQuat::from_rotation_x(std::f64::consts::PI);
    let overturned = GraspTarget { world_from_object: Pose::new(DVec3::Z * 0.5, over), table_height: 0.2, ..target };
    for grasp in planner.fitting_grasps(&overturned, grasps.iter()).unwrap() {
        let approach = over * grasp.approach();
        assert!(approach.z < 0.13, "{name}: the hand does not come from below: {approach}");
    }
    expected(&grasps);
}

#[test]
fn compact_and_tall_things_are_grasped() {
    check("cube", &box_of(DVec3::splat(0.05)), |grasps| {
        assert!(grasps.len() >= 5);
        assert!((grasps[0].width - 0.05).abs() < 1.5e-3 && grasps[0].approach().z < -0.95, "{:?}", grasps[0]);
        assert!((grasps[0].pose.position - DVec3::Z * 0.025).length() < 0.02, "{:?}", grasps[0]);
    });
    check("ball", &[Piece::at(DVec3::Z * 0.035, Shape::Sphere { radius: 0.035 })], |grasps| {
        assert!(grasps.len() >= 5 && (grasps[0].width - 0.07).abs() < 2e-3, "{:?}", grasps[0]);
    });
    check("bottle", &tube(0.033, 0.24), |grasps| assert!(grasps.len() >= 5));
    check("book on edge", &box_of(DVec3::new(0.2, 0.03, 0.25)), |grasps| assert!(grasps.len() >= 5));
}

#[test]
fn thin_flat_things_are_grasped_just_above_the_table() {
    check("pen", &lying_rod(0.005, 0.14), |grasps| {
        assert!(grasps.len() >= 5, "{}", grasps.len());
        assert!((grasps[0].width - 0.01).abs() < 2e-3 && grasps[0].approach().z < -0.9, "{:?}", grasps[0]);
    });
    check("knife", &box_of(DVec3::new(0.2, 0.018, 0.006)), |grasps| assert!(grasps.len() >= 5, "{}", grasps.len()));
    check("book", &box_of(DVec3::new(0.2, 0.07, 0.03)), |grasps| assert!(grasps.len() >= 5, "{}", grasps.len()));
}

#[test]
fn walls_are_grasped_at_the_rim() {
    check("bowl", &wall(20, 0.075, 0.004, 0.06), |grasps| {
        assert!(grasps.len() >= 5, "{}", grasps.len());
        assert!(grasps.iter().all(|grasp| grasp.width < 0.012), "{:?}", grasps[0]);
    });
}

#[test]
fn what_does_not_fit_has_no_grasp() {
    check("crate", &box_of(DVec3::new(0.1, 0.12, 0.09)), |grasps| assert!(grasps.is_empty(), "{grasps:?}"));
    check("plate", &tube(0.1, 0.012), |grasps| assert!(grasps.is_empty(), "{grasps:?}"));
}

#[test]
fn what_has_no_width_is_refused_with_the_reason() {
    let surface: Vec<(DVec3, DVec3)> = (0..500)
        .map(|i| (DVec3::new(0.0002 * f64::from(i) - 0.05, 0.0, 0.01), if i % 2 == 0 { DVec3::Y } else { -DVec3::Y }))
        .collect();
    let refused = |pieces: &[Piece]| {
        let target = GraspTarget {
            surface: &surface,
            pieces,
            center_of_mass: DVec3::Z * 0.01,
            world_from_object: Pose::from_position(DVec3::X * 0.5),
            table_height: 0.0,
        };
        planner().grasps(&target, Seed::new(1)).unwrap_err().to_string()
    };
    for size in [DVec3::new(0.1, 0.0, 0.05), DVec3::ZERO, DVec3::new(f64::NAN, 0.02, 0.05)] {
        let error = refused(&box_of(size));
        assert!(error.starts_with("collision piece 0 of object: sizes must be positive and finite"), "{size}: {error}");
    }
    let sheet = [[-0.05, 0.0], [0.05, 0.0], [0.05, 0.1], [-0.05, 0.1], [0.0, 0.12]].map(|[x, z]| DVec3::new(x, 0.0, z));
    let line = [0.0, 0.02, 0.05, 0.1].map(|x| DVec3::X * x);
    for points in [sheet.to_vec(), line.to_vec(), vec![DVec3::ONE; 6]] {
        let whole = box_of(DVec3::splat(0.04)).remove(0);
        let error = refused(&[whole, Piece::at(DVec3::ZERO, Shape::Hull { points: points.clone() })]);
        assert_eq!(error, "collision piece 1 of object: its corners span no volume", "{points:?}");
    }
}

#[test]
fn grasps_turn_towards_the_tool_where_the_object_is_round() {
    let planner = planner();
    let down = DQuat::from_rotation_x(std::f64::consts::PI);
    let check = |name: &str, pieces: &[Piece], is_round: bool| {
        let surface = surface(pieces, 3000);
        let target = GraspTarget {
            surface: &surface,
            pieces,
            center_of_mass: surface.iter().map(|(point, _)| *point).sum::<DVec3>() / surface.len() as f64,
            world_from_object: Pose::from_position_yaw(DVec3::new(0.5, 0.1, 0.0), 0.7),
            table_height: 0.0,
        };
        let grasps = planner.grasps(&target, Seed::new(1)).unwrap();
        for yaw in [0.0, 1.0, -2.5] {
            let tool = DQuat::from_rotation_z(yaw) * down;
            let turned = planner.grasps_towards(&target, grasps.clone(), tool).unwrap();
            let moved = grasps.iter().zip(&turned).filter(|(before, after)| before != after).count();
            if !is_round {
                assert_eq!(moved, 0, "{name}");
                continue;
            }
            // Of a cup, only grasps still fit that meet a wall piece as they did before.
            assert!(moved > grasps.len() / 4, "{name}: {moved} of {} turned", grasps.len());
            for (before, after) in grasps.iter().zip(&turned).filter(|(before, after)| before != after) {
                // The tilt stays, and no turn about the vertical would bring the tool nearer.
                assert!((before.approach().z - after.approach().z).abs() < 1e-9, "{name}");
                let angle = |turn: f64| {
                    let world_from_tcp = target.world_from_object.rotation * after.pose.rotation;
                    (DQuat::from_rotation_z(turn) * world_from_tcp).angle_between(tool)
                };
                assert!(angle(0.0) <= angle(0.05) + 1e-6 && angle(0.0) <= angle(-0.05) + 1e-6, "{name}");
            }
            let fitting = planner.fitting_grasps(&target, turned.iter()).unwrap();
            assert!(2 * fitting.len() > turned.len(), "{name}: {} of {} fit", fitting.len(), turned.len());
        }
    };
    check("cylinder", &tube(0.03, 0.1), true);
    check("cup", &wall(16, 0.04, 0.004, 0.09), true);
    check("box", &box_of(DVec3::new(0.04, 0.06, 0.05)), false);
}

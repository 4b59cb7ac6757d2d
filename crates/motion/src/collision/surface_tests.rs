use std::sync::Arc;

use genmanip_core::{Piece, Pose, Seed, Shape, glam::DVec3};
use rand::{Rng, RngExt};

use super::field::DistanceField;
use super::lanes::{LANES, Lanes, lanes_of};
use super::placed_obstacle::PlacedObstacle;
use super::tests::one_of_each_shape;
use super::*;
use crate::path::lerp;
use crate::test_robot::test_panda;

const RADIUS_M: f64 = 0.004;

/// The same surface as one obstacle and as one convex piece per facet.
struct Twins {
    surface: CollisionWorld,
    pieces: CollisionWorld,
}

fn within(rng: &mut impl Rng, low: DVec3, high: DVec3) -> DVec3 {
    let mut draw = |axis: usize| rng.random_range(low[axis]..high[axis]);
    DVec3::new(draw(0), draw(1), draw(2))
}

/// Random points around and in front of the robot.
fn place(rng: &mut impl Rng) -> DVec3 {
    within(rng, DVec3::new(0.1, -0.5, 0.0), DVec3::new(0.8, 0.5, 0.8))
}

fn clouds(rng: &mut impl Rng) -> Twins {
    let mut points = Vec::new();
    for _ in 0..5 {
        // Patches of a wall, as seen by a camera.
        let (corner, a, b) = (place(rng), place(rng) * 0.2, place(rng) * 0.2);
        points.extend((0..30).map(|_| corner + a * rng.random_range(0.0..1.0) + b * rng.random_range(0.0..1.0)));
    }
    let pieces: Vec<Piece> = points.iter().map(|point| Piece::at(*point, Shape::Sphere { radius: RADIUS_M })).collect();
    let mut twins = Twins { surface: CollisionWorld::new(), pieces: CollisionWorld::new() };
    twins.surface.add_points("seen", &points, RADIUS_M).unwrap();
    twins.pieces.add("seen", &pieces, &Pose::IDENTITY).unwrap();
    twins
}

fn meshes(rng: &mut impl Rng) -> Twins {
    let (mut corners, mut triangles) = (Vec::new(), Vec::new());
    for index in 0..40_u32 {
        let size = if index % 10 == 0 { 0.4 } else { 0.1 };
        let at = place(rng);
        corners.extend((0..3).map(|_| at + within(rng, DVec3::splat(-size), DVec3::splat(size))));
        triangles.push([3 * index, 3 * index + 1, 3 * index + 2]);
    }
    let pose = Pose::from_position_yaw(DVec3::new(0.02, 0.03, 0.1), 0.3);
    // A hull needs four vertices; here two of them coincide.
    let hull = |c: &[DVec3]| Piece::at(DVec3::ZERO, Shape::Hull { points: vec![c[0], c[1], c[2], c[2]] });
    let pieces: Vec<Piece> = corners.chunks_exact(3).map(hull).collect();
    let mut twins = Twins { surface: CollisionWorld::new(), pieces: CollisionWorld::new() };
    twins.surface.add_mesh("seen", &corners, &triangles, &pose).unwrap();
    twins.pieces.add("seen", &pieces, &pose).unwrap();
    twins
}

/// An attached object with every kind of piece.
fn carried(rng: &mut impl Rng) -> Attached {
    let points = (0..60).map(|_| within(rng, DVec3::splat(-1.0), DVec3::ONE).normalize() * 0.04).collect();
    let shapes = [
        Shape::Hull { points },
        Shape::Ellipsoid { radii: DVec3::new(0.02, 0.03, 0.05) },
        Shape::Cylinder { radius: 0.02, half_height: 0.05 },
    ];
    let piece = |(index, shape)| Piece::at(DVec3::new(0.06 * index as f64 - 0.06, 0.0, 0.08), shape);
    let pieces: Vec<Piece> = shapes.into_iter().enumerate().map(piece).collect();
    Attached::new("tools", &pieces, &Pose::IDENTITY).unwrap()
}

#[test]
fn surfaces_answer_as_their_facets_do() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let limits: Vec<(f64, f64)> = shape.chain().lower().zip(shape.chain().upper()).collect();
    let mut rng = Seed::new(11).rng();
    let (mut free, mut touching, mut free_edges, mut blocked_edges) = (0, 0, 0, 0);
    for case in 0..16 {
        let twins = if case % 2 == 0 { clouds(&mut rng) } else { meshes(&mut rng) };
        let held = carried(&mut rng);
        for padding in [0.0, 0.003, 0.03] {
            let allowed = AllowedCollisions::none().and(MovingBody::Link(5), "seen");
            let checker = |world| Checker::new(&shape, world, Some(&held), &allowed, 0.05, padding);
            let (surface, pieces) = (checker(&twins.surface), checker(&twins.pieces));
            let near_home = |rng: &mut _| -> Vec<f64> {
                let draw = |(low, high): &(f64, f64)| rand::RngExt::random_range(rng, *low..*high);
                let wild: Vec<f64> = limits.iter().map(draw).collect();
                lerp(&robot.home, &wild, 0.4)
            };
            for _ in 0..4 {
                let config = near_home(&mut rng);
                let (found, expected) = (surface.check(&config), pieces.check(&config));
                assert_eq!(surface.is_free(&config), expected.is_none(), "case {case}: {found:?} {expected:?}");
                assert_eq!(found.is_none(), expected.is_none(), "case {case}: {found:?} {expected:?}");
                if let (Some(found), Some(expected)) = (&found, &expected) {
                    assert!((found.distance - expected.distance).abs() < 1e-6, "case {case}: {found} {expected}");
                }
                if expected.is_none() {
                    free += 1
                } else {
                    touching += 1
                }
                let (mut one, mut other) = (surface.clone(), pieces.clone());
                let (found, expected) = (one.relax(&config, 0.001), other.relax(&config, 0.001));
                assert_eq!(found.is_ok(), expected.is_ok(), "case {case}: {found:?} {expected:?}");
                assert!(found.is_err() || one.is_free(&config) && one.check(&config).is_none(), "case {case}");
            }
            let (from, to) = (near_home(&mut rng), near_home(&mut rng));
            let steps = surface.edge_steps(&from, &to, 0.006);
            let mut states = (1..=steps).map(|step| lerp(&from, &to, step as f64 / steps as f64));
            let expected = states.all(|state| pieces.is_free(&state));
            assert_eq!(surface.edge_is_free(&from, &to, 0.006), expected, "case {case}");
            let clear = surface.polyline_is_free(&[from.clone(), to.clone()], 0.006);
            let mut dense = (0..=400).map(|k| lerp(&from, &to, f64::from(k) / 400.0));
            assert!(clear || dense.any(|state| !pieces.is_free(&state)), "case {case}: nothing is too near");
            if clear && padding > 0.002 {
                let exact = Checker::new(&shape, &twins.pieces, Some(&held), &allowed, 0.05, 0.0);
                assert!(dense.all(|state| exact.is_free(&state)), "case {case}");
            }
            if expected { free_edges += 1 } else { blocked_edges += 1 }
        }
    }
    let counts = [free, touching, free_edges, blocked_edges];
    assert!(counts.iter().all(|count| *count >= 10), "the cases are one-sided: {counts:?}");
}

#[test]
fn only_the_points_near_the_start_are_excused() {
    let robot = test_panda();
    let shape = RobotShape::new(&robot).unwrap();
    let tcp = robot.tcp_pose(&robot.home);
    // One point beside the palm at home, and a wall of them to the left.
    let beside = tcp.position + DVec3::new(0.0, 0.0, 0.0374 - 0.005);
    let wall = (0..1600).map(|k| DVec3::new(0.2 + 0.015 * f64::from(k % 40), 0.25, 0.02 * f64::from(k / 40)));
    let points: Vec<DVec3> = wall.chain([beside]).collect();
    let mut world = CollisionWorld::new();
    world.add_points("seen", &points, RADIUS_M).unwrap();
    let allowed = AllowedCollisions::none();
    let mut checker = Checker::new(&shape, &world, None, &allowed, 0.08, 0.003);
    assert_eq!(checker.check(&robot.home).unwrap().to_string(), "hand is 1.0 mm from seen");
    checker.relax(&robot.home, 0.001).unwrap();
    assert!(checker.is_free(&robot.home) && checker.check(&robot.home).is_none());
    // Elsewhere the hand keeps its padding: just before the wall it is still too close.
    let turned = |angle: f64| [&[angle][..], &robot.home[1..]].concat();
    let exact = Checker::new(&shape, &world, None, &allowed, 0.08, 0.0);
    let too_near = (0..2000).map(|k| turned(f64::from(k) * 5e-4)).find(|config| !checker.is_free(config)).unwrap();
    let report = checker.check(&too_near).unwrap();
    assert!(exact.is_free(&too_near) && report.distance > 0.001, "{report}");
    assert!(!checker.edge_is_free(&robot.home, &turned(1.0), 0.006));
}

#[test]
fn fields_never_promise_more_room_or_less_than_there_is() {
    let mut rng = Seed::new(12).rng();
    for case in 0..12 {
        let size = [0.02, 0.3, 1.0, 4.0][case % 4];
        let points: Vec<DVec3> = (0..60).map(|_| within(&mut rng, DVec3::splat(-size), DVec3::splat(size))).collect();
        let (low, high) = (points.iter().copied().reduce(DVec3::min), points.iter().copied().reduce(DVec3::max));
        let field = DistanceField::new([low.unwrap(), high.unwrap()], RADIUS_M, 0.0, |_, mark| {
            points.iter().for_each(|point| mark(*point, *point));
        });
        let (mut clear, mut touching) = (0, 0);
        for draw in 0..2000 {
            let anywhere = within(&mut rng, DVec3::splat(-size - 0.2), DVec3::splat(size + 0.2));
            let beside = points[draw % points.len()] + within(&mut rng, DVec3::splat(-0.04), DVec3::splat(0.04));
            let center = if draw % 2 == 0 { anywhere } else { beside };
            let reach: f64 = rng.random_range(0.0..0.2);
            let nearest = points.iter().map(|point| point.distance(center)).fold(f64::MAX, f64::min) - RADIUS_M;
            let in_lanes = center.to_array().map(|x| Lanes::all(x as f32));
            let lanes = field.near(&in_lanes, reach as f32);
            let touch = rng.random_range(0.0..reach);
            let verdict = field.compare(&in_lanes, reach as f32, touch as f32);
            assert_eq!(verdict.undecided, lanes);
            assert!(
                verdict.touching == 0 || nearest < touch,
                "case {case}: {center} is {nearest} m away, not {touch} m"
            );
            touching += usize::from(verdict.touching != 0);
            assert!(lanes == 0 || lanes_of(lanes).count() == LANES);
            assert!(lanes != 0 || nearest > reach, "case {case}: {center} has {nearest} m, not {reach} m");
            clear += usize::from(lanes == 0);
            // The bounds are tight to two cells of 12.5 mm.
            let is_inside = size < 0.5 && center.abs().max_element() < 0.9 * size;
            assert!(lanes == 0 || !is_inside || nearest < reach + 0.045, "case {case}: {nearest} {reach}");
        }
        assert!(clear > 100, "case {case}: {clear} of 2000");
        assert!(touching > 50 || size > 1.0, "case {case}: {touching} of 2000");
    }
}

#[test]
fn only_points_prove_contact() {
    let touching = |from: DVec3, to: DVec3| {
        let field = DistanceField::new([from, DVec3::splat(0.1)], RADIUS_M, 0.0, |_, mark| mark(from, to));
        field.compare(&[Lanes::all(0.0); 3], 0.1, 0.05).touching
    };
    assert_eq!(touching(DVec3::ZERO, DVec3::ZERO), u8::MAX);
    assert_eq!(touching(DVec3::ZERO, DVec3::splat(0.01)), 0, "a box may hold a triangle that misses its corners");
}

#[test]
fn clones_of_a_world_share_its_surfaces() {
    let mut world = clouds(&mut Seed::new(13).rng()).surface;
    let copy = world.clone();
    let surface = |world: &CollisionWorld| world.obstacles[0].surface.clone().unwrap();
    assert!(Arc::ptr_eq(&surface(&world), &surface(&copy)));
    assert!(PlacedObstacle::new(&world.obstacles[0]).pieces.is_empty());
    world.add("seen", &[Piece::at(DVec3::ZERO, Shape::Sphere { radius: 0.1 })], &Pose::IDENTITY).unwrap();
    assert_eq!((world.names().count(), world.obstacles[0].surface.is_none()), (1, true));
    assert!(world.remove("seen") && !world.remove("seen"));
}

#[test]
fn surfaces_that_make_no_sense_are_refused() {
    let [a, b, c] = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let far = DVec3::X * 1e7;
    type Cloud<'a> = (&'a [DVec3], f64, &'a str);
    let clouds: [Cloud; 6] = [
        (&[], 0.01, "seen has no points; omit it"),
        (&[a, DVec3::NAN], 0.01, "point 1 of seen is not finite, or more than 100 m away"),
        (&[a, b, far], 0.01, "point 2 of seen is not finite, or more than 100 m away"),
        (&[a], 0.0, "the points of seen should have a radius above 0 and up to 1 m, got 0 m"),
        (&[a], f64::NAN, "the points of seen should have a radius above 0 and up to 1 m, got NaN m"),
        (&vec![a; (1 << 20) + 1], 0.01, "seen has 1048577 points, at most 1048576 are allowed; downsample it"),
    ];
    let mut world = CollisionWorld::new();
    for (points, radius, message) in clouds {
        assert_eq!(world.add_points("seen", points, radius).unwrap_err().to_string(), message);
    }
    type Mesh<'a> = (&'a [DVec3], &'a [[u32; 3]], &'a str);
    let meshes: [Mesh; 6] = [
        (&[a, b, c], &[], "seen has no triangles; omit it"),
        (&[a, DVec3::INFINITY, c], &[[0, 1, 2]], "point 1 of seen is not finite, or more than 100 m away"),
        (&[a, b, c], &[[0, 1, 2], [0, 1, 3]], "triangle 1 of seen refers to vertex 3, but there are only 3"),
        (&[a, b, c], &[[0, 1, 1]], "triangle 0 of seen is degenerate: its vertices are collinear; remove it"),
        (&[a, b, -b], &[[0, 1, 2]], "triangle 0 of seen is degenerate: its vertices are collinear; remove it"),
        (
            &[a, b, c],
            &vec![[0, 1, 2]; (1 << 20) + 1],
            "seen has 1048577 triangles, at most 1048576 are allowed; downsample it",
        ),
    ];
    for (corners, triangles, message) in meshes {
        let error = world.add_mesh("seen", corners, triangles, &Pose::IDENTITY).unwrap_err();
        assert_eq!(error.to_string(), message);
    }
    let nowhere = Pose::from_position(DVec3::NAN);
    assert!(world.add_mesh("seen", &[a, b, c], &[[0, 1, 2]], &nowhere).is_err());
    assert_eq!(world.names().count(), 0, "what was refused left nothing behind");
}

#[test]
fn triangulated_pieces_have_the_surface_of_the_piece() {
    let mut rng = Seed::new(14).rng();
    for shape in one_of_each_shape() {
        let piece = Piece::at(DVec3::new(0.1, 0.2, 0.3), shape.clone());
        let (corners, triangles) = triangulate(&piece).unwrap();
        // Same extent as the piece in every direction, except for the chords of 48 sides.
        for _ in 0..300 {
            let outward = within(&mut rng, DVec3::splat(-1.0), DVec3::ONE).normalize();
            let farthest = corners.iter().map(|corner| corner.dot(outward)).fold(f64::MIN, f64::max);
            let lost = piece.support(outward).dot(outward) - farthest;
            assert!((-1e-9..1e-3).contains(&lost), "{shape:?}: {lost} m");
        }
        // Closed and oriented outwards: positive volume, and every edge is used once in either direction.
        let corner = |index: u32| corners[index as usize] - corners[0];
        let volume: f64 = triangles.iter().map(|[a, b, c]| corner(*a).cross(corner(*b)).dot(corner(*c))).sum();
        let mut edges: Vec<(u32, u32)> =
            triangles.iter().flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)]).collect();
        edges.sort_unstable();
        assert!(volume > 0.0 && edges.iter().all(|(a, b)| edges.binary_search(&(*b, *a)).is_ok()), "{shape:?}");
        edges.dedup();
        assert_eq!(edges.len(), 3 * triangles.len());
    }
    let flat = Piece::at(DVec3::ZERO, Shape::Box { half_extents: DVec3::new(0.1, 0.0, 0.1) });
    assert!(triangulate(&flat).is_err());
}

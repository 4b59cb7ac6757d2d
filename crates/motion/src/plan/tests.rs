use genmanip_core::{Piece, Pose, Seed, Shape, glam::DVec3};

use crate::test_robot::test_panda;
use crate::{AllowedCollisions, CollisionWorld, PlanError, Planner, PlannerSettings, PlanningScene};

fn planner() -> Planner {
    Planner::new(test_panda(), PlannerSettings::default()).unwrap()
}

fn cuboid(center: DVec3, size: DVec3) -> Piece {
    Piece::at(center, Shape::Box { half_extents: size / 2.0 })
}

/// A table and a wall across the straight path between two sides.
fn walled() -> CollisionWorld {
    let mut world = CollisionWorld::new();
    world.add("table", &[cuboid(DVec3::new(0.55, 0.0, -0.02), DVec3::new(0.7, 1.0, 0.04))], &Pose::IDENTITY).unwrap();
    world.add("wall", &[cuboid(DVec3::new(0.55, 0.0, 0.2), DVec3::new(0.3, 0.03, 0.4))], &Pose::IDENTITY).unwrap();
    world
}

fn down(position: DVec3) -> Pose {
    Pose::new(position, genmanip_core::glam::DQuat::from_rotation_x(std::f64::consts::PI))
}

fn around<'a>(world: &'a CollisionWorld, allowed: &'a AllowedCollisions) -> PlanningScene<'a> {
    PlanningScene { world, attached: None, allowed, gripper_width: 0.08 }
}

#[test]
fn paths_go_around_a_wall_and_touch_nothing() {
    let (planner, world, allowed) = (planner(), walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = planner.robot().home.clone();
    let start = planner.ik(&down(DVec3::new(0.55, -0.25, 0.1)), &home).remove(0);
    let goals = planner.ik(&down(DVec3::new(0.55, 0.25, 0.1)), &home);
    let exact = planner.checker(&around, 0.0);
    for seed in 0..5 {
        let path = planner.plan_joint(&around, &start, &goals, Seed::new(seed)).unwrap();
        assert_eq!(path.start(), start);
        assert!(goals.iter().any(|goal| goal == path.goal()));
        for state in path.states(0.005) {
            assert!(exact.is_free(&state), "seed {seed}: {:?}", exact.check(&state));
        }
        let again = planner.plan_joint(&around, &start, &goals, Seed::new(seed)).unwrap();
        assert_eq!(path, again);
    }
}

#[test]
fn failures_say_what_is_wrong() {
    let (planner, world, allowed) = (planner(), walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = planner.robot().home.clone();
    let inside_wall = planner.ik(&down(DVec3::new(0.55, 0.0, 0.2)), &home).remove(0);
    type Case<'a> = (&'a [f64], Vec<Vec<f64>>, &'a str);
    let cases: [Case; 6] = [
        (&inside_wall, vec![home.clone()], "the start is in collision: hand is 117.0 mm inside wall"),
        (&home, vec![inside_wall.clone()], "every goal is in collision; at the first, hand is 117.0 mm inside wall"),
        (&home, vec![], "out of reach: no goal configuration was given"),
        (&home[..5], vec![home.clone()], "start configuration: expected 7 finite joint positions"),
        (&home, vec![vec![f64::NAN; 7]], "goal configuration: expected 7 finite joint positions"),
        (&home, vec![vec![0.0; 7]], "goal configuration is 0.0698 rad outside the joint limits"),
    ];
    for (start, goals, message) in cases {
        let error = planner.plan_joint(&around, start, &goals, Seed::new(1)).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
}

#[test]
fn a_way_too_narrow_for_the_arm_exhausts_the_search() {
    let settings = PlannerSettings {
        plan: crate::PlanSettings { max_iterations: 300, ..Default::default() },
        ..Default::default()
    };
    let planner = Planner::new(test_panda(), settings).unwrap();
    let turned = |angle: f64| vec![angle, 0.6, 0.0, -2.0, 0.0, 0.8, 0.8];
    let (start, goal) = (turned(1.6), turned(-1.6));
    let mut world = CollisionWorld::new();
    // A wall through the base with a slot 0.2 m wide and 0.7 m high for the shoulder.
    let plates = [
        ("ahead", DVec3::new(0.85, 0.0, 0.5), DVec3::new(1.5, 0.02, 3.0)),
        ("behind", DVec3::new(-0.85, 0.0, 0.5), DVec3::new(1.5, 0.02, 3.0)),
        ("above", DVec3::new(0.0, 0.0, 1.35), DVec3::new(0.2, 0.02, 1.3)),
    ];
    for (name, center, size) in plates {
        world.add(name, &[cuboid(center, size)], &Pose::IDENTITY).unwrap();
    }
    let error =
        planner.plan_joint(&around(&world, &AllowedCollisions::none()), &start, &[goal], Seed::new(1)).unwrap_err();
    let PlanError::Exhausted { iterations: 300, straight_collision: Some(report) } = &error else { panic!("{error}") };
    assert_eq!(report.other, "ahead", "the wall that the straight way runs into: {error}");
}

/// A cam on the first link passes a post on the base at 2 mm, wherever the other joints are.
#[test]
fn a_gap_between_links_narrower_than_the_padding_is_passed() {
    let mut robot = test_panda().as_ref().clone();
    let links = robot.links.len();
    for (name, parent, center) in [("post", 0, DVec3::new(0.242, 0.0, 0.333)), ("cam", 1, DVec3::new(0.2, 0.0, 0.0))] {
        let mut link = robot.links[0].clone();
        link.name = name.into();
        link.parent = Some(parent);
        link.pieces = vec![Piece::at(center, Shape::Sphere { radius: 0.02 })];
        robot.links.push(link);
    }
    robot.never_colliding.extend((0..links).flat_map(|link| [(link, links), (link, links + 1)]));
    let (world, allowed) = (CollisionWorld::new(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let turned = |angle: f64| vec![angle, 0.6, 0.0, -2.0, 0.0, 0.8, 0.8];
    for (link_padding, is_passed) in [(0.0005, true), (0.0025, false)] {
        let plan =
            crate::PlanSettings { link_padding, link_padding_after: 50, max_iterations: 1_000, ..Default::default() };
        let settings = PlannerSettings { plan, ..Default::default() };
        let planner = Planner::new(std::sync::Arc::new(robot.clone()), settings).unwrap();
        let found = planner.plan_joint(&around, &turned(0.5), &[turned(-0.5)], Seed::new(1));
        assert_eq!(found.is_ok(), is_passed, "{link_padding} m: {:?}", found.err());
        let exact = planner.checker(&around, 0.0);
        assert!(found.iter().flat_map(|path| path.states(0.002)).all(|state| exact.is_free(&state)));
    }
}

/// The paper's planner took steps of 0.001 rad: thousands of nodes, but a bounded search like any other.
#[test]
fn tiny_steps_find_the_same_way_around() {
    let (world, allowed) = (walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = test_panda().home.clone();
    let (left, right) = (down(DVec3::new(0.55, -0.25, 0.1)), down(DVec3::new(0.55, 0.25, 0.1)));
    for (rrt_range, max_iterations, found) in [(0.7, 2_000, true), (0.01, 20_000, true), (0.001, 100, false)] {
        let plan = crate::PlanSettings { rrt_range, max_iterations, ..Default::default() };
        let planner = Planner::new(test_panda(), PlannerSettings { plan, ..Default::default() }).unwrap();
        let (start, goal) = (planner.ik(&left, &home).remove(0), planner.ik(&right, &home).remove(0));
        match planner.plan_joint(&around, &start, &[goal], Seed::new(1)) {
            Ok(path) => assert!(found && path.length() < 6.0, "{rrt_range}: {} rad", path.length()),
            Err(error) => {
                assert!(
                    !found && matches!(error, PlanError::Exhausted { iterations: 100, .. }),
                    "{rrt_range}: {error}"
                );
            }
        }
    }
}

/// Fingertips 0.02 mm above the table at both ends: the timed motion, which cuts corners slightly, touches nothing.
#[test]
fn timed_motions_from_and_to_near_contact_touch_nothing() {
    let (planner, world, allowed) = (planner(), walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = planner.robot().home.clone();
    let above_table = |y: f64| down(DVec3::new(0.55, y, 0.00852));
    let start = planner.ik(&above_table(-0.25), &home).remove(0);
    let goals = planner.ik(&above_table(0.25), &home);
    let exact = planner.checker(&around, 0.0);
    assert!(!planner.checker(&around, 0.0001).is_free(&start), "the start is not near contact");
    for seed in 0..20 {
        let path = planner.plan_joint(&around, &start, &goals, Seed::new(seed)).unwrap();
        for state in path.states(0.005).iter().chain(&planner.time(&path, 1.0).configs) {
            assert!(exact.is_free(state), "seed {seed}: {:?}", exact.check(state));
        }
    }
}

#[test]
fn straight_lines_are_straight_or_say_where_they_end() {
    let (planner, world, allowed) = (planner(), walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = planner.robot().home.clone();
    let (high, low) = (down(DVec3::new(0.55, 0.25, 0.2)), down(DVec3::new(0.55, 0.25, 0.05)));
    let start = planner.ik(&high, &home).remove(0);
    let path = planner.straight(&around, &start, &low).unwrap();
    for state in path.states(0.005) {
        let tcp = planner.tcp_pose(&state);
        let off = (tcp.position - high.position) * DVec3::new(1.0, 1.0, 0.0);
        assert!(off.length() < 5e-4 && tcp.angle_to(&high) < 5e-3, "{off} {}", tcp.angle_to(&high));
    }
    assert!(planner.tcp_pose(path.goal()).position.distance(low.position) < 1e-9);

    let blocked = planner.straight(&around, &start, &down(DVec3::new(0.55, -0.25, 0.2))).unwrap_err();
    assert!(
        matches!(&blocked, PlanError::Blocked { fraction, report }
        if (0.2..0.6).contains(fraction) && report.other == "wall"),
        "{blocked}"
    );
    let far = planner.straight(&around, &start, &down(DVec3::new(1.2, 0.25, 0.2))).unwrap_err();
    assert!(matches!(far, PlanError::Unreachable { .. }), "{far}");
}

#[test]
fn straight_lines_may_begin_near_contact_but_not_end_there() {
    let (planner, world, allowed) = (planner(), walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = planner.robot().home.clone();
    let above_table = |gap: f64| down(DVec3::new(0.55, 0.25, 0.0085 + gap));
    let config = |gap: f64| planner.ik(&above_table(gap), &home).remove(0);
    for gap in [0.0005, 0.002] {
        let away = planner.straight(&around, &config(gap), &above_table(0.09)).unwrap();
        assert!(planner.checker(&around, planner.settings().plan.padding).is_free(away.goal()));
        let toward = planner.straight(&around, &config(0.09), &above_table(gap)).unwrap_err();
        assert!(
            matches!(&toward, PlanError::Blocked { fraction, report } if *fraction > 0.9 && report.other == "table"),
            "{toward}"
        );
    }
}

#[test]
fn trajectories_obey_the_limits_and_rest_at_both_ends() {
    let (planner, world, allowed) = (planner(), walled(), AllowedCollisions::none());
    let around = around(&world, &allowed);
    let home = planner.robot().home.clone();
    let start = planner.ik(&down(DVec3::new(0.55, -0.25, 0.1)), &home).remove(0);
    let goals = planner.ik(&down(DVec3::new(0.55, 0.25, 0.1)), &home);
    let path = planner.plan_joint(&around, &start, &goals, Seed::new(1)).unwrap();
    let exact = planner.checker(&around, 0.0);
    let mut durations = Vec::new();
    for speed in [1.0, 0.5, 0.2] {
        let trajectory = planner.time(&path, speed);
        let (q, dt) = (&trajectory.configs, trajectory.dt);
        assert_eq!((q.first().unwrap().as_slice(), q.last().unwrap().as_slice()), (path.start(), path.goal()));
        for (joint, limit) in planner.robot().arm_joints().enumerate() {
            let at = |k: isize| q[k.clamp(0, q.len() as isize - 1) as usize][joint];
            for k in -1..=q.len() as isize {
                let velocity = (at(k + 1) - at(k)) / dt;
                let acceleration = (at(k + 1) - 2.0 * at(k) + at(k - 1)) / (dt * dt);
                assert!(velocity.abs() <= limit.max_velocity * speed, "joint {joint} at {k}: {velocity}");
                assert!(acceleration.abs() <= limit.max_acceleration, "joint {joint} at {k}: {acceleration}");
            }
        }
        assert!(q.iter().all(|state| exact.is_free(state)));
        durations.push(trajectory.duration());
    }
    assert!(durations[0] < durations[1] && durations[1] < durations[2], "{durations:?}");
    assert!(durations[0] > 0.5 && durations[0] < 4.0, "{durations:?}");
}

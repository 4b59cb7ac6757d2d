use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, Seed};
use rand::{Rng, RngExt};

use super::*;
use crate::test_robot::test_panda;

fn solver() -> (Chain, InverseKinematics) {
    let chain = Chain::new(&test_panda()).unwrap();
    (chain.clone(), InverseKinematics::new(chain, IkSettings::default()))
}

fn random_config(chain: &Chain, margin: f64, rng: &mut impl Rng) -> Vec<f64> {
    let limits: Vec<_> = chain.lower().zip(chain.upper()).collect();
    limits.into_iter().map(|(lower, upper)| rng.random_range(lower + margin..upper - margin)).collect()
}

fn error(chain: &Chain, config: &[f64], wanted: &Pose) -> (f64, f64) {
    let reached = chain.tcp_pose(config);
    (reached.position.distance(wanted.position), reached.angle_to(wanted))
}

#[test]
fn every_reachable_pose_is_solved_exactly() {
    let (chain, ik) = solver();
    assert!(ik.is_analytic());
    let home = test_panda().home.clone();
    let mut rng = Seed::new(1).rng();
    // 10 000 poses take a few seconds; a tenth of them per run, the rest with `--ignored`.
    check_poses(&chain, &ik, &home, 1000, &mut rng);
}

#[test]
#[ignore = "the full figure of 10 000 poses; takes seconds"]
fn ten_thousand_reachable_poses_are_solved_exactly() {
    let (chain, ik) = solver();
    let home = test_panda().home.clone();
    let mut rng = Seed::new(2).rng();
    check_poses(&chain, &ik, &home, 10_000, &mut rng);
}

fn check_poses(chain: &Chain, ik: &InverseKinematics, home: &[f64], count: usize, rng: &mut impl Rng) {
    for index in 0..count {
        let config = random_config(chain, 0.02, rng);
        let wanted = chain.tcp_pose(&config);
        let solutions = ik.solve(&wanted, home);
        assert!(!solutions.is_empty(), "pose {index} of {config:?} has no solution");
        for solution in &solutions {
            let (position, _) = error(chain, solution, &wanted);
            assert!(position < 1e-9, "pose {index}: error {position} m at {solution:?}");
            assert!(chain.limit_margin(solution) >= 0.02 - 1e-9);
        }
    }
}

#[test]
fn the_branches_hold_the_configuration_they_came_from() {
    let (chain, ik) = solver();
    let mut rng = Seed::new(3).rng();
    for _ in 0..2000 {
        let config = random_config(&chain, 0.02, &mut rng);
        let branches = ik.branches(&chain.tcp_pose(&config), config[6], &config);
        let nearest = branches.iter().map(|branch| largest_difference(branch, &config)).fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-5, "{config:?} is {nearest} from the nearest of {} branches", branches.len());
    }
}

/// An arm with a joint at its limit still follows its tool with the other joints.
#[test]
fn a_tool_is_followed_along_limits() {
    let (chain, ik) = solver();
    let mut rng = Seed::new(6).rng();
    let (mut followed, mut clamped) = (0, 0);
    for index in 0..400 {
        let mut start = random_config(&chain, 0.2, &mut rng);
        let joint = index % chain.dof();
        start[joint] = chain.joints()[joint].upper - 0.005;
        let mut goal: Vec<f64> = start.iter().map(|q| q + rng.random_range(-0.05..0.05)).collect();
        goal[joint] = start[joint] - rng.random_range(0.0..0.05);
        let wanted = chain.tcp_pose(&goal);
        clamped += usize::from(ik.continue_from(&wanted, &start, f64::INFINITY).is_some());
        if let Some(solution) = ik.follow(&wanted, &start, &[f64::INFINITY; 7]) {
            followed += 1;
            assert!(error(&chain, &solution, &wanted).0 < 1e-9);
            assert!(chain.limit_margin(&solution) >= 0.005 - 1e-9);
        }
    }
    assert!(followed >= 396 && clamped < followed, "{followed} followed, {clamped} with clamped joints");
}

/// If one joint is limited, the others still reach the tool pose.
#[test]
fn a_tool_is_followed_within_reach() {
    let (chain, ik) = solver();
    let mut rng = Seed::new(7).rng();
    let (mut asked, mut followed) = (0, 0);
    for _ in 0..400 {
        let start = random_config(&chain, 0.3, &mut rng);
        let goal: Vec<f64> = start.iter().map(|q| q + rng.random_range(-0.1..0.1)).collect();
        let wanted = chain.tcp_pose(&goal);
        let Some(free) = ik.follow(&wanted, &start, &[f64::INFINITY; 7]) else { continue };
        let (fastest, far) = free
            .iter()
            .zip(&start)
            .map(|(a, b)| (a - b).abs())
            .enumerate()
            .fold((0, 0.0), |most, (joint, step)| if step > most.1 { (joint, step) } else { most });
        let mut reach = [f64::INFINITY; 7];
        reach[fastest] = 0.8 * far;
        asked += 1;
        if let Some(solution) = ik.follow(&wanted, &start, &reach) {
            followed += 1;
            assert!((solution[fastest] - start[fastest]).abs() <= reach[fastest] + 1e-12);
            assert!(error(&chain, &solution, &wanted).0 < 1e-9);
        }
    }
    assert!(followed * 10 >= asked * 8 && asked > 300, "{followed} of {asked} followed");
}

#[test]
fn the_first_solution_stays_near_the_reference() {
    let (chain, ik) = solver();
    let home = test_panda().home.clone();
    let mut near_home = home.clone();
    near_home[3] += 0.05;
    let best = ik.solve(&chain.tcp_pose(&near_home), &home).remove(0);
    assert!(largest_difference(&best, &home) < 0.3, "{best:?}");
}

#[test]
fn poses_out_of_reach_have_no_solution() {
    let (_, ik) = solver();
    let home = test_panda().home.clone();
    for position in [DVec3::new(2.0, 0.0, 0.5), DVec3::new(0.5, 0.0, 1.2), DVec3::splat(f64::NAN)] {
        let pose = Pose { position, rotation: DQuat::IDENTITY };
        assert_eq!(ik.solve(&pose, &home), Vec::<Vec<f64>>::new());
    }
}

/// The bound holds for every configuration, and is tight enough to reject what lies just beyond the reach from above.
#[test]
fn the_reach_is_bounded() {
    let (chain, ik) = solver();
    let mut rng = Seed::new(3).rng();
    for _ in 0..1000 {
        let pose = chain.tcp_pose(&random_config(&chain, 0.0, &mut rng));
        assert!(ik.reach.may_contain(&Rigid::from(&pose)), "{pose:?}");
    }
    let down = DQuat::from_rotation_x(std::f64::consts::PI);
    let above = |x_m: f64| Pose::new(DVec3::new(x_m, 0.0, 0.12), down);
    let home = test_panda().home.clone();
    let places = (60..90).map(|x_cm| f64::from(x_cm) / 100.0);
    let farthest_m = places.filter(|&x_m| !ik.solve(&above(x_m), &home).is_empty()).fold(0.0, f64::max);
    assert!((0.6..0.89).contains(&farthest_m), "{farthest_m}");
    assert!(!ik.reach.may_contain(&Rigid::from(&above(farthest_m + 0.05))), "{farthest_m}");
}

#[test]
fn another_arm_is_solved_numerically() {
    let mut robot = (*test_panda()).clone();
    robot.links[5].parent_from_link.position.x += 0.02;
    robot.links[5].parent_from_link.position.z += 0.02;
    let chain = Chain::new(&robot).unwrap();
    let ik = InverseKinematics::new(chain.clone(), IkSettings::default());
    assert!(!ik.is_analytic());
    let mut rng = Seed::new(4).rng();
    for _ in 0..20 {
        let wanted = chain.tcp_pose(&random_config(&chain, 0.2, &mut rng));
        let solutions = ik.solve(&wanted, &robot.home);
        assert!(!solutions.is_empty());
        for solution in solutions {
            assert!(error(&chain, &solution, &wanted).0 < 1e-9);
        }
    }
}

/// An arm with five joints keeps the orientation along a line as far as its wrist allows, then turns; one with seven
/// never turns.
#[test]
fn an_arm_with_five_joints_turns_where_its_limits_require_it() {
    let panda = test_panda();
    let mut robot = (*panda).clone();
    let wrist = robot.home[5];
    for fixed in [5, 3] {
        let link = robot.arm_links().nth(fixed - 1).unwrap();
        robot.links[link].joint = None;
        robot.home.remove(fixed - 1);
    }
    let joint = robot.arm_links().nth(3).unwrap();
    let limits = robot.links[joint].joint.as_mut().unwrap();
    (limits.lower, limits.upper) = (wrist - 0.1, wrist + 0.1);
    let chain = Chain::new(&robot).unwrap();
    assert_eq!(chain.tool_dof(), 5);
    let ik = InverseKinematics::new(chain.clone(), IkSettings::default());
    let start = chain.tcp_pose(&robot.home);
    let (mut config, mut worst) = (robot.home.clone(), 0.0_f64);
    for step in 1..=15 {
        let wanted = Pose { position: start.position + DVec3::Z * 0.01 * f64::from(step), ..start };
        config = ik.continue_line(&wanted, &config, 0.15, 0.8).unwrap();
        let (position, orientation) = error(&chain, &config, &wanted);
        assert!(position < 2e-4 && orientation < 0.8, "step {step}: {position} m, {orientation} rad");
        worst = worst.max(orientation);
        let keeps_orientation = ik.continue_from(&wanted, &config, 0.15).is_some();
        assert!(if keeps_orientation { orientation < 0.06 } else { step > 1 }, "step {step}: {orientation} rad");
    }
    assert!(worst > 0.1, "{worst} rad");
    let (chain, ik) = solver();
    let wanted = Pose { position: DVec3::Z * 3.0, ..chain.tcp_pose(&panda.home) };
    assert!(ik.continue_line(&wanted, &panda.home, 10.0, 0.8).is_none());
}

/// Joints that turn by more than a circle have several positions for one posture: the one next to the reference is
/// returned.
#[test]
fn wide_joints_are_unwound_towards_the_reference() {
    use std::f64::consts::{PI, TAU};
    let mut robot = (*test_panda()).clone();
    robot.links[5].parent_from_link.position.x += 0.02;
    robot.links[5].parent_from_link.position.z += 0.02;
    for joint in robot.links.iter_mut().filter_map(|link| link.joint.as_mut()).take(7) {
        (joint.lower, joint.upper) = (-TAU, TAU);
    }
    let chain = Chain::new(&robot).unwrap();
    let ik = InverseKinematics::new(chain.clone(), IkSettings::default());
    assert!(!ik.is_analytic());
    let mut rng = Seed::new(10).rng();
    for _ in 0..20 {
        let wanted = chain.tcp_pose(&random_config(&chain, 0.2, &mut rng));
        let reference: Vec<f64> = (0..7).map(|_| rng.random_range(-3.0..3.0)).collect();
        let solutions = ik.solve(&wanted, &reference);
        assert!(!solutions.is_empty());
        for solution in solutions {
            assert!(error(&chain, &solution, &wanted).0 < 1e-9);
            assert!(largest_difference(&solution, &reference) <= PI + 0.05, "{solution:?} from {reference:?}");
        }
    }
}

#[test]
fn jacobian_is_the_derivative_of_the_tcp() {
    let (chain, _) = solver();
    let config = random_config(&chain, 0.1, &mut Seed::new(5).rng());
    let jacobian = chain.jacobian(&config);
    for (joint, column) in jacobian.iter().enumerate() {
        let step = 1e-6;
        let (mut high, mut low) = (config.clone(), config.clone());
        high[joint] += step;
        low[joint] -= step;
        let slope = (chain.tcp_pose(&high).position - chain.tcp_pose(&low).position) / (2.0 * step);
        assert!((slope - DVec3::new(column[0], column[1], column[2])).length() < 1e-8);
    }
}

#[test]
fn a_broken_robot_is_refused() {
    let mut robot = (*test_panda()).clone();
    robot.home.pop();
    assert_eq!(
        Chain::new(&robot).unwrap_err().to_string(),
        "robot test panda: home holds 6 positions, expected one for each of its 7 arm joints"
    );
    let mut robot = (*test_panda()).clone();
    robot.links[3].parent = Some(7);
    assert!(matches!(Chain::new(&robot), Err(crate::ModelError::ParentOrder { index: 3, got: 7, .. })));
}

/// Null-space drift keeps the tool pose, respects the reach, and moves the joints towards their targets.
#[test]
fn a_motion_drifts_where_the_tool_leaves_it_free() {
    let (chain, ik) = solver();
    let home = &test_panda().home;
    let mut rng = Seed::new(9).rng();
    let (mut asked, mut drifted) = (0, 0);
    let far = |q: &[f64]| q.iter().zip(home).map(|(q, home)| (q - home).powi(2)).sum::<f64>();
    for _ in 0..200 {
        let start = random_config(&chain, 0.3, &mut rng);
        let mut wanted = chain.tcp_pose(&start);
        wanted.position.z += 0.01;
        let drift = start.iter().zip(home).map(|(q, home)| 0.1 * (home - q)).collect();
        let reach = [0.3; 7];
        let Some(free) = ik.follow(&wanted, &start, &reach) else { continue };
        asked += 1;
        let Some(solution) = ik.follow_drifting(&wanted, &start, &reach, drift) else { continue };
        assert!(error(&chain, &solution, &wanted).0 < 1e-9);
        assert!(largest_difference(&solution, &start) <= 0.3 + 1e-12);
        drifted += usize::from(far(&solution) < far(&free));
    }
    assert!(asked > 100 && drifted * 100 >= asked * 95, "{drifted} of {asked} drifted");
}

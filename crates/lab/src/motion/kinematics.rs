//! Inverse kinematics at the tool poses of random configurations: success, cost and accuracy.

use genmanip_core::Seed;
use genmanip_motion::{Chain, IkSettings, InverseKinematics, Planner};
use rand::RngExt;
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;

/// Divisor of the number of poses for arms with numeric inverse kinematics, which is slower.
const PER_NUMERIC_POSE: usize = 200;

/// Success, cost and accuracy of inverse kinematics.
#[derive(Serialize)]
pub struct Kinematics {
    /// True if the arm has closed-form inverse kinematics.
    pub analytic: bool,
    /// Number of poses tried.
    pub poses: usize,
    /// Number of poses with at least one solution.
    pub solved: usize,
    /// Mean CPU time of all solution branches at one value of the redundant joint; for a numeric arm, of one search,
    /// µs.
    pub branches_us: f64,
    /// Mean CPU time of all solutions of a pose (sweep of the redundant joint, ranking, refinement), µs.
    pub sweep_us: f64,
    /// Largest position error of the tcp over all solutions, m.
    pub worst_error_m: f64,
}

/// Measures at `poses` reachable poses; at fewer for a numeric arm.
pub fn measure(planner: &Planner, poses: usize, seed: Seed) -> Result<Kinematics, LabError> {
    let robot = planner.robot();
    let chain = Chain::new(robot).map_err(|error| LabError::broken("the robot has no arm", error))?;
    let settings = IkSettings::default();
    let ik = InverseKinematics::new(chain.clone(), settings);
    let poses = if ik.is_analytic() { poses } else { poses.div_ceil(PER_NUMERIC_POSE) };
    let mut rng = seed.fork("poses").rng();
    let ranges = ik.solved_ranges();
    let mut draw = || -> Vec<f64> { ranges.iter().map(|range| rng.random_range(range.clone())).collect() };
    let targets: Vec<_> = (0..poses).map(|_| draw()).map(|config| (chain.tcp_pose(&config), config)).collect();
    let mut clock = cpu_clock();
    for (pose, config) in &targets {
        if ik.is_analytic() {
            std::hint::black_box(ik.branches(pose, config[config.len() - 1], &robot.home));
        } else {
            std::hint::black_box(ik.continue_from(pose, &robot.home, f64::INFINITY));
        }
    }
    let branches_us = clock() / poses as f64 * 1e6;
    let mut clock = cpu_clock();
    let solutions: Vec<_> = targets.iter().map(|(pose, _)| ik.solve(pose, &robot.home)).collect();
    let sweep_us = clock() / poses as f64 * 1e6;
    let error = |(pose, _): &(genmanip_core::Pose, Vec<f64>), found: &Vec<Vec<f64>>| {
        found.iter().map(|config| chain.tcp_pose(config).position.distance(pose.position)).fold(0.0, f64::max)
    };
    Ok(Kinematics {
        analytic: ik.is_analytic(),
        poses,
        solved: solutions.iter().filter(|found| !found.is_empty()).count(),
        branches_us,
        sweep_us,
        worst_error_m: targets.iter().zip(&solutions).map(|(target, found)| error(target, found)).fold(0.0, f64::max),
    })
}

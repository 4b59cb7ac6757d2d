//! Motion planning: problems from a file or random ones are planned, every path is checked again, and all steps are
//! timed.

mod depth;
mod generate;
mod kinematics;
mod problems;

use genmanip_workspace::documents;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip_core::{RobotModel, Seed};
use genmanip_motion::{AllowedCollisions, Path, Planner, PlannerSettings, PlanningScene, Trajectory};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
pub use depth::Depth;
use depth::DepthTally;
use genmanip_workspace::Progress;
pub use kinematics::Kinematics;
use problems::Problem;

/// Runs per problem; the median CPU time is reported.
const RUNS: usize = 3;
/// Maximum joint step between the states of a path when it is checked again, rad.
const RECHECK: f64 = 0.02;
/// Opening of the gripper, m. A robot from a file keeps the finger positions of that file.
const OPEN: f64 = 0.08;
/// Maximum number of failures and of contacts in the text summary.
const SHOWN: usize = 20;

/// Robot, problems and outputs of the measurement.
#[derive(Clone, Debug)]
pub struct MotionArguments {
    /// The robot to plan for.
    pub robot: Arc<RobotModel>,
    /// Source of the problems.
    pub problems: Source,
    /// Maximum edge length of the search tree, rad; `None` for the planner's default.
    pub rrt_range: Option<f64>,
    /// Number of poses for inverse kinematics; arms with numeric inverse kinematics use one in 200.
    pub ik_poses: usize,
    /// File to write the states of every path to, at most 0.02 rad per joint apart; `None` for no file.
    pub paths: Option<PathBuf>,
}

/// Source of motion problems.
#[derive(Clone, Debug)]
pub enum Source {
    /// Problems from a file.
    File {
        /// Path of the file, JSON with a list of problems.
        path: PathBuf,
        /// Maximum number of problems, from the front of the file.
        count: usize,
    },
    /// Random pick-and-place motions on a table.
    Generated {
        /// True for a shelf and taller objects.
        is_hard: bool,
        /// Number of problems to generate.
        count: usize,
        /// File to write the generated problems to; `None` for no file.
        out: Option<PathBuf>,
    },
}

/// Success, validity and cost of the planner.
#[derive(Serialize)]
pub struct Measured {
    /// Number of problems planned.
    pub problems: usize,
    /// Number of problems with a path.
    pub solved: usize,
    /// Number of paths with a state in collision, checked every 0.02 rad.
    pub invalid_paths: usize,
    /// CPU time of planning and smoothing one path, ms.
    pub cpu_ms: Spread,
    /// Path length: sum of Euclidean distances in joint space, rad.
    pub path_length_rad: Spread,
    /// Median CPU time of time parameterisation, ms.
    pub time_scaling_ms: f64,
    /// Mean CPU time of all inverse kinematics branches at one value of the redundant joint (numeric arms: one search),
    /// µs.
    pub ik_us: f64,
    /// Further results of inverse kinematics.
    pub ik: Kinematics,
    /// 95th percentile of the CPU time of time parameterisation, ms.
    pub time_scaling_p95_ms: f64,
    /// Number of timed paths that exceed a velocity or acceleration limit.
    pub limits_exceeded: usize,
    /// Duration of the timed paths, s.
    pub duration_s: Spread,
    /// CPU time to build the planner for the robot, ms.
    pub setup_ms: f64,
    /// CPU time from a depth image to a path, ms; details are in `depth`.
    pub depth_to_path_ms: Spread,
    /// Results of planning from depth images.
    pub depth: Depth,
    /// Name of the robot.
    pub robot: String,
    /// Seed of the searches, and of random problems.
    pub seed: u64,
    /// Runs per problem; the median time counts.
    pub runs_per_problem: usize,
    /// Reasons of the first unsolved problems.
    pub failures: Vec<String>,
    /// Contacts of the first paths in collision.
    pub contacts: Vec<String>,
}

/// Median, 95th percentile and maximum of measured values.
#[derive(Serialize)]
pub struct Spread {
    /// Median of the values.
    pub median: f64,
    /// 95th percentile of the values.
    pub p95: f64,
    /// Maximum of the values.
    pub max: f64,
}

#[derive(Default)]
struct Tally {
    plan_ms: Vec<f64>,
    time_ms: Vec<f64>,
    lengths: Vec<f64>,
    durations: Vec<f64>,
    limits_exceeded: usize,
    invalid: usize,
    failures: Vec<String>,
    contacts: Vec<String>,
    paths: Vec<Option<Vec<Vec<f64>>>>,
}

/// Plans every problem, checks the paths again, and times planning, time parameterisation and kinematics; one thread.
///
/// # Errors
/// If the problems cannot be read or generated, the robot cannot be loaded, or a file cannot be written.
pub fn measure(arguments: &MotionArguments, seed: Seed, progress: &dyn Progress) -> Result<Measured, LabError> {
    let robot = &arguments.robot;
    let mut settings = PlannerSettings::default();
    settings.plan.rrt_range = arguments.rrt_range.unwrap_or(settings.plan.rrt_range);
    let mut clock = cpu_clock();
    let planner = Planner::new(Arc::clone(robot), settings)
        .map_err(|error| LabError::broken("the robot cannot be planned for", error))?;
    let setup_ms = clock() * 1e3;
    let problems = problems(&arguments.problems, &planner, seed)?;
    let mut tally = Tally::default();
    let mut depth_tally = DepthTally::new(&planner);
    progress.begin("planning", problems.len());
    for (index, problem) in problems.iter().enumerate() {
        tally.solve(&planner, index, problem, seed);
        depth_tally.solve(&planner, index, problem, seed)?;
        progress.advance();
    }
    progress.end();
    depth_tally.finish();
    if let Some(path) = &arguments.paths {
        let text = serde_json::to_string(&tally.paths).unwrap_or_default();
        std::fs::write(path, text).map_err(|error| LabError::file("write", path, error))?;
    }
    let ik = kinematics::measure(&planner, arguments.ik_poses, seed)?;
    let timing = Spread::of(tally.time_ms);
    Ok(Measured {
        problems: problems.len(),
        solved: tally.lengths.len(),
        invalid_paths: tally.invalid,
        cpu_ms: Spread::of(tally.plan_ms),
        path_length_rad: Spread::of(tally.lengths),
        time_scaling_ms: timing.median,
        ik_us: ik.branches_us,
        ik,
        time_scaling_p95_ms: timing.p95,
        limits_exceeded: tally.limits_exceeded,
        duration_s: Spread::of(tally.durations),
        setup_ms,
        depth_to_path_ms: Spread::of(depth_tally.total_ms),
        depth: depth_tally.depth,
        robot: robot.name.clone(),
        seed: seed.value(),
        runs_per_problem: RUNS,
        failures: tally.failures,
        contacts: tally.contacts,
    })
}

/// Problems from a file, or random ones, which are also written to a file if requested.
fn problems(source: &Source, planner: &Planner, seed: Seed) -> Result<Vec<Problem>, LabError> {
    let (is_hard, count, out) = match source {
        Source::File { path, count } => return problems::read(path, planner.robot().arm_dof(), *count),
        Source::Generated { is_hard, count, out } => (*is_hard, *count, out),
    };
    let made = generate::generate(planner, is_hard, count, seed.fork("problems"))?;
    if let Some(path) = out {
        let text =
            serde_json::to_string(&made).map_err(|error| LabError::broken("cannot write the problems", error))?;
        documents::write_file(path, text.as_bytes())?;
    }
    made.compile().map_err(|error| LabError::broken("the problems cannot be built", error))
}

impl Tally {
    fn solve(&mut self, planner: &Planner, index: usize, problem: &Problem, seed: Seed) {
        let allowed = AllowedCollisions::none();
        let around = PlanningScene { world: &problem.world, attached: None, allowed: &allowed, gripper_width: OPEN };
        let goals = std::slice::from_ref(&problem.goal);
        let (planned, seconds) = timed(|| planner.plan_joint(&around, &problem.start, goals, seed));
        self.plan_ms.push(seconds * 1e3);
        let path = match planned {
            Ok(path) => path,
            Err(error) => {
                if self.failures.len() < SHOWN {
                    self.failures.push(format!("problem {index}: {error}"));
                }
                self.paths.push(None);
                return;
            }
        };
        let (trajectory, seconds) = timed(|| planner.time(&path, 1.0));
        self.time_ms.push(seconds * 1e3);
        self.durations.push(trajectory.duration());
        self.limits_exceeded += usize::from(exceeds_limits(planner, &trajectory));
        let states = states(&path);
        self.lengths.push(states.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum());
        let exact = planner.checker(&around, 0.0);
        // Also check the waypoints, which smoothing cuts off, and the trajectory at the control rate.
        let all = states.iter().chain(path.waypoints()).chain(&trajectory.configs);
        if let Some(report) = all.into_iter().find_map(|state| exact.check(state)) {
            self.invalid += 1;
            if self.contacts.len() < SHOWN {
                self.contacts.push(format!("problem {index}: {report}"));
            }
        }
        self.paths.push(Some(states));
    }
}

/// Result of the work, and median CPU time of [`RUNS`] identical runs, s.
fn timed<T>(work: impl Fn() -> T) -> (T, f64) {
    let run = || {
        let mut clock = cpu_clock();
        let answer = work();
        (answer, clock())
    };
    let (answer, first) = run();
    let mut seconds: Vec<f64> = (1..RUNS).map(|_| run().1).chain([first]).collect();
    seconds.sort_by(f64::total_cmp);
    (answer, seconds[RUNS / 2])
}

/// States of a path with joint steps of at most [`RECHECK`].
fn states(path: &Path) -> Vec<Vec<f64>> {
    let coarse = path.states(RECHECK);
    let mut states: Vec<Vec<f64>> = coarse.first().cloned().into_iter().collect();
    for pair in coarse.windows(2) {
        let largest = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let steps = (largest / RECHECK).ceil().max(1.0) as usize;
        let between = |t: f64| pair[0].iter().zip(&pair[1]).map(|(a, b)| a + (b - a) * t).collect();
        states.extend((1..=steps).map(|k| between(k as f64 / steps as f64)));
    }
    states
}

fn exceeds_limits(planner: &Planner, trajectory: &Trajectory) -> bool {
    let (configs, dt) = (&trajectory.configs, trajectory.dt);
    let at = |k: isize, joint: usize| configs[k.clamp(0, configs.len() as isize - 1) as usize][joint];
    planner.robot().arm_joints().enumerate().any(|(joint, limit)| {
        (-1..=configs.len() as isize).any(|k| {
            let (before, here, after) = (at(k - 1, joint), at(k, joint), at(k + 1, joint));
            ((after - here) / dt).abs() > limit.max_velocity * (1.0 + 1e-9)
                || ((after - 2.0 * here + before) / (dt * dt)).abs() > limit.max_acceleration * (1.0 + 1e-9)
        })
    })
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

impl Spread {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let index = (values.len().saturating_sub(1) as f64 * part).round() as usize;
            values.get(index).copied().unwrap_or(f64::NAN)
        };
        Self { median: at(0.5), p95: at(0.95), max: at(1.0) }
    }
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let Measured { cpu_ms, path_length_rad, ik, .. } = measured;
    let mut text = format!(
        "solved        {} of {}\ninvalid       {} paths touch something when tested again every {RECHECK} rad\n\
         planning      {:.3} ms median, {:.3} ms p95\nlength        {:.3} rad median\n\
         time scaling  {:.3} ms median, {} exceed a limit\n\
         kinematics    {:.2} us all branches, {:.0} us all solutions; {} of {} poses, worst error {:.1e} m\n",
        measured.solved,
        measured.problems,
        measured.invalid_paths,
        cpu_ms.median,
        cpu_ms.p95,
        path_length_rad.median,
        measured.time_scaling_ms,
        measured.limits_exceeded,
        ik.branches_us,
        ik.sweep_us,
        ik.solved,
        ik.poses,
        ik.worst_error_m,
    );
    let (depth, depth_ms) = (&measured.depth, &measured.depth_to_path_ms);
    text += &format!(
        "from depth    {:.2} ms median, {:.2} ms p95 from a depth image to a path; {} of {} solved, {} paths touch what was \
         seen, {} what was not\n",
        depth_ms.median,
        depth_ms.p95,
        depth.solved,
        depth.planned,
        depth.touching_seen_surfaces,
        depth.touching_anything - depth.touching_seen_surfaces,
    );
    for line in measured.failures.iter().chain(&measured.contacts) {
        text += &format!("  {line}\n");
    }
    text
}

//! Motion: plan problems, of a file or fresh ones, test the paths again, time everything.

mod depth;
mod generate;
mod kinematics;
mod problems;

use genmanip_workspace::documents;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip_core::{RobotModel, Seed};
use genmanip_motion::{Allowed, Path, Planner, PlannerSettings, PlanningScene, Trajectory};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
pub use depth::Depth;
use depth::DepthTally;
use genmanip_workspace::Progress;
pub use kinematics::Kinematics;
use problems::Problem;

/// A path is planned and timed this often; its time is the middle one.
const RUNS: usize = 3;
/// Largest joint step between the states of a path that are tested again, rad.
const RECHECK: f64 = 0.02;
/// Opening of the gripper, m (a robot from a file keeps its fingers where the file puts them).
const OPEN: f64 = 0.08;
/// Failures and contacts that are named.
const SHOWN: usize = 20;

/// What is measured.
#[derive(Clone, Debug)]
pub struct MotionArguments {
    /// The arm.
    pub robot: Arc<RobotModel>,
    /// Where the problems come from.
    pub problems: Source,
    /// Longest edge of the search tree, rad; without it, the planner's own.
    pub rrt_range: Option<f64>,
    /// Poses at which the inverse kinematics are measured; a numeric arm gets one for 200 of them.
    pub ik_poses: usize,
    /// File for the states of every path, 0.02 rad apart.
    pub paths: Option<PathBuf>,
}

/// Where motion problems come from.
#[derive(Clone, Debug)]
pub enum Source {
    /// A file.
    File {
        /// Which.
        path: PathBuf,
        /// Only the first of its problems; all when it holds fewer.
        count: usize,
    },
    /// They are made: picking and placing on a table.
    Generated {
        /// With a shelf and taller things.
        is_hard: bool,
        /// How many.
        count: usize,
        /// File they are also written to.
        out: Option<PathBuf>,
    },
}

/// What was measured.
#[derive(Serialize)]
pub struct Measured {
    /// Problems.
    pub problems: usize,
    /// Problems with a path.
    pub solved: usize,
    /// Paths with a state, every 0.02 rad, that touches something.
    pub invalid_paths: usize,
    /// Processor time of planning and smoothing one path.
    pub cpu_ms: Spread,
    /// Sum of the Euclidean joint-space steps.
    pub path_length_rad: Spread,
    /// Median processor time of timing one path.
    pub time_scaling_ms: f64,
    /// All branches of the inverse kinematics for one value of the free joint (numeric arms: one solution), median.
    pub ik_us: f64,
    /// More of the inverse kinematics.
    pub ik: Kinematics,
    /// 95 of 100 paths are timed in no more.
    pub time_scaling_p95_ms: f64,
    /// Timed paths that exceed a joint's velocity or acceleration limit.
    pub limits_exceeded: usize,
    /// How long the motions take.
    pub duration_s: Spread,
    /// Compiling the robot, once.
    pub setup_ms: f64,
    /// Processor time from a depth image to a path; `depth` says of which problems, and what became of the paths.
    pub depth_to_path_ms: Spread,
    /// Planning in what a camera sees.
    pub depth: Depth,
    /// Name of the robot.
    pub robot: String,
    /// Seed of the searches, and of the problems that are made.
    pub seed: u64,
    /// How often each problem is solved; the middle time counts.
    pub runs_per_problem: usize,
    /// The first problems without a path, and why.
    pub failures: Vec<String>,
    /// The first paths that touch something, and what.
    pub contacts: Vec<String>,
}

/// Of many values the middle one, the one that 95 of 100 do not exceed, and the largest.
#[derive(Serialize)]
pub struct Spread {
    /// The middle one.
    pub median: f64,
    /// 95 of 100 are not larger.
    pub p95: f64,
    /// The largest.
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

/// Plans every problem, tests the paths again, and times planning, timing and kinematics; one thread.
///
/// # Errors
/// When the problems cannot be read or made, the robot cannot be planned for, or a file cannot be written.
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

/// The problems of the user's file, or fresh ones.
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
        let allowed = Allowed::none();
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
        // The corners, which rounding cuts, count as well; and what the robot is told to do at the control rate.
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

/// The answer, and the middle one of the processor times of equal runs, s.
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

/// The path as states with no joint step above `RECHECK`.
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

/// The same in words.
pub fn in_words(measured: &Measured) -> String {
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

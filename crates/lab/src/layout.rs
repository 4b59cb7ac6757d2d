//! Layouts: each task is laid out once, timed, and audited outside the timing.

use genmanip_workspace::worlds;
use std::collections::BTreeMap;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_core::{Scenario, Seed, Task, World};
use genmanip_layout::{LayoutAudit, LayoutError, LayoutSettings, Phase, audit, lay_out_observed, posed};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_relations::{Rest, ShapeCache, judge_goal};
use serde::Serialize;

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_workspace::Progress;

/// Duration of the audit's simulation of the objects without a robot, simulated s.
const ALONE_S: f64 = 2.0;
/// Number of slowest tasks reported. Chosen by hand.
const MAX_SLOW: usize = 20;
/// Names of the layout's phases, in the order of [`Phase`].
const PHASES: [&str; 6] = ["preparing", "placing", "settling", "judging", "reaching", "seeing"];

/// Success, cost and faults of the layouts. Times include tasks without a layout.
#[derive(Default, Serialize)]
pub struct Measured {
    /// Seed of the layouts.
    pub seed: u64,
    /// Number of tasks that were laid out or refused.
    pub tasks: usize,
    /// Number of tasks with a layout.
    pub laid_out: usize,
    /// Number of tasks without a layout.
    pub refused: usize,
    /// CPU time per task, ms.
    pub cpu_ms: Spread,
    /// Mean CPU time per task by phase, ms.
    pub phase_cpu_ms: BTreeMap<&'static str, f64>,
    /// Largest penetration of two objects in any initial scene, mm.
    pub worst_penetration_mm: f64,
    /// Largest displacement of an object in the audit's simulation, mm.
    pub worst_drift_mm: f64,
    /// Number of edges and joint states of the initial scene graphs that were checked.
    pub edges_checked: usize,
    /// Number of checked edges and joint states that do not hold.
    pub edges_failed: usize,
    /// Number of layouts whose goal holds from the start.
    pub goals_true: usize,
    /// Number of layouts with an object that no camera sees sufficiently.
    pub unseen: usize,
    /// CPU time of posing all objects and judging the whole goal, in the scenes with the most objects, µs.
    pub goal_verdict_us: Spread,
    /// Number of objects in these largest scenes.
    pub goal_verdict_objects: usize,
    /// The slowest tasks, slowest first.
    pub slowest: Vec<Slow>,
    /// Tasks without a layout, with the reason.
    pub refusals: Vec<Refusal>,
    /// Faults that the audit found in layouts.
    pub faults: Vec<Refusal>,
}

/// Median, mean, 95th percentile and maximum.
#[derive(Clone, Copy, Default, Serialize)]
pub struct Spread {
    /// Median of the values.
    pub median: f64,
    /// Mean of the values.
    pub mean: f64,
    /// 95th percentile of the values.
    pub p95: f64,
    /// Maximum of the values.
    pub worst: f64,
}

/// A task among the slowest.
#[derive(Serialize)]
pub struct Slow {
    /// Id of the task.
    pub task: String,
    /// CPU time of laying the task out, ms.
    pub cpu_ms: f64,
}

/// A task with the reason of its refusal or a fault of its layout.
#[derive(Serialize)]
pub struct Refusal {
    /// Id of the task.
    pub task: String,
    /// Reason or fault, for people.
    pub reason: String,
}

/// Lays each task out once with additional distractors, and audits the layouts outside the timing; one thread.
///
/// # Errors
/// If a layout cannot be audited; an infeasible task is a result.
pub fn measure(
    tasks: &[Task],
    world: &World,
    distractors: usize,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Measured, LabError> {
    let planner = worlds::planner(world, &PlannerSettings::default())?;
    let catalogue = Catalogue::builtin();
    let settings = LayoutSettings { distractors, ..LayoutSettings::default() };
    let mut measured = Measured { seed: seed.value(), tasks: tasks.len(), ..Measured::default() };
    let (mut cpu_ms, mut phases_s) = (Vec::new(), [0.0; PHASES.len()]);
    let mut verdicts: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    progress.begin("laying out", tasks.len());
    for (index, task) in tasks.iter().enumerate() {
        let seed = seed.fork("lab layout").fork_index(index as u64);
        let (outcome, seconds) = timed(task, world, &planner, seed, &settings, &mut phases_s);
        cpu_ms.push(seconds * 1e3);
        match outcome {
            Ok(scenario) => {
                let report = audit(&scenario, catalogue, planner.robot(), &settings, ALONE_S)
                    .map_err(|error| LabError::broken(format!("cannot audit the layout of {}", task.id), error))?;
                measured.add(task, &report);
                let (objects, microseconds) = goal_verdict(&scenario)?;
                verdicts.entry(objects).or_default().push(microseconds);
            }
            Err(error) if error.is_defect() => {
                return Err(LabError::broken(format!("laying out {} stopped", task.id), error));
            }
            Err(error) => measured.refusals.push(Refusal { task: task.id.clone(), reason: error.to_string() }),
        }
        progress.advance();
    }
    progress.end();
    measured.refused = measured.refusals.len();
    measured.laid_out = tasks.len() - measured.refused;
    measured.slowest = slowest(tasks, &cpu_ms);
    measured.cpu_ms = spread(cpu_ms);
    let per_task = |seconds: f64| (seconds * 1e5 / tasks.len().max(1) as f64).round() / 100.0;
    measured.phase_cpu_ms = PHASES.into_iter().zip(phases_s.map(per_task)).collect();
    if let Some((objects, microseconds)) = verdicts.pop_last() {
        (measured.goal_verdict_objects, measured.goal_verdict_us) = (objects, spread(microseconds));
    }
    Ok(measured)
}

/// One layout and its CPU time, s; adds the time of each phase (s) to `phases_s`.
fn timed(
    task: &Task,
    world: &World,
    planner: &Planner,
    seed: Seed,
    settings: &LayoutSettings,
    phases_s: &mut [f64; PHASES.len()],
) -> (Result<Scenario, LayoutError>, f64) {
    let mut clock = cpu_clock();
    let (mut phase, mut since) = (Phase::Preparing, 0.0);
    let mut begin = |next: Phase| {
        let now = clock();
        phases_s[phase as usize] += now - since;
        (phase, since) = (next, now);
    };
    let outcome = lay_out_observed(
        task,
        Catalogue::builtin(),
        world,
        planner,
        GraspLibrary::builtin(),
        seed,
        settings,
        &mut begin,
    );
    begin(Phase::Preparing);
    (outcome, since)
}

/// Number of objects, and CPU time of posing all of them and judging the goal, µs.
fn goal_verdict(scenario: &Scenario) -> Result<(usize, f64), LabError> {
    let scene = posed(scenario, Catalogue::builtin(), &mut ShapeCache::default());
    let mut scene = scene.map_err(|error| LabError::broken(format!("cannot pose {}", scenario.id), error))?;
    let settings = scenario.world.relations;
    let mut clock = cpu_clock();
    for (index, placed) in scenario.objects.iter().enumerate() {
        scene.set_pose(index, placed.pose, &placed.joint_positions);
    }
    let verdict = judge_goal(&scene, &scenario.task.judged_goal(), &Rest::default(), &settings);
    let seconds = clock();
    debug_assert!(!verdict.success);
    Ok((scenario.objects.len(), seconds * 1e6))
}

fn slowest(tasks: &[Task], cpu_ms: &[f64]) -> Vec<Slow> {
    let mut times: Vec<_> = tasks.iter().zip(cpu_ms).collect();
    times.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    let named = |(task, &cpu_ms): (&Task, &f64)| Slow { task: task.id.clone(), cpu_ms: rounded(cpu_ms) };
    times.into_iter().take(MAX_SLOW).map(named).collect()
}

fn rounded(value: f64) -> f64 {
    (value * 100.0).round() / 100.0
}

fn spread(mut values: Vec<f64>) -> Spread {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = ((values.len() as f64 * share).ceil() as usize).saturating_sub(1);
        values.get(index).map_or(0.0, |&value| rounded(value))
    };
    let mean = rounded(values.iter().sum::<f64>() / values.len().max(1) as f64);
    Spread { median: at(0.5), mean, p95: at(0.95), worst: at(1.0) }
}

impl Measured {
    fn add(&mut self, task: &Task, report: &LayoutAudit) {
        let millimetres = |metres: f64| (metres * 1e7).round() / 1e4;
        self.worst_penetration_mm = self.worst_penetration_mm.max(millimetres(report.penetration_m));
        self.worst_drift_mm = self.worst_drift_mm.max(millimetres(report.drift_m));
        self.edges_checked += report.checked;
        self.edges_failed += report.failed.len();
        self.goals_true += usize::from(report.goal_holds);
        self.unseen += usize::from(report.hidden.is_some());
        let mut fault = |reason: String| self.faults.push(Refusal { task: task.id.clone(), reason });
        report.failed.iter().for_each(|atom| fault(format!("not so: {atom}")));
        if report.goal_holds {
            fault("the goal holds".into());
        }
        if let Some(reason) = &report.hidden {
            fault(reason.to_string());
        }
        if report.drift_m.max(report.penetration_m) >= 1e-3 {
            let (drift, depth) = (millimetres(report.drift_m), millimetres(report.penetration_m));
            fault(format!("drifts {drift} mm, penetrates {depth} mm"));
        }
    }
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let Measured { cpu_ms, goal_verdict_us: verdict, .. } = measured;
    let phases = measured.phase_cpu_ms.iter().map(|(name, ms)| format!("{name} {ms:.1}"));
    let mut text = format!(
        "laid out      {} of {}\ntime          median {:.0} ms, mean {:.0} ms, p95 {:.0} ms, worst {:.0} ms of CPU time\n\
         phases        {} ms\npenetration   at most {:.3} mm\ndrift         at most {:.3} mm in {ALONE_S} s\n\
         graph         {} edges and states checked, {} fail; goal already true {}, object unseen {}\n\
         goal verdict  median {:.0} µs, worst {:.0} µs with {} objects\n",
        measured.laid_out,
        measured.tasks,
        cpu_ms.median,
        cpu_ms.mean,
        cpu_ms.p95,
        cpu_ms.worst,
        phases.collect::<Vec<_>>().join(", "),
        measured.worst_penetration_mm,
        measured.worst_drift_mm,
        measured.edges_checked,
        measured.edges_failed,
        measured.goals_true,
        measured.unseen,
        verdict.median,
        verdict.worst,
        measured.goal_verdict_objects,
    );
    for (what, list) in [("refused", &measured.refusals), ("wrong", &measured.faults)] {
        for Refusal { task, reason } in list.iter().take(20) {
            text += &format!("{what}: {task}: {reason}\n");
        }
    }
    text
}

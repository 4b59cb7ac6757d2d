//! Grasps from point clouds, tried in physics: lift, shake, hold.

use genmanip_workspace::worlds;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use genmanip_agent_sim::{GraspChoice, demonstration_grasps};
use genmanip_assets::Catalogue;
use genmanip_core::{Seed, World};
use genmanip_motion::PlannerSettings;
use genmanip_rollout::grasp_trial::{
    CandidateChoice, GraspTrials, Trial, TrialClass, TrialEnding, TrialView, ViewSettings,
};
use genmanip_workspace::Progress;
use serde::Serialize;

use crate::LabError;
use crate::calibration::Calibration;
use crate::clock::cpu_clock;
use crate::quantile::quantile;

/// Number of bins of the reliability diagram.
const BINS: usize = 10;

/// Clouds, objects and selection rule of the trials.
#[derive(Clone, Debug, PartialEq)]
pub struct GraspArguments {
    /// Source of the target's point cloud.
    pub view: TrialView,
    /// Rule that selects the executed candidate.
    pub pick: CandidateChoice,
    /// Classes of objects to try.
    pub classes: Vec<TrialClass>,
    /// Number of trials per class.
    pub count: u64,
    /// File to write one line of JSON per trial to; `None` for no file.
    pub out: Option<PathBuf>,
}

/// Success, calibration and cost of the grasps.
#[derive(Serialize)]
pub struct Report {
    /// Seed of objects, views and noise.
    pub seed: u64,
    /// Source of the target's point cloud.
    pub view: TrialView,
    /// Rule that selected the executed candidate.
    pub pick: CandidateChoice,
    /// Totals by class of objects.
    pub classes: BTreeMap<TrialClass, Tally>,
    /// CPU time of sampling grasps; for a detector behind a service, without the service.
    pub cpu_ms: CpuTimes,
    /// Calibration of the scores as success probabilities.
    pub calibration: Calibration,
    /// Number of failed trials by outcome.
    pub failures: BTreeMap<TrialEnding, usize>,
    /// CPU time of the measurement, physics included, s.
    pub cpu_s: f64,
}

/// Totals over the trials of one class.
#[derive(Serialize, Default)]
pub struct Tally {
    /// Number of distinct objects tried.
    pub objects: usize,
    /// Number of grasp trials of the class.
    pub attempts: usize,
    /// Number of trials with a candidate.
    pub proposed: usize,
    /// Number of trials whose grasp held.
    pub held: usize,
    /// Share of all trials whose grasp held, 0 to 1.
    pub share: f64,
    /// Number of failed trials by outcome.
    pub failures: BTreeMap<TrialEnding, usize>,
    /// Names of the objects that were not held, with the number of their failed trials.
    pub missed: BTreeMap<String, usize>,
}

/// CPU time of sampling grasps for one cloud.
#[derive(Serialize)]
pub struct CpuTimes {
    /// Median CPU time per cloud, ms.
    pub median: f64,
    /// 95th percentile of the CPU time per cloud, ms.
    pub p95: f64,
    /// Median number of points of a cloud.
    pub points: usize,
}

/// Tries grasps of the sampler, or of a detector, on random objects of each class; one thread.
///
/// # Errors
/// If the file cannot be written or a trial raises an error; a grasp that does not hold is a result.
pub fn measure(
    arguments: &GraspArguments,
    grasps: &GraspChoice,
    world: &Arc<World>,
    seed: Seed,
    progress: &dyn Progress,
) -> Result<Report, LabError> {
    let GraspArguments { view, pick, ref classes, .. } = *arguments;
    let mut out = match &arguments.out {
        None => None,
        Some(path) => {
            let file = std::fs::File::create(path).map_err(|error| LabError::file("write", path, error))?;
            Some(std::io::BufWriter::new(file))
        }
    };
    let planner = worlds::planner(world, &PlannerSettings::default())?;
    let trials = GraspTrials {
        catalogue: Catalogue::builtin(),
        detector: match grasps {
            GraspChoice::Rgbd => None,
            GraspChoice::Http(_) => Some(demonstration_grasps::source(grasps, &planner)),
        },
        planner,
        robot: worlds::robot(world)?,
        world: Arc::clone(world),
        view: ViewSettings::default(),
    };
    progress.begin("trials", classes.len() * arguments.count as usize);
    let mut clock = cpu_clock();
    let mut done = Vec::new();
    for &class in classes {
        for index in 0..arguments.count {
            let seed = seed.fork(&format!("{class:?}")).fork_index(index);
            let trial = trials
                .run(class, view, pick, seed, &mut clock)
                .map_err(|error| LabError::broken(format!("trial {index} of {class:?}"), error))?;
            if let Some(out) = &mut out {
                let line = serde_json::to_string(&trial).unwrap_or_default();
                writeln!(out, "{line}").map_err(|error| LabError::broken("cannot write the trials", error))?;
            }
            done.push(trial);
            progress.advance();
        }
    }
    progress.end();
    if let Some(mut out) = out {
        out.flush().map_err(|error| LabError::broken("cannot write the trials", error))?;
    }
    Ok(report(seed.value(), view, pick, &done, clock()))
}

/// A value of the command line by name: view, selection rule or class.
///
/// # Errors
/// If no value has this name.
pub fn named<T: serde::de::DeserializeOwned>(name: &str) -> Result<T, LabError> {
    serde_json::from_value(name.into())
        .map_err(|error| LabError::input(format!("`{name}` is not a valid choice")).because(error))
}

fn report(seed: u64, view: TrialView, pick: CandidateChoice, trials: &[Trial], cpu_s: f64) -> Report {
    let mut classes: BTreeMap<TrialClass, Tally> = BTreeMap::new();
    let mut failures = BTreeMap::new();
    let mut names: BTreeMap<TrialClass, BTreeSet<&str>> = BTreeMap::new();
    for trial in trials {
        let tally = classes.entry(trial.class).or_default();
        names.entry(trial.class).or_default().insert(&trial.object);
        tally.attempts += 1;
        tally.proposed += usize::from(trial.candidates > 0);
        if trial.ending == TrialEnding::Held {
            tally.held += 1;
        } else {
            *tally.failures.entry(trial.ending).or_default() += 1;
            *tally.missed.entry(trial.object.clone()).or_default() += 1;
            *failures.entry(trial.ending).or_default() += 1;
        }
    }
    for (class, tally) in &mut classes {
        tally.share = tally.held as f64 / tally.attempts.max(1) as f64;
        tally.objects = names.get(class).map_or(0, BTreeSet::len);
    }
    let mut times: Vec<f64> = trials.iter().map(|trial| trial.sampler_cpu_s * 1e3).collect();
    let mut points: Vec<usize> = trials.iter().map(|trial| trial.points).collect();
    times.sort_by(f64::total_cmp);
    points.sort_unstable();
    let cpu_ms =
        CpuTimes { median: quantile(&times, 0.5), p95: quantile(&times, 0.95), points: points[points.len() / 2] };
    Report { seed, view, pick, classes, cpu_ms, calibration: calibration(trials), failures, cpu_s }
}

fn calibration(trials: &[Trial]) -> Calibration {
    let outcome = |trial: &Trial| Some((trial.grasp.as_ref()?.score, trial.ending == TrialEnding::Held));
    Calibration::of(&trials.iter().filter_map(outcome).collect::<Vec<_>>(), BINS)
}

/// Text summary.
pub fn describe(report: &Report) -> String {
    let mut text = String::from("class     objects  attempts  proposed  held  share\n");
    for (class, tally) in &report.classes {
        text += &format!(
            "{:<9} {:>7}  {:>8}  {:>8}  {:>4}  {:.3}\n",
            format!("{class:?}").to_lowercase(),
            tally.objects,
            tally.attempts,
            tally.proposed,
            tally.held,
            tally.share
        );
        for (name, count) in &tally.missed {
            text += &format!("  {count} × {name}\n");
        }
        for (ending, count) in &tally.failures {
            text += &format!("  {count} {ending:?}\n");
        }
    }
    let cpu = &report.cpu_ms;
    text += &format!(
        "sampler   {:.1} ms median, {:.1} ms p95 of CPU time, clouds of {} points\n\
         scores    Brier {:.3}, {:.3} for the constant share of grasps that held\n",
        cpu.median, cpu.p95, cpu.points, report.calibration.brier, report.calibration.brier_of_base_rate
    );
    text
}

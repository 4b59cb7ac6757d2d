//! Builds a suite from a seed: tasks, layouts, trials of the expert, selection.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::Catalogue;
use genmanip_benchmark::balance;
use genmanip_benchmark::suite_format::{BuildStep, Candidate, SuiteEntry, SuiteFile, Targets, choose, sha256};
use genmanip_core::{Document, EpisodeResult, Scenario, Seed, Task, World};
use genmanip_layout::LayoutSettings;

use crate::evaluate::{EvaluateOptions, Suite, evaluate};
use crate::layouts::{LayoutOutput, lay_out};
use crate::policies::PolicyFactory;
use genmanip_benchmark::suites::KINDS;
use genmanip_benchmark::suites::candidates::{CandidateRequest, design, traits};
use genmanip_benchmark::suites::frozen::{self, SuiteHeader, certificate};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::scenarios;

/// Number of trials; the expert must succeed in all of them for a scenario to be certified.
const TRIALS: usize = 5;
/// Time limit of a scenario as a multiple of the expert's longest trial. Chosen by hand: learned policies are slower,
/// and some retry.
const HORIZON_FACTOR: f64 = 3.0;
/// Step to which time limits are rounded up, s.
const HORIZON_STEP_S: f64 = 5.0;

/// Options of [`build`].
#[derive(Clone, Debug)]
pub struct BuildOptions<'a> {
    /// Name of the suite.
    pub name: String,
    /// Folder to write the suite to.
    pub out: PathBuf,
    /// Number of scenarios per kind of task.
    pub per_kind: usize,
    /// Number of candidates that are laid out and tried per scenario.
    pub candidates: usize,
    /// Seed of tasks, layouts and trials.
    pub seed: Seed,
    /// Catalogue of the objects that tasks may contain.
    pub catalogue: &'a Catalogue,
    /// Tasks used before any are designed, such as recorded answers of language models; those of a kind that is
    /// not in [`KINDS`] are refused and counted in the funnel.
    pub tasks: Vec<Task>,
    /// World of the scenarios.
    pub world: World,
    /// Number of threads.
    pub workers: usize,
}

/// Builds a suite; `None` if interrupted. The same call continues an interrupted build.
///
/// # Errors
/// When the folder holds another suite, too few candidates pass, or a file cannot be written.
pub fn build(
    options: &BuildOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteFile>, WorkspaceError> {
    frozen::refuse_another(&options.out)?;
    let work = options.out.join("work");
    let wanted = CandidateRequest {
        of_each_kind: options.per_kind * options.candidates,
        recorded: &options.tasks,
        catalogue: options.catalogue,
        seed: options.seed,
        workers: options.workers,
    };
    let Some((tasks, designed)) = design(&wanted, progress, stop) else { return Ok(None) };
    let layouts = work.join("layouts");
    fs::create_dir_all(&layouts).map_err(|error| WorkspaceError::file("write", &layouts, error))?;
    let (scenarios, laid_out) = lay_out_all(&tasks, &layouts, options, progress, stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let Some((certified, tried)) = certify(scenarios, &layouts, &work.join("trials"), options, progress, stop)? else {
        return Ok(None);
    };
    let funnel = vec![designed, laid_out, tried];
    let entries: Vec<(Scenario, SuiteEntry)> =
        certified.into_iter().map(|(scenario, trials)| entry(scenario, &trials, options.catalogue)).collect();
    let candidate = |(scenario, entry): &(Scenario, SuiteEntry)| {
        let is_preferred = options.tasks.iter().any(|task| task.id == scenario.task.id);
        balance::candidate(&scenario.task, entry.traits.clone(), is_preferred)
    };
    let candidates: Vec<Candidate> = entries.iter().map(candidate).collect();
    let chosen = choose(&candidates, options.per_kind, &Targets::new());
    for kind in KINDS {
        let count = chosen.iter().filter(|&&index| entries[index].1.kind == kind).count();
        if count < options.per_kind {
            let what = format!("{count} of {} scenarios of kind {} passed", options.per_kind, kind.name());
            return Err(
                WorkspaceError::input(what).with_hint("raise --candidates, or take another --seed or --catalog")
            );
        }
    }
    let mut kept: Vec<(Scenario, SuiteEntry)> =
        entries.into_iter().enumerate().filter(|(index, _)| chosen.contains(index)).map(|(_, own)| own).collect();
    kept.sort_by(|a, b| a.0.id.cmp(&b.0.id));
    let head = SuiteHeader {
        name: options.name.clone(),
        seed: options.seed,
        per_kind: options.per_kind,
        perturbation: None,
        funnel,
    };
    frozen::write(&options.out, head, kept).map(Some)
}

fn lay_out_all(
    tasks: &[Task],
    folder: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<(Vec<Scenario>, BuildStep), WorkspaceError> {
    let output = LayoutOutput { folder: folder.to_owned(), explain: false };
    let (settings, seed) = (LayoutSettings::default(), options.seed.fork("layouts"));
    let rows =
        lay_out(tasks, 1, &options.world, &settings, seed, &output, options.workers, progress, stop, &mut |_| {})?;
    let mut stage = BuildStep::new("can be laid out");
    let mut scenarios = Vec::new();
    for row in rows {
        match row.scenario {
            Some(path) => {
                let scenario = scenarios::read_scenario(Path::new(&path))?;
                stage.pass(scenario.task.kind);
                scenarios.push(scenario);
            }
            None => stage.refuse("no layout found"),
        }
    }
    Ok((scenarios, stage))
}

/// Scenarios that the expert solved in every trial, with the results of the trials.
type Certified = Vec<(Scenario, Vec<EpisodeResult>)>;

fn certify(
    scenarios: Vec<Scenario>,
    layouts: &Path,
    folder: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<(Certified, BuildStep)>, WorkspaceError> {
    let paths: Vec<PathBuf> = scenarios.iter().map(|scenario| layouts.join(format!("{}.json", scenario.id))).collect();
    let Some(mut by_scenario) = try_expert(&paths, Some(folder), options.workers, progress, stop)? else {
        return Ok(None);
    };
    let mut stage = BuildStep::new(&format!("are solved by the expert, {TRIALS} of {TRIALS} times"));
    let mut certified = Vec::new();
    for scenario in scenarios {
        let trials = by_scenario.remove(&scenario.id).unwrap_or_default();
        let verified = trials.iter().filter(|trial| trial.success).count();
        if verified == TRIALS {
            stage.pass(scenario.task.kind);
            certified.push((scenario, trials));
        } else {
            stage.refuse(format!("solved {verified} of {TRIALS} times"));
        }
    }
    Ok(Some((certified, stage)))
}

/// Results of the expert's trials of each scenario, `TRIALS` each, by scenario id; `None` if interrupted. A call with
/// the same `folder` continues an interrupted one.
///
/// # Errors
/// When a scenario cannot be read, two have the same id, their robots differ, or an episode raises an error.
pub fn try_expert(
    paths: &[PathBuf],
    folder: Option<&Path>,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<BTreeMap<String, Vec<EpisodeResult>>>, WorkspaceError> {
    let suite = Suite::of_scenarios(paths)?.with_episodes(TRIALS);
    let evaluation = EvaluateOptions { out: folder.map(Path::to_owned), workers, ..EvaluateOptions::default() };
    let expert = [PolicyFactory::resolve("expert")?];
    let reports = evaluate(&suite, &expert, &evaluation, progress, stop)?;
    Ok(reports.into_iter().next().map(|report| frozen::by_scenario(report.results)))
}

/// Time limit of a scenario, simulated s, from the expert's trials: the longest verified one times a factor for slower
/// policies, rounded up.
pub fn horizon_s(trials: &[EpisodeResult]) -> f64 {
    let longest = trials.iter().filter(|it| it.success).map(|it| it.duration_s).fold(0.0, f64::max);
    (HORIZON_FACTOR * longest / HORIZON_STEP_S).ceil() * HORIZON_STEP_S
}

fn entry(scenario: Scenario, trials: &[EpisodeResult], catalogue: &Catalogue) -> (Scenario, SuiteEntry) {
    let entry = SuiteEntry {
        id: scenario.id.clone(),
        sha256: sha256(scenario.to_json().as_bytes()),
        kind: scenario.task.kind,
        source: scenario.task.source.clone(),
        traits: traits(&scenario.task, catalogue),
        horizon_s: horizon_s(trials),
        certificate: certificate(trials),
        pictures: BTreeMap::new(),
    };
    (scenario, entry)
}

//! From a seed to a suite: tasks, layouts, trials, choice.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::Catalogue;
use genmanip_benchmark::suite_format::{BuildStep, Candidate, SuiteEntry, SuiteFile, select, sha256, template};
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

/// Episodes in which the expert must solve a scenario, all of them.
const TRIALS: usize = 5;
/// Time that a policy has, as a multiple of the longest that the expert needed: learned policies are slower, and some
/// try again.
const HORIZON_FACTOR: f64 = 3.0;
/// Horizons are whole multiples of this, s.
const HORIZON_STEP_S: f64 = 5.0;

/// Options of [`build`].
#[derive(Clone, Debug)]
pub struct BuildOptions<'a> {
    /// Name of the suite.
    pub name: String,
    /// Folder that it is written into.
    pub out: PathBuf,
    /// Scenarios of each kind.
    pub per_kind: usize,
    /// Candidates per scenario that are laid out and tried.
    pub candidates: usize,
    /// Seed of tasks, layouts and trials.
    pub seed: Seed,
    /// Objects that tasks may be about.
    pub catalogue: &'a Catalogue,
    /// Tasks that are taken before designed ones, of any kind of the suite: recorded answers of language models.
    pub tasks: Vec<Task>,
    /// World of the scenarios.
    pub world: World,
    /// Threads.
    pub workers: usize,
}

/// Builds a suite; `None` when it was stopped. An interrupted build continues where it stopped, by the same call.
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
        let things = scenario.task.goal.alternatives.iter().flatten().flat_map(|atom| atom.ids().map(String::from));
        Candidate {
            kind: entry.kind.name().into(),
            traits: entry.traits.clone(),
            once: things.chain([template(&scenario.task.instruction)]).collect(),
            is_preferred: options.tasks.iter().any(|task| task.id == scenario.task.id),
        }
    };
    let candidates: Vec<Candidate> = entries.iter().map(candidate).collect();
    let chosen = choose(&candidates, options.per_kind);
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

/// Indices of the chosen candidates: balanced; at least half of the spatial ones identify two objects by position.
fn choose(candidates: &[Candidate], per_kind: usize) -> BTreeSet<usize> {
    let has_one_clue = |index: &usize| {
        candidates[*index].traits.get("clues").is_some_and(|clues| clues.iter().any(|clue| clue == "one"))
    };
    let mut left: Vec<usize> = (0..candidates.len()).collect();
    loop {
        let offered: Vec<Candidate> = left.iter().map(|&index| candidates[index].clone()).collect();
        let chosen: BTreeSet<usize> = select(&offered, per_kind).into_iter().map(|place| left[place]).collect();
        let with_one: Vec<usize> = chosen.iter().copied().filter(has_one_clue).collect();
        let superfluous = with_one.iter().rev().find(|&&index| !candidates[index].is_preferred);
        match superfluous {
            Some(superfluous) if with_one.len() > per_kind.div_ceil(2) => left.retain(|index| index != superfluous),
            _ => return chosen,
        }
    }
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

/// The scenarios that the expert solves every time, with its results.
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
    let suite = Suite::of_scenarios(&paths)?.with_episodes(TRIALS);
    let evaluation =
        EvaluateOptions { out: Some(folder.to_owned()), workers: options.workers, ..EvaluateOptions::default() };
    let expert = [PolicyFactory::resolve("expert")?];
    let reports = evaluate(&suite, &expert, &evaluation, progress, stop)?;
    let Some(report) = reports.into_iter().next() else { return Ok(None) };
    let mut by_scenario = frozen::by_scenario(report.results);
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

fn entry(scenario: Scenario, trials: &[EpisodeResult], catalogue: &Catalogue) -> (Scenario, SuiteEntry) {
    let longest = trials.iter().filter(|it| it.success).map(|it| it.duration_s).fold(0.0, f64::max);
    let entry = SuiteEntry {
        id: scenario.id.clone(),
        sha256: sha256(scenario.to_json().as_bytes()),
        kind: scenario.task.kind,
        source: scenario.task.source.clone(),
        traits: traits(&scenario.task, catalogue),
        horizon_s: (HORIZON_FACTOR * longest / HORIZON_STEP_S).ceil() * HORIZON_STEP_S,
        certificate: certificate(trials),
        pictures: BTreeMap::new(),
    };
    (scenario, entry)
}

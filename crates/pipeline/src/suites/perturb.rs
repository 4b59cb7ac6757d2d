//! Perturbed suites: the scenarios of a suite, each changed along one axis with a given strength.
//!
//! The original suite is the baseline: scenarios keep their ids and seeds, so `genmanip compare` pairs the two
//! evaluations of a policy episode by episode. Scenarios that cannot be certified after the change are omitted and
//! counted.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::Catalogue;
use genmanip_benchmark::suite_format::{BuildStep, Perturbation, SuiteEntry, SuiteFile, sha256};
use genmanip_core::{Document, EpisodeResult, Scenario, Seed};
use genmanip_layout::{LayoutSettings, audit};
use genmanip_rollout::collect::in_parallel;

use crate::evaluate::{EvaluateOptions, Suite, evaluate};
use crate::policies::PolicyFactory;
use genmanip_benchmark::suites::frozen::{self, SuiteHeader, certificate};
use genmanip_benchmark::suites::open;
use genmanip_benchmark::suites::perturb::{Axis, Perturber};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Number of trials; the expert must succeed in all of them for a changed scenario to be certified.
const TRIALS: usize = 3;
/// Agent that must solve a changed scenario once from its images; the oracle gives all its answers and masks.
const LOOKER: &str = "agent:vlm=oracle,masks=oracle";
/// Minimum number of pixels of every object of the task in at least one prompt camera, as the benchmark requires.
const MIN_PIXELS: usize = 200;

/// Options of [`perturb`].
#[derive(Clone, Debug)]
pub struct PerturbOptions {
    /// Folder of the original suite.
    pub suite: PathBuf,
    /// Folder to write the perturbed suite to.
    pub out: PathBuf,
    /// Name of the new suite.
    pub name: String,
    /// Axis of the perturbation.
    pub axis: Axis,
    /// Strength of the perturbation, in (0, 1].
    pub dial: f64,
    /// Seed of the random changes.
    pub seed: Seed,
    /// Number of threads.
    pub workers: usize,
}

/// Changes every scenario of a suite along one axis; `None` if interrupted. The same call continues an interrupted one.
///
/// # Errors
/// When the suite does not exist, the folder holds another one, no scenario can be certified, or a file cannot be
/// written.
pub fn perturb(
    options: &PerturbOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteFile>, WorkspaceError> {
    frozen::refuse_another(&options.out)?;
    if !(options.dial > 0.0 && options.dial <= 1.0) {
        return Err(WorkspaceError::input(format!("--dial {}: expected a number above 0 and up to 1", options.dial))
            .with_hint("1 is the most that is meant to be solvable"));
    }
    let control = open(&options.suite)?;
    let scenarios = Suite::frozen(&options.suite)?.scenarios;
    let (changed, made) = change_all(&scenarios, options, progress, stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let work = options.out.join("work");
    let drafts = work.join("scenarios");
    for scenario in &changed {
        documents::write_file(&drafts.join(format!("{}.json", scenario.id)), scenario.to_json().as_bytes())?;
    }
    let paths: Vec<PathBuf> = changed.iter().map(|scenario| drafts.join(format!("{}.json", scenario.id))).collect();
    if paths.is_empty() {
        return Err(WorkspaceError::input("no scenario of the suite can be changed so")
            .because(made.reasons())
            .with_hint("try a smaller --dial or another --seed"));
    }
    let trial = |policy: &str, episodes: usize| -> Result<Option<Vec<EpisodeResult>>, WorkspaceError> {
        let suite = Suite::of_scenarios(&paths)?.with_episodes(episodes);
        let out = Some(work.join("trials"));
        let evaluation = EvaluateOptions { out, workers: options.workers, ..EvaluateOptions::default() };
        let reports = evaluate(&suite, &[PolicyFactory::resolve(policy)?], &evaluation, progress, stop)?;
        Ok(reports.into_iter().next().map(|report| report.results))
    };
    let (Some(expert), Some(looker)) = (trial("expert", TRIALS)?, trial(LOOKER, 1)?) else { return Ok(None) };
    let seen: BTreeSet<String> =
        looker.into_iter().filter(|result| result.success).map(|result| result.scenario_id).collect();
    let mut by_scenario = frozen::by_scenario(expert);
    let mut certified = BuildStep::new(&format!(
        "are solved by the expert, {TRIALS} of {TRIALS} times, and by the agent with the oracle's answers and masks"
    ));
    let mut kept: Vec<(Scenario, SuiteEntry)> = Vec::new();
    for scenario in changed {
        let trials = by_scenario.remove(&scenario.id).unwrap_or_default();
        let Some(entry) = control.scenarios.iter().find(|entry| entry.id == scenario.id) else { continue };
        let certificate = certificate(&trials);
        if certificate.verified < TRIALS {
            certified.refuse(format!("the expert solved it {} of {TRIALS} times", certificate.verified));
        } else if !seen.contains(&scenario.id) {
            certified.refuse("the agent did not solve it");
        } else {
            certified.pass(entry.kind);
            let (kind, sha256) = (scenario.task.kind, sha256(scenario.to_json().as_bytes()));
            kept.push((scenario, SuiteEntry { kind, sha256, certificate, pictures: BTreeMap::new(), ..entry.clone() }));
        }
    }
    if kept.is_empty() {
        return Err(WorkspaceError::input("no changed scenario is certified")
            .because(certified.reasons())
            .with_hint("try a smaller --dial"));
    }
    let head = SuiteHeader {
        name: options.name.clone(),
        seed: control.seed,
        per_kind: control.per_kind,
        perturbation: Some(Perturbation {
            of: control.name,
            of_hash: control.suite_hash,
            axis: options.axis.name().into(),
            dial: options.dial,
            seed: options.seed,
        }),
        funnel: vec![made, certified],
    };
    frozen::write(&options.out, head, kept).map(Some)
}

/// A changed scenario, or the reason why it cannot be changed.
type Changed = Result<Scenario, String>;

/// All changed scenarios; those that cannot be changed are counted by reason.
fn change_all(
    scenarios: &[Arc<Scenario>],
    options: &PerturbOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<(Vec<Scenario>, BuildStep), WorkspaceError> {
    let Some(first) = scenarios.first() else { return Ok((Vec::new(), BuildStep::new("can be changed"))) };
    let workshop = Perturber::new(&first.world, options.axis, options.dial)?;
    let layout = LayoutSettings { min_pixels: MIN_PIXELS, ..LayoutSettings::default() };
    let seed = options.seed.fork("perturbation").fork(options.axis.name());
    progress.begin("changing", scenarios.len());
    let one = |scenario: &Arc<Scenario>| -> Result<Changed, WorkspaceError> {
        let changed = workshop.change(scenario, seed.fork(&scenario.id));
        progress.advance();
        let Ok(changed) = changed else { return Ok(changed) };
        if !options.axis.moves_what_is_seen() {
            return Ok(Ok(changed));
        }
        let robot = workshop.planner.robot();
        // Audited without simulated time, since the expert's trials show if the objects remain at rest.
        let audited = audit(&changed, Catalogue::builtin(), robot, &layout, 0.0)
            .map_err(|error| WorkspaceError::broken(format!("{} cannot be audited", changed.id), error))?;
        Ok(match audited.hidden {
            Some(reason) => Err(reason.to_string()),
            None if !audited.failed.is_empty() => Err("a relation of the scene does not hold any more".into()),
            None => Ok(changed),
        })
    };
    let outcomes = in_parallel(scenarios, options.workers, stop, &one)?;
    progress.end();
    let mut made = BuildStep::new("can be changed, with every thing of the task in view");
    let mut changed = Vec::new();
    for (scenario, outcome) in scenarios.iter().zip(outcomes) {
        match outcome {
            Ok(draft) => {
                // Counted by the kind of the original task, since an exchanged instruction changes the kind.
                made.pass(scenario.task.kind);
                changed.push(draft);
            }
            Err(reason) => made.refuse(reason),
        }
    }
    Ok((changed, made))
}

//! From a seed to a suite: tasks, layouts, trials, choice.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::Catalogue;
use genmanip_assets::notes::Split;
use genmanip_bench::suite::{Candidate, Stage, SuiteEntry, SuiteFile, balanced_traits, select, sha256, template};
use genmanip_core::{Document, EpisodeResult, Scenario, Seed, Task, TaskKind, World};
use genmanip_layout::LayoutSettings;
use genmanip_scene::designer::{DesignSettings, Series};
use genmanip_scene::references::{self, Clue, Mismatch, clues_at_places, is_needless};

use super::KINDS;
use super::frozen::{self, Head, certificate};
use crate::error::RunError;
use crate::evaluate::{EvaluateOptions, Suite, evaluate};
use crate::inputs;
use crate::layouts::{LayoutOutput, lay_out};
use crate::policies::PolicyFactory;
use crate::progress::Progress;

/// Episodes in which the expert must solve a scenario, all of them.
const TRIALS: usize = 5;
/// Time that a policy has, as a multiple of the longest that the expert needed: learned policies are slower, and some
/// try again.
const HORIZON_FACTOR: f64 = 3.0;
/// Horizons are whole multiples of this, s.
const HORIZON_STEP_S: f64 = 5.0;
/// Designs of a kind for each candidate that is wanted, before the kind is given up.
const DESIGNS_PER_CANDIDATE: usize = 60;
/// Designs that are drawn for one long-horizon task; of three steps about one in 1,000 works out.
const DRAWS_OF_STEPS: usize = 20_000;
/// A value of a trait is frequent above so many times the mean of its values, and so many designs with one are passed
/// over for each candidate that is chosen.
const FREQUENT: f64 = 1.1;
const PASSED_OVER: usize = 10;

/// What is built, and where.
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
) -> Result<Option<SuiteFile>, RunError> {
    frozen::refuse_another(&options.out)?;
    let work = options.out.join("work");
    let (tasks, designed) = design(options, progress);
    let layouts = work.join("layouts");
    fs::create_dir_all(&layouts).map_err(|error| RunError::file("write", &layouts, error))?;
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
    let chosen: BTreeSet<usize> = select(&candidates, options.per_kind).into_iter().collect();
    for kind in KINDS {
        let count = chosen.iter().filter(|&&index| entries[index].1.kind == kind).count();
        if count < options.per_kind {
            let what = format!("{count} of {} scenarios of kind {} passed", options.per_kind, kind.name());
            return Err(RunError::input(what).with_hint("raise --candidates, or take another --seed or --catalog"));
        }
    }
    let mut kept: Vec<(Scenario, SuiteEntry)> =
        entries.into_iter().enumerate().filter(|(index, _)| chosen.contains(index)).map(|(_, own)| own).collect();
    kept.sort_by(|a, b| a.0.id.cmp(&b.0.id));
    let head =
        Head { name: options.name.clone(), seed: options.seed, per_kind: options.per_kind, perturbation: None, funnel };
    frozen::write(&options.out, head, kept).map(Some)
}

/// Tasks of each kind that need what their kind is about.
fn design(options: &BuildOptions, progress: &dyn Progress) -> (Vec<Task>, Stage) {
    let wanted = options.per_kind * options.candidates;
    let mut stage = Stage::new("say what their kind is about, and need it");
    let mut tasks = Vec::new();
    progress.begin("designing", wanted * KINDS.len());
    for task in options.tasks.iter().filter(|task| !KINDS.contains(&task.kind)) {
        stage.refuse(format!("{}, recorded: a suite has no such kind", task.kind.name()));
    }
    for kind in KINDS {
        let mut chosen = Chosen { wanted, ..Chosen::default() };
        for task in options.tasks.iter().filter(|task| task.kind == kind) {
            match chosen.refusal(task) {
                Some(reason) => stage.refuse(format!("{}, recorded: {reason}", kind.name())),
                None => {
                    chosen.take(task.clone(), options.catalogue);
                    progress.advance();
                }
            }
        }
        let series = series(kind);
        for (number, settings) in series.iter().enumerate() {
            // The same share of what is left for each series.
            let left = wanted.saturating_sub(chosen.tasks.len());
            let until = chosen.tasks.len() + left.div_ceil(series.len() - number);
            compose(kind, settings, until, &mut chosen, &mut stage, options, progress);
        }
        chosen.tasks.iter().for_each(|_| stage.pass(kind));
        tasks.append(&mut chosen.tasks);
    }
    progress.end();
    (tasks, stage)
}

/// Long-horizon tasks have two and three steps equally often; four the designer cannot say in 30 words.
fn series(kind: TaskKind) -> Vec<DesignSettings> {
    let usual = DesignSettings::default();
    let with = |steps| DesignSettings { steps: [steps; 2], max_draws: DRAWS_OF_STEPS, ..usual.clone() };
    match kind {
        TaskKind::LongHorizon => [2, 3].map(with).into(),
        _ => vec![usual],
    }
}

/// Composes tasks until so many are chosen.
fn compose(
    kind: TaskKind,
    settings: &DesignSettings,
    until: usize,
    chosen: &mut Chosen,
    stage: &mut Stage,
    options: &BuildOptions,
    progress: &dyn Progress,
) {
    let kinds = [kind];
    let seed = options.seed.fork(&format!("{} steps", settings.steps[0]));
    let Ok(mut series) = Series::new(&kinds, options.catalogue.cards(), seed, settings, false) else { return };
    let (first, mut passed_over) = (chosen.tasks.len(), 0);
    for _ in 0..DESIGNS_PER_CANDIDATE * until.saturating_sub(first) {
        if chosen.tasks.len() >= until {
            break;
        }
        let refused = match series.compose() {
            Err(_) => Some("no such task could be composed".to_owned()),
            Ok(mut task) => {
                task.id = format!("{}-{}-{:05}", kind.name(), options.seed, chosen.tasks.len());
                let is_frequent = chosen.is_frequent(&task, options.catalogue);
                match chosen.refusal(&task) {
                    Some(reason) => Some(reason),
                    None if is_frequent && passed_over < PASSED_OVER * (chosen.tasks.len() - first + 1) => {
                        passed_over += 1;
                        Some("others like it are frequent already".to_owned())
                    }
                    None => {
                        chosen.take(task, options.catalogue);
                        progress.advance();
                        None
                    }
                }
            }
        };
        if let Some(reason) = refused {
            stage.refuse(format!("{}: {reason}", kind.name()));
        }
    }
}

/// The candidates of a kind so far.
#[derive(Default)]
struct Chosen {
    tasks: Vec<Task>,
    /// How many there are to be.
    wanted: usize,
    /// How often each need was said.
    needs: BTreeMap<String, usize>,
    /// Spatial tasks with one clue.
    with_one_clue: usize,
    /// How often each value of each trait occurs, by name and value; 0 for those that were only seen.
    traits: BTreeMap<String, BTreeMap<String, usize>>,
}

impl Chosen {
    fn take(&mut self, task: Task, catalogue: &Catalogue) {
        if let Some(need) = need(&task) {
            *self.needs.entry(need).or_default() += 1;
        }
        self.with_one_clue += usize::from(has_one_clue(&task));
        for (name, values) in traits(&task, catalogue) {
            for value in values {
                *self.traits.entry(name.clone()).or_default().entry(value).or_default() += 1;
            }
        }
        self.tasks.push(task);
    }

    /// Whether some trait of a task has a value that is more frequent than the others that were seen of it.
    fn is_frequent(&mut self, task: &Task, catalogue: &Catalogue) -> bool {
        let mut is_frequent = false;
        for (name, values) in traits(task, catalogue) {
            let counts = self.traits.entry(name).or_default();
            for value in values {
                counts.entry(value.clone()).or_default();
                let mean = counts.values().sum::<usize>() as f64 / counts.len() as f64;
                is_frequent |= counts[&value] as f64 > FREQUENT * mean + 1.0;
            }
        }
        is_frequent
    }

    /// Why a task is no candidate.
    fn refusal(&self, task: &Task) -> Option<String> {
        match Clue::of(task.kind).filter(|&clue| is_needless(task, clue)) {
            Some(Clue::Need) => return Some("what is meant is clear without the need".into()),
            Some(Clue::Place) => return Some("what is meant is clear without where it is".into()),
            Some(Clue::Trait) => return Some("what is meant is clear without what it looks like".into()),
            None => {}
        }
        if need(task).is_some_and(|need| self.needs.get(&need).is_some_and(|&count| count >= 2)) {
            return Some("its need occurs twice already".into());
        }
        // A recorded sentence may be beyond the reader, but not mean something else to it.
        match references::check(task) {
            Ok(()) | Err(Mismatch::Unreadable { .. }) => {}
            Err(mismatch) => return Some(format!("its sentence does not mean its goal: {mismatch}")),
        }
        // At least half of the spatial candidates tell two things by their place.
        let is_half = 2 * self.with_one_clue >= self.wanted.max(self.tasks.len());
        (has_one_clue(task) && is_half).then(|| "enough tasks with one clue".into())
    }
}

/// What a common-sense task says before its request.
fn need(task: &Task) -> Option<String> {
    let need = || task.instruction.split(['.', ':', ';']).next().unwrap_or_default().to_lowercase();
    (task.kind == TaskKind::CommonSense).then(need)
}

fn has_one_clue(task: &Task) -> bool {
    task.kind == TaskKind::Spatial && clues_at_places(task).is_ok_and(|count| count < 2)
}

fn traits(task: &Task, catalogue: &Catalogue) -> BTreeMap<String, Vec<String>> {
    let is_unseen = |uid: &str| catalogue.split(uid) != Split::Train;
    balanced_traits(task, clues_at_places(task).unwrap_or(0), &is_unseen)
}

fn lay_out_all(
    tasks: &[Task],
    folder: &Path,
    options: &BuildOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<(Vec<Scenario>, Stage), RunError> {
    let output = LayoutOutput { folder: folder.to_owned(), explain: false };
    let (settings, seed) = (LayoutSettings::default(), options.seed.fork("layouts"));
    let rows =
        lay_out(tasks, 1, &options.world, &settings, seed, &output, options.workers, progress, stop, &mut |_| {})?;
    let mut stage = Stage::new("can be laid out");
    let mut scenarios = Vec::new();
    for row in rows {
        match row.scenario {
            Some(path) => {
                let scenario = inputs::read_scenario(Path::new(&path))?;
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
) -> Result<Option<(Certified, Stage)>, RunError> {
    let paths: Vec<PathBuf> = scenarios.iter().map(|scenario| layouts.join(format!("{}.json", scenario.id))).collect();
    let suite = Suite::of_scenarios(&paths)?.with_episodes(TRIALS);
    let evaluation =
        EvaluateOptions { out: Some(folder.to_owned()), workers: options.workers, ..EvaluateOptions::default() };
    let expert = [PolicyFactory::resolve("expert")?];
    let reports = evaluate(&suite, &expert, &evaluation, progress, stop)?;
    let Some(report) = reports.into_iter().next() else { return Ok(None) };
    let mut by_scenario = frozen::by_scenario(report.results);
    let mut stage = Stage::new(&format!("are solved by the expert, {TRIALS} of {TRIALS} times"));
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

//! The report of a run: its input gathered from the folder in one pass over the episodes, and the page.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_bench::{
    AttemptRow, EvaluationReport, FilmFrame, ReportInput, ReportSettings, StatisticsSettings, TaskSection, Timing,
    compare, graph_svg, layout_svg, report_html,
};
use genmanip_core::limits;
use genmanip_core::{AttemptOutcome, Episode, EpisodeResult, Task};
use genmanip_data::EpisodeStore;
use genmanip_rollout::Stage;

use crate::error::RunError;
use crate::evaluate::kept_episodes;
use crate::folder::{Run, RunFolder, Timings};
use crate::inputs;
use crate::pictures;
use crate::policies::POLICIES;
use crate::progress::Progress;

/// Moments of the film strip.
const FILM_FRAMES: usize = 12;

/// Width of a picture of the film strip, and of the first and the last picture, pixels.
const FILM_WIDTH: u32 = 256;
const PICTURE_WIDTH: u32 = 512;

/// The HTML page of a run as text.
///
/// # Errors
/// As [`gather`], and when the page would be too large.
pub fn report(path: &Path, settings: &ReportSettings, progress: &dyn Progress) -> Result<String, RunError> {
    let input = gather(path, progress)?;
    report_html(&input, settings).map_err(|error| RunError::broken("cannot make the report", error))
}

/// Everything the page shows, from a run folder.
///
/// The record of each attempt is read once, and the frames of one episode per task; one episode is held at a time.
///
/// # Errors
/// When there is no run, or an episode or an evaluation cannot be read or drawn.
pub fn gather(path: &Path, progress: &dyn Progress) -> Result<ReportInput, RunError> {
    let (folder, run) = RunFolder::open(path)?;
    let store = folder.store()?;
    let survey = folder.survey(&store)?;
    let evaluations = evaluations(&folder, progress)?;
    let timings = folder.timings();
    let mut left_out = survey.notes();
    let mut attempts = attempts(&store, &survey.sound, &timings)?;
    let mut tasks = Vec::new();
    progress.begin("drawing", run.tasks.len());
    for task in &run.tasks {
        let attempts = attempts.remove(&task.id).unwrap_or_default();
        tasks.push(section(task, attempts, &folder, &evaluations, &mut left_out)?);
        progress.advance();
    }
    progress.end();
    left_out.iter().for_each(|note| progress.note(note));
    let mut page = page(&path.display().to_string(), &run, &timings, &evaluations, tasks);
    page.notes.extend(left_out);
    Ok(page)
}

/// The attempts at one task.
#[derive(Default)]
struct Attempts {
    rows: Vec<AttemptRow>,
    /// The recorded attempt that is shown: the first verified one, else the first.
    shown: Option<EpisodeResult>,
}

/// The attempts of each task, in the order of their ids.
fn attempts(store: &EpisodeStore, sound: &[String], timings: &Timings) -> Result<BTreeMap<String, Attempts>, RunError> {
    let unreadable = |error| RunError::broken("cannot read the episodes", error);
    let mut attempts: BTreeMap<String, Attempts> = BTreeMap::new();
    for id in sound.iter().cloned() {
        let (result, is_recorded) = store.read_attempt(&id).map_err(unreadable)?;
        let mine = attempts.entry(result.task_id.clone()).or_default();
        mine.rows.push(AttemptRow {
            outcome: result.failure().map_or(AttemptOutcome::Verified, AttemptOutcome::Failed),
            seconds: timings.attempts.get(&id).copied().unwrap_or(0.0),
            id,
        });
        if is_recorded && mine.shown.as_ref().is_none_or(|shown| result.success && !shown.success) {
            mine.shown = Some(result);
        }
    }
    Ok(attempts)
}

/// Finished evaluations; what is none is named and left out.
fn evaluations(folder: &RunFolder, progress: &dyn Progress) -> Result<Vec<EvaluationReport>, RunError> {
    let path = folder.join("evaluation");
    let listed = match fs::read_dir(&path) {
        Ok(entries) => entries.collect::<Result<Vec<_>, _>>(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => Err(error),
    };
    let mut files: Vec<PathBuf> = listed
        .map_err(|error| RunError::file("list", &path, error))?
        .into_iter()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "json") && !is_hidden(path))
        .collect();
    // Policies of the registry first, in its order; then the others by name.
    let place = |path: &PathBuf| {
        let stem = inputs::stem(path);
        (POLICIES.iter().position(|entry| entry.name == stem).unwrap_or(POLICIES.len()), stem)
    };
    files.sort_by_key(place);
    let mut reports: Vec<EvaluationReport> = Vec::new();
    for path in &files {
        match inputs::read_own_document(path, limits::EVALUATION) {
            Ok(report) => reports.push(report),
            Err(error) => {
                let why = std::error::Error::source(&error).map_or_else(String::new, |source| format!(": {source}"));
                progress.note(&format!("left out of the report: {error}{why}"));
            }
        }
    }
    // The page tells evaluations apart by their policies' names.
    for report in &mut reports {
        report.summary.policy.clone_from(&report.label);
        report.results.iter_mut().for_each(|result| result.policy.clone_from(&report.label));
    }
    Ok(reports)
}

/// Unfinished work of a program that runs or was killed.
fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

fn page(
    name: &str,
    run: &Run,
    timings: &Timings,
    evaluations: &[EvaluationReport],
    tasks: Vec<TaskSection>,
) -> ReportInput {
    let by_name = |name: &str| evaluations.iter().find(|report| report.label == name);
    let comparisons = [("expert", "replay"), ("expert", "do_nothing")]
        .iter()
        .filter_map(|(a, b)| {
            let (a, b) = (by_name(a)?, by_name(b)?);
            compare(&a.results, &b.results, &StatisticsSettings::default()).ok()
        })
        .collect();
    ReportInput {
        title: "GenManip: from tasks to verified demonstrations".into(),
        generated_by: format!("genmanip {}", env!("CARGO_PKG_VERSION")),
        seed: run.seed,
        commands: commands(name, run, tasks.iter().all(|task| task.attempts.is_empty())),
        versions: vec![("genmanip".into(), run.genmanip_version.clone()), ("physics".into(), run.engine.clone())],
        summaries: evaluations.iter().map(|report| report.summary.clone()).collect(),
        control: by_name("do_nothing").map(|report| report.label.clone()),
        comparisons,
        timings: timings.phases.iter().map(|(phase, &seconds)| Timing { phase: phase.clone(), seconds }).collect(),
        notes: notes(run),
        tasks,
    }
}

/// How the run was made; one that was made of scenarios was not collected.
fn commands(name: &str, run: &Run, is_given: bool) -> Vec<String> {
    let made = match is_given {
        true => format!("genmanip evaluate SCENARIOS --out {name}"),
        false => {
            format!("genmanip collect TASKS --out {name} --episodes {} --seed {}", run.episodes_per_task, run.seed)
        }
    };
    let evaluated = (!is_given).then(|| format!("genmanip evaluate {name}"));
    [made].into_iter().chain(evaluated).chain([format!("genmanip report {name}")]).collect()
}

/// What the reader must know about this run.
fn notes(run: &Run) -> Vec<String> {
    let recorded = run.tasks.iter().filter(|task| task.source.starts_with("recorded answer")).count();
    vec![
        "The expert reads simulator truth; its results are marked oracle.".into(),
        "Replay applies the recorded commands without looking; it shows that the simulation is deterministic, \
             not that a policy is good."
            .into(),
        format!(
            "{recorded} of {} tasks are recorded answers of a language model; every task passed every rule.",
            run.tasks.len()
        ),
    ]
}

fn section(
    task: &Task,
    attempts: Attempts,
    folder: &RunFolder,
    evaluations: &[EvaluationReport],
    left_out: &mut Vec<String>,
) -> Result<TaskSection, RunError> {
    let mut store = folder.store()?;
    let mut shown = attempts.shown;
    if shown.is_none()
        && let Some((kept, result)) = kept_failure(task, folder, evaluations)?
    {
        (store, shown) = (kept, Some(result));
    }
    let results = evaluations.iter().flat_map(|report| &report.results);
    let mut section = TaskSection {
        task: task.clone(),
        scenario: None,
        graph: graph_svg(task),
        layout: None,
        first_image: None,
        last_image: None,
        film: Vec::new(),
        shown,
        attempts: attempts.rows,
        results: results.filter(|result| result.task_id == task.id).cloned().collect(),
    };
    let shown = section.shown.as_ref().map(|result| (result.id.clone(), store.read(&result.id)));
    if let Some((id, Err(error))) = &shown
        && error.is_damage()
    {
        left_out.push(format!("episode {id} is damaged and not shown: {error}"));
        section.shown = None;
    } else if let Some((_, episode)) = shown {
        let episode = episode.map_err(|error| RunError::broken("cannot read the episodes", error))?;
        section.layout = Some(layout_svg(&pictures::layout_picture(&episode.scenario, Catalogue::builtin())?));
        add_pictures(&mut section, &episode)?;
        section.scenario = Some(episode.scenario);
    }
    Ok(section)
}

/// Of a task that was not collected: the first failed episode that an evaluation kept, else the first.
fn kept_failure(
    task: &Task,
    folder: &RunFolder,
    evaluations: &[EvaluationReport],
) -> Result<Option<(EpisodeStore, EpisodeResult)>, RunError> {
    let mut first = None;
    for report in evaluations {
        let path = kept_episodes(folder, &report.label);
        if !path.join("store.json").is_file() {
            continue;
        }
        let store = EpisodeStore::open(path).map_err(|error| RunError::broken("cannot read kept episodes", error))?;
        let own = report.results.iter().filter(|result| result.task_id == task.id && store.contains(&result.id));
        for result in own {
            if !result.success {
                return Ok(Some((store, result.clone())));
            }
            first = first.or_else(|| Some((store.clone(), result.clone())));
        }
    }
    Ok(first)
}

fn add_pictures(section: &mut TaskSection, episode: &Episode) -> Result<(), RunError> {
    let robot = inputs::robot(&episode.scenario.world)?;
    let stage = Stage::open(Arc::new(episode.scenario.clone()), Catalogue::builtin(), &robot)
        .map_err(|error| RunError::broken(format!("cannot draw {}", episode.result.id), error))?;
    let mut painter = pictures::painter(&stage)?;
    let mut ends = pictures::stills(&mut painter, episode, 2, PICTURE_WIDTH)?;
    section.last_image = ends.pop();
    section.first_image = ends.pop();
    let strip = pictures::stills(&mut painter, episode, FILM_FRAMES, FILM_WIDTH)?;
    let duration = episode.frames.last().map_or(0.0, |frame| frame.time_s);
    section.film = strip
        .into_iter()
        .enumerate()
        .map(|(index, jpeg)| FilmFrame { time_s: duration * index as f64 / (FILM_FRAMES - 1) as f64, jpeg })
        .collect();
    Ok(())
}

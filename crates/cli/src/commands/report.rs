//! `genmanip report`.

use std::path::PathBuf;
use std::sync::Arc;

use genmanip_assets::{Catalogue, panda};
use genmanip_bench::{
    AttemptRow, EvaluationReport, FilmFrame, ReportInput, ReportSettings, StatisticsSettings, TaskSection, Timing,
    compare, graph_svg, layout_svg, report_html,
};
use genmanip_core::{AttemptOutcome, Episode, EpisodeResult, Task};
use genmanip_data::EpisodeStore;
use genmanip_rollout::Stage;

use crate::args::ReportArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::pictures;
use crate::printer::Printer;
use crate::run_folder::{Run, RunFolder};

/// Moments of the film strip.
const FILM_FRAMES: usize = 12;

pub fn run(arguments: &ReportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let path = write(arguments, printer)?;
    printer.data(&path.display().to_string(), &path.display().to_string());
    Ok(ExitStatus::Done)
}

/// Writes the report of a run and says where.
pub fn write(arguments: &ReportArguments, printer: &Printer) -> Result<PathBuf, Failed> {
    let (folder, run) = RunFolder::open(&arguments.run)?;
    let store = folder.store()?;
    let evaluations = evaluations(&folder)?;
    let bar = printer.progress("drawing", run.tasks.len());
    let mut tasks = Vec::new();
    for task in &run.tasks {
        tasks.push(section(task, &run, &folder, &store, &evaluations)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let input = page(&arguments.run.display().to_string(), &run, &folder, &evaluations, tasks);
    let html = report_html(&input, &ReportSettings::default())
        .map_err(|error| Failed::because("cannot make the report", &error))?;
    let path = arguments.out.clone().unwrap_or_else(|| folder.join("report.html"));
    inputs::write_file(&path, html.as_bytes())?;
    Ok(path)
}

fn evaluations(folder: &RunFolder) -> Result<Vec<EvaluationReport>, Failed> {
    ["expert", "replay", "do_nothing"]
        .iter()
        .map(|policy| folder.join("evaluation").join(format!("{policy}.json")))
        .filter(|path| path.is_file())
        .map(|path| inputs::read_document(&path))
        .collect()
}

fn page(
    name: &str,
    run: &Run,
    folder: &RunFolder,
    evaluations: &[EvaluationReport],
    tasks: Vec<TaskSection>,
) -> ReportInput {
    let by_name = |name: &str| evaluations.iter().find(|report| report.policy == name);
    let comparisons = [("expert", "replay"), ("expert", "do_nothing")]
        .iter()
        .filter_map(|(a, b)| {
            let (a, b) = (by_name(a)?, by_name(b)?);
            compare(&a.results, &b.results, &StatisticsSettings::default()).ok()
        })
        .collect();
    let timings = folder.timings();
    ReportInput {
        title: "GenManip: from tasks to verified demonstrations".into(),
        generated_by: format!("genmanip {}", env!("CARGO_PKG_VERSION")),
        seed: run.seed,
        commands: vec![
            format!("genmanip collect TASKS --out {name} --episodes {} --seed {}", run.episodes_per_task, run.seed),
            format!("genmanip evaluate {name}"),
            format!("genmanip report {name}"),
        ],
        versions: vec![("genmanip".into(), run.genmanip_version.clone()), ("physics".into(), run.engine.clone())],
        summaries: evaluations.iter().map(|report| report.summary.clone()).collect(),
        control: by_name("do_nothing").map(|report| report.policy.clone()),
        comparisons,
        timings: timings.phases.iter().map(|(phase, &seconds)| Timing { phase: phase.clone(), seconds }).collect(),
        notes: notes(run),
        tasks,
    }
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
    run: &Run,
    folder: &RunFolder,
    store: &EpisodeStore,
    evaluations: &[EvaluationReport],
) -> Result<TaskSection, Failed> {
    let unreadable = |error| Failed::because("cannot read the episodes", &error);
    let timings = folder.timings();
    let mut attempts = Vec::new();
    let mut collected: Vec<EpisodeResult> = Vec::new();
    for id in store.ids().map_err(unreadable)? {
        let result = store.read_result(&id).map_err(unreadable)?;
        if result.task_id != task.id {
            continue;
        }
        attempts.push(AttemptRow {
            id: id.clone(),
            outcome: result.failure().map_or(AttemptOutcome::Verified, AttemptOutcome::Failed),
            seconds: timings.attempts.get(&id).copied().unwrap_or(0.0),
        });
        collected.push(result);
    }
    let recorded = |result: &&EpisodeResult| store.is_recorded(&result.id).unwrap_or(false);
    let shown = collected.iter().filter(recorded).max_by_key(|result| (result.success, std::cmp::Reverse(&result.id)));
    let mut section = TaskSection {
        task: task.clone(),
        scenario: None,
        graph: graph_svg(task),
        layout: None,
        first_image: None,
        last_image: None,
        film: Vec::new(),
        shown: shown.cloned(),
        attempts,
        results: evaluations
            .iter()
            .flat_map(|report| report.results.iter().filter(|result| result.task_id == task.id).cloned())
            .collect(),
    };
    if let Some(result) = shown {
        let episode = store.read(&result.id).map_err(unreadable)?;
        section.scenario = Some(episode.scenario.clone());
        section.layout = Some(layout_svg(&pictures::layout_picture(&episode.scenario, Catalogue::builtin())?));
        add_pictures(&mut section, episode, run)?;
    }
    Ok(section)
}

fn add_pictures(section: &mut TaskSection, episode: Episode, run: &Run) -> Result<(), Failed> {
    let stage = Stage::open(Arc::new(episode.scenario.clone()), Catalogue::builtin(), &panda(), &run.settings.sim)
        .map_err(|error| Failed::because(format!("cannot draw {}", episode.result.id), &error))?;
    let mut ends = pictures::stills(&stage, &episode, 2, 512)?;
    section.last_image = ends.pop();
    section.first_image = ends.pop();
    let strip = pictures::stills(&stage, &episode, FILM_FRAMES, 256)?;
    let duration = episode.frames.last().map_or(0.0, |frame| frame.time_s);
    section.film = strip
        .into_iter()
        .enumerate()
        .map(|(index, jpeg)| FilmFrame { time_s: duration * index as f64 / (FILM_FRAMES - 1) as f64, jpeg })
        .collect();
    Ok(())
}

//! Report of a run: all episodes as rows from one pass over their results, then images of selected cases.

mod full;
mod rows;
mod sections;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use genmanip_benchmark::rows::cases::{self, Case, MAX_CASES};
use genmanip_benchmark::{
    EvaluationReport, ReportInput, ReportSettings, StatisticsSettings, TaskSection, Timing, compare, report_html,
};

use genmanip_data::EpisodeStore;

use crate::evaluate::Unfinished;
use crate::folder::{Run, RunFolder, Timings};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use rows::Rows;
use sections::Drawing;

pub use full::{FullReport, report_full};

/// HTML page of a run, or only of the task or episode `only`.
///
/// # Errors
/// As [`gather`], and when the page would be too large.
pub fn report(
    path: &Path,
    only: Option<&str>,
    settings: &ReportSettings,
    progress: &dyn Progress,
) -> Result<String, WorkspaceError> {
    let input = gather(path, only, progress)?;
    report_html(&input, settings).map_err(|error| WorkspaceError::broken("cannot make the report", error))
}

/// Contents of the page, from a run folder.
///
/// Every attempt gives a row, from the run's index if that covers it. Frames are read and images rendered only for the
/// selected cases, whose number is bounded, one episode at a time.
///
/// # Errors
/// When there is no run, `only` is no task or episode of it, or an episode or an evaluation cannot be read or rendered.
pub fn gather(path: &Path, only: Option<&str>, progress: &dyn Progress) -> Result<ReportInput, WorkspaceError> {
    let mut opened = Opened::new(path, progress)?;
    let chosen = match only {
        Some(id) => only_cases(&mut opened.rows, id)?,
        None => cases::choose(&opened.rows.tasks, &opened.rows.episodes, opened.baseline.as_deref(), MAX_CASES),
    };
    let (mut drawn, mut damaged) = (Vec::new(), Vec::new());
    progress.begin("drawing", chosen.len());
    for case in chosen {
        drawn.push(opened.drawing().section(case, &mut damaged)?);
        progress.advance();
    }
    progress.end();
    opened.left_out.extend(damaged);
    opened.left_out.iter().for_each(|note| progress.note(note));
    let mut input = opened.into_input(drawn, false);
    if let Some(id) = only {
        narrow(&mut input, id, path);
    }
    Ok(input)
}

/// An opened run with all its episodes as rows.
struct Opened {
    path: PathBuf,
    folder: RunFolder,
    run: Run,
    store: EpisodeStore,
    timings: Timings,
    evaluations: Vec<EvaluationReport>,
    unfinished: Vec<Unfinished>,
    baseline: Option<String>,
    rows: Rows,
    /// Messages about omitted episodes.
    left_out: Vec<String>,
}

impl Opened {
    fn new(path: &Path, progress: &dyn Progress) -> Result<Self, WorkspaceError> {
        let (folder, run) = RunFolder::open(path)?;
        let store = folder.store()?;
        let timings = folder.timings();
        let evaluations = rows::evaluations(&folder, progress)?;
        let unfinished = rows::unfinished(&folder, &evaluations, progress)?;
        let baseline = evaluations.iter().find(|report| report.label == BASELINE).map(|report| report.label.clone());
        let results = rows::results(&evaluations, &unfinished);
        let (rows, left_out) = rows::read(&run, &folder, &store, results, &timings)?;
        let path = path.to_owned();
        Ok(Self { path, folder, run, store, timings, evaluations, unfinished, baseline, rows, left_out })
    }

    fn drawing(&self) -> Drawing<'_> {
        let Self { folder, store, run, evaluations, unfinished, rows, .. } = self;
        Drawing { folder, store, run, evaluations, unfinished, rows }
    }

    fn into_input(self, drawn: Vec<TaskSection>, has_pages: bool) -> ReportInput {
        let is_all = drawn.iter().all(|section| section.why.is_none());
        let name = self.path.display().to_string();
        let mut input = page(&name, &self.run, &self.timings, self.evaluations, self.rows, drawn);
        input.baseline = self.baseline;
        input.notes.extend(self.unfinished.iter().map(rows::note_on_unfinished));
        input.rule = (!is_all).then(|| cases::RULE.to_owned());
        input.notes.extend(self.left_out);
        input.has_pages = has_pages;
        input
    }
}

/// Name of the baseline policy, which must never succeed.
const BASELINE: &str = "do_nothing";

/// Keeps the rows of one task or one episode, and selects every one that can be rendered as a case.
fn only_cases(rows: &mut Rows, id: &str) -> Result<Vec<Case>, WorkspaceError> {
    let task = rows.tasks.iter().position(|task| task.id == id);
    let is_meant = |row: &genmanip_benchmark::EpisodeRow| task.map_or(row.id == id, |task| row.task == task);
    let found: Vec<usize> = (0..rows.episodes.len()).filter(|&index| is_meant(&rows.episodes[index])).collect();
    let Some(task) = task.or_else(|| Some(rows.episodes[*found.first()?].task)) else {
        let known = rows.tasks.iter().map(|task| &task.id).chain(rows.episodes.iter().map(|row| &row.id));
        let shared = |known: &str| known.bytes().zip(id.bytes()).take_while(|(a, b)| a == b).count();
        let near = known.max_by_key(|known| shared(known)).map_or(String::new(), |near| format!(", e.g. {near}"));
        return Err(WorkspaceError::input(format!("no task and no episode `{id}` in the run"))
            .with_hint(format!("expected the id of a task or an episode{near}")));
    };
    rows.episodes = found.into_iter().map(|index| rows.episodes[index].clone()).collect();
    let mut cases: Vec<Case> = (rows.episodes.iter().enumerate())
        .filter(|(_, row)| row.recorded)
        .take(MAX_CASES)
        .map(|(index, _)| Case { task, episode: Some(index), why: None })
        .collect();
    if cases.is_empty() {
        cases.push(Case { task, episode: (!rows.episodes.is_empty()).then_some(0), why: None });
    }
    Ok(cases)
}

/// Adapts the input of a run's page to a page about one task or episode.
fn narrow(input: &mut ReportInput, id: &str, path: &Path) {
    input.title = format!("GenManip: {id}");
    input.commands.pop();
    input.commands.push(format!("genmanip report {} --only {id}", path.display()));
    let task = input.cases.first().map(|case| case.task.id.clone()).unwrap_or_default();
    input.tasks.retain(|row| row.id == task);
    input.episodes.iter_mut().for_each(|row| row.task = 0);
    input.summaries.clear();
    input.not_run.clear();
    input.comparisons.clear();
    input.timings.clear();
}

fn page(
    name: &str,
    run: &Run,
    timings: &Timings,
    evaluations: Vec<EvaluationReport>,
    rows: Rows,
    cases: Vec<TaskSection>,
) -> ReportInput {
    let by_name = |name: &str| evaluations.iter().find(|report| report.label == name);
    let comparisons = [("expert", "replay"), ("expert", BASELINE)]
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
        commands: commands(name, run, &evaluations, !rows.episodes.iter().any(|row| row.is_attempt())),
        versions: vec![("genmanip".into(), run.genmanip_version.clone()), ("physics".into(), run.engine.clone())],
        summaries: evaluations.iter().map(|report| report.summary.clone()).collect(),
        not_run: evaluations
            .iter()
            .filter(|report| !report.not_run.is_empty())
            .map(|report| (report.summary.policy.clone(), report.not_run.clone()))
            .collect(),
        baseline: None,
        comparisons,
        timings: timings.phases.iter().map(|(phase, &seconds)| Timing { phase: phase.clone(), seconds }).collect(),
        notes: notes(run, &rows),
        tasks: rows.tasks,
        episodes: rows.episodes,
        cases,
        rule: None,
        has_pages: false,
    }
}

/// Command lines that reproduce the run, with the options that it records. A run made from scenario files (`is_given`)
/// has no `collect`.
fn commands(name: &str, run: &Run, evaluations: &[EvaluationReport], is_given: bool) -> Vec<String> {
    let policies: BTreeSet<&str> = evaluations.iter().map(|report| report.policy.as_str()).collect();
    let policies: String = policies.iter().map(|policy| format!(" --policy {policy}")).collect();
    let mut commands = Vec::new();
    if is_given {
        commands.push(format!("genmanip evaluate SCENARIOS{policies} --out {name}"));
    } else {
        let amount = match run.episodes_per_task {
            0 => "--verified N".into(),
            count => format!("--episodes {count}"),
        };
        let options = [("--no-dataset", run.settings.images.is_none()), ("--keep-failed", run.settings.keep_failed)];
        let options: String =
            options.iter().filter(|(_, is_set)| *is_set).map(|(option, _)| format!(" {option}")).collect();
        commands.push(format!("genmanip collect TASKS --out {name} {amount} --seed {}{options}", run.seed));
        if !policies.is_empty() {
            commands.push(format!("genmanip evaluate {name}{policies}"));
        }
    }
    commands.push(format!("genmanip report {name}"));
    commands
}

/// Notes for the reader of the report.
fn notes(run: &Run, rows: &Rows) -> Vec<String> {
    let tasks = run.tasks.entries().len();
    let mut notes = vec![
        "The commands do not show every option: run.json has every setting of the run, and the label of an evaluation \
             the arguments of its policy."
            .into(),
        "The expert reads simulator truth; its results are marked oracle.".into(),
        "Replay applies the recorded commands without looking; it shows that the simulation is deterministic, \
             not that a policy is good."
            .into(),
        format!(
            "{} of {tasks} tasks are recorded answers of a language model; every task passed every rule.",
            rows.recorded_answers
        ),
    ];
    let (made, planned) = (rows.episodes.iter().filter(|row| row.is_attempt()).count(), tasks * run.episodes_per_task);
    if made > 0 && made < planned {
        notes.push(format!("Not all was collected yet: {made} of {planned} attempts are finished."));
    }
    notes
}

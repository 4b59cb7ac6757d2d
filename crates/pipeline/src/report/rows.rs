//! The first pass over a run: every episode as a row.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use genmanip_benchmark::{EpisodeRow, EvaluationReport, TaskRow};
use genmanip_core::{AgentFailure, limits};
use genmanip_data::{DataError, EpisodeStore};

use crate::evaluate::kept_episodes;
use crate::folder::{Run, RunFolder, Timings};
use crate::index::IndexedAttempt;
use crate::policies::POLICIES;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// All tasks and episodes of a run.
#[derive(Default)]
pub(super) struct Rows {
    /// Rows of the tasks, in the order of the run.
    pub tasks: Vec<TaskRow>,
    /// Rows of the attempts, ordered by id, then of the episodes of each evaluation.
    pub episodes: Vec<EpisodeRow>,
    /// Number of tasks that come from recorded answers of a language model.
    pub recorded_answers: usize,
}

/// Rows of every attempt and of every episode of the evaluations; reports what was omitted through `progress`.
///
/// # Errors
/// When the store cannot be listed.
pub(super) fn read(
    run: &Run,
    folder: &RunFolder,
    store: &EpisodeStore,
    evaluations: &[EvaluationReport],
    timings: &Timings,
) -> Result<(Rows, Vec<String>), WorkspaceError> {
    let survey = folder.survey(store)?;
    let mut left_out = survey.notes();
    let index: BTreeMap<&str, usize> =
        run.tasks.entries().iter().enumerate().map(|(index, task)| (task.id.as_str(), index)).collect();
    let mut rows = Rows::default();
    for task in run.tasks.iter() {
        let task = task?;
        rows.recorded_answers += usize::from(task.source.starts_with("recorded answer"));
        rows.tasks.push(TaskRow::of(&task));
    }
    let mut foreign = 0;
    for IndexedAttempt { id, task_id, recorded, outcome, .. } in survey.sound {
        match index.get(task_id.as_str()) {
            Some(&task) => {
                let wall_s = timings.attempts.get(&id).copied();
                rows.episodes.push(EpisodeRow { id, task, evaluation: None, outcome, recorded, wall_s });
            }
            None => foreign += 1,
        }
    }
    if foreign > 0 {
        left_out.push(format!("{foreign} episodes are of tasks that are not in the run; they are left out"));
    }
    for report in evaluations {
        let kept = kept_store(folder, &report.label).unwrap_or_else(|why| {
            left_out.push(format!("episodes kept by {} are left out: {why}", report.label));
            None
        });
        for result in &report.results {
            let Some(&task) = index.get(result.task_id.as_str()) else { continue };
            let is_kept = kept.as_ref().is_some_and(|store| store.contains(&result.id));
            rows.episodes.push(EpisodeRow::of(result, task, Some(&report.label), is_kept, None));
        }
    }
    Ok((rows, left_out))
}

/// Store of the episodes that an evaluation kept; `None` if it kept none.
///
/// # Errors
/// When the folder exists and its store cannot be opened.
pub(super) fn kept_store(folder: &RunFolder, label: &str) -> Result<Option<EpisodeStore>, DataError> {
    let path = kept_episodes(folder, label);
    path.join("store.json").is_file().then(|| EpisodeStore::open(path)).transpose()
}

/// All finished evaluations of a run; other and unreadable files are reported and omitted.
pub(super) fn evaluations(
    folder: &RunFolder,
    progress: &dyn Progress,
) -> Result<Vec<EvaluationReport>, WorkspaceError> {
    let path = folder.join("evaluation");
    let listed = match fs::read_dir(&path) {
        Ok(entries) => entries.collect::<Result<Vec<_>, _>>(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => Err(error),
    };
    let mut files: Vec<PathBuf> = listed
        .map_err(|error| WorkspaceError::file("list", &path, error))?
        .into_iter()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "json") && !is_hidden(path))
        .collect();
    // Order: policies of the registry in its order, then all others by name.
    let place = |path: &PathBuf| {
        let stem = documents::stem(path);
        (POLICIES.iter().position(|entry| entry.name == stem).unwrap_or(POLICIES.len()), stem)
    };
    files.sort_by_key(place);
    let mut reports: Vec<EvaluationReport> = Vec::new();
    for path in &files {
        match documents::read_document_no_follow(path, limits::EVALUATION) {
            Ok(report) => reports.push(report),
            Err(error) => {
                let why = std::error::Error::source(&error).map_or_else(String::new, |source| format!(": {source}"));
                progress.note(&format!("left out of the report: {error}{why}"));
            }
        }
    }
    // The page identifies evaluations by policy names, so these are replaced by the unique labels.
    for report in &mut reports {
        report.summary.policy.clone_from(&report.label);
        for result in &mut report.results {
            result.policy.clone_from(&report.label);
            result.agent_failure.as_mut().into_iter().for_each(locate_transcript);
            // Drop the conditions of every verdict to save memory; those of the episodes shown are read again.
            result.verdict.alternatives = Vec::new();
        }
    }
    Ok(reports)
}

/// Makes the path of a transcript absolute, so that pages in any folder can link to it, and prefers its HTML page.
/// The path is removed if no such file exists.
pub(super) fn locate_transcript(failure: &mut AgentFailure) {
    let found = failure.transcript.take().and_then(|path| {
        let path = Path::new(&path);
        path.with_extension("html").canonicalize().or_else(|_| path.canonicalize()).ok()
    });
    failure.transcript = found.map(|path| path.display().to_string());
}

/// True for a name that begins with a dot: unfinished files of a program that is running or was killed.
fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

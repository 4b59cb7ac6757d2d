//! The first pass over a run: every episode as a row.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use genmanip_benchmark::{EpisodeRow, EvaluationReport, TaskRow};
use genmanip_core::{AgentFailure, EpisodeResult, limits};
use genmanip_data::{DataError, EpisodeStore};

use crate::evaluate::{Unfinished, kept_episodes};
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
pub(super) fn read<'a>(
    run: &Run,
    folder: &RunFolder,
    store: &EpisodeStore,
    evaluations: impl Iterator<Item = (&'a str, &'a [EpisodeResult])>,
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
    for (label, results) in evaluations {
        let kept = kept_store(folder, label).unwrap_or_else(|why| {
            left_out.push(format!("episodes kept by {label} are left out: {why}"));
            None
        });
        for result in results {
            let Some(&task) = index.get(result.task_id.as_str()) else { continue };
            let is_kept = kept.as_ref().is_some_and(|store| store.contains(&result.id));
            rows.episodes.push(EpisodeRow::of(result, task, Some(label), is_kept, None));
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
    let mut files: Vec<PathBuf> = listed(folder)?
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
    for report in &mut reports {
        report.summary.policy.clone_from(&report.label);
        name_by_label(&mut report.results, &report.label);
    }
    Ok(reports)
}

/// Evaluations with journals and without a report; those whose journals cannot be read are reported and omitted.
pub(super) fn unfinished(
    folder: &RunFolder,
    finished: &[EvaluationReport],
    progress: &dyn Progress,
) -> Result<Vec<Unfinished>, WorkspaceError> {
    let is_folder = |entry: &fs::DirEntry| entry.file_type().is_ok_and(|kind| kind.is_dir());
    let entries = listed(folder)?.into_iter().filter(|entry| is_folder(entry) && !is_hidden(&entry.path()));
    let mut labels: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    labels.retain(|label| finished.iter().all(|report| report.label != *label));
    labels.sort();
    let mut found = Vec::new();
    for label in labels {
        match Unfinished::read(folder, &label) {
            Ok(unfinished) => found.extend(unfinished),
            Err(error) => progress.note(&format!("left out of the report: {error}")),
        }
    }
    for Unfinished { label, results } in &mut found {
        name_by_label(results, label);
    }
    found.iter().for_each(|unfinished| progress.note(&note_on_unfinished(unfinished)));
    Ok(found)
}

/// Note for the reader of a report that shows an unfinished evaluation.
pub(super) fn note_on_unfinished(Unfinished { label, results }: &Unfinished) -> String {
    let count = results.len();
    format!(
        "The evaluation {label} is not finished: its {count} results so far are listed without a success rate. The same \
         `genmanip evaluate` without --shard gathers all shards and does the rest."
    )
}

/// Labels and results of all evaluations.
pub(super) fn results<'a>(
    finished: &'a [EvaluationReport],
    unfinished: &'a [Unfinished],
) -> impl Iterator<Item = (&'a str, &'a [EpisodeResult])> {
    let finished = finished.iter().map(|report| (report.label.as_str(), report.results.as_slice()));
    finished.chain(unfinished.iter().map(|one| (one.label.as_str(), one.results.as_slice())))
}

/// Replaces policy names by the label, by which the page identifies evaluations.
fn name_by_label(results: &mut [EpisodeResult], label: &str) {
    for result in results {
        result.policy = label.to_owned();
        result.agent_failure.as_mut().into_iter().for_each(locate_transcript);
        // Drop the conditions of every verdict to save memory; those of the episodes shown are read again.
        result.verdict.alternatives = Vec::new();
    }
}

/// Entries of the folder of evaluations.
fn listed(folder: &RunFolder) -> Result<Vec<fs::DirEntry>, WorkspaceError> {
    let path = folder.join("evaluation");
    let listed = match fs::read_dir(&path) {
        Ok(entries) => entries.collect::<Result<Vec<_>, _>>(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => Err(error),
    };
    listed.map_err(|error| WorkspaceError::file("list", &path, error))
}

/// Makes the path of a transcript absolute, so that pages in any folder can link to it, and prefers its HTML page. The
/// path is removed if no such file exists.
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

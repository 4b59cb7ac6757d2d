//! Tasks by rules into a folder: written as they are composed, so that a kind that runs out costs nothing that is there.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use genmanip_core::{Document, ObjectCard, Seed, Task, TaskKind, limits};
use genmanip_data::files;
use genmanip_rollout::collect::in_parallel;
use genmanip_tasks::designer::{DesignSettings, Missing, Series};
use serde::Serialize;

use crate::Progress;
use crate::RunError;
use crate::documents;

/// A task of a folder, or why it is missing there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NewTask {
    /// Id of the task.
    pub task: String,
    /// Its kind.
    pub kind: &'static str,
    /// What it asks for; `None` when there is no task.
    pub instruction: Option<String>,
    /// Its file; `None` when there is no task.
    pub file: Option<String>,
    /// Why there is no task.
    pub refused: Option<String>,
}

/// What is designed.
#[derive(Clone, Debug)]
pub struct Design<'a> {
    /// Kinds, in turn.
    pub kinds: &'a [TaskKind],
    /// Tasks.
    pub count: usize,
    /// Objects that they may be about.
    pub cards: &'a [ObjectCard],
    /// Seed of the series.
    pub seed: Seed,
    /// How they are composed.
    pub settings: DesignSettings,
    /// Whether other kinds take the place of one that has run out.
    pub fill: bool,
}

/// Composes tasks and writes each as a file of the folder; one that is there already and the same is left alone, so a
/// call with a larger count continues one with a smaller.
///
/// A task whose kind has run out is a row with the reason, not an error.
///
/// # Errors
/// When no kind is asked for, a file cannot be written, or a file of the same name holds another task.
pub fn design_into(folder: &Path, design: &Design, progress: &dyn Progress) -> Result<Vec<NewTask>, RunError> {
    let Design { kinds, count, cards, seed, ref settings, fill } = *design;
    let mut series = Series::new(kinds, cards, seed, settings, fill)
        .map_err(|error| RunError::broken("the designer gave up", error))?;
    let mut rows = Vec::with_capacity(count);
    progress.begin("designing", count);
    while rows.len() < count {
        let composed: Vec<_> = (rows.len()..count).take(BATCH).map(|_| series.compose()).collect();
        rows.extend(in_parallel(&composed, WRITERS, &AtomicBool::new(false), &|composed| {
            progress.advance();
            match composed {
                Ok(task) => keep(task, folder),
                Err(missing) => Ok(NewTask::missing(missing)),
            }
        })?);
    }
    progress.end();
    Ok(rows)
}

/// Tasks that are composed before they are written together, and threads that write them; chosen: a disk takes as long to
/// flush one file as many at the same time, and no more than a second's work is lost when the program is killed.
const BATCH: usize = 128;
const WRITERS: usize = 16;

/// Writes a task unless the folder has it.
fn keep(task: &Task, folder: &Path) -> Result<NewTask, RunError> {
    let path = folder.join(format!("{}.json", task.id));
    let text = task.to_json();
    if !files::is_own_file(&path) {
        return write(task, folder);
    }
    let known = files::read_own(&path, limits::TASK).map_err(|error| RunError::of_file("read", &path, error))?;
    match known == text.as_bytes() {
        true => Ok(NewTask::written(task, &path)),
        false => Err(RunError::input(format!("{} holds another task than this call composes", path.display()))
            .with_hint("repeat the call that made it with a larger --count only, or choose an empty --out folder")),
    }
}

/// Writes a task as a file of a folder; one of that name is replaced.
///
/// # Errors
/// When it cannot be written.
pub fn write(task: &Task, folder: &Path) -> Result<NewTask, RunError> {
    let path = folder.join(format!("{}.json", task.id));
    documents::write_file(&path, task.to_json().as_bytes())?;
    Ok(NewTask::written(task, &path))
}

impl NewTask {
    fn written(task: &Task, path: &Path) -> Self {
        Self {
            task: task.id.clone(),
            kind: task.kind.name(),
            instruction: Some(task.instruction.clone()),
            file: Some(path.display().to_string()),
            refused: None,
        }
    }

    fn missing(missing: &Missing) -> Self {
        let (task, kind) = (missing.id.clone(), missing.kind.name());
        Self { task, kind, instruction: None, file: None, refused: Some(missing.why.to_string()) }
    }
}

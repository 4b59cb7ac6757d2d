//! Composition of tasks by the rule-based designer; each is written into a folder at once.
//!
//! If a kind of task is exhausted, the tasks written before stay valid.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use genmanip_core::{AssetUid, Atom, Document, ObjectCard, Seed, Task, TaskKind, limits};
use genmanip_data::files;
use genmanip_rollout::collect::in_parallel;
use genmanip_tasks::designer::{DesignSettings, Missing, SentenceError, Series, task_from_sentence};
use serde::Serialize;

use crate::Progress;
use crate::WorkspaceError;
use crate::documents;

/// Row of [`design_into`]: a task file, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NewTask {
    /// Id of the task, which is also the name of its file.
    pub task: String,
    /// Name of the task's kind.
    pub kind: &'static str,
    /// Instruction in English; `None` if there is no task.
    pub instruction: Option<String>,
    /// Path of the task file; `None` if there is no task.
    pub file: Option<String>,
    /// Reason why no task could be composed; `None` if there is a task.
    pub refused: Option<String>,
}

/// Number, kinds and objects of the tasks that [`design_into`] composes.
#[derive(Clone, Debug)]
pub struct Design<'a> {
    /// Kinds of task, composed in rotation.
    pub kinds: &'a [TaskKind],
    /// Number of tasks to compose.
    pub count: usize,
    /// Objects that the tasks may use.
    pub cards: &'a [ObjectCard],
    /// Seed of the series of tasks.
    pub seed: Seed,
    /// Settings of the designer.
    pub settings: DesignSettings,
    /// True if a task whose kind fails is replaced by one of the next kind that succeeds.
    pub fill: bool,
    /// Uid of an object that the goal of every task involves. `None` for any objects.
    pub include: Option<&'a AssetUid>,
}

/// Composes tasks and writes each as a file of the folder. An existing file with the same content is kept, so a call
/// with a larger `count` extends the folder of a smaller one.
///
/// A task that cannot be composed is a row with the reason, not an error.
///
/// # Errors
/// When `kinds` is empty, a file cannot be written, or a file of the same name holds another task.
pub fn design_into(folder: &Path, design: &Design, progress: &dyn Progress) -> Result<Vec<NewTask>, WorkspaceError> {
    let Design { kinds, count, cards, seed, ref settings, fill, include } = *design;
    let mut series = Series::new(kinds, cards, seed, settings, fill)
        .map_err(|error| WorkspaceError::broken("the designer gave up", error))?;
    let mut rows = Vec::with_capacity(count);
    progress.begin("designing", count);
    while rows.len() < count {
        let composed: Vec<_> =
            (rows.len()..count).take(BATCH).map(|_| compose(&mut series, include)).collect::<Result<_, _>>()?;
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

/// Composes `count` scenes from a sentence, and writes each as a task file of the folder, like [`design_into`].
///
/// # Errors
/// When the sentence is not understood or no scene suits it, before anything is written; when a file cannot be written,
/// or a file of the same name holds another task.
pub fn compose_into(
    folder: &Path,
    sentence: &str,
    count: usize,
    cards: &[ObjectCard],
    seed: Seed,
    settings: &DesignSettings,
    progress: &dyn Progress,
) -> Result<Vec<NewTask>, WorkspaceError> {
    let name = slug(sentence);
    progress.begin("designing", count);
    let tasks: Vec<Task> = (0..count)
        .map(|index| {
            let id = format!("{name}-{seed}-{index:05}");
            let task = task_from_sentence(sentence, cards, seed.fork_index(index as u64), &id, settings);
            progress.advance();
            task.map_err(|error| {
                let hint = hint_for(&error);
                WorkspaceError::broken("there is no task for the sentence", error).with_hint(hint)
            })
        })
        .collect::<Result<_, _>>()?;
    let rows = tasks.iter().map(|task| keep(task, folder)).collect();
    progress.end();
    rows
}

/// First words of a sentence as part of a file name.
fn slug(sentence: &str) -> String {
    const MAX_LETTERS: usize = 40;
    let letters = sentence.to_lowercase();
    let words = letters.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let mut name = String::new();
    for word in words {
        if name.len() + word.len() > MAX_LETTERS {
            break;
        }
        name += if name.is_empty() { "" } else { "-" };
        name += word;
    }
    if name.is_empty() { "sentence".into() } else { name }
}

fn hint_for(error: &SentenceError) -> &'static str {
    match error {
        SentenceError::Unreadable { .. } => {
            "say what to move and where, or what to open, close or turn: \"put the red mug to the left of the bowl\", \
             \"take the apple out of the bowl and put it on the plate\", \"open the top drawer of the cabinet\""
        }
        SentenceError::NoObject { .. } => "name a candidate, or search the catalogue: genmanip assets search WORDS",
        SentenceError::Unsuitable { .. } => "name another object for this part of the sentence",
        SentenceError::NoScene { .. } => "ask for fewer objects, name them more precisely, or try another --seed",
    }
}

/// Next task of the series; with `include`, the next one whose goal involves that object. The inner error describes a
/// task that could not be composed; the outer one ends the series.
fn compose(series: &mut Series, include: Option<&AssetUid>) -> Result<Result<Task, Missing>, WorkspaceError> {
    let Some(uid) = include else { return Ok(series.compose()) };
    let involves = |task: &Task| {
        let named = task.goal.alternatives.iter().flatten().flat_map(Atom::ids);
        named.filter_map(|id| task.card(id)).any(|card| card.uid == *uid)
    };
    for _ in 0..MOST_WITHOUT {
        match series.compose() {
            Ok(task) if !involves(&task) => {}
            composed => return Ok(composed),
        }
    }
    Err(WorkspaceError::input(format!("none of {MOST_WITHOUT} tasks involves object {uid}"))
        .with_hint("offer fewer other objects with --objects, or choose another --kind"))
}

/// Maximum number of tasks composed without the wanted object before the search ends. A goal involves about two of
/// 1,120 objects (all families), so one task in about 560 involves a given object.
const MOST_WITHOUT: usize = 10_000;

/// Number of tasks composed before they are written in parallel, and (`WRITERS`) number of writer threads. Flushing
/// many files at once takes a disk as long as flushing one, and a kill loses at most a second's work.
const BATCH: usize = 128;
const WRITERS: usize = 16;

/// Writes a task unless the folder already has it.
fn keep(task: &Task, folder: &Path) -> Result<NewTask, WorkspaceError> {
    let path = folder.join(format!("{}.json", task.id));
    let text = task.to_json();
    if !files::is_file_no_follow(&path) {
        return write(task, folder);
    }
    let known =
        files::read_no_follow(&path, limits::TASK).map_err(|error| WorkspaceError::of_file("read", &path, error))?;
    match known == text.as_bytes() {
        true => Ok(NewTask::written(task, &path)),
        false => Err(WorkspaceError::input(format!("{} holds another task than this call composes", path.display()))
            .with_hint("repeat the call that made it with a larger --count only, or choose an empty --out folder")),
    }
}

/// Writes a task as a file of a folder; replaces a file of that name.
///
/// # Errors
/// When the file cannot be written.
pub fn write(task: &Task, folder: &Path) -> Result<NewTask, WorkspaceError> {
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

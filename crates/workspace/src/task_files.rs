//! Tasks from files: task documents, recorded answers of language models, and lists of task documents, one per line.

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, Read};
use std::path::{Path, PathBuf};

use genmanip_assets::Catalogue;
use genmanip_assets::search::Filter;
use genmanip_core::limits::{self, Limit};
use genmanip_core::names::fits_file_name;
use genmanip_core::{Document, DocumentError, InstanceId, ObjectCard, Seed, SharedCards, Task, TaskKind, json};
use genmanip_data::{DataError, files};
use genmanip_tasks::answer::{AnswerReport, MAX_ANSWER_BYTES, RecordedAnswer, TaskRequest, check_answer};
use genmanip_tasks::designer::{DesignSettings, design_many};
use serde_json::Value;

use crate::documents::{nearest_folder, not_a_document, read_text, stem, text_of, unreadable};
use crate::error::WorkspaceError;
use crate::task_faults::{self, Fault, MAX_ID_LENGTH};
use crate::task_spool::{Spool, Tasks};
use crate::worlds::read_world;

/// Reads tasks from task documents, recorded answers, and lists (`*.jsonl`) with a task document per line. A rejected
/// answer is an error.
///
/// # Errors
/// As [`read_task`], and when two tasks share an id.
pub fn read_tasks(paths: &[PathBuf]) -> Result<Vec<Task>, WorkspaceError> {
    let mut tasks: Vec<Task> = Vec::new();
    let mut cards = SharedCards::default();
    each_task(paths, |mut task| {
        cards.share(&mut task);
        tasks.push(task);
        Ok(())
    })?;
    Ok(tasks)
}

/// Reads tasks as [`read_tasks`] does, but spools their texts to the disk of `out`, so that memory holds only ids and
/// kinds.
///
/// # Errors
/// As [`read_tasks`], and when the spool file cannot be written.
pub fn spool_tasks(paths: &[PathBuf], out: &Path) -> Result<Tasks, WorkspaceError> {
    let mut spool = Spool::in_folder(nearest_folder(out).as_deref().unwrap_or(Path::new(".")));
    each_task(paths, |task| spool.add(task))?;
    Ok(spool.finish())
}

/// Reads one task from a task document or a recorded answer.
///
/// # Errors
/// When the file is neither, or the task breaks a rule.
pub fn read_task(path: &Path) -> Result<Task, WorkspaceError> {
    task_of_text(path, &read_text(path, limits::TASK)?)
}

/// Files named by the user; a folder is expanded to its `*.json` files, sorted by name.
///
/// # Errors
/// When a folder cannot be listed or holds no such file.
pub fn expand(paths: &[PathBuf]) -> Result<Vec<PathBuf>, WorkspaceError> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let entries = fs::read_dir(path).map_err(|error| WorkspaceError::file("list", path, error))?;
        let mut inside: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.extension().is_some_and(|extension| extension == "json"))
            .collect();
        inside.sort();
        if inside.is_empty() {
            return Err(WorkspaceError::input(format!("no *.json in {}", path.display()))
                .with_hint("name task files or their folder"));
        }
        files.append(&mut inside);
    }
    Ok(files)
}

fn each_task(
    paths: &[PathBuf],
    mut take: impl FnMut(Task) -> Result<(), WorkspaceError>,
) -> Result<(), WorkspaceError> {
    let mut known = BTreeSet::new();
    let mut take = |task: Task, place: &Path| {
        if !known.insert(task.id.clone()) {
            return Err(WorkspaceError::input(format!(
                "two tasks are called `{}` (the second: {})",
                task.id,
                place.display()
            ))
            .with_hint("task ids name folders and files, so they must differ"));
        }
        take(task)
    };
    for path in expand(paths)? {
        if is_list(&path) {
            each_line(&path, &mut |place, text| take(task_of_text(place, &text?)?, place))?;
        } else {
            take(read_task(&path)?, &path)?;
        }
    }
    Ok(())
}

/// True if a file is a list (`*.jsonl`) with a task document per line.
pub fn is_list(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "jsonl")
}

/// Callback of [`each_line`]: receives `FILE:LINE` and the text of the line or the error of reading it.
pub type TakeLine<'a> = dyn FnMut(&Path, Result<String, WorkspaceError>) -> Result<(), WorkspaceError> + 'a;

/// Passes every non-empty line of a list to `take`; lines that are too long or not UTF-8 are passed as errors.
pub fn each_line(path: &Path, take: &mut TakeLine) -> Result<(), WorkspaceError> {
    let mut lines = files::open_list(path).map_err(|error| unreadable(path, error))?;
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let failed = |error| WorkspaceError::file("read", path, error);
        if lines.by_ref().take(limits::TASK.bytes + 1).read_until(b'\n', &mut line).map_err(failed)? == 0 {
            break;
        }
        let place = PathBuf::from(format!("{}:{number}", path.display()));
        if line.len() as u64 > limits::TASK.bytes {
            if !line.ends_with(b"\n") {
                lines.skip_until(b'\n').map_err(failed)?;
            }
            take(&place, Err(WorkspaceError::TooLarge { path: place.clone(), limit: limits::TASK }))?;
        } else if !line.trim_ascii().is_empty() {
            take(&place, text_of(&place, std::mem::take(&mut line)))?;
        }
    }
    Ok(())
}

/// Tasks of the rule-based designer on the objects of a catalogue, the six kinds in rotation.
///
/// # Errors
/// When the designer finds no task.
pub fn designed_tasks(count: usize, seed: u64, catalogue: &Catalogue) -> Result<Vec<Task>, WorkspaceError> {
    let cards = catalogue.cards();
    let batch = design_many(&TaskKind::ALL, count, cards, Seed::new(seed), &DesignSettings::default())
        .map_err(|error| WorkspaceError::broken("the designer gave up", error))?;
    Ok(batch.tasks)
}

/// Task of a text; messages name it by `path`.
fn task_of_text(path: &Path, text: &str) -> Result<Task, WorkspaceError> {
    let value = json::parse(text).map_err(|error| {
        let hint = if let DocumentError::NotJson { hint, .. } = &error { *hint } else { "" };
        WorkspaceError::input(format!("{} is no task document and no recorded answer", path.display()))
            .with_hint(format!("{hint}; see `genmanip task check --help`"))
            .because(error)
    })?;
    if value.get("schema").is_some() {
        let task = task_of_document(path, value)?;
        let mut faults = task_faults::faults(&task).into_iter();
        let Some(Fault { place, message, hint, .. }) = faults.next() else { return Ok(task) };
        let more = match faults.count() {
            0 => String::new(),
            more => format!(" (and {more} more; `genmanip task check` lists all)"),
        };
        return Err(WorkspaceError::input(format!("{}: at {place}: {message}{more}", path.display())).with_hint(hint));
    }
    let report = check_recorded(path, text)?;
    report.task.ok_or_else(|| {
        let flaws: Vec<String> =
            report.flaws.iter().map(|flaw| format!("{}: {}", flaw.kind.name(), flaw.message)).collect();
        WorkspaceError::input(format!("{} holds no valid task: {}", path.display(), flaws.join("; ")))
            .with_hint(format!("see `genmanip task check {}`", path.display()))
    })
}

/// Task of a parsed document, without the checks of [`task_faults`].
///
/// # Errors
/// [`WorkspaceError::Document`] if the document does not follow the schema.
pub fn task_of_document(path: &Path, value: Value) -> Result<Task, WorkspaceError> {
    Task::from_value(value).map_err(|error| not_a_document::<Task>(path, error))
}

/// Checks a recorded-answer file.
///
/// # Errors
/// When the text is no recorded answer, or offers an object that is not in the catalogue.
pub fn check_recorded(path: &Path, text: &str) -> Result<AnswerReport, WorkspaceError> {
    let recorded = RecordedAnswer::from_json(text).map_err(|error| {
        let hint = "for a bare answer name what was offered: --objects UID,UID,…";
        let hint = error.hint().map_or_else(|| hint.to_owned(), |wrong| format!("{wrong}; {hint}"));
        WorkspaceError::input(format!("{} is no recorded answer", path.display())).because(error).with_hint(hint)
    })?;
    let request = TaskRequest {
        id: id_from(path),
        kind: recorded.task_type,
        offered: offered(&recorded.objects, &format!("{}: at $.objects", path.display()))?,
        surfaces: recorded.surfaces,
        min_objects: recorded.num_objects,
        between: false,
        source: format!("recorded answer {}", path.file_name().unwrap_or_default().to_string_lossy()),
    };
    Ok(check_answer(&recorded.response, &request))
}

/// Objects selected by a text: uids separated by commas, or a search query for `catalogue` if no part is or resembles a
/// uid.
///
/// # Errors
/// When a uid is unknown, or nothing fits the query.
pub fn select_objects(text: &str, catalogue: &Catalogue) -> Result<Vec<ObjectCard>, WorkspaceError> {
    let parts = text.split(',').map(|part| part.trim().to_owned()).filter(|part| !part.is_empty());
    let parts: Vec<String> = parts.collect();
    let is_uid = |part: &String| {
        let Ok(id) = part.parse::<InstanceId>() else { return false };
        let uid = &id.asset();
        let is_like_one = uid.as_str().contains(|c: char| c.is_ascii_digit())
            && uid.as_str().chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        is_like_one || Catalogue::builtin().card(uid).or_else(|| Catalogue::all().card(uid)).is_some()
    };
    if parts.iter().any(is_uid) {
        let ids = parts.iter().map(|part| part.parse()).collect::<Result<Vec<_>, _>>();
        let ids = ids.map_err(|error| WorkspaceError::input("--objects").because(error))?;
        return offered(&ids, "--objects");
    }
    let index = catalogue.index();
    let found = index.search(text, &Filter::default(), usize::MAX);
    if found.is_empty() {
        return Err(WorkspaceError::input(format!("no object fits \"{text}\""))
            .with_hint("expected uids, or words as with `genmanip assets search`"));
    }
    Ok(found.iter().map(|one| one.card.clone()).collect())
}

/// Checks a bare answer (one without its request); `objects` as in [`select_objects`]. `min_objects` is 2 by default,
/// or 1 if one object was offered.
///
/// # Errors
/// When the file cannot be read, the kind is unknown, or an offered object is not in the catalogue.
pub fn check_bare(
    path: &Path,
    objects: &str,
    world: Option<&Path>,
    kind: &str,
    min_objects: Option<usize>,
) -> Result<AnswerReport, WorkspaceError> {
    let kind = task_kind(kind)?;
    let offered = select_objects(objects, Catalogue::all())?;
    let min_objects = min_objects.unwrap_or_else(|| offered.len().min(MIN_OBJECTS));
    let request = TaskRequest {
        id: id_from(path),
        kind,
        offered,
        surfaces: read_world(world)?.named_surfaces(),
        min_objects,
        between: false,
        source: format!("answer {}", path.file_name().unwrap_or_default().to_string_lossy()),
    };
    // A larger answer is replaced by blanks: the check rejects it by its length alone.
    let bytes = match files::read(path, Limit { what: "an answer", bytes: MAX_ANSWER_BYTES as u64 }) {
        Err(DataError::TooLarge { .. }) => vec![b' '; MAX_ANSWER_BYTES + 1],
        bytes => bytes.map_err(|error| unreadable(path, error))?,
    };
    Ok(check_answer(&String::from_utf8_lossy(&bytes), &request))
}

/// Kind of task by its name in files.
///
/// # Errors
/// [`WorkspaceError::UnknownName`].
pub fn task_kind(name: &str) -> Result<TaskKind, WorkspaceError> {
    let known = TaskKind::ALL.map(TaskKind::name);
    TaskKind::named(name).ok_or_else(|| WorkspaceError::unknown("kind", "kinds", name, &known))
}

/// Default minimum number of objects of a bare answer.
const MIN_OBJECTS: usize = 2;

fn offered(ids: &[InstanceId], place: &str) -> Result<Vec<ObjectCard>, WorkspaceError> {
    let catalogue = Catalogue::builtin();
    ids.iter()
        .map(|id| match catalogue.card(&id.asset()).or_else(|| Catalogue::all().card(&id.asset())) {
            Some(card) => Ok(card.clone()),
            // Building the model of an unknown object yields an error with similar uids.
            None => catalogue.build(id.as_str()).map(|model| model.card.clone()).map_err(|error| {
                WorkspaceError::input(format!("{place}: an offered object is not in the catalogue"))
                    .because(error)
                    .with_hint("uids are 001 to 064, or as `genmanip assets list` says")
            }),
        })
        .collect()
}

/// Task id from a file name; characters that are not allowed in folder names become `_`.
fn id_from(path: &Path) -> String {
    let fit = |c: char| if fits_file_name(c) { c } else { '_' };
    let id: String = stem(path).trim_start_matches('.').chars().map(fit).take(MAX_ID_LENGTH).collect();
    if id.is_empty() { "task".into() } else { id }
}

//! Checks of task documents and recorded answers: reports every flaw of every file.

use std::path::{Path, PathBuf};

use genmanip_core::{Document, Task, json, limits};
use genmanip_tasks::answer::{AnswerReport, TaskRequest, Verdict, check_answer};
use genmanip_tasks::designer::as_answer;
use serde::Serialize;
use serde_json::Value;

use crate::WorkspaceError;
use crate::documents;
use crate::task_faults;
use crate::task_files;

/// Result of the check of one file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FileCheck {
    /// Path of the file as given; `FILE:LINE` for a line of a list.
    pub file: String,
    /// Verdict on the file: `valid`, `repaired` or `rejected`.
    pub verdict: &'static str,
    /// Names of all flaws, whether repaired or not.
    pub flaws: Vec<String>,
    /// Repairs made, in words.
    pub repairs: Vec<String>,
    /// Details, one per flaw.
    pub details: Vec<FlawDetail>,
    /// Valid or repaired task document; `None` if rejected.
    pub task: Option<Value>,
}

/// Details of one flaw.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FlawDetail {
    /// Name of the flaw.
    pub flaw: String,
    /// JSON path, or line and column of a syntax error.
    pub path: String,
    /// Expected and found values, in words.
    pub message: String,
    /// Suggested fix; may be empty.
    pub hint: String,
}

/// Request against which bare answers (without their request) are checked.
#[derive(Clone, Copy, Debug)]
pub struct BareAnswers<'a> {
    /// Offered objects, see [`task_files::select_objects`].
    pub objects: &'a str,
    /// World file whose additional support surfaces were offered too; `None` for none.
    pub world: Option<&'a Path>,
    /// Requested kind of task.
    pub kind: &'a str,
    /// Requested minimum number of objects; `None` for the default.
    pub min_objects: Option<usize>,
}

/// Flaw name of a file that holds no task or cannot be read.
const NO_TASK: &str = "no_task";

/// Checks every file, and every line of lists (`*.jsonl`), in order. If there are several files, one that holds no task
/// is reported as a result.
///
/// # Errors
/// When a folder cannot be listed or holds no JSON file, when the only file holds no task, and when a list cannot be
/// read or is empty.
pub fn check_each(
    paths: &[PathBuf],
    bare: Option<BareAnswers>,
    found: &mut dyn FnMut(FileCheck),
) -> Result<(), WorkspaceError> {
    let files = task_files::expand(paths)?;
    for file in &files {
        if bare.is_none() && task_files::is_list(file) {
            match check_lines(file, found) {
                Err(error) if files.len() > 1 => found(FileCheck::no_task(file, &error)),
                checked => checked?,
            }
            continue;
        }
        let judged = match bare {
            None => documents::read_text(file, limits::TASK).and_then(|text| of_text(file, &text)),
            Some(BareAnswers { objects, world, kind, min_objects }) => {
                task_files::check_bare(file, objects, world, kind, min_objects)
                    .map(|report| FileCheck::of(file, report))
            }
        };
        found(match judged {
            Err(error) if files.len() > 1 => FileCheck::no_task(file, &error),
            judged => judged?,
        });
    }
    Ok(())
}

fn check_lines(list: &Path, found: &mut dyn FnMut(FileCheck)) -> Result<(), WorkspaceError> {
    let mut is_empty = true;
    task_files::each_line(list, &mut |place, text| {
        is_empty = false;
        let checked = text.and_then(|text| of_text(place, &text));
        found(checked.unwrap_or_else(|error| FileCheck::no_task(place, &error)));
        Ok(())
    })?;
    if is_empty {
        return Err(WorkspaceError::input(format!("{} has no task", list.display()))
            .with_hint("expected a task document per line"));
    }
    Ok(())
}

fn of_text(file: &Path, text: &str) -> Result<FileCheck, WorkspaceError> {
    let document = json::parse(text).ok().filter(|value| value.get("schema").is_some());
    let Some(value) = document else { return Ok(FileCheck::of(file, task_files::check_recorded(file, text)?)) };
    Ok(check_task(file, task_files::task_of_document(file, value)?))
}

/// Checks a task by the rules for documents and for answers; `file` names it in the result.
pub fn check_task(file: &Path, task: Task) -> FileCheck {
    let faults = task_faults::faults(&task);
    if faults.is_empty() {
        // Also checked as an answer, so that a document obeys the same rules as the answers of language models.
        let report = check_answer(&as_answer(&task).to_string(), &request_of(&task));
        let mut checked = FileCheck::of(file, AnswerReport { task: report.task.map(|_| task), ..report });
        for detail in &mut checked.details {
            detail.path = detail.path.replacen("$.goal_conditions", "$.goal", 1);
        }
        return checked;
    }
    let detail = |fault: task_faults::Fault| FlawDetail {
        flaw: fault.flaw.into(),
        path: fault.place,
        message: fault.message,
        hint: fault.hint,
    };
    FileCheck::rejected(file, faults.into_iter().map(detail).collect())
}

/// Request that a task document would answer.
fn request_of(task: &Task) -> TaskRequest {
    TaskRequest {
        id: task.id.clone(),
        kind: task.kind,
        offered: task.objects.iter().map(|card| (**card).clone()).collect(),
        surfaces: task.surfaces.clone(),
        min_objects: 1,
        between: true,
        source: task.source.clone(),
    }
}

impl FileCheck {
    fn of(file: &Path, report: AnswerReport) -> Self {
        let details = report.flaws.iter().map(|flaw| FlawDetail {
            flaw: flaw.kind.name(),
            path: flaw.path.clone(),
            message: flaw.message.clone(),
            hint: flaw.hint.clone(),
        });
        Self {
            file: file.display().to_string(),
            verdict: report.verdict.name(),
            flaws: report.flaws.iter().map(|flaw| flaw.kind.name()).collect(),
            repairs: report.repairs.iter().map(|repair| repair.what.clone()).collect(),
            details: details.collect(),
            task: report.task.as_ref().map(Document::to_value),
        }
    }

    fn rejected(file: &Path, details: Vec<FlawDetail>) -> Self {
        Self {
            file: file.display().to_string(),
            verdict: Verdict::Rejected.name(),
            flaws: details.iter().map(|detail| detail.flaw.clone()).collect(),
            repairs: Vec::new(),
            details,
            task: None,
        }
    }

    fn no_task(file: &Path, error: &WorkspaceError) -> Self {
        let cause = std::error::Error::source(error).map_or_else(String::new, |cause| format!(": {cause}"));
        let message = format!("{error}{cause}");
        let hint = error.hint().unwrap_or_default();
        Self::rejected(file, vec![FlawDetail { flaw: NO_TASK.into(), path: "$".into(), message, hint }])
    }

    /// True if the file cannot be used.
    pub fn is_rejected(&self) -> bool {
        self.verdict == Verdict::Rejected.name()
    }
}

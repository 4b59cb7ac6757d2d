//! Reads a language model's task (a ToSG answer) exactly as it was sent.
//!
//! The steps, each in a module of its own: find the JSON object in the text (`extract`), read it forgivingly
//! (`json`), give it the shape of the format (`decode`), turn names into offered objects (`resolve`), and check
//! every rule of the format (`rules`).
//! Only what has exactly one reading is repaired; everything else is reported, all of it at once, so that the model
//! can be asked again with the whole list.
//!
//! ```
//! use genmanip_core::TaskKind;
//! use genmanip_tasks::answer::{FlawKind, TaskRequest, Verdict, check_answer};
//!
//! let request = TaskRequest {
//!     id: "demo".into(),
//!     kind: TaskKind::PickAndPlace,
//!     offered: Vec::new(),
//!     surfaces: Vec::new(),
//!     min_objects: 3,
//!     between: false,
//!     source: "doc example".into(),
//! };
//! let report = check_answer("I am sorry, I cannot do that.", &request);
//! assert_eq!(report.verdict, Verdict::Rejected);
//! assert_eq!(report.flaws[0].kind, FlawKind::NoJson);
//! ```

mod decode;
mod extract;
mod flaw;
pub mod hostile;
mod json;
#[cfg(test)]
mod mutation_tests;
mod recorded;
mod resolve;
mod rules;
#[cfg(test)]
mod tests;
mod words;

use genmanip_core::asset::instance_ids;
use genmanip_core::{NamedSurface, ObjectCard, Task, TaskKind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::references;
use flaw::Findings;
pub use flaw::{Flaw, FlawKind, Repair};
pub use recorded::{RecordedAnswer, RecordedAnswerError};

/// Longest answer that is looked at, bytes; longer ones are refused unread.
pub const MAX_ANSWER_BYTES: usize = 1 << 20;

/// What a model was asked for: the other half of an answer's meaning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TaskRequest {
    /// Name of the resulting task.
    pub id: String,
    /// Kind of task asked for.
    pub kind: TaskKind,
    /// Cards of the objects the model could choose from, one per instance: the second card of an asset offers its
    /// second copy, under the uid `001#2`.
    pub offered: Vec<ObjectCard>,
    /// Support surfaces, other than the table, that things may be put on or near.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<NamedSurface>,
    /// Smallest number of objects in the scene.
    pub min_objects: usize,
    /// Whether `between` is a position, with the second reference in `obj3` and `obj3_uid`; no part of the published
    /// exchange format.
    #[serde(default)]
    pub between: bool,
    /// Where the answer comes from, stored in the task.
    pub source: String,
}

/// Judgement of one answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AnswerReport {
    /// Whether there is a task, and whether the answer had to be mended for it.
    pub verdict: Verdict,
    /// Everything that is wrong with the answer, repaired or not, in the order of the checks.
    pub flaws: Vec<Flaw>,
    /// What was changed; one entry per repaired flaw.
    pub repairs: Vec<Repair>,
    /// Number of further flaws that are not listed because the list was full.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub flaws_left_out: usize,
    /// The task, unless the answer was rejected.
    pub task: Option<Task>,
}

/// Outcome of checking an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Taken as it is; a code fence or prose around the object is not a flaw.
    Valid,
    /// Taken after certain repairs.
    Repaired,
    /// Not taken.
    Rejected,
}

impl Verdict {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::Repaired => "repaired",
            Self::Rejected => "rejected",
        }
    }
}

/// Checks the text a model sent against what it was asked for.
///
/// Never panics and takes time proportional to the text, whatever the text is.
pub fn check_answer(raw: &str, request: &TaskRequest) -> AnswerReport {
    let mut findings = Findings::default();
    let task = read_task(raw, request, &mut findings);
    let verdict = match (findings.rejects(), findings.flaws.is_empty()) {
        (true, _) => Verdict::Rejected,
        (false, true) => Verdict::Valid,
        (false, false) => Verdict::Repaired,
    };
    AnswerReport {
        verdict,
        flaws: findings.flaws,
        repairs: findings.repairs,
        flaws_left_out: findings.left_out,
        task: task.filter(|_| verdict != Verdict::Rejected),
    }
}

impl TaskRequest {
    /// What the answer calls the offered objects: uids, numbered from the second copy of an asset on; then the surfaces.
    pub fn ids(&self) -> Vec<String> {
        let mut ids = instance_ids(self.offered.iter().map(|card| card.uid.as_str()));
        ids.extend(self.surfaces.iter().map(|surface| surface.id.clone()));
        ids
    }

    /// What people call each of [`TaskRequest::ids`].
    fn names(&self) -> Vec<&str> {
        let objects = self.offered.iter().map(|card| card.name.as_str());
        objects.chain(self.surfaces.iter().map(|surface| surface.name.as_str())).collect()
    }

    /// Whether one of [`TaskRequest::ids`] is a surface.
    fn is_surface(&self, index: usize) -> bool {
        index >= self.offered.len()
    }
}

/// A flaw of the text hides what comes after it; from the resolved answer on, every rule is checked.
fn read_task(raw: &str, request: &TaskRequest, findings: &mut Findings) -> Option<Task> {
    let value = extract::find_answer(raw, findings)?;
    let answer = decode::decode(&value, request.between, findings)?;
    let draft = resolve::resolve(answer, request, findings);
    let draft = rules::check(draft, request, findings);
    let mut task = draft.to_task(request)?;
    task.interchangeable = references::interchangeable(&task);
    rules::check_copies(&task, findings);
    Some(task)
}

fn is_zero(value: &usize) -> bool {
    *value == 0
}

//! Parser and validator of a language model's task (a ToSG answer).
//!
//! The steps: find the JSON object in the text (`extract`), parse it leniently (`json`), decode the format (`decode`),
//! resolve names to offered objects (`resolve`), and check every rule of the format (`rules`). Only unambiguous flaws
//! are repaired; all others are reported together, so that the model can be asked again with the complete list.
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

/// Maximum length of an answer, bytes; longer ones are rejected unread.
pub const MAX_ANSWER_BYTES: usize = 1 << 20;

/// Request that an answer responds to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TaskRequest {
    /// Id of the resulting task.
    pub id: String,
    /// Requested kind of task.
    pub kind: TaskKind,
    /// Cards of the offered objects, one per instance: the second card of an asset offers its second instance, with the
    /// uid `001#2`.
    pub offered: Vec<ObjectCard>,
    /// Support surfaces, other than the table, that objects may be put on or near.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<NamedSurface>,
    /// Minimum number of objects in the scene.
    pub min_objects: usize,
    /// Allow the position `between`, with the second reference in `obj3` and `obj3_uid`; not part of the published
    /// exchange format.
    #[serde(default)]
    pub between: bool,
    /// Origin of the answer, stored in the task.
    pub source: String,
}

/// Result of checking an answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AnswerReport {
    /// Outcome of the check.
    pub verdict: Verdict,
    /// All flaws of the answer, repaired or not, in the order of the checks.
    pub flaws: Vec<Flaw>,
    /// Changes made, one per repaired flaw.
    pub repairs: Vec<Repair>,
    /// Number of further flaws, not listed because the list was full.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub flaws_left_out: usize,
    /// The task, unless the answer was rejected.
    pub task: Option<Task>,
}

/// Outcome of checking an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Accepted unchanged; a code fence or prose around the object is not a flaw.
    Valid,
    /// Accepted after unambiguous repairs.
    Repaired,
    /// Rejected.
    Rejected,
}

impl Verdict {
    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::Repaired => "repaired",
            Self::Rejected => "rejected",
        }
    }
}

/// Checks a model's text against the request.
///
/// Never panics; takes linear time for any text.
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
    /// Ids of the offered objects: uids, numbered from the second instance of an asset on; then those of the surfaces.
    pub fn ids(&self) -> Vec<String> {
        let mut ids = instance_ids(self.offered.iter().map(|card| card.uid.as_str()));
        ids.extend(self.surfaces.iter().map(|surface| surface.id.clone()));
        ids
    }

    /// Names of [`TaskRequest::ids`].
    fn names(&self) -> Vec<&str> {
        let objects = self.offered.iter().map(|card| card.name.as_str());
        objects.chain(self.surfaces.iter().map(|surface| surface.name.as_str())).collect()
    }

    /// True if the id with this index is a surface.
    fn is_surface(&self, index: usize) -> bool {
        index >= self.offered.len()
    }
}

/// A flaw of the text hides later ones; from the resolved answer on, all rules are checked.
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

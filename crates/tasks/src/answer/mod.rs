//! Parser and validator of a language model's task (a ToSG answer).
//!
//! The steps: find the JSON object in the text (`extract`), read leniently, decode the format (`decode`),
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
#[cfg(test)]
mod mutation_tests;
mod recorded;
mod request;
mod resolve;
mod rules;
#[cfg(test)]
mod tests;
mod words;

use genmanip_core::Task;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::references;
use flaw::Findings;
pub use flaw::{Flaw, FlawKind, Repair};
pub use recorded::{RecordedAnswer, RecordedAnswerError};
pub use request::{MAX_ANSWER_BYTES, TaskRequest};
pub use rules::DESCRIPTION_PLACEHOLDER;

/// Result of checking an answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AnswerReport {
    /// Outcome of the check.
    pub verdict: Verdict,
    /// All flaws of the answer, repaired or not, in the order of the checks.
    pub flaws: Vec<Flaw>,
    /// Changes made, one per repaired flaw.
    pub repairs: Vec<Repair>,
    /// Number of further flaws, omitted because the list was full.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub flaws_left_out: usize,
    /// The task; `None` if the answer was rejected.
    pub task: Option<Task>,
}

/// Outcome of checking an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Accepted unchanged; a code fence or prose around the object is not a flaw.
    Valid,
    /// Accepted after unambiguous repairs, which [`AnswerReport::repairs`] lists.
    Repaired,
    /// Rejected because of a flaw that cannot be repaired.
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

/// Reads the task; `None` after an essential flaw. A flaw of the text hides later ones, but once an answer is resolved,
/// all rules are checked.
fn read_task(raw: &str, request: &TaskRequest, findings: &mut Findings) -> Option<Task> {
    let value = extract::find_answer(raw, findings)?;
    let answer = decode::decode(&value, request.between, findings)?;
    let draft = resolve::resolve(answer, request, findings);
    let draft = rules::check(draft, request, findings);
    let mut task = draft.to_task(request)?;
    task.interchangeable = references::interchangeable(&task);
    rules::check_copies(&task, findings);
    rules::check_sentence(&task, findings);
    Some(task)
}

fn is_zero(value: &usize) -> bool {
    *value == 0
}

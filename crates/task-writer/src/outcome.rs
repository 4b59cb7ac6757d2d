//! Outcome of a task request: the task or the reason for failure, with all rounds.

use genmanip_core::{Document, ReferenceId, Task, TaskKind, Upgrade, upgrade};
use genmanip_llm::{ChatError, ChatReply, Ledger};
use genmanip_tasks::answer::{Flaw, Repair, Verdict};
use serde::{Deserialize, Serialize};

use crate::prompt::PromptStamp;
use crate::sampling::SamplingError;

/// Complete record of one task request; recording and replay give the same file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GenerationOutcome {
    /// Id of the task, also if none was made.
    pub id: String,
    /// Requested kind of task.
    pub kind: TaskKind,
    /// Name of the requested model.
    pub model: String,
    /// Names and hashes of the prompts used.
    pub prompts: Vec<PromptStamp>,
    /// Uids of the offered objects, in prompt order.
    pub offered: Vec<ReferenceId>,
    /// Requested minimum number of objects.
    pub min_objects: usize,
    /// Answers with their validation results, oldest first.
    pub rounds: Vec<Round>,
    /// The task, or the reason for failure.
    pub result: Designed,
}

impl Document for GenerationOutcome {
    const SCHEMA: &'static str = "genmanip.generation/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::generation::FROM_1);
}

/// One answer with its validation result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// Content hash of the request; its beginning names the cassette.
    pub key: String,
    /// Answer of the model.
    pub reply: ChatReply,
    /// Verdict of the validation on the answer.
    pub verdict: Verdict,
    /// Flaws found by the validation, repaired ones included.
    pub flaws: Vec<Flaw>,
    /// Repairs applied by the validation.
    pub repairs: Vec<Repair>,
}

/// Final result of a task request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Designed {
    /// A valid task, possibly after repairs.
    Task(Box<Task>),
    /// No task, with the reason.
    Refused(Refusal),
}

/// Reason why a request gave no task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// No answer was valid; the rounds contain the flaws.
    #[error("no answer was valid")]
    Invalid,
    /// The last answer is truncated, because the model reached its token limit.
    #[error("the model was stopped at its limit of tokens (`max_tokens`) before its answer ended")]
    CutOff,
    /// The model could not be reached, or gave no answer.
    #[error("{error}")]
    Unanswered {
        /// Error of the last request to the model.
        error: ChatError,
    },
    /// The catalogue lacks objects for this kind of task.
    #[error("{error}")]
    NoObjects {
        /// Requirement that the objects of the catalogue do not meet.
        error: SamplingError,
    },
    /// The server failed for several tasks in a row, so the request was not sent.
    #[error("not requested, because the server failed for several previous tasks")]
    NotAsked,
}

impl GenerationOutcome {
    /// The task; `None` if the request failed.
    pub fn task(&self) -> Option<&Task> {
        match &self.result {
            Designed::Task(task) => Some(task),
            Designed::Refused(_) => None,
        }
    }

    /// Reason for failure with every violation of the last answer; `None` if there is a task.
    pub fn refusal(&self) -> Option<String> {
        let Designed::Refused(refusal) = &self.result else {
            return None;
        };
        let mut text = refusal.to_string();
        if let (Refusal::Invalid, Some(last)) = (refusal, self.rounds.last()) {
            let rounds = if self.rounds.len() == 1 { "round" } else { "rounds" };
            text += &format!(" in {} {rounds}; the last one:", self.rounds.len());
            for flaw in last.flaws.iter().filter(|flaw| !flaw.repaired) {
                text += &format!("\n  {} at {}: {}", flaw.kind.name(), flaw.path, flaw.message);
            }
        }
        Some(text)
    }

    /// Ledger of the tokens and costs of all rounds of these outcomes.
    pub fn ledger(outcomes: &[Self]) -> Ledger {
        let mut ledger = Ledger::default();
        for outcome in outcomes {
            for round in &outcome.rounds {
                ledger.add(&outcome.model, &round.reply);
            }
        }
        ledger
    }

    /// Advice on a failure; empty if there is none.
    pub fn hint(&self) -> &'static str {
        match &self.result {
            Designed::Refused(Refusal::Unanswered { error }) => error.hint(),
            Designed::Refused(Refusal::CutOff) => "raise `max_tokens` in `server.parameters`",
            Designed::Refused(Refusal::Invalid) => "a stronger model or a higher `max_rounds` may help",
            Designed::Refused(Refusal::NoObjects { error: SamplingError::TooFew { .. } }) => {
                "lower `generation.sampling.offered`, or widen the catalogue"
            }
            Designed::Refused(Refusal::NoObjects { error: SamplingError::Lacks { .. } }) => {
                "widen the catalogue, or ask for another kind of task"
            }
            Designed::Refused(Refusal::NotAsked) | Designed::Task(_) => "",
        }
    }
}

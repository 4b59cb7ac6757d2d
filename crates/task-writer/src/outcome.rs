//! What became of asking for a task: the task or the reasons against it, and every round on the way.

use genmanip_core::{Document, Task, TaskKind, Upgrade, upgrade};
use genmanip_llm::{ChatError, ChatReply, Ledger};
use genmanip_tasks::answer::{Flaw, Repair, Verdict};
use serde::{Deserialize, Serialize};

use crate::prompt::PromptStamp;
use crate::sampling::SamplingError;

/// Everything about one request for a task; recording and replay give the same file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GenerationOutcome {
    /// Name of the task, whether there is one or not.
    pub id: String,
    /// Kind asked for.
    pub kind: TaskKind,
    /// Model asked.
    pub model: String,
    /// Prompts used.
    pub prompts: Vec<PromptStamp>,
    /// Uids of the objects offered, in the order of the prompt.
    pub offered: Vec<String>,
    /// Smallest number of objects asked for.
    pub min_objects: usize,
    /// Answers, oldest first.
    pub rounds: Vec<Round>,
    /// The task, or why there is none.
    pub result: Designed,
}

impl Document for GenerationOutcome {
    const SCHEMA: &'static str = "genmanip.generation/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::generation::FROM_1);
}

/// One answer and what was found in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// Content hash of the request, whose beginning is the name of its cassette.
    pub key: String,
    /// The answer.
    pub reply: ChatReply,
    /// Its verdict.
    pub verdict: Verdict,
    /// What is wrong with it.
    pub flaws: Vec<Flaw>,
    /// What was mended.
    pub repairs: Vec<Repair>,
}

/// The end of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Designed {
    /// A valid task, perhaps after repairs.
    Task(Box<Task>),
    /// None, and why.
    Refused(Refusal),
}

/// Why there is no task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// No answer was valid; the rounds say what was wrong with each.
    #[error("no answer was valid")]
    Invalid,
    /// The model could not be asked.
    #[error("{error}")]
    Unanswered {
        /// Why.
        error: ChatError,
    },
    /// The catalogue lacks what this kind of task needs.
    #[error("{error}")]
    NoObjects {
        /// What it lacks.
        error: SamplingError,
    },
    /// The server failed for several tasks in a row, so it was not tried.
    #[error("not asked, because the server failed for several tasks before it")]
    NotAsked,
}

impl GenerationOutcome {
    /// The task, if there is one.
    pub fn task(&self) -> Option<&Task> {
        match &self.result {
            Designed::Task(task) => Some(task),
            Designed::Refused(_) => None,
        }
    }

    /// Why there is no task, with every violation of the last answer; `None` if there is one.
    pub fn refusal(&self) -> Option<String> {
        let Designed::Refused(refusal) = &self.result else {
            return None;
        };
        let mut text = refusal.to_string();
        if let (Refusal::Invalid, Some(last)) = (refusal, self.rounds.last()) {
            text += &format!(" in {} rounds; the last one:", self.rounds.len());
            for flaw in last.flaws.iter().filter(|flaw| !flaw.repaired) {
                text += &format!("\n  {} at {}: {}", flaw.kind.name(), flaw.path, flaw.message);
            }
        }
        Some(text)
    }

    /// What all rounds of some outcomes took.
    pub fn ledger(outcomes: &[Self]) -> Ledger {
        let mut ledger = Ledger::default();
        for outcome in outcomes {
            for round in &outcome.rounds {
                ledger.add(&outcome.model, &round.reply);
            }
        }
        ledger
    }

    /// What to do about a refusal; empty if there is nothing to do.
    pub fn hint(&self) -> &'static str {
        match &self.result {
            Designed::Refused(Refusal::Unanswered { error }) => error.hint(),
            Designed::Refused(Refusal::Invalid) => "a stronger model, or more `max_rounds`, may help",
            Designed::Refused(Refusal::NoObjects { .. }) => {
                "lower `generation.sampling.offered`, or widen the catalogue"
            }
            Designed::Refused(Refusal::NotAsked) | Designed::Task(_) => "",
        }
    }
}

//! Composes tasks of all six kinds by rules, without a language model or network access.
//!
//! `composer` builds a scene from its goal: a destination with free room, the object to move, distractors that make a
//! reference necessary, and fillers in the relations furthest below their quotas. The graph is read from a sketch of
//! the table (`sketch`), so a layout exists. `naming` then finds expressions that refer to exactly one object each, and
//! `phrasing` fills in the sentence.
//!
//! All vocabulary is data in `data/designer`: names of objects and what can be put in or on what (`things.json`),
//! everyday needs (`knowledge.json`), changes of state (`handling.json`) and sentence templates (`phrases.json`).
//!
//! Each task passes an independent check (`gate`): it is written in the exchange format and validated by
//! [`crate::answer`] like the answer of a language model, and [`crate::references`] must read exactly the goal back
//! from its sentence. Rejected designs are counted by reason and drawn again.

mod balance;
mod choices;
mod composer;
mod facts;
mod gate;
mod graspable;
mod kinds;
mod knowledge;
mod naming;
mod phrasing;
mod questions;
mod report;
mod room;
mod sentence;
mod sentence_error;
#[cfg(test)]
mod sentence_tests;
mod series;
mod settings;
mod sketch;
#[cfg(test)]
mod tests;
mod things;

use std::collections::{BTreeMap, HashSet};

use genmanip_core::{ObjectCard, Seed, Task, TaskKind};

use balance::Balance;
use choices::Choices;
use composer::Composer;
use sketch::Sketch;

pub use gate::as_answer;
pub use graspable::{fitting, graspable_by};
pub use report::{DesignReport, Occurrence, measure};
pub use sentence::{SENTENCE, SentencePhrase, phrases_of_sentence, task_from_sentence};
pub use sentence_error::SentenceError;
pub use series::{Missing, Series};

/// Source of tasks that were designed by these rules.
pub const RULES: &str = "rules";
pub use settings::{DesignSettings, RelationQuotas};

/// Reason why no task was composed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// All designs were rejected.
    #[error("no {kind} task in {draws} designs: {}", counted(.rejections))]
    Exhausted {
        /// Requested kind of task.
        kind: &'static str,
        /// Number of designs tried.
        draws: usize,
        /// Number of rejections by reason.
        rejections: BTreeMap<String, usize>,
    },
    /// No kinds were requested.
    #[error("no kind of task was asked for")]
    NoKinds,
}

/// Tasks, and the designs rejected before they were found.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// The tasks in order; the kinds alternate.
    pub tasks: Vec<Task>,
    /// Number of rejected designs by reason.
    pub rejections: BTreeMap<String, usize>,
}

/// Composes one task from these objects.
///
/// # Errors
/// [`DesignError::Exhausted`] if [`DesignSettings::max_draws`] designs were rejected, for example because no object can
/// be moved.
pub fn design(
    kind: TaskKind,
    cards: &[ObjectCard],
    seed: Seed,
    settings: &DesignSettings,
) -> Result<Task, DesignError> {
    let mut rejections = BTreeMap::new();
    let id = format!("{}-{seed}", kind.name());
    draw(kind, cards, seed, settings, &Balance::default(), &id, &HashSet::new(), &mut rejections)
}

/// Composes many tasks with distinct instructions: the first `count` tasks of a [`Series`].
///
/// # Errors
/// The [`DesignError`] of the first task that could not be composed.
pub fn design_many(
    kinds: &[TaskKind],
    count: usize,
    cards: &[ObjectCard],
    seed: Seed,
    settings: &DesignSettings,
) -> Result<Batch, DesignError> {
    let mut series = Series::new(kinds, cards, seed, settings, false)?;
    let tasks = (0..count).map(|_| series.compose().map_err(|missing| missing.why)).collect::<Result<_, _>>()?;
    Ok(Batch { tasks, rejections: series.rejections().clone() })
}

/// Draws at most [`DesignSettings::max_draws`] designs until one passes the gate with an instruction that is not in
/// `said`; adds the numbers of rejected ones by reason to `rejections`.
#[allow(clippy::too_many_arguments)] // one task's share of a batch's state
fn draw(
    kind: TaskKind,
    cards: &[ObjectCard],
    seed: Seed,
    settings: &DesignSettings,
    balance: &Balance,
    id: &str,
    said: &HashSet<String>,
    rejections: &mut BTreeMap<String, usize>,
) -> Result<Task, DesignError> {
    let mut here: BTreeMap<String, usize> = BTreeMap::new();
    let mut made = None;
    let choices = Choices::of(cards);
    for draw in 0..settings.max_draws {
        // The second half of the draws ignores the quotas: the relation furthest below its quota may be impossible.
        let keeps_quotas = draw < settings.max_draws / 2;
        let balance = balance.clone();
        let mut composer = Composer {
            choices: &choices,
            settings,
            rng: seed.fork_index(draw as u64).rng(),
            balance: if keeps_quotas { balance } else { balance.ignored() },
            sketch: Sketch::new(),
            theme: &[],
        };
        let outcome = kinds::compose(kind, &mut composer)
            .ok_or_else(|| "the composition does not work out".to_owned())
            .and_then(|draft| gate::pass(&composer.sketch, &draft, kind, id, RULES))
            .and_then(|task| match said.contains(&task.instruction) {
                true => Err("the instruction was used before".to_owned()),
                false => Ok(task),
            });
        match outcome {
            Ok(task) => {
                made = Some(task);
                break;
            }
            Err(reason) => *here.entry(reason).or_default() += 1,
        }
    }
    for (reason, count) in &here {
        *rejections.entry(reason.clone()).or_default() += count;
    }
    made.ok_or(DesignError::Exhausted { kind: kind.name(), draws: settings.max_draws, rejections: here })
}

fn counted(rejections: &BTreeMap<String, usize>) -> String {
    let mut sorted: Vec<_> = rejections.iter().collect();
    sorted.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
    sorted.iter().map(|(reason, count)| format!("{reason} ({count}×)")).collect::<Vec<_>>().join(", ")
}

/// Parses an embedded table. A test reads all of them, so this cannot fail in a release.
#[allow(clippy::expect_used)]
fn data<T: serde::de::DeserializeOwned>(text: &str) -> T {
    serde_json::from_str(text).expect("the designer's tables are valid; a test reads them all")
}

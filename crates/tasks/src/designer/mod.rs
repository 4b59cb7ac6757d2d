//! Composes tasks of all six kinds by rules: no model, no network.
//!
//! A task grows from its goal outwards: a destination with room for what is to come (`composer`), the thing to
//! move, look-alikes that make a reference worth while, and more objects with the relations that are rarest so far.
//! The graph is read off a sketch on the table, so it can be laid out.
//! Then the finished scene is looked at to find words that single out each object, and the sentence is filled in.
//!
//! Words are data: `data/designer/things.json` says what kinds of things are called and what may lie in what, `knowledge.json` what everyday needs ask for, `handling.json` how states are changed and
//! `phrases.json` holds the sentences.
//!
//! The last gate is not the designer's own: every task is written in the exchange format and read by
//! [`crate::answer`] as if a language model had sent it, and [`crate::references`] must read the sentence back to
//! exactly the goal. What fails is counted and drawn again.

mod balance;
mod choices;
mod composer;
mod facts;
mod gate;
mod kinds;
mod knowledge;
mod naming;
mod phrasing;
mod report;
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
pub use report::{DesignReport, Occurrence, measure};
pub use series::{Missing, Series};

/// Source of tasks that were designed by these rules.
pub const RULES: &str = "rules";
pub use settings::{DesignSettings, RelationQuotas};

/// Why there is no task.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DesignError {
    /// Every draw was rejected.
    #[error("no {kind} task in {draws} designs: {}", counted(.rejections))]
    Exhausted {
        /// Kind that was asked for.
        kind: &'static str,
        /// Designs tried.
        draws: usize,
        /// Reasons and how often each was met.
        rejections: BTreeMap<String, usize>,
    },
    /// Nothing was asked for.
    #[error("no kind of task was asked for")]
    NoKinds,
}

/// Tasks and what it took to make them.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// The tasks in order; the kinds take turns.
    pub tasks: Vec<Task>,
    /// Reasons for which designs were drawn again, and how often.
    pub rejections: BTreeMap<String, usize>,
}

/// Composes one task from these objects.
///
/// # Errors
/// [`DesignError::Exhausted`] when the bounded number of designs was rejected, for example because the cards offer
/// nothing that can be moved.
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

/// Composes many tasks whose instructions all differ: the first of a [`Series`].
///
/// # Errors
/// [`DesignError`] of the first task that could not be made.
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

/// Draws designs until one passes the gate and says something new.
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
        // The relation that lacks most may be the one that nothing can be composed with.
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
            .and_then(|draft| gate::pass(&composer.sketch, &draft, kind, id))
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

/// A table that was compiled in; whether it can be read is a test's business.
#[allow(clippy::expect_used)]
fn data<T: serde::de::DeserializeOwned>(text: &str) -> T {
    serde_json::from_str(text).expect("the designer's tables are valid; a test reads them all")
}

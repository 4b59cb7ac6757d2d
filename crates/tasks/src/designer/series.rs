//! An endless series of tasks from one seed. The kinds alternate; if one kind becomes impossible, the others continue.

use std::collections::{BTreeMap, HashSet};

use genmanip_core::{ObjectCard, Seed, Task, TaskKind};

use super::balance::Balance;
use super::{DesignError, DesignSettings, draw};

/// Number of consecutive failures after which a kind is not tried again. Each failure has cost
/// [`DesignSettings::max_draws`] designs; more than one attempt guards against bad luck. Chosen by hand.
const MAX_CONSECUTIVE_FAILURES: usize = 3;

/// An endless series of tasks with distinct instructions.
///
/// The kinds alternate. Task `k` draws from the stream `seed.fork_index(k)`; it also depends on the tasks before it: on
/// their relations (quotas), their instructions (none is repeated) and the kinds that failed. It does not depend on the
/// length of the series, so a longer one begins with the tasks of a shorter one.
pub struct Series<'a> {
    kinds: &'a [TaskKind],
    cards: &'a [ObjectCard],
    seed: Seed,
    settings: &'a DesignSettings,
    /// True if a task whose kind fails, this time or for good, is composed of the next kind that succeeds.
    fill: bool,
    next: usize,
    balance: Balance,
    /// Instructions used so far.
    said: HashSet<String>,
    /// Number of consecutive failures of each kind, and the last error.
    failed: BTreeMap<TaskKind, (usize, DesignError)>,
    rejections: BTreeMap<String, usize>,
}

/// A task of the series that could not be composed.
#[derive(Clone, Debug, PartialEq)]
pub struct Missing {
    /// Id that the task would have had.
    pub id: String,
    /// Kind of the task.
    pub kind: TaskKind,
    /// Reason for the failure.
    pub why: DesignError,
}

impl<'a> Series<'a> {
    /// Creates a series from these objects. With `fill`, a task whose kind fails is composed of the next kind that
    /// succeeds.
    ///
    /// # Errors
    /// [`DesignError::NoKinds`] if `kinds` is empty.
    pub fn new(
        kinds: &'a [TaskKind],
        cards: &'a [ObjectCard],
        seed: Seed,
        settings: &'a DesignSettings,
        fill: bool,
    ) -> Result<Self, DesignError> {
        if kinds.is_empty() {
            return Err(DesignError::NoKinds);
        }
        Ok(Self {
            kinds,
            cards,
            seed,
            settings,
            fill,
            next: 0,
            balance: Balance::default(),
            said: HashSet::new(),
            failed: BTreeMap::new(),
            rejections: BTreeMap::new(),
        })
    }

    /// Number of rejected designs so far by reason.
    pub fn rejections(&self) -> &BTreeMap<String, usize> {
        &self.rejections
    }

    /// Composes the next task.
    ///
    /// # Errors
    /// [`Missing`] if its kind fails, or is no longer tried because it failed too often; with `fill`, only if all kinds
    /// do. The error names the kind whose turn it was.
    pub fn compose(&mut self) -> Result<Task, Missing> {
        let index = self.next;
        self.next += 1;
        let turns = if self.fill { self.kinds.len() } else { 1 };
        let mut first = None;
        for turn in 0..turns {
            let kind = self.kinds[(index + turn) % self.kinds.len()];
            match self.of_kind(kind, index) {
                Ok(task) => return Ok(task),
                Err(missing) => first = first.or(Some(missing)),
            }
        }
        let kind = self.kinds[index % self.kinds.len()];
        Err(first.unwrap_or(Missing { id: self.id(kind, index), kind, why: DesignError::NoKinds }))
    }

    fn id(&self, kind: TaskKind, index: usize) -> String {
        format!("{}-{}-{index:05}", kind.name(), self.seed)
    }

    fn of_kind(&mut self, kind: TaskKind, index: usize) -> Result<Task, Missing> {
        let id = self.id(kind, index);
        if let Some((MAX_CONSECUTIVE_FAILURES, why)) = self.failed.get(&kind) {
            return Err(Missing { id, kind, why: why.clone() });
        }
        let stream = self.seed.fork_index(index as u64);
        let said = &self.said;
        match draw(kind, self.cards, stream, self.settings, &self.balance, &id, said, &mut self.rejections) {
            Ok(task) => {
                self.failed.remove(&kind);
                self.balance.count(&task);
                self.said.insert(task.instruction.clone());
                Ok(task)
            }
            Err(why) => {
                let before = self.failed.get(&kind).map_or(0, |(times, _)| *times);
                self.failed.insert(kind, (before + 1, why.clone()));
                Err(Missing { id, kind, why })
            }
        }
    }
}

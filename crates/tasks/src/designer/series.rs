//! Task after task from one seed: the kinds take turns, and a kind that has run out is told instead of ending the rest.

use std::collections::{BTreeMap, HashSet};

use genmanip_core::{ObjectCard, Seed, Task, TaskKind};

use super::balance::Balance;
use super::{DesignError, DesignSettings, draw};

/// Tasks of a kind in a row that could not be composed, after which the kind is not tried again; chosen: each has cost
/// [`DesignSettings::max_draws`] designs, and one of them may be bad luck.
const SPENT_AFTER: usize = 3;

/// Tasks in their order, without end; the instructions all differ.
///
/// Task `k` is of kind `k` in turn and has the stream `seed.fork_index(k)`. Relations follow the quotas of the settings,
/// so it also depends on those before it, and on nothing else: the first tasks of a longer series are those of a shorter.
pub struct Series<'a> {
    kinds: &'a [TaskKind],
    cards: &'a [ObjectCard],
    seed: Seed,
    settings: &'a DesignSettings,
    /// Whether another kind takes the place of one that has run out.
    fill: bool,
    next: usize,
    balance: Balance,
    /// Instructions so far.
    said: HashSet<String>,
    /// Failures in a row of each kind, and the last of them.
    failed: BTreeMap<TaskKind, (usize, DesignError)>,
    rejections: BTreeMap<String, usize>,
}

/// A task of the series that could not be composed.
#[derive(Clone, Debug, PartialEq)]
pub struct Missing {
    /// The id that it would have had.
    pub id: String,
    /// Its kind.
    pub kind: TaskKind,
    /// Why there is none.
    pub why: DesignError,
}

impl<'a> Series<'a> {
    /// A series about these objects; with `fill`, another kind takes the place of one that has run out.
    ///
    /// # Errors
    /// [`DesignError::NoKinds`].
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

    /// Reasons for which designs were drawn again so far, and how often.
    pub fn rejections(&self) -> &BTreeMap<String, usize> {
        &self.rejections
    }

    /// The next task, or what is missing in its place.
    ///
    /// # Errors
    /// [`Missing`] when its kind has run out, and with `fill` every other kind too.
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
        if let Some((SPENT_AFTER, why)) = self.failed.get(&kind) {
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

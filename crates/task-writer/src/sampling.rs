//! Sampling of the objects offered to a model: a catalogue subset stratified by general category.

use std::collections::BTreeMap;

use genmanip_core::{ObjectCard, Seed, TaskKind};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Settings for the choice of offered objects.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplingSettings {
    /// Number of objects offered per request.
    pub offered: usize,
    /// True to offer objects with states also for kinds of tasks that do not need them.
    pub articulated_elsewhere: bool,
}

impl Default for SamplingSettings {
    fn default() -> Self {
        Self {
            offered: 8,                   // as in the recorded answers; more fill the table and the prompt
            articulated_elsewhere: false, // they are large, and nothing can be put into a closed one
        }
    }
}

/// Reason why no objects can be offered.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum SamplingError {
    /// The catalogue is too small.
    #[error("a {kind} task needs {wanted} objects to offer, but the catalogue has {have}")]
    TooFew {
        /// Number of objects to offer.
        wanted: usize,
        /// Number of objects of the catalogue that may be offered.
        have: usize,
        /// Kind of task.
        kind: String,
    },
    /// The catalogue lacks a required kind of object.
    #[error("a {kind} task needs {what}, but the catalogue has no more")]
    Lacks {
        /// Description of the missing kind of object.
        what: String,
        /// Kind of task.
        kind: String,
    },
}

/// Samples objects, in random order, with which the kind of task is possible.
///
/// Stratified sampling: each pick takes one of the least-used general categories, then a card in it. Objects that the
/// kind needs are picked first: one with states for `articulated`; otherwise movable ones and a container, and
/// look-alikes for `appearance`. The same seed gives the same objects.
///
/// # Errors
/// Names what the catalogue lacks.
pub fn sample_objects(
    cards: &[ObjectCard],
    kind: TaskKind,
    settings: &SamplingSettings,
    seed: Seed,
) -> Result<Vec<ObjectCard>, SamplingError> {
    let allowed =
        |card: &&ObjectCard| kind == TaskKind::Articulated || settings.articulated_elsewhere || !card.is_articulated;
    let mut sampler = Sampler {
        left: cards.iter().filter(allowed).collect(),
        chosen: Vec::new(),
        used: BTreeMap::new(),
        rng: seed.rng(),
    };
    let (wanted, have) = (settings.offered, sampler.left.len());
    if have < wanted {
        return Err(SamplingError::TooFew { wanted, have, kind: kind.name().into() });
    }
    let lacks = |what: &str| SamplingError::Lacks { what: what.into(), kind: kind.name().into() };
    match kind {
        TaskKind::Articulated => {
            sampler
                .pick(|card| card.is_articulated && !card.states.is_empty())
                .ok_or_else(|| lacks("an object with states"))?;
        }
        _ => {
            let movable_count = if kind == TaskKind::LongHorizon { 3 } else { 2 };
            if kind == TaskKind::Appearance {
                sampler.look_alikes().ok_or_else(|| lacks("two look-alikes that can be picked up"))?;
            }
            for _ in 0..movable_count {
                sampler
                    .pick(|card| is_movable(card) && !card.is_container)
                    .or_else(|| sampler.pick(is_movable))
                    .ok_or_else(|| lacks("an object that can be picked up"))?;
            }
            sampler.pick(|card| card.is_container).ok_or_else(|| lacks("a container"))?;
        }
    }
    while sampler.chosen.len() < wanted && sampler.pick(|_| true).is_some() {}
    sampler.chosen.truncate(wanted);
    Ok(sampler.shuffled())
}

fn is_movable(card: &ObjectCard) -> bool {
    card.can_grasp && !card.is_articulated
}

struct Sampler<'a> {
    left: Vec<&'a ObjectCard>,
    chosen: Vec<&'a ObjectCard>,
    /// Number of picks so far per general category.
    used: BTreeMap<&'a str, usize>,
    rng: ChaCha8Rng,
}

impl<'a> Sampler<'a> {
    fn pick(&mut self, fits: impl Fn(&ObjectCard) -> bool) -> Option<&'a ObjectCard> {
        let fitting: Vec<&'a ObjectCard> = self.left.iter().copied().filter(|card| fits(card)).collect();
        let times = |card: &ObjectCard| self.used.get(card.general_category.as_str()).copied().unwrap_or(0);
        let least = fitting.iter().map(|card| times(card)).min()?;
        let mut strata: BTreeMap<&str, Vec<&'a ObjectCard>> = BTreeMap::new();
        for card in fitting.into_iter().filter(|card| times(card) == least) {
            strata.entry(card.general_category.as_str()).or_default().push(card);
        }
        let strata: Vec<Vec<&'a ObjectCard>> = strata.into_values().collect();
        let stratum = &strata[self.rng.random_range(0..strata.len())];
        let card = stratum[self.rng.random_range(0..stratum.len())];
        self.take(card);
        Some(card)
    }

    /// Picks two movable objects of one category, such as mugs of two colours; `None` if there are none.
    fn look_alikes(&mut self) -> Option<()> {
        let mut groups: BTreeMap<&str, Vec<&'a ObjectCard>> = BTreeMap::new();
        for card in self.left.iter().copied().filter(|card| is_movable(card)) {
            groups.entry(card.category.as_str()).or_default().push(card);
        }
        let mut groups: Vec<Vec<&'a ObjectCard>> = groups.into_values().filter(|group| group.len() > 1).collect();
        if groups.is_empty() {
            return None;
        }
        let mut group = groups.swap_remove(self.rng.random_range(0..groups.len()));
        for _ in 0..2 {
            let card = group.swap_remove(self.rng.random_range(0..group.len()));
            self.take(card);
        }
        Some(())
    }

    fn take(&mut self, card: &'a ObjectCard) {
        self.left.retain(|other| other.uid != card.uid);
        *self.used.entry(card.general_category.as_str()).or_default() += 1;
        self.chosen.push(card);
    }

    fn shuffled(mut self) -> Vec<ObjectCard> {
        for last in (1..self.chosen.len()).rev() {
            self.chosen.swap(last, self.rng.random_range(0..=last));
        }
        self.chosen.into_iter().cloned().collect()
    }
}

//! Keeps relations near their quotas: the next relation is the one with the most missing occurrences.

use genmanip_core::{Relation, Task};
use rand::{Rng, RngExt};

use super::settings::DesignSettings;

/// Relations counted so far, over edges and goal conditions.
#[derive(Clone, Debug, Default)]
pub(super) struct Balance {
    counts: [usize; Relation::ALL.len()],
    /// True if relations are chosen at random without regard to the quotas.
    ignored: bool,
}

impl Balance {
    /// Counts all edges of the graph and all conditions of all alternatives of the goal.
    pub fn count(&mut self, task: &Task) {
        for relation in relations_of(task) {
            self.add(relation);
        }
    }

    pub fn add(&mut self, relation: Relation) {
        if let Some(index) = index(relation) {
            self.counts[index] += 1;
        }
    }

    /// The same counts, but relations are chosen at random from now on.
    pub fn ignored(self) -> Self {
        Self { ignored: true, ..self }
    }

    pub fn of(&self, relation: Relation) -> usize {
        index(relation).map_or(0, |index| self.counts[index])
    }

    pub fn total(&self) -> usize {
        self.counts.iter().sum()
    }

    /// Relation with the most missing occurrences ([`Self::lack`]) plus random noise, which makes designs vary; `None`
    /// if `among` is empty.
    pub fn choose(&self, among: &[Relation], settings: &DesignSettings, rng: &mut impl Rng) -> Option<Relation> {
        let mut best: Option<(f64, Relation)> = None;
        for &relation in among {
            let wanted = if self.ignored { 0.0 } else { self.lack(relation, settings) };
            let lack = wanted + settings.chance * rng.random::<f64>();
            if best.is_none_or(|(most, _)| lack > most) {
                best = Some((lack, relation));
            }
        }
        best.map(|(_, relation)| relation)
    }

    /// Number of further occurrences of the relation that its quota requires so far; negative above the quota.
    pub fn lack(&self, relation: Relation, settings: &DesignSettings) -> f64 {
        settings.relation_quotas.of(relation) * self.total() as f64 - self.of(relation) as f64
    }
}

/// The relations of a task that count towards the quotas: of edges, and of conditions in all alternatives of the goal.
pub(super) fn relations_of(task: &Task) -> impl Iterator<Item = Relation> {
    let edges = task.scene_graph.edges.iter().map(|edge| edge.relation);
    let goal = task.goal.alternatives.iter().flatten().filter_map(|atom| match atom {
        genmanip_core::Atom::Relation { relation, .. } => Some(*relation),
        genmanip_core::Atom::State { .. } => None,
    });
    edges.chain(goal)
}

fn index(relation: Relation) -> Option<usize> {
    Relation::ALL.iter().position(|known| *known == relation)
}

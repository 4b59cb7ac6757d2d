//! Relations that follow from the graph of a scene, in all or in some of its layouts.

use genmanip_core::{HorizontalAxis, ReferenceId, Relation, SceneGraph, Side};

/// Certainty of a relation in the layouts of a graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Certainty {
    /// True in every layout of the graph.
    Certain,
    /// True in some layouts, as far as the graph determines.
    Possible,
    /// True in no layout of the graph.
    Impossible,
}

/// Derives the certainty of relations from one graph.
pub(super) struct Space<'g> {
    graph: &'g SceneGraph,
}

impl<'g> Space<'g> {
    pub fn new(graph: &'g SceneGraph) -> Self {
        Self { graph }
    }

    /// True if a chain of edges orders all of `one` beyond all of `other` along the axis.
    pub fn is_beyond(&self, one: &ReferenceId, axis: HorizontalAxis, other: &ReferenceId) -> bool {
        let mut reached = vec![other];
        let mut next = 0;
        while let Some(&low) = reached.get(next) {
            next += 1;
            for edge in &self.graph.edges {
                let Some(side) = edge.relation.side().filter(|side| side.axis == axis) else { continue };
                let (subject, reference): (&ReferenceId, _) = (&edge.subject, &edge.reference);
                let (high, below) = if side.is_positive { (subject, reference) } else { (reference, subject) };
                if below == low {
                    if high == one {
                        return true;
                    }
                    if !reached.contains(&high) {
                        reached.push(high);
                    }
                }
            }
        }
        false
    }

    fn is_apart(&self, one: &ReferenceId, axis: HorizontalAxis, other: &ReferenceId) -> bool {
        self.is_beyond(one, axis, other) || self.is_beyond(other, axis, one)
    }

    /// The object on or in which `id` is, with the relation; `None` if it stands on the table.
    pub fn support(&self, id: &ReferenceId) -> Option<(&'g ReferenceId, Relation)> {
        let edge = self.graph.edges.iter().find(|edge| edge.subject == *id && edge.relation.is_support())?;
        Some((&edge.reference, edge.relation))
    }

    /// Certainty that `subject` is in one of the relations `said` to `reference`.
    pub fn stands(&self, subject: &ReferenceId, said: &[Relation], reference: &ReferenceId) -> Certainty {
        let support = self.support(subject).filter(|(carrier, _)| *carrier == reference);
        if said.iter().any(|relation| relation.is_support()) {
            return match support {
                Some((_, relation)) if said.contains(&relation) => Certainty::Certain,
                Some(_) => Certainty::Possible,
                None => Certainty::Impossible,
            };
        }
        if support.is_some() || self.support(reference).is_some_and(|(carrier, _)| carrier == subject) {
            return Certainty::Impossible;
        }
        let Some(&relation) = said.first() else { return Certainty::Impossible };
        let neighbours = |relation: Relation| {
            self.graph.edges.iter().any(|edge| {
                let direct = edge.subject == *subject && edge.reference == *reference && edge.relation == relation;
                let turned = edge.subject == *reference
                    && edge.reference == *subject
                    && edge.relation.inverse() == Some(relation);
                direct || turned
            })
        };
        if Relation::ALL.into_iter().filter(|other| other.implies(relation)).any(neighbours) {
            return Certainty::Certain;
        }
        let is_impossible = |Side { axis, is_positive }: Side| {
            let (low, high) = if is_positive { (reference, subject) } else { (subject, reference) };
            self.is_apart(subject, axis.other(), reference) || self.is_beyond(low, axis, high)
        };
        if relation.side().is_some_and(is_impossible) { Certainty::Impossible } else { Certainty::Possible }
    }

    /// Certainty that `subject` is between two others.
    pub fn is_between(&self, subject: &ReferenceId, one: &ReferenceId, other: &ReferenceId) -> Certainty {
        let stated = self.graph.edges.iter().any(|edge| {
            let ends = (&edge.reference, edge.second_reference.as_ref());
            edge.relation == Relation::Between
                && edge.subject == *subject
                && (ends == (one, Some(other)) || ends == (other, Some(one)))
        });
        if stated {
            return Certainty::Certain;
        }
        let beyond_both = [HorizontalAxis::Depth, HorizontalAxis::Width].into_iter().any(|axis| {
            (self.is_beyond(subject, axis, one) && self.is_beyond(subject, axis, other))
                || (self.is_beyond(one, axis, subject) && self.is_beyond(other, axis, subject))
        });
        if beyond_both { Certainty::Impossible } else { Certainty::Possible }
    }
}

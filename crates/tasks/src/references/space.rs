//! Relations that follow from the graph of a scene, in all or in some of its layouts.

use genmanip_core::{Relation, SceneGraph};

/// Certainty of a relation, given the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Certainty {
    /// True in every layout.
    Certain,
    /// True in some layouts, as far as the graph tells.
    Possible,
    /// True in no layout.
    Impossible,
}

/// An axis along which objects are ordered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    /// Away from the robot.
    Depth,
    /// To the robot's left.
    Width,
}

/// Derives relations from one graph.
pub(super) struct Space<'g> {
    graph: &'g SceneGraph,
}

impl<'g> Space<'g> {
    pub fn new(graph: &'g SceneGraph) -> Self {
        Self { graph }
    }

    /// True if a chain of edges orders all of `one` beyond all of `other` along the axis.
    pub fn is_beyond(&self, one: &str, axis: Axis, other: &str) -> bool {
        let mut reached = vec![other];
        let mut next = 0;
        while let Some(&low) = reached.get(next) {
            next += 1;
            for edge in &self.graph.edges {
                let up = match (axis, edge.relation) {
                    (Axis::Depth, Relation::Front) | (Axis::Width, Relation::Left) => (&edge.subject, &edge.reference),
                    (Axis::Depth, Relation::Back) | (Axis::Width, Relation::Right) => (&edge.reference, &edge.subject),
                    _ => continue,
                };
                if up.1 == low {
                    if up.0 == one {
                        return true;
                    }
                    if !reached.contains(&up.0.as_str()) {
                        reached.push(up.0);
                    }
                }
            }
        }
        false
    }

    fn is_apart(&self, one: &str, axis: Axis, other: &str) -> bool {
        self.is_beyond(one, axis, other) || self.is_beyond(other, axis, one)
    }

    /// The object on or in which `uid` is, and how.
    pub fn support(&self, uid: &str) -> Option<(&'g str, Relation)> {
        let edge = self.graph.edges.iter().find(|edge| edge.subject == uid && edge.relation.is_support())?;
        Some((&edge.reference, edge.relation))
    }

    /// Certainty that `subject` is in one of the relations `said` to `reference`.
    pub fn stands(&self, subject: &str, said: &[Relation], reference: &str) -> Certainty {
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
                let direct = edge.subject == subject && edge.reference == reference && edge.relation == relation;
                let turned =
                    edge.subject == reference && edge.reference == subject && edge.relation.inverse() == Some(relation);
                direct || turned
            })
        };
        let directions = [Relation::Front, Relation::Back, Relation::Left, Relation::Right];
        let certain = neighbours(relation) || (relation == Relation::Near && directions.into_iter().any(neighbours));
        if certain {
            return Certainty::Certain;
        }
        let impossible = match relation {
            Relation::Front => {
                self.is_apart(subject, Axis::Width, reference) || self.is_beyond(reference, Axis::Depth, subject)
            }
            Relation::Back => {
                self.is_apart(subject, Axis::Width, reference) || self.is_beyond(subject, Axis::Depth, reference)
            }
            Relation::Left => {
                self.is_apart(subject, Axis::Depth, reference) || self.is_beyond(reference, Axis::Width, subject)
            }
            Relation::Right => {
                self.is_apart(subject, Axis::Depth, reference) || self.is_beyond(subject, Axis::Width, reference)
            }
            _ => false,
        };
        if impossible { Certainty::Impossible } else { Certainty::Possible }
    }

    /// Certainty that `subject` is between two others.
    pub fn is_between(&self, subject: &str, one: &str, other: &str) -> Certainty {
        let stated = self.graph.edges.iter().any(|edge| {
            let ends = (edge.reference.as_str(), edge.second_reference.as_deref().unwrap_or_default());
            edge.relation == Relation::Between
                && edge.subject == subject
                && (ends == (one, other) || ends == (other, one))
        });
        if stated {
            return Certainty::Certain;
        }
        let beyond_both = [Axis::Depth, Axis::Width].into_iter().any(|axis| {
            (self.is_beyond(subject, axis, one) && self.is_beyond(subject, axis, other))
                || (self.is_beyond(one, axis, subject) && self.is_beyond(other, axis, subject))
        });
        if beyond_both { Certainty::Impossible } else { Certainty::Possible }
    }
}

//! Spatial facts that the graph of a scene implies or excludes.
//!
//! Left and front are strict orders of bounds and therefore transitive. Two objects that are apart along one axis
//! cannot be in a relation that requires an overlap along it.

use genmanip_core::{HorizontalAxis, Relation, Side};

use super::sketch::Sketch;

/// Truth of a relation, as far as the graph determines it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Known {
    Yes,
    No,
    Open,
}

/// The two strict orders of a scene's objects, transitively closed.
pub(super) struct Facts {
    /// `farther[a][b]`: all of `a` is farther from the robot than all of `b`.
    farther: Vec<Vec<bool>>,
    /// `lefter[a][b]`: all of `a` is further to the robot's left than all of `b`.
    lefter: Vec<Vec<bool>>,
}

impl Facts {
    pub fn new(scene: &Sketch) -> Self {
        let count = scene.len();
        let mut farther = vec![vec![false; count]; count];
        let mut lefter = vec![vec![false; count]; count];
        for link in &scene.edges {
            let (a, b) = (link.subject, link.reference);
            let Some(side) = link.relation.side() else { continue };
            let (high, low) = if side.is_positive { (a, b) } else { (b, a) };
            match side.axis {
                HorizontalAxis::Depth => farther[high][low] = true,
                HorizontalAxis::Width => lefter[high][low] = true,
            }
        }
        close(&mut farther);
        close(&mut lefter);
        Self { farther, lefter }
    }

    /// True if all of `a` is known to be farther from the robot than all of `b`.
    pub fn is_farther(&self, a: usize, b: usize) -> bool {
        self.farther[a][b]
    }

    /// True if all of `a` is known to be further to the robot's left than all of `b`.
    pub fn is_lefter(&self, a: usize, b: usize) -> bool {
        self.lefter[a][b]
    }

    /// Truth of `subject relation reference`, as far as it is the same in every layout of the scene.
    pub fn known(&self, scene: &Sketch, subject: usize, relation: Relation, reference: usize) -> Known {
        let carried = |a: usize, b: usize| scene.carrier(a) == Some(b);
        if relation.is_support() {
            return if carried(subject, reference) { Known::Yes } else { Known::No };
        }
        if carried(subject, reference) || carried(reference, subject) {
            return Known::No;
        }
        let stated = scene.edges.iter().any(|link| {
            let pair = (link.subject, link.reference);
            (pair == (subject, reference) && link.relation == relation)
                || (pair == (reference, subject) && link.relation.inverse() == Some(relation))
        });
        if stated {
            return Known::Yes;
        }
        let is_excluded = |Side { axis, is_positive }: Side| {
            let (along, across) = match axis {
                HorizontalAxis::Depth => (&self.farther, &self.lefter),
                HorizontalAxis::Width => (&self.lefter, &self.farther),
            };
            let (low, high) = if is_positive { (reference, subject) } else { (subject, reference) };
            across[subject][reference] || across[reference][subject] || along[low][high]
        };
        if relation.side().is_some_and(is_excluded) { Known::No } else { Known::Open }
    }
}

/// Replaces an order by its transitive closure.
fn close(order: &mut [Vec<bool>]) {
    for via in 0..order.len() {
        let beyond = order[via].clone();
        for row in order.iter_mut().filter(|row| row[via]) {
            for (reached, next) in row.iter_mut().zip(&beyond) {
                *reached |= next;
            }
        }
    }
}

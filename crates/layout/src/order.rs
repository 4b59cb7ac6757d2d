//! Placement order of objects.

use std::cmp::Reverse;

use genmanip_core::{Atom, InstanceId, Relation};

use crate::LayoutError;

/// One object to be placed, with its support.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    /// Index of the object.
    pub object: usize,
    /// Index of the supporting or containing object and the relation; `None` for the table and other surfaces.
    pub support: Option<(usize, Relation)>,
    /// Index of the support edge in `edges`, which may refer to a surface; `None` for an object on the table.
    pub support_edge: Option<usize>,
}

/// Placement steps in topological order of support, each after related objects if possible; subjects of `between` come
/// after their references.
///
/// `edges` are the graph's edges with the indices of their objects, subject first; surfaces have no index.
///
/// # Errors
/// [`LayoutError::SupportCycle`] with the ids of the objects that could not be ordered.
pub(crate) fn steps(
    edges: &[(Atom, Vec<usize>)],
    count: usize,
    id: impl Fn(usize) -> InstanceId,
) -> Result<Vec<Step>, LayoutError> {
    let relation = |atom: &Atom| match atom {
        Atom::Relation { relation, .. } => Some(*relation),
        Atom::State { .. } => None,
    };
    let support_edge = |object: usize| {
        edges.iter().position(|(atom, indices)| {
            indices.first() == Some(&object) && relation(atom).is_some_and(Relation::is_support)
        })
    };
    let mut placed: Vec<usize> = Vec::new();
    let mut steps: Vec<Step> = Vec::new();
    while placed.len() < count {
        let is_known = |other: &usize| placed.contains(other);
        let rank = |object: usize| {
            let own = || edges.iter().filter(move |(_, indices)| indices.contains(&object));
            let links = own().filter(|(_, indices)| indices.iter().any(is_known)).count();
            let early = own().any(|(atom, indices)| {
                relation(atom).is_some_and(Relation::has_two_references)
                    && indices[0] == object
                    && !indices[1..].iter().all(is_known)
            });
            (!early, links > 0, links, own().count(), Reverse(object))
        };
        let step = |object: usize| {
            let edge = support_edge(object);
            let support = edge.and_then(|edge| Some((*edges[edge].1.get(1)?, relation(&edges[edge].0)?)));
            Step { object, support, support_edge: edge }
        };
        let ready = (0..count)
            .filter(|object| !placed.contains(object))
            .map(step)
            .filter(|step| step.support.is_none_or(|(support, _)| placed.contains(&support)));
        let Some(next) = ready.max_by_key(|step| rank(step.object)) else {
            let left = (0..count).filter(|object| !placed.contains(object));
            return Err(LayoutError::SupportCycle { ids: left.map(id).collect() });
        };
        placed.push(next.object);
        steps.push(next);
    }
    Ok(steps)
}

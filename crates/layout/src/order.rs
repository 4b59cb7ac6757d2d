//! In which order objects are placed, and roughly where the whole group fits.

use genmanip_core::glam::DVec2;
use genmanip_core::{ObjectModel, Relation, Task};
use std::sync::Arc;

use crate::LayoutError;

/// What constrains one object: its support and its edges to objects placed before it.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    /// Index of the object among the graph's nodes.
    pub object: usize,
    /// Index of what it stands on or lies in; `None` for the table.
    pub support: Option<usize>,
    /// Edges to objects placed earlier, the subject being this object (inverted where needed).
    pub relations: Vec<(Relation, usize)>,
    /// Offset from the first object of a rough sketch of the whole group, metres.
    pub sketch: DVec2,
}

/// Objects in topological order of support, each after the objects it is related to where possible.
#[derive(Clone, Debug)]
pub(crate) struct PlacementPlan {
    pub steps: Vec<Step>,
    /// Smallest and largest sketch position of the group.
    pub sketch_min: DVec2,
    pub sketch_max: DVec2,
}

impl PlacementPlan {
    pub fn new(task: &Task, models: &[Arc<ObjectModel>]) -> Result<Self, LayoutError> {
        let index_of = |uid: &str, edge: &str| {
            task.scene_graph
                .nodes
                .iter()
                .position(|node| node.uid == uid)
                .ok_or_else(|| LayoutError::NotANode { edge: edge.into(), uid: uid.into() })
        };
        let mut edges = Vec::new();
        for edge in &task.scene_graph.edges {
            let name = edge.atom().to_string();
            edges.push((index_of(&edge.subject, &name)?, edge.relation, index_of(&edge.reference, &name)?));
            if let Some(second) = &edge.second_reference {
                edges.push((index_of(&edge.subject, &name)?, edge.relation, index_of(second, &name)?));
            }
        }
        let count = models.len();
        let support: Vec<Option<usize>> = (0..count)
            .map(|object| edges.iter().find(|(s, r, _)| *s == object && r.is_support()).map(|edge| edge.2))
            .collect();
        let degree = |object: usize| edges.iter().filter(|(s, _, r)| *s == object || *r == object).count();

        let mut placed: Vec<usize> = Vec::new();
        let mut steps: Vec<Step> = Vec::new();
        while placed.len() < count {
            let links = |object: usize| {
                edges
                    .iter()
                    .filter(|(s, _, r)| (*s == object && placed.contains(r)) || (*r == object && placed.contains(s)))
                    .count()
            };
            let Some(object) = (0..count)
                .filter(|object| !placed.contains(object))
                .filter(|&object| support[object].is_none_or(|support| placed.contains(&support)))
                .max_by_key(|&object| (links(object), degree(object), std::cmp::Reverse(object)))
            else {
                let left = (0..count).filter(|object| !placed.contains(object));
                let uids = left.map(|object| task.scene_graph.nodes[object].uid.clone()).collect();
                return Err(LayoutError::SupportCircle { uids });
            };
            let relations: Vec<(Relation, usize)> = edges
                .iter()
                .filter_map(|&(s, relation, r)| {
                    if s == object && placed.contains(&r) {
                        Some((relation, r))
                    } else if r == object && placed.contains(&s) {
                        relation.inverse().map(|inverse| (inverse, s))
                    } else {
                        None
                    }
                })
                .collect();
            let sketch = sketch(object, &relations, &steps, models);
            steps.push(Step { object, support: support[object], relations, sketch });
            placed.push(object);
        }
        let sketch_min =
            steps.iter().fold(DVec2::INFINITY, |min, step| min.min(step.sketch - half(step.object, models)));
        let sketch_max =
            steps.iter().fold(DVec2::NEG_INFINITY, |max, step| max.max(step.sketch + half(step.object, models)));
        Ok(Self { steps, sketch_min, sketch_max })
    }
}

impl PlacementPlan {
    /// What an object stands on or lies in; `None` for the table.
    pub fn support_of(&self, object: usize) -> Option<usize> {
        self.steps.iter().find(|step| step.object == object)?.support
    }
}

fn half(object: usize, models: &[Arc<ObjectModel>]) -> DVec2 {
    models[object].card.size_m.truncate() * 0.5
}

/// A typical place beside the first object it is related to.
fn sketch(object: usize, relations: &[(Relation, usize)], steps: &[Step], models: &[Arc<ObjectModel>]) -> DVec2 {
    let at = |anchor: usize| steps.iter().find(|step| step.object == anchor).map_or(DVec2::ZERO, |step| step.sketch);
    let Some(&(relation, anchor)) = relations.first() else { return DVec2::ZERO };
    let reach = half(object, models) + half(anchor, models) + DVec2::splat(0.06);
    at(anchor)
        + match relation {
            Relation::Front => DVec2::new(reach.x, 0.0),
            Relation::Back => DVec2::new(-reach.x, 0.0),
            Relation::Left => DVec2::new(0.0, reach.y),
            Relation::Right => DVec2::new(0.0, -reach.y),
            _ => DVec2::ZERO,
        }
}

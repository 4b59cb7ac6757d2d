//! The problem of one layout, as every draw of it sees it: objects, edges, the order of placing, what the goal needs.

use std::sync::Arc;

use genmanip_core::{Atom, Goal, ObjectModel, Relation, Task, World};
use genmanip_scene::relations::RelationSettings;

use crate::LayoutSettings;
use crate::order::Step;

/// What every draw of one task shares.
pub(crate) struct Context<'a> {
    pub task: &'a Task,
    /// The task's goal as it is judged.
    pub goal: &'a Goal,
    /// The graph's nodes in their order, distractors behind them.
    pub models: Vec<Arc<ObjectModel>>,
    /// Joint positions of each object's initial state.
    pub joints: Vec<Vec<f64>>,
    /// The graph's edges with the indices of their objects, subject first.
    pub edges: Vec<(Atom, Vec<usize>)>,
    pub steps: Vec<Step>,
    /// Whether the goal moves the object.
    pub moved: Vec<bool>,
    /// Per alternative of the goal: where moved objects must find room.
    pub goal_rooms: Vec<Vec<GoalRoom>>,
    /// Per alternative of the goal: what it wants between two objects that stay, subject first.
    pub goal_betweens: Vec<Vec<[usize; 3]>>,
    pub settings: &'a LayoutSettings,
    pub world: &'a World,
    /// Nearest and farthest distance of a moved object from the robot's axis, metres.
    pub reach_m: [f64; 2],
    pub relations: &'a RelationSettings,
}

/// Where the goal wants an object: its relations to objects that stay where they are.
#[derive(Clone, Debug)]
pub(crate) struct GoalRoom {
    pub object: usize,
    pub anchors: Vec<(Relation, usize)>,
}

impl Context<'_> {
    /// Replaces the distractors: free objects that are placed last.
    pub fn set_distractors(&mut self, models: Vec<Arc<ObjectModel>>) {
        let nodes = self.task.scene_graph.nodes.len();
        self.models.truncate(nodes);
        self.joints.truncate(nodes);
        self.moved.truncate(nodes);
        self.steps.truncate(nodes);
        for model in models {
            self.steps.push(Step { object: self.models.len(), support: None, support_edge: None });
            self.joints.push(vec![0.0; model.joint_count()]);
            self.moved.push(false);
            self.models.push(model);
        }
    }

    /// Index of what the object stands on or lies in; `None` for the table.
    /// What the scene calls an object: a node by its id, a distractor by its uid.
    pub fn id(&self, object: usize) -> String {
        let node = self.task.scene_graph.nodes.get(object);
        node.map_or_else(|| self.models[object].card.uid.clone(), |node| node.id.clone())
    }

    pub fn support_of(&self, object: usize) -> Option<usize> {
        self.steps.iter().find(|step| step.object == object)?.support.map(|(support, _)| support)
    }

    /// Whether the object stands on or lies in the carrier, directly or through others.
    pub fn carries(&self, carrier: usize, mut object: usize) -> bool {
        while let Some(support) = self.support_of(object) {
            if support == carrier {
                return true;
            }
            object = support;
        }
        false
    }

    fn is_distractor(&self, object: usize) -> bool {
        object >= self.task.scene_graph.nodes.len()
    }

    /// Smallest distance in the plane between two objects of which neither carries the other, metres.
    pub fn gap(&self, a: usize, b: usize) -> f64 {
        match (self.support_of(a), self.support_of(b)) {
            (None, None) if self.is_distractor(a) || self.is_distractor(b) => self.settings.distractor_gap_m,
            (None, None) => self.settings.min_gap_m,
            _ => self.settings.min_gap_on_carrier_m,
        }
    }
}

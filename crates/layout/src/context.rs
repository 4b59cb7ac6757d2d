//! The problem of one layout, as every draw of it sees it: objects, edges, the order of placing, what the goal needs.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, Goal, ObjectModel, Relation, RobotModel, Task, Workspace, World};
use genmanip_relations::{RelationSettings, Window, placement_window};

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
    /// The graph's edges with the indices of their objects, subject first, surfaces left out.
    pub edges: Vec<(Atom, Vec<usize>)>,
    pub steps: Vec<Step>,
    /// Per object, the index of the support surface that it, or what carries it, stands on.
    pub grounds: Vec<usize>,
    /// Whether the goal moves the object.
    pub moved: Vec<bool>,
    /// Per alternative of the goal: where moved objects must find room.
    pub goal_rooms: Vec<Vec<GoalRoom>>,
    /// Per alternative of the goal: what it wants between two objects that stay, subject first.
    pub goal_betweens: Vec<Vec<[usize; 3]>>,
    /// The alternatives of the goal that only say how things stand beside each other, with the indices of their objects.
    pub goal_sides: Vec<(Vec<Atom>, Vec<usize>)>,
    /// Smallest gap between a distractor and anything else in the draws at hand, metres.
    pub distractor_gap_m: f64,
    /// The robot, which the cameras see too.
    pub robot: &'a Arc<RobotModel>,
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
    /// Objects by their indices.
    pub anchors: Vec<(Relation, usize)>,
    /// Support surfaces, by their indices in the world.
    pub surfaces: Vec<(Relation, usize)>,
}

impl GoalRoom {
    /// The surface it is to stand on, where nothing else carries it.
    pub fn ground(&self) -> usize {
        self.surfaces.iter().find(|(relation, _)| relation.is_support()).map_or(0, |(_, surface)| *surface)
    }
}

impl Context<'_> {
    /// Replaces the distractors: free objects that are placed last.
    pub fn set_distractors(&mut self, models: Vec<Arc<ObjectModel>>) {
        let nodes = self.task.scene_graph.nodes.len();
        self.models.truncate(nodes);
        self.joints.truncate(nodes);
        self.moved.truncate(nodes);
        self.steps.truncate(nodes);
        self.grounds.truncate(nodes);
        for model in models {
            self.steps.push(Step { object: self.models.len(), support: None, support_edge: None });
            self.joints.push(vec![0.0; model.joint_count()]);
            self.moved.push(false);
            self.grounds.push(0);
            self.models.push(model);
        }
    }

    /// What the scene calls an object: a node by its id, a distractor by its uid.
    pub fn id(&self, object: usize) -> String {
        let node = self.task.scene_graph.nodes.get(object);
        node.map_or_else(|| self.models[object].card.uid.clone(), |node| node.id.clone())
    }

    /// Index of the object that the object stands on or lies in; `None` for the table and other surfaces.
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

    /// Where the bounds of what stands on a surface may be, without those that turn with it: of the table the `area`, of
    /// another one the bounds of its top within its margin.
    pub fn area(&self, ground: usize, area: Workspace) -> Workspace {
        self.world.surfaces.get(ground).filter(|_| ground > 0).map_or(area, |surface| surface.area(0.0))
    }

    /// Height of a surface's top, metres.
    pub fn height(&self, ground: usize) -> f64 {
        self.world.surfaces.get(ground).map_or(0.0, |surface| surface.top_center_m.z)
    }

    /// Where a surface other than the table wants the middle of something that is related to it.
    pub fn surface_window(&self, relation: Relation, surface: usize, size: DVec3) -> Option<Window> {
        let bounds = self.world.surfaces.get(surface)?.slab_bounds();
        placement_window(relation, &bounds, size, self.relations)
    }

    /// Smallest distance in the plane between two objects of which neither carries the other, metres.
    pub fn gap(&self, a: usize, b: usize) -> f64 {
        match (self.support_of(a), self.support_of(b)) {
            (None, None) if self.is_distractor(a) || self.is_distractor(b) => self.distractor_gap_m,
            (None, None) => self.settings.min_gap_m,
            _ => self.settings.min_gap_on_carrier_m,
        }
    }
}

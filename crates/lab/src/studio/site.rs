//! Scenarios in which a fault is planted, and what must stay as it is.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, GraphEdge, Pose, Scenario};
use genmanip_layout::Move;
use genmanip_relations::{PosedScene, Rest, judge_atom, judge_goal, outlines_apart};
use genmanip_studio::edit::{Operation, Placement};
use genmanip_studio::verdict::Equipment;

/// A scenario with a fault.
pub struct Planted {
    /// The scenario.
    pub scenario: Arc<Scenario>,
    /// Ids of the objects of which one has to be named.
    pub objects: Vec<String>,
    /// Id of the neighbour that has to be named too.
    pub neighbour: Option<String>,
}

/// A scenario in which a fault is planted.
pub(super) struct Site<'a> {
    pub scenario: &'a Scenario,
    pub scene: PosedScene,
    pub equipment: &'a Equipment,
    /// First object that the goal has carried; `None` for a goal with alternatives.
    pub step: Option<Move>,
}

impl Site<'_> {
    pub fn count(&self) -> usize {
        self.scenario.objects.len()
    }

    pub fn id(&self, index: usize) -> String {
        self.scenario.objects[index].id.clone()
    }

    pub fn target(&self) -> Option<usize> {
        self.step.as_ref().map(|step| step.object)
    }

    /// The scenario after some operations.
    pub fn planted(&self, operations: &[Operation], objects: Vec<String>) -> Option<Planted> {
        let mut changed = self.scenario.clone();
        for operation in operations {
            changed = operation.apply(&changed, self.equipment.assets).ok()?.scenario;
        }
        Some(Planted { scenario: Arc::new(changed), objects, neighbour: None })
    }

    /// The operation that shifts an object.
    pub fn shifted(&self, index: usize, by: DVec3) -> Operation {
        let pose = self.scenario.objects[index].pose;
        let pose = Pose { position: pose.position + by, ..pose };
        Operation::Place { objects: vec![Placement { id: self.id(index), pose, joint_positions: None }] }
    }

    /// The scene with a shifted object.
    pub fn moved(&self, index: usize, by: DVec3) -> PosedScene {
        let mut moved = self.scene.clone();
        moved.shift(index, by);
        moved
    }

    /// True if no support edge names the object, so that it stands on the table alone.
    pub fn is_alone(&self, index: usize) -> bool {
        let id = &self.scenario.objects[index].id;
        let mut supports = self.scenario.task.scene_graph.edges.iter().filter(|edge| edge.relation.is_support());
        !supports.any(|edge| edge.subject == *id || edge.reference == *id)
    }

    pub fn is_clear(&self, moved: &PosedScene, index: usize, gap_m: f64) -> bool {
        (0..self.count()).all(|other| other == index || outlines_apart(moved, index, other, gap_m))
    }

    /// True if no edge is false and the goal is not reached.
    pub fn keeps_the_rest(&self, moved: &PosedScene) -> bool {
        self.keeps_edges(moved) && !self.is_reached(moved)
    }

    pub fn keeps_edges(&self, moved: &PosedScene) -> bool {
        self.false_edges(moved).is_empty()
    }

    pub fn false_edges(&self, moved: &PosedScene) -> Vec<Atom> {
        let edges = self.scenario.task.scene_graph.edges.iter().map(GraphEdge::atom);
        edges.filter(|edge| !judge_atom(moved, edge, &self.scenario.world.relations).holds).collect()
    }

    pub fn is_reached(&self, moved: &PosedScene) -> bool {
        let goal = self.scenario.task.judged_goal();
        judge_goal(moved, &goal, &Rest::default(), &self.scenario.world.relations).success
    }
}

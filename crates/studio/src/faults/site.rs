//! Scenarios to plant a fault in, with operations and checks that the rest of the scenario stays as it is.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, GraphEdge, InstanceId, Pose, Scenario};
use genmanip_layout::Move;
use genmanip_relations::{PosedScene, Rest, judge_atom, judge_goal, outlines_apart};

use crate::edit::{Operation, Placement};
use crate::verdict::Equipment;

/// A scenario with a fault.
pub struct Planted {
    /// The scenario with the fault.
    pub scenario: Arc<Scenario>,
    /// Ids of the objects that have the fault; the verdict must name at least one.
    pub objects: Vec<InstanceId>,
    /// Id of the neighbour that blocks the grasp; `None` for other faults.
    pub neighbour: Option<InstanceId>,
}

/// A scenario in which a fault is planted.
pub(super) struct Site<'a> {
    pub scenario: &'a Scenario,
    pub scene: PosedScene,
    pub equipment: &'a Equipment,
    /// First move that the goal requires; `None` for a goal with alternatives.
    pub step: Option<Move>,
}

impl Site<'_> {
    pub fn count(&self) -> usize {
        self.scenario.objects.len()
    }

    pub fn id(&self, index: usize) -> InstanceId {
        self.scenario.objects[index].id.clone()
    }

    pub fn target(&self) -> Option<usize> {
        self.step.as_ref().map(|step| step.object)
    }

    /// The scenario after these operations, with the objects to be named; `None` if an operation does not apply.
    pub fn planted(&self, operations: &[Operation], objects: Vec<InstanceId>) -> Option<Planted> {
        let mut changed = self.scenario.clone();
        for operation in operations {
            changed = operation.apply(&changed, self.equipment.assets).ok()?.scenario;
        }
        Some(Planted { scenario: Arc::new(changed), objects, neighbour: None })
    }

    /// Operation that shifts an object by a vector, m.
    pub fn shifted(&self, index: usize, by: DVec3) -> Operation {
        let pose = self.scenario.objects[index].pose;
        let pose = Pose { position: pose.position + by, ..pose };
        Operation::Place { objects: vec![Placement { id: self.id(index), pose, joint_positions: None }] }
    }

    /// The posed scene with an object shifted by a vector, m.
    pub fn moved(&self, index: usize, by: DVec3) -> PosedScene {
        let mut moved = self.scene.clone();
        moved.shift(index, by);
        moved
    }

    /// True if no support edge (such as `on` or `in`) names the object: it stands on the table and carries nothing.
    pub fn is_alone(&self, index: usize) -> bool {
        let id = &self.scenario.objects[index].id;
        let mut supports = self.scenario.task.scene_graph.edges.iter().filter(|edge| edge.relation.is_support());
        !supports.any(|edge| edge.subject == *id || edge.reference == *id)
    }

    pub fn is_clear(&self, moved: &PosedScene, index: usize, gap_m: f64) -> bool {
        (0..self.count()).all(|other| other == index || outlines_apart(moved, index, other, gap_m))
    }

    /// True if every edge of the scene graph holds and the goal is not reached.
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

//! The layout problem shared by all attempts: objects, edges, placement order, goal regions.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{Atom, Goal, InstanceId, ObjectModel, Relation, RobotModel, Task, Workspace, World};
use genmanip_relations::{RelationSettings, Window, placement_window};

use crate::LayoutSettings;
use crate::order::Step;

/// Layout problem of one task: distractors and their gap change from attempt to attempt, all else is fixed.
pub(crate) struct Context<'a> {
    pub task: &'a Task,
    /// Goal expanded by permutations of interchangeable copies, see [`Task::judged_goal`].
    pub goal: &'a Goal,
    /// Models of the graph's nodes in order, followed by distractors.
    pub models: Vec<Arc<ObjectModel>>,
    /// Joint positions of each object's initial state.
    pub joints: Vec<Vec<f64>>,
    /// Edges of the graph with the indices of their objects, subject first; surfaces have no index.
    pub edges: Vec<(Atom, Vec<usize>)>,
    pub steps: Vec<Step>,
    /// Per object, the index of the support surface below it, directly or through its carriers.
    pub grounds: Vec<usize>,
    /// Per object, true if the goal moves it.
    pub moved: Vec<bool>,
    /// Per goal alternative, the target regions of moved objects.
    pub goal_regions: Vec<Vec<GoalRegion>>,
    /// Per goal alternative, `between` relations with references that stay, subject first.
    pub goal_betweens: Vec<Vec<[usize; 3]>>,
    /// Goal alternatives with only directional relations, with the indices of their objects.
    pub goal_sides: Vec<(Vec<Atom>, Vec<usize>)>,
    /// Minimum gap between a distractor and other objects in the current attempt (m).
    pub distractor_gap_m: f64,
    /// Model of the robot, which may occlude objects.
    pub robot: &'a Arc<RobotModel>,
    pub settings: &'a LayoutSettings,
    pub world: &'a World,
    /// Minimum and maximum distance of a moved object from the robot's axis (m).
    pub reach_m: [f64; 2],
    pub relations: &'a RelationSettings,
}

/// Target region of an object: its relations to objects and surfaces that stay.
#[derive(Clone, Debug)]
pub(crate) struct GoalRegion {
    pub object: usize,
    /// Relations to objects, by index.
    pub anchors: Vec<(Relation, usize)>,
    /// Relations to support surfaces, by index in the world.
    pub surfaces: Vec<(Relation, usize)>,
}

impl GoalRegion {
    /// Index of the target surface; 0 for the table.
    pub fn ground(&self) -> usize {
        self.surfaces.iter().find(|(relation, _)| relation.is_support()).map_or(0, |(_, surface)| *surface)
    }
}

impl Context<'_> {
    /// Replaces the distractors, which have no relations and are placed last.
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

    /// True if the arm must reach the object: it is moved, or a short arm puts another one in or on it. The area of
    /// other arms lies within their reach, almost everywhere.
    pub fn must_be_reached(&self, object: usize) -> bool {
        let receives = || {
            let mut anchors = self.goal_regions.iter().flatten().flat_map(|region| &region.anchors);
            anchors.any(|&(relation, anchor)| relation.is_support() && anchor == object)
        };
        self.moved[object] || self.robot.reach_scale() < 1.0 && receives()
    }

    /// Id of an object in the scene; a distractor is the only instance of its asset.
    pub fn id(&self, object: usize) -> InstanceId {
        let node = self.task.scene_graph.nodes.get(object);
        node.map_or_else(|| InstanceId::new(&self.models[object].card.uid, 1), |node| node.id.clone())
    }

    /// Index of the supporting or containing object; `None` for the table and other surfaces.
    pub fn support_of(&self, object: usize) -> Option<usize> {
        self.steps.iter().find(|step| step.object == object)?.support.map(|(support, _)| support)
    }

    /// True if the carrier supports the object, directly or through others.
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

    /// Area in which the bounds of objects on a surface must lie: `area` for the table; for others the bounds of the
    /// top, inset by its edge margin.
    pub fn area(&self, ground: usize, area: Workspace) -> Workspace {
        self.world.surfaces.get(ground).filter(|_| ground > 0).map_or(area, |surface| surface.area(0.0))
    }

    /// Height of a surface's top (m).
    pub fn height(&self, ground: usize) -> f64 {
        self.world.surfaces.get(ground).map_or(0.0, |surface| surface.top_center_m.z)
    }

    /// Region of an object's centre allowed by a relation to a surface other than the table; `None` if the relation
    /// gives no region.
    pub fn surface_window(&self, relation: Relation, surface: usize, size: DVec3) -> Option<Window> {
        let bounds = self.world.surfaces.get(surface)?.slab_bounds();
        placement_window(relation, &bounds, size, self.relations)
    }

    /// Minimum planar gap between two objects of which neither carries the other (m).
    pub fn gap(&self, a: usize, b: usize) -> f64 {
        match (self.support_of(a), self.support_of(b)) {
            (None, None) if self.is_distractor(a) || self.is_distractor(b) => self.distractor_gap_m,
            (None, None) => self.settings.min_gap_m,
            _ => self.settings.min_gap_on_carrier_m,
        }
    }
}

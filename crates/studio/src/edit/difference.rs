//! Difference between two revisions of a scenario.

use genmanip_core::{Goal, GraphEdge, InstanceId, Scenario, TaskKind};
use serde::Serialize;

/// Difference between two revisions.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Objects whose position differs.
    pub moved: Vec<Moved>,
    /// Objects whose orientation differs.
    pub turned: Vec<Turned>,
    /// Ids of objects whose joint positions or states differ.
    pub articulated: Vec<InstanceId>,
    /// Ids of objects only in the later revision.
    pub added: Vec<InstanceId>,
    /// Ids of objects only in the earlier revision.
    pub removed: Vec<InstanceId>,
    /// Instruction before and after; `None` if equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instruction: Option<[String; 2]>,
    /// Goal before and after; `None` if equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub goal: Option<[Goal; 2]>,
    /// Kind of the task before and after; `None` if equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<[TaskKind; 2]>,
    /// Edges only in the later scene graph.
    pub edges_added: Vec<GraphEdge>,
    /// Edges only in the earlier scene graph.
    pub edges_removed: Vec<GraphEdge>,
    /// Description of the scene before and after; `None` if equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub description: Option<[String; 2]>,
    /// Names of cameras that were added, removed or changed.
    pub cameras: Vec<String>,
}

/// An object at another position.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Moved {
    /// Id of the object.
    pub id: InstanceId,
    /// Distance between the two positions, m.
    pub distance_m: f64,
}

/// An object with another orientation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Turned {
    /// Id of the object.
    pub id: InstanceId,
    /// Angle between the two orientations, rad.
    pub angle_rad: f64,
}

/// Minimum angle between two orientations that count as different, rad.
const MIN_TURN_RAD: f64 = 1e-6;

impl Difference {
    /// The difference between two scenarios.
    pub fn between(before: &Scenario, after: &Scenario) -> Self {
        let mut difference = Self::default();
        let state = |scenario: &Scenario, id: &InstanceId| {
            let graph = &scenario.task.scene_graph;
            graph.index_of(id).and_then(|node| graph.nodes[node].state.clone())
        };
        for old in &before.objects {
            let Some(new) = after.index_of(&old.id).map(|index| &after.objects[index]) else {
                difference.removed.push(old.id.clone());
                continue;
            };
            let id = || old.id.clone();
            let distance_m = old.pose.position.distance(new.pose.position);
            if distance_m > 0.0 {
                difference.moved.push(Moved { id: id(), distance_m });
            }
            let angle_rad = old.pose.angle_to(&new.pose);
            if angle_rad > MIN_TURN_RAD && old.pose.rotation != new.pose.rotation {
                difference.turned.push(Turned { id: id(), angle_rad });
            }
            if old.joint_positions != new.joint_positions || state(before, &old.id) != state(after, &old.id) {
                difference.articulated.push(id());
            }
        }
        let is_new = |object: &&genmanip_core::PlacedObject| before.index_of(&object.id).is_none();
        difference.added = after.objects.iter().filter(is_new).map(|object| object.id.clone()).collect();
        let (old, new) = (&before.task, &after.task);
        difference.instruction = changed(&old.instruction, &new.instruction);
        difference.goal = changed(&old.goal, &new.goal);
        difference.kind = changed(&old.kind, &new.kind);
        difference.description = changed(&old.scene_graph.description, &new.scene_graph.description);
        let missing = |from: &[GraphEdge], of: &[GraphEdge]| -> Vec<GraphEdge> {
            of.iter().filter(|edge| !from.contains(edge)).cloned().collect()
        };
        difference.edges_added = missing(&old.scene_graph.edges, &new.scene_graph.edges);
        difference.edges_removed = missing(&new.scene_graph.edges, &old.scene_graph.edges);
        let cameras = [before, after].into_iter().flat_map(|scenario| &scenario.world.cameras);
        let differs = |name: &str| before.world.camera(name) != after.world.camera(name);
        for camera in cameras.filter(|camera| differs(&camera.name)) {
            if !difference.cameras.contains(&camera.name) {
                difference.cameras.push(camera.name.clone());
            }
        }
        difference
    }
}

fn changed<T: Clone + PartialEq>(old: &T, new: &T) -> Option<[T; 2]> {
    (old != new).then(|| [old.clone(), new.clone()])
}

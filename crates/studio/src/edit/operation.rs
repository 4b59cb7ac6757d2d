//! Operations: all changes that can be made to a scenario.

use std::sync::Arc;

use genmanip_core::{
    AssetRef, AssetUid, Camera, Goal, GraphEdge, GraphNode, InstanceId, ObjectCard, PlacedObject, Pose, Request,
    Scenario, TaskKind,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A change of a scenario: `{"op": "place", "args": {…}}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "op", content = "args", rename_all = "snake_case", deny_unknown_fields)]
pub enum Operation {
    /// Gives objects new poses and joint positions.
    Place {
        /// The objects with their new placement.
        objects: Vec<Placement>,
    },
    /// Sets the initial state of an articulated object in the scene graph, and moves its joints into it.
    State {
        /// Id of the object.
        object: InstanceId,
        /// Name of the state; absent to remove it from the graph.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        state: Option<String>,
        /// Joint positions, rad or m; the nominal ones of the state if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        joint_positions: Option<Vec<f64>>,
    },
    /// Adds an object from the catalogue.
    Add {
        /// The asset, or its uid.
        asset: ChosenAsset,
        /// Id of the new instance; the first free one of the asset if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<InstanceId>,
        /// Pose of the object, `world_from_object`.
        pose: Pose,
        /// True for a distractor: it has no node in the scene graph, and no instruction may mention it.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        distractor: bool,
    },
    /// Removes an object and the edges that name it.
    Remove {
        /// Id of the object.
        object: InstanceId,
    },
    /// Restores a removed object; the inverse of `remove`.
    Insert {
        /// The removed object with everything that referred to it.
        instance: Box<Instance>,
    },
    /// Adds another instance of an object's asset.
    Duplicate {
        /// Id of the object.
        object: InstanceId,
        /// Pose of the new instance, `world_from_object`; a free place beside the original if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pose: Option<Pose>,
        /// Id of the new instance; the first free one of the asset if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<InstanceId>,
    },
    /// Replaces an object's asset; goal and scene graph then refer to the new id.
    Swap {
        /// Id of the object.
        object: InstanceId,
        /// The new asset, or its uid.
        uid: ChosenAsset,
        /// New id; the first free one of the new asset if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<InstanceId>,
    },
    /// Replaces an object by another complete one; the inverse of `swap`.
    Exchange {
        /// Id of the object.
        object: InstanceId,
        /// The complete object that replaces it.
        instance: Box<Instance>,
    },
    /// Sets the instruction of the task.
    Instruction {
        /// The new instruction.
        text: String,
    },
    /// Sets the goal of the task.
    Goal {
        /// The new goal, a disjunction of conjunctions.
        goal: Goal,
    },
    /// Sets the relations of the initial scene graph.
    Edges {
        /// All edges of the graph, which replace the present ones.
        edges: Vec<GraphEdge>,
        /// Description of the scene; kept if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        description: Option<String>,
    },
    /// Sets the kind of the task.
    Kind {
        /// The new kind.
        kind: TaskKind,
    },
    /// Adds a camera, or replaces the one of the same name.
    Camera {
        /// The new or changed camera.
        camera: Box<Camera>,
        /// Index of a new camera in the list; the end if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        index: Option<usize>,
    },
    /// Removes a camera.
    RemoveCamera {
        /// Name of the camera.
        name: String,
    },
}

/// Placement of one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// Id of the object.
    pub id: InstanceId,
    /// New pose, `world_from_object`.
    pub pose: Pose,
    /// Joint positions, rad or m; kept if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_positions: Option<Vec<f64>>,
}

/// An asset, by uid or by the reference that scenarios use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ChosenAsset {
    /// Uid in the catalogue.
    Uid(AssetUid),
    /// Reference with its source.
    Reference(AssetRef),
}

/// An object with everything that refers to it in a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// The object as in the scenario's list of objects.
    pub object: PlacedObject,
    /// Index in the list of objects.
    pub index: usize,
    /// Node in the scene graph, and card; absent for a distractor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<NodeWithCard>,
    /// Edges that name the object, each with its index in the list.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub edges: Vec<(usize, GraphEdge)>,
    /// Groups of interchangeable instances; absent if they are derived from the instruction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interchangeable: Option<Vec<Vec<InstanceId>>>,
    /// The alternative request; absent if it does not name the object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_request: Option<Request>,
}

/// A node of the scene graph with its card.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NodeWithCard {
    /// Index in the list of nodes.
    pub index: usize,
    /// The object's node in the scene graph.
    pub node: GraphNode,
    /// Card of the object.
    pub card: Arc<ObjectCard>,
}

/// Result of an operation.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The scenario after the operation.
    pub scenario: Scenario,
    /// The operation with every optional choice filled in, such as the id of a new object.
    pub operation: Operation,
    /// Operation that undoes the change.
    pub inverse: Operation,
}

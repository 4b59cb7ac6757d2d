//! Operations: the changes of a scenario.

use std::sync::Arc;

use genmanip_core::{
    AssetRef, Camera, Goal, GraphEdge, GraphNode, ObjectCard, PlacedObject, Pose, Request, Scenario, TaskKind,
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
    /// Names the state of an articulated object in the scene graph and brings its joints there.
    State {
        /// Id of the object.
        object: String,
        /// Name of the state; none to remove it from the graph.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        state: Option<String>,
        /// Joint positions, rad or m; those of the state if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        joint_positions: Option<Vec<f64>>,
    },
    /// Adds an object from the catalogue.
    Add {
        /// The asset, or its uid.
        asset: ChosenAsset,
        /// Id of the instance; the first free one of the asset if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// `world_from_object`.
        pose: Pose,
        /// True for an object without a node in the scene graph, which no instruction may mention.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        distractor: bool,
    },
    /// Removes an object and the edges that name it.
    Remove {
        /// Id of the object.
        object: String,
    },
    /// Puts a removed object back; the inverse of `remove`.
    Insert {
        /// The object with all that belongs to it.
        instance: Box<Instance>,
    },
    /// Adds another instance of an object's asset.
    Duplicate {
        /// Id of the object.
        object: String,
        /// `world_from_object` of the new instance; beside the first one if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        pose: Option<Pose>,
        /// Id of the new instance; the first free one of the asset if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
    },
    /// Replaces an object's asset; its id follows the new uid in goal and graph.
    Swap {
        /// Id of the object.
        object: String,
        /// The new asset, or its uid.
        uid: ChosenAsset,
        /// New id; the first free one of the new asset if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
    },
    /// Replaces an object by another one as it was; the inverse of `swap`.
    Exchange {
        /// Id of the object.
        object: String,
        /// The object that takes its place.
        instance: Box<Instance>,
    },
    /// Sets the instruction.
    Instruction {
        /// The instruction.
        text: String,
    },
    /// Sets the goal.
    Goal {
        /// Disjunction of conjunctions.
        goal: Goal,
    },
    /// Sets the relations of the initial scene.
    Edges {
        /// All edges.
        edges: Vec<GraphEdge>,
        /// Description of the scene; kept if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        description: Option<String>,
    },
    /// Sets the category of the task.
    Kind {
        /// The category.
        kind: TaskKind,
    },
    /// Adds a camera, or replaces the one with its name.
    Camera {
        /// The camera.
        camera: Box<Camera>,
        /// Place in the list of cameras of a new one; the end if absent.
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
    pub id: String,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions, rad or m; kept if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_positions: Option<Vec<f64>>,
}

/// An asset by uid, or as scenarios name it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum ChosenAsset {
    /// Uid in the catalogue.
    Uid(String),
    /// Reference with its source.
    Reference(AssetRef),
}

/// An object with all that belongs to it in a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// The object.
    pub object: PlacedObject,
    /// Place in the list of objects.
    pub index: usize,
    /// Node and card; none for a distractor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub node: Option<NodeWithCard>,
    /// Edges that name the object, with their places in the list.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub edges: Vec<(usize, GraphEdge)>,
    /// Groups of interchangeable instances, if they do not follow from the instruction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interchangeable: Option<Vec<Vec<String>>>,
    /// The alternative request, if it names the object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_request: Option<Request>,
}

/// A node of the scene graph with its card.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NodeWithCard {
    /// Place among the nodes.
    pub index: usize,
    /// The node.
    pub node: GraphNode,
    /// Its card.
    pub card: Arc<ObjectCard>,
}

/// Result of an operation.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The changed scenario.
    pub scenario: Scenario,
    /// The operation with its open choices made, such as the id of a new object.
    pub operation: Operation,
    /// Operation that takes it back.
    pub inverse: Operation,
}

//! Scenarios: a task laid out, frozen.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Camera, Document, Pose, Seed, Task};

/// A task with poses: everything an episode starts from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scenario {
    /// Name, unique in its collection and usable as a file name, e.g. `017_pick_and_place-03`.
    pub id: String,
    /// The task.
    pub task: Task,
    /// Seed the layout was drawn from.
    pub seed: Seed,
    /// Objects in the order of the task's nodes, distractors behind them.
    pub objects: Vec<PlacedObject>,
    /// Name of the robot.
    pub robot: String,
    /// Arm joint positions at the start.
    pub robot_home: Vec<f64>,
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// Usable area of the table.
    pub workspace: Workspace,
    /// Version of the program that made it.
    pub genmanip_version: String,
}

impl Document for Scenario {
    const SCHEMA: &'static str = "genmanip.scenario/1";
}

/// An object of a scenario, named so that a change of its physics is noticed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlacedObject {
    /// Uid in the catalogue.
    pub uid: String,
    /// Family of the generator.
    pub family: String,
    /// Seed of the generator.
    pub seed: Seed,
    /// Version of the generator.
    pub generator_version: u32,
    /// [`crate::ObjectModel::physics_hash`]; a mismatch is an error.
    pub physics_hash: String,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions of an articulated object, in the order of its links.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_positions: Vec<f64>,
}

/// The part of the table that may be used; the table top is at z = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Workspace {
    /// Nearest and farthest x.
    pub x: [f64; 2],
    /// Rightmost and leftmost y.
    pub y: [f64; 2],
}

impl Default for Workspace {
    fn default() -> Self {
        Self { x: [0.2, 0.9], y: [-0.5, 0.5] }
    }
}

impl Scenario {
    /// Index of an object.
    pub fn index_of(&self, uid: &str) -> Option<usize> {
        self.objects.iter().position(|object| object.uid == uid)
    }
}

//! Scenarios: a task laid out, frozen.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{Document, Pose, Seed, Task, Upgrade, World};

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
    /// Everything around them: surfaces, robot, cameras, and how things move and are judged.
    pub world: World,
    /// Version of the program that made it.
    pub genmanip_version: String,
}

impl Document for Scenario {
    const SCHEMA: &'static str = "genmanip.scenario/2";
    const PREVIOUS: Option<Upgrade> =
        Some(Upgrade { schema: "genmanip.scenario/1", upgrade: crate::upgrade::scenario_of_version_1 });
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

impl Scenario {
    /// Index of an object.
    pub fn index_of(&self, uid: &str) -> Option<usize> {
        self.objects.iter().position(|object| object.uid == uid)
    }
}

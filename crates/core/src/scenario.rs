//! Scenarios: tasks with a frozen layout.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::names::is_file_name;
use crate::upgrade;
use crate::{AssetRef, Document, DocumentError, Goal, InstanceId, Pose, ReferenceId, Seed, Task, Upgrade, World};

/// A task with poses: the initial conditions of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scenario {
    /// Name, unique in its collection and usable as a file name, e.g. `017_pick_and_place-03`.
    pub id: String,
    /// Instruction, goal and initial graph.
    pub task: Task,
    /// Seed from which the layout was sampled.
    pub seed: Seed,
    /// Instances in the order of the task's nodes, followed by distractors.
    pub objects: Vec<PlacedObject>,
    /// Surfaces, robot, cameras, physics and judging settings.
    pub world: World,
    /// Alternative request that the scene allows but the instruction does not make, to detect policies that ignore
    /// language; `None` if the scenario has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_request: Option<Request>,
    /// Version of the program that created it.
    pub genmanip_version: String,
}

/// An instruction and its goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Language instruction.
    pub instruction: String,
    /// Success condition of the request.
    pub goal: Goal,
}

impl Document for Scenario {
    const SCHEMA: &'static str = "genmanip.scenario/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::scenario::FROM_1);

    fn check(&self) -> Result<(), DocumentError> {
        let refuse = |path: String, message: String| Err(DocumentError::Invalid { path, message });
        if !is_file_name(&self.id) {
            let message = format!("expected a file name (letters, digits, any of -_.+=@), got {:?}", self.id);
            return refuse("$.id".into(), message.chars().take(200).collect());
        }
        if self.objects.len() > MAX_OBJECTS {
            return refuse("$.objects".into(), format!("expected at most {MAX_OBJECTS}, got {}", self.objects.len()));
        }
        for (index, object) in self.objects.iter().enumerate() {
            if self.objects[..index].iter().any(|other| other.id == object.id) {
                return refuse(format!("$.objects[{index}].id"), format!("expected a unique id, got {:?}", object.id));
            }
        }
        for (index, object) in self.objects.iter().enumerate() {
            if let Some((factor, value)) = object.physics.fault() {
                let expected = format!("expected {MIN_FACTOR} to {MAX_FACTOR}, got {value}");
                return refuse(format!("$.objects[{index}].physics.{factor}"), expected);
            }
        }
        match self.world.faults_of_parts().into_iter().next() {
            Some(fault) => refuse(format!("$.world.{}", fault.place), fault.expectation()),
            None => Ok(()),
        }
    }
}

/// Maximum number of objects in a scene; several times what fits on a table.
pub const MAX_OBJECTS: usize = 256;

/// An instance in a scenario, with hashes of its asset that detect changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlacedObject {
    /// Instance id, as in the task's graph.
    pub id: InstanceId,
    /// Asset of which this is an instance.
    pub asset: AssetRef,
    /// Physics hash, [`crate::AssetHashes::physics`]; a mismatch is an error.
    ///
    /// The prefix is the hash version: `v2:` currently, `v1:` in scenarios of version 1.
    pub physics_hash: String,
    /// Hash of further judging inputs, [`crate::AssetHashes::judging`]; a mismatch is an error.
    /// Absent in scenarios of version 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judging_hash: Option<String>,
    /// Appearance hash, [`crate::AssetHashes::looks`]; a mismatch is only reported. Absent in scenarios of version 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub looks_hash: Option<String>,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions of an articulated object, in link order: rad, or m for prismatic joints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_positions: Vec<f64>,
    /// Perturbation of the instance's physics.
    #[serde(default, skip_serializing_if = "PhysicsFactors::is_unchanged")]
    pub physics: PhysicsFactors,
}

/// Physics perturbation of an instance: factors on its asset's values, 1 for unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsFactors {
    /// Factor on the sliding friction.
    pub friction: f64,
    /// Factor on mass and inertia.
    pub mass: f64,
    /// Factor on contact damping; below 1 the object bounces.
    pub contact_damping: f64,
    /// Factor on joint damping and dry friction.
    pub joint_friction: f64,
}

/// Range of [`PhysicsFactors`]: a factor beyond it would make a different object. Chosen by hand.
const MIN_FACTOR: f64 = 0.1;
const MAX_FACTOR: f64 = 10.0;

impl PhysicsFactors {
    /// True if all factors are 1.
    pub fn is_unchanged(&self) -> bool {
        *self == Self::default()
    }

    /// Name and value of the first factor out of range; `None` if all are valid.
    fn fault(&self) -> Option<(&'static str, f64)> {
        let factors = [
            ("friction", self.friction),
            ("mass", self.mass),
            ("contact_damping", self.contact_damping),
            ("joint_friction", self.joint_friction),
        ];
        factors.into_iter().find(|(_, value)| !(MIN_FACTOR..=MAX_FACTOR).contains(value))
    }
}

impl Default for PhysicsFactors {
    fn default() -> Self {
        Self { friction: 1.0, mass: 1.0, contact_damping: 1.0, joint_friction: 1.0 }
    }
}

impl Scenario {
    /// Index of an instance by id; `None` if there is none.
    pub fn index_of(&self, id: &ReferenceId) -> Option<usize> {
        self.objects.iter().position(|object| object.id == *id)
    }
}

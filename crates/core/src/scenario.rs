//! Scenarios: a task laid out, frozen.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::names::is_file_name;
use crate::upgrade;
use crate::{AssetRef, Document, DocumentError, Goal, Pose, Seed, Task, Upgrade, World};

/// A task with poses: everything an episode starts from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scenario {
    /// Name, unique in its collection and usable as a file name, e.g. `017_pick_and_place-03`.
    pub id: String,
    /// The task.
    pub task: Task,
    /// Seed the layout was drawn from.
    pub seed: Seed,
    /// Instances in the order of the task's nodes, distractors behind them.
    pub objects: Vec<PlacedObject>,
    /// Everything around them: surfaces, robot, cameras, and how things move and are judged.
    pub world: World,
    /// Another request that the scene allows and that was not made: whoever does it did not listen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other_request: Option<Request>,
    /// Version of the program that made it.
    pub genmanip_version: String,
}

/// A sentence and what it asks for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// The sentence.
    pub instruction: String,
    /// When it is done.
    pub goal: Goal,
}

impl Document for Scenario {
    const SCHEMA: &'static str = "genmanip.scenario/2";
    const PREVIOUS: Option<Upgrade> = Some(upgrade::scenario::FROM_1);

    fn check(&self) -> Result<(), DocumentError> {
        let refuse = |path: String, message: String| Err(DocumentError::Invalid { path, message });
        if !is_file_name(&self.id) {
            let message = format!("expected a name of a file (letters, digits, any of -_.+=@), got {:?}", self.id);
            return refuse("$.id".into(), message.chars().take(200).collect());
        }
        if self.objects.len() > MOST_OBJECTS {
            return refuse("$.objects".into(), format!("expected at most {MOST_OBJECTS}, got {}", self.objects.len()));
        }
        for (index, object) in self.objects.iter().enumerate() {
            if self.objects[..index].iter().any(|other| other.id == object.id) {
                return refuse(
                    format!("$.objects[{index}].id"),
                    format!("expected an id of its own, got {:?}", object.id),
                );
            }
        }
        for (index, object) in self.objects.iter().enumerate() {
            if let Some((factor, value)) = object.physics.fault() {
                let expected = format!("expected {LEAST_FACTOR} to {MOST_FACTOR}, got {value}");
                return refuse(format!("$.objects[{index}].physics.{factor}"), expected);
            }
        }
        match self.world.faults_of_parts().into_iter().next() {
            Some(fault) => refuse(format!("$.world.{}", fault.place), fault.expectation()),
            None => Ok(()),
        }
    }
}

/// Most objects of a scene: several times what fits on a table.
pub const MOST_OBJECTS: usize = 256;

/// An instance of a scenario, with hashes of its asset, so that a change of that is noticed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlacedObject {
    /// What the scene calls it, as in the task's graph.
    pub id: String,
    /// What it is made from.
    pub asset: AssetRef,
    /// Hash of its physics, [`crate::AssetHashes::physics`]; a mismatch is an error.
    ///
    /// The prefix says how it was made: `v2:` today, `v1:` in scenarios of version 1.
    pub physics_hash: String,
    /// Hash of what else the judge uses, [`crate::AssetHashes::judging`]; a mismatch is an error.
    /// Scenarios of version 1 have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judging_hash: Option<String>,
    /// Hash of its looks, [`crate::AssetHashes::looks`]; a mismatch is only reported. Scenarios of version 1 have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub looks_hash: Option<String>,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions of an articulated object, in the order of its links.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joint_positions: Vec<f64>,
    /// How it moves differently from its asset.
    #[serde(default, skip_serializing_if = "PhysicsFactors::is_usual")]
    pub physics: PhysicsFactors,
}

/// How an instance moves differently from its asset: factors, 1 for what is as usual.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsFactors {
    /// Of the sliding friction.
    pub friction: f64,
    /// Of the mass, and of the inertia with it.
    pub mass: f64,
    /// Of the damping of its contacts: below 1 it bounces.
    pub contact_damping: f64,
    /// Of the damping and the dry friction of its joints.
    pub joint_friction: f64,
}

/// Range of [`PhysicsFactors`]; beyond, it is another thing.
const LEAST_FACTOR: f64 = 0.1;
const MOST_FACTOR: f64 = 10.0;

impl PhysicsFactors {
    /// Whether everything is as usual.
    pub fn is_usual(&self) -> bool {
        *self == Self::default()
    }

    /// A factor that cannot be, with its name.
    fn fault(&self) -> Option<(&'static str, f64)> {
        let factors = [
            ("friction", self.friction),
            ("mass", self.mass),
            ("contact_damping", self.contact_damping),
            ("joint_friction", self.joint_friction),
        ];
        factors.into_iter().find(|(_, value)| !(LEAST_FACTOR..=MOST_FACTOR).contains(value))
    }
}

impl Default for PhysicsFactors {
    fn default() -> Self {
        Self { friction: 1.0, mass: 1.0, contact_damping: 1.0, joint_friction: 1.0 }
    }
}

impl Scenario {
    /// Index of an instance.
    pub fn index_of(&self, id: &str) -> Option<usize> {
        self.objects.iter().position(|object| object.id == id)
    }
}

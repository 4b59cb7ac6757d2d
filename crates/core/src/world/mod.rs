//! The world of a scenario as data: what stands there, who works there, who looks on, and by which rules.
//!
//! Physics, planner, renderer, prompts, drawings and layout read one [`World`]; there is no second table anywhere.
//! World frame = robot base frame: +x away from the robot over the table, +y to its left, +z up, the table top at z = 0.
//!
//! A world falls into three parts with a hash each ([`WorldPart`]): *physics* and *judging* decide what happens and what
//! counts, so a replay in another one is refused; *looks* decide what is seen and are only reported.

mod check;
mod compare;
mod file;
mod settings;
mod surface;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use check::{WorldFault, camera_faults};
pub use compare::{WorldDifference, WorldHashes, WorldPart};
pub use file::{WorldFile, read_camera};
pub use settings::{PhysicsSettings, RelationSettings};
pub use surface::{Board, SupportSurface};

use crate::{Camera, Document, Look, NamedSurface};

/// Everything about a scenario that is neither its task nor its objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// Fixed slabs that things stand on; the first is the table, whose top is at z = 0.
    pub surfaces: Vec<SupportSurface>,
    /// Height of the floor, where things end that leave the surfaces, metres.
    pub floor_z_m: f64,
    /// The part of the table that may be used.
    pub workspace: Workspace,
    /// The robot.
    pub robot: WorldRobot,
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// How things move.
    pub physics: PhysicsSettings,
    /// How relations are judged.
    pub relations: RelationSettings,
    /// How it is drawn, where that is not as usual: light, background, table top, paint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<Look>,
}

impl Document for World {
    const SCHEMA: &'static str = "genmanip.world/1";
}

/// The robot of a world: which one, that it is the very same one, and how it starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldRobot {
    /// Name in the registry of robots, e.g. `panda`; its base is the world's origin.
    pub name: String,
    /// [`crate::RobotModel::physics_hash`]; a mismatch is an error.
    pub physics_hash: String,
    /// Arm joint positions to which it returns, and from which it starts unless `start` says otherwise, rad or m, base
    /// to hand.
    pub home: Vec<f64>,
    /// Arm joint positions at the start, where they are not `home`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<Vec<f64>>,
}

impl WorldRobot {
    /// Arm joint positions at the start, rad or m, base to hand.
    pub fn start(&self) -> &[f64] {
        self.start.as_deref().unwrap_or(&self.home)
    }

    /// Whether another one is the same robot with the same home, wherever it starts.
    pub fn is_same(&self, other: &Self) -> bool {
        (&self.name, &self.physics_hash, &self.home) == (&other.name, &other.physics_hash, &other.home)
    }
}

/// The part of the table that may be used; the table top is at z = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Nearest and farthest x, metres.
    pub x: [f64; 2],
    /// Rightmost and leftmost y, metres.
    pub y: [f64; 2],
}

impl World {
    /// The table: the first surface.
    pub fn table(&self) -> Option<&SupportSurface> {
        self.surfaces.first()
    }

    /// A support surface by its id.
    pub fn surface(&self, id: &str) -> Option<&SupportSurface> {
        self.surfaces.iter().find(|surface| surface.id == id)
    }

    /// Index among the surfaces of one other than the table, by its id.
    pub fn further_surface(&self, id: &str) -> Option<usize> {
        self.surfaces.iter().position(|surface| surface.id == id).filter(|&index| index > 0)
    }

    /// The support surfaces that tasks may name: all but the table.
    pub fn named_surfaces(&self) -> Vec<NamedSurface> {
        let named = |surface: &SupportSurface| NamedSurface { id: surface.id.clone(), name: surface.name.clone() };
        self.surfaces.iter().skip(1).map(named).collect()
    }

    /// A camera by its name.
    pub fn camera(&self, name: &str) -> Option<&Camera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }

    /// The cameras that prompt-based systems look through and that must see the objects of a task:
    /// `overview`, `left` and `right`, or every camera fixed in the world where there is none of these.
    pub fn prompt_cameras(&self) -> Vec<&Camera> {
        let fixed = || self.cameras.iter().filter(|camera| camera.mount == crate::CameraMount::World);
        let named: Vec<&Camera> =
            fixed().filter(|camera| ["overview", "left", "right"].contains(&camera.name.as_str())).collect();
        if named.is_empty() { fixed().collect() } else { named }
    }
}

impl Workspace {
    /// What two areas have in common; this one where that is nothing.
    #[must_use]
    pub fn within(&self, x: [f64; 2], y: [f64; 2]) -> Self {
        let common = |[low, high]: [f64; 2], [least, most]: [f64; 2]| [low.max(least), high.min(most)];
        let both = Self { x: common(self.x, x), y: common(self.y, y) };
        if both.x[0] < both.x[1] && both.y[0] < both.y[1] { both } else { *self }
    }
}

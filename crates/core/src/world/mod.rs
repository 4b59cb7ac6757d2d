//! The world of a scenario as data: surfaces, robot, cameras, physics and judging settings.
//!
//! Physics, planner, renderer, prompts, drawings and layout all read one [`World`].
//! World frame = robot base frame: +x away from the robot over the table, +y to its left, +z up, the table top at z =
//! 0.
//!
//! A world has three parts with a hash each ([`WorldPart`]): *physics* and *judging* decide the outcome, so a replay
//! in a world that differs there is refused; *looks* only affects appearance, so differences are merely reported.

mod appearance;
mod check;
mod compare;
mod fault;
mod file;
mod settings;
mod surface;
mod workspace;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use appearance::{
    CameraAppearance, CameraResponse, MIDDLE_GREY, MeasuredMaterial, Photograph, ToneCurve, WorkspaceAppearance,
    WorkspaceLight,
};
pub use check::camera_faults;
pub use compare::{WorldDifference, WorldHashes, WorldPart};
pub use fault::WorldFault;
pub use file::{WorldFile, read_camera};
pub use settings::{ArmPhysics, BetweenReading, PhysicsSettings, RelationSettings};
pub use surface::{Board, SupportSurface};
pub use workspace::Workspace;

use crate::{AppearanceRandomisation, Camera, Document, NamedSurface, ReferenceId};

/// Everything in a scenario except its task and objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// Fixed support surfaces; the first is the table, whose top is at z = 0.
    pub surfaces: Vec<SupportSurface>,
    /// Height of the floor, on which objects that leave the surfaces land, metres.
    pub floor_z_m: f64,
    /// Usable part of the table.
    pub workspace: Workspace,
    /// Name, physics hash, and home and start position of the robot.
    pub robot: WorldRobot,
    /// Fixed and wrist cameras; names are unique.
    pub cameras: Vec<Camera>,
    /// Simulation rates, gravity, friction and solver settings.
    pub physics: PhysicsSettings,
    /// Thresholds by which the judge decides the relations.
    pub relations: RelationSettings,
    /// Appearance randomisation: light, background, table top, object paint; `None` for the default appearance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<AppearanceRandomisation>,
    /// Appearance measured from photographs of the real workspace; `None` for the default appearance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub appearance: Option<WorkspaceAppearance>,
}

impl Document for World {
    const SCHEMA: &'static str = "genmanip.world/1";
}

/// The robot of a world: name, physics hash and start position.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WorldRobot {
    /// Name in the robot registry, e.g. `panda`; its base is the world origin.
    pub name: String,
    /// [`crate::RobotModel::physics_hash`]; a mismatch is an error.
    pub physics_hash: String,
    /// Home position of the arm, and its start position unless `start` is given, rad or m, base to tip.
    pub home: Vec<f64>,
    /// Start position of the arm, rad or m; `None` if the arm starts at `home`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<Vec<f64>>,
}

impl WorldRobot {
    /// Start position of the arm, rad or m, base to tip.
    pub fn start(&self) -> &[f64] {
        self.start.as_deref().unwrap_or(&self.home)
    }

    /// True if the other robot is the same with the same home position; start positions may differ.
    pub fn is_same(&self, other: &Self) -> bool {
        (&self.name, &self.physics_hash, &self.home) == (&other.name, &other.physics_hash, &other.home)
    }
}

impl World {
    /// The table: the first surface; `None` without surfaces.
    pub fn table(&self) -> Option<&SupportSurface> {
        self.surfaces.first()
    }

    /// A support surface by id; `None` if there is none.
    pub fn surface(&self, id: &ReferenceId) -> Option<&SupportSurface> {
        self.surfaces.iter().find(|surface| surface.id == *id)
    }

    /// Index of a surface other than the table, by id; `None` if no such surface has this id.
    pub fn further_surface(&self, id: &ReferenceId) -> Option<usize> {
        self.surfaces.iter().position(|surface| surface.id == *id).filter(|&index| index > 0)
    }

    /// The support surfaces that tasks may refer to: all but the table.
    pub fn named_surfaces(&self) -> Vec<NamedSurface> {
        self.surfaces.iter().skip(1).map(SupportSurface::named).collect()
    }

    /// A camera by name; `None` if there is none.
    pub fn camera(&self, name: &str) -> Option<&Camera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }

    /// Cameras used by prompt-based systems, which must see the objects of a task: `overview`, `left` and `right`, or
    /// every fixed camera if none of these exists.
    pub fn prompt_cameras(&self) -> Vec<&Camera> {
        let fixed = || self.cameras.iter().filter(|camera| camera.mount == crate::CameraMount::World);
        let named: Vec<&Camera> =
            fixed().filter(|camera| ["overview", "left", "right"].contains(&camera.name.as_str())).collect();
        if named.is_empty() { fixed().collect() } else { named }
    }
}

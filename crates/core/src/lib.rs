//! The vocabulary of GenManip: what a task, an object, a robot, a scenario, a policy and a verdict *are*.
//!
//! Everything here is a plain value with a documented unit and frame.
//! The crate does no IO, knows no simulator and draws no picture; every other crate speaks through these types.
//!
//! World frame = robot base frame: +x away from the robot over the table, +y to the robot's left, +z up.
//! Metres, radians, seconds, kilograms and newtons everywhere; a unit is in a name only where SI is not obvious.
//!
//! ```
//! use genmanip_core::{Pose, Seed, glam::DVec3};
//!
//! let world_from_mug = Pose::from_position_yaw(DVec3::new(0.5, 0.1, 0.0), std::f64::consts::FRAC_PI_2);
//! let handle_in_world = world_from_mug.transform_point(DVec3::new(0.05, 0.0, 0.04));
//! assert!((handle_in_world - DVec3::new(0.5, 0.15, 0.04)).length() < 1e-12);
//!
//! // Labelled sub-streams: one more draw for the layout changes nothing about the grasps.
//! assert_ne!(Seed::new(7).fork("layout"), Seed::new(7).fork("grasp"));
//! ```

pub mod action;
pub mod asset;
pub mod camera;
mod distortion;
pub mod document;
mod document_error;
pub mod episode;
pub mod geometry;
pub mod grasp;
mod hash;
pub mod image;
mod interchange;
mod intrinsics;
pub mod json;
pub mod limits;
mod look;
pub mod mesh;
pub mod names;
pub mod object;
pub mod perception;
pub mod policy;
pub mod pose;
mod projection;
pub mod robot;
pub mod scenario;
pub mod seed;
pub mod sensor;
pub mod stroke_font;
pub mod task;
pub mod upgrade;
pub mod verdict;
pub mod world;

pub use glam;

pub use action::{
    ActionContract, ActionFrame, ActionMismatch, ActionSpace, ActionSpec, Between, DeltaFrom, GripperEncoding,
    GripperSpec, RotationEncoding,
};
pub use asset::AssetRef;
pub use camera::{Camera, CameraMount};
pub use distortion::Distortion;
pub use document::{Document, LongDocument, Upgrade, long_from_json, long_from_reader, long_to_json, write_tagged};
pub use document_error::DocumentError;
pub use episode::{
    AttemptOutcome, CloudVerdict, Correction, Ending, Episode, EpisodeResult, Failure, FailureCause, Frame, HandPhase,
    NotRun, ObjectState, StrayContact,
};
pub use geometry::{Aabb, OrientedBox, Piece, Shape};
pub use grasp::{Grasp, TriedGrasp};
pub use hash::AssetHashes;
pub use image::{CameraRequest, ImageChannels, RgbdImage};
pub use interchange::{InterchangeError, MOST_ALTERNATIVES, MOST_INTERCHANGEABLE};
pub use intrinsics::Intrinsics;
pub use look::{Look, Vary};
pub use mesh::{Material, Texture, TriMesh, VisualPart};
pub use object::{
    Annotations, Joint, JointKind, JointState, MassProperties, ObjectCard, ObjectLink, ObjectModel, Room,
};
pub use policy::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, PrivilegedState};
pub use pose::Pose;
pub use projection::Projection;
pub use robot::{Drives, Gripper, Reach, RobotJoint, RobotLink, RobotModel};
pub use scenario::{PhysicsFactors, PlacedObject, Request, Scenario};
pub use seed::Seed;
pub use sensor::{CameraSensor, ColorSensor, DepthSensor};
pub use task::{Atom, Goal, GraphEdge, GraphNode, NamedSurface, Relation, SceneGraph, SharedCards, Task, TaskKind};
pub use verdict::{AtomVerdict, GoalVerdict, Measurement, Unit};
pub use world::{
    Board, PhysicsSettings, RelationSettings, SupportSurface, Workspace, World, WorldDifference, WorldFault, WorldFile,
    WorldHashes, WorldPart, WorldRobot,
};

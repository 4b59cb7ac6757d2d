//! The shared data types of GenManip: tasks, objects, robots, scenarios, policies and verdicts.
//!
//! Every type is a plain value with a documented unit and frame.
//! The crate performs no IO, knows no simulator and renders nothing; the other crates exchange these types.
//!
//! World frame = robot base frame: +x away from the robot over the table, +y to the robot's left, +z up.
//! SI units (m, rad, s, kg, N) throughout; names carry a unit only where it is not obvious.
//!
//! ```
//! use genmanip_core::{Pose, Seed, glam::DVec3};
//!
//! let world_from_mug = Pose::from_position_yaw(DVec3::new(0.5, 0.1, 0.0), std::f64::consts::FRAC_PI_2);
//! let handle_in_world = world_from_mug.transform_point(DVec3::new(0.05, 0.0, 0.04));
//! assert!((handle_in_world - DVec3::new(0.5, 0.15, 0.04)).length() < 1e-12);
//!
//! // Labelled sub-streams: an additional draw for the layout does not change the grasps.
//! assert_ne!(Seed::new(7).fork("layout"), Seed::new(7).fork("grasp"));
//! ```

pub mod action;
mod appearance;
pub mod asset;
pub mod camera;
mod distortion;
pub mod document;
mod document_error;
pub mod episode;
mod failure;
pub mod geometry;
pub mod grasp;
mod hash;
mod ids;
pub mod image;
mod interchange;
mod intrinsics;
pub mod json;
pub mod lenient_json;
pub mod limits;
pub mod mesh;
mod named_enum;
pub mod names;
pub mod object;
pub mod perception;
pub mod policy;
pub mod pose;
mod projection;
mod relation;
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
    ActionContract, ActionFrame, ActionMismatch, ActionSpace, ActionSpec, DeltaFrom, GripperEncoding, GripperSpec,
    Interpolation, RotationEncoding,
};
pub use appearance::{AppearanceFactor, AppearanceRandomisation};
pub use asset::AssetRef;
pub use camera::{Camera, CameraMount};
pub use distortion::Distortion;
pub use document::{Document, LongDocument, Upgrade, long_from_json, long_from_reader, long_to_json, write_tagged};
pub use document_error::DocumentError;
pub use episode::{
    AttemptOutcome, CloudVerdict, Correction, Ending, Episode, EpisodeResult, EpisodeSource, ExpertStyle, Frame,
    GripperPhase, NotRun, ObjectState, StrayContact,
};
pub use failure::{AgentFailure, AgentStage, FailedStage, Failure, FailureCause, FailureClass, StageCause};
pub use geometry::{Aabb, OrientedBox, Piece, Shape};
pub use grasp::{Grasp, VerifiedGrasp};
pub use hash::{AssetHashes, hexadecimal};
pub use ids::{AssetUid, IdError, InstanceId, ReferenceId, SurfaceId};
pub use image::{CameraRequest, ImageChannels, RgbdImage};
pub use interchange::{InterchangeError, MAX_ALTERNATIVES, MAX_INTERCHANGEABLE};
pub use intrinsics::Intrinsics;
pub use mesh::{Material, Texture, TriMesh, VisualPart};
pub use object::{
    Annotations, CavitySize, Joint, JointKind, JointState, MassProperties, ObjectCard, ObjectLink, ObjectModel,
};
pub use policy::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, PrivilegedState};
pub use pose::Pose;
pub use projection::Projection;
pub use relation::{HorizontalAxis, Relation, RelationFacts, RelationKind, Side, Support};
pub use robot::{Drives, Gripper, Mimic, Reach, RobotJoint, RobotLink, RobotModel};
pub use scenario::{PhysicsFactors, PlacedObject, Request, Scenario};
pub use seed::Seed;
pub use sensor::{CameraSensor, ColorSensor, DepthSensor};
pub use task::{Atom, Goal, GraphEdge, GraphNode, NamedSurface, SceneGraph, SharedCards, Task, TaskKind};
pub use verdict::{AtomVerdict, GoalVerdict, Measurement, Unit};
pub use world::{
    ArmPhysics, BetweenReading, Board, CameraAppearance, CameraResponse, MeasuredMaterial, Photograph, PhysicsSettings,
    RelationSettings, SupportSurface, ToneCurve, Workspace, WorkspaceAppearance, WorkspaceLight, World,
    WorldDifference, WorldFault, WorldFile, WorldHashes, WorldPart, WorldRobot,
};

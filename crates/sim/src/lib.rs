//! Physics simulation: MJCF assembly, a compiled [`Model`], its mutable [`Sim`] state, and joint control at the world's
//! control rate (60 Hz by default).
//!
//! [`Flattened`] is a file in MJCF as the engine's compiler understands it, for importers.
//!
//! This is the only crate that uses a simulator (MuJoCo through `mujoco-rs`).
//! A [`Model`] is immutable and shared between threads; all mutable state lives in a [`Sim`] and can be saved and
//! restored byte for byte.
//!
//! Objects are free bodies, held only by friction between the finger pads.
//! The arm's motors carry the arm against gravity within the published torque limits.
//!
//! Deliberately absent: rendering, sensors, welds, mocap bodies, and the engine's sleeping of resting bodies
//! (sleep is not part of the saved state and hides contacts).

mod body;
mod contact;
mod drive;
mod engine_log;
mod engine_settings;
mod error;
mod flattened;
mod mjcf;
mod model;
mod scene_object;
mod settle;
mod sim;
#[cfg(test)]
mod tests;
mod xml;

pub use body::BodyId;
pub use contact::ContactReport;
pub use engine_settings::EngineSettings;
pub use error::SimError;
pub use flattened::{
    FlatBody, FlatGeom, FlatJoint, FlatJointKind, FlatMaterial, FlatMesh, FlatShape, FlatTexture, Flattened,
};
pub use model::Model;
pub use scene_object::SceneObject;
pub use settle::{SettleReport, SettleSettings};
pub use sim::{RobotStep, Sim};

/// The engine version in use; other versions produce different bytes.
const ENGINE: &str = "mujoco 3.17.0";

/// Name and version of the physics engine, as stored with every result: `mujoco 3.17.0`.
pub fn engine_version() -> String {
    format!("mujoco {}", mujoco_rs::mujoco_version())
}

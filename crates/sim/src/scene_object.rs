//! What is put into a scene.

use std::sync::Arc;

use genmanip_core::{ObjectModel, PhysicsFactors, Pose};

/// An object and where it starts.
#[derive(Clone, Debug)]
pub struct SceneObject {
    /// Name, unique in the scene; the uid in scenarios.
    pub name: String,
    /// The model.
    pub model: Arc<ObjectModel>,
    /// `world_from_object`.
    pub pose: Pose,
    /// A position per joint, in the order of the links; empty for a rigid object.
    pub joint_positions: Vec<f64>,
    /// How it moves differently from its model.
    pub physics: PhysicsFactors,
}

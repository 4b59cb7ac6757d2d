//! Objects placed in a scene.

use std::sync::Arc;

use genmanip_core::{ObjectModel, PhysicsFactors, PlacedObject, Pose};

/// An object model with its initial pose and joint positions.
#[derive(Clone, Debug)]
pub struct SceneObject {
    /// Name, unique in the scene; the instance id in scenarios.
    pub name: String,
    /// Links, joints, collision pieces and mass.
    pub model: Arc<ObjectModel>,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions in link order; empty for a rigid object.
    pub joint_positions: Vec<f64>,
    /// Factors on mass, friction and damping.
    pub physics: PhysicsFactors,
}

impl SceneObject {
    /// An object of a scenario with its model.
    pub fn placed(placed: &PlacedObject, model: &Arc<ObjectModel>) -> Self {
        Self {
            name: placed.id.to_string(),
            model: Arc::clone(model),
            pose: placed.pose,
            joint_positions: placed.joint_positions.clone(),
            physics: placed.physics,
        }
    }
}

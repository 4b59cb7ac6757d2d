//! Tests of the public interface: compiling, saving and restoring, grasping.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

mod grasping;
mod models;
mod pick;
mod speed;
mod states;
mod worlds;

use std::sync::Arc;

use genmanip_assets::worlds::default_world;
use genmanip_core::glam::DVec3;
use genmanip_core::{PhysicsFactors, Pose};
use genmanip_sim::{Model, SceneObject};

use models::{ball, cabinet, can, cuboid, mug, pen, rigid};

fn placed(name: &str, model: Arc<genmanip_core::ObjectModel>, x: f64, y: f64, yaw: f64) -> SceneObject {
    let joint_positions = vec![0.03; model.joint_count()];
    let pose = Pose::from_position_yaw(DVec3::new(x, y, 0.0), yaw);
    SceneObject { name: name.into(), model, pose, joint_positions, physics: PhysicsFactors::default() }
}

/// Six objects of all kinds, one of them with a drawer.
fn six_objects() -> Vec<SceneObject> {
    vec![
        placed("Cube & <co>", rigid("cube", 0.06, 0.5, vec![cuboid(0.04, 0.04, 0.04)]), 0.45, 0.0, 0.3),
        placed("Can", rigid("can", 0.35, 0.4, vec![can(0.033, 0.12)]), 0.55, 0.2, 0.0),
        placed("Red Mug", rigid("mug", 0.3, 0.5, mug(0.04, 0.09, 0.004, 16)), 0.6, -0.15, 1.0),
        placed("Pen", rigid("pen", 0.015, 0.4, vec![pen(0.006, 0.14)]), 0.4, -0.2, 0.7),
        placed("Ball", rigid("ball", 0.06, 0.5, vec![ball(0.0325)]), 0.5, 0.35, 0.0),
        placed("Cabinet", cabinet(), 0.75, 0.15, 0.2),
    ]
}

fn scene() -> Arc<Model> {
    Arc::new(Model::compile(&default_world(), &genmanip_assets::panda(), &six_objects()).unwrap())
}

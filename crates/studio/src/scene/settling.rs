//! Dropping of objects in the physics simulation until they rest.

use std::sync::Arc;

use genmanip_core::{ObjectModel, Pose, Scenario};
use genmanip_sim::{Model, SceneObject, SettleSettings, Sim, SimError};

/// Translation (m) and rotation (rad) below which an object counts as at rest already and keeps its exact pose.
const NO_MOVE_M: f64 = 5e-5;
const NO_TURN_RAD: f64 = 1e-3;

/// An object that came to rest at another pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// Index in the scenario's list of objects.
    pub object: usize,
    /// New pose, `world_from_object`.
    pub pose: Pose,
    /// New joint positions, rad or m.
    pub joint_positions: Vec<f64>,
}

/// Objects that move when a scenario is simulated without its robot, with their final poses; and true if everything
/// came to rest within the time limit.
///
/// # Errors
/// When the simulator refuses the scene, or the simulation becomes unstable.
pub fn settle(scenario: &Scenario, models: &[Arc<ObjectModel>]) -> Result<(Vec<Settled>, bool), SimError> {
    let objects: Vec<SceneObject> =
        scenario.objects.iter().zip(models).map(|(placed, model)| SceneObject::placed(placed, model)).collect();
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(&scenario.world, &objects)?));
    let report = sim.settle(&SettleSettings::default())?;
    let moved = sim.object_states().into_iter().zip(&objects).enumerate().filter_map(|(object, (state, before))| {
        let is_same = state.pose.position.distance(before.pose.position) < NO_MOVE_M
            && state.pose.angle_to(&before.pose) < NO_TURN_RAD;
        (!is_same).then_some(Settled { object, pose: state.pose, joint_positions: state.joint_positions })
    });
    Ok((moved.collect(), report.settled))
}

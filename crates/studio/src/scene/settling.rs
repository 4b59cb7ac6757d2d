//! Dropping objects with physics.

use std::sync::Arc;

use genmanip_core::{ObjectModel, Pose, Scenario};
use genmanip_sim::{Model, SceneObject, SettleSettings, Sim, SimError};

/// Moves and turns below these are none, m and rad: objects that already rest keep their numbers.
const NO_MOVE_M: f64 = 5e-5;
const NO_TURN_RAD: f64 = 1e-3;

/// An object that came to rest elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// Index in the scenario.
    pub object: usize,
    /// `world_from_object`.
    pub pose: Pose,
    /// Joint positions, rad or m.
    pub joint_positions: Vec<f64>,
}

/// Objects that move when a scenario is simulated without its robot, at rest; `false` if they still move at the end of
/// the time.
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

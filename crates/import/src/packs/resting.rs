//! Resting test: simulates an object on the table until it settles.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{ObjectModel, PhysicsFactors, Pose, World};
use genmanip_sim::{Model, SceneObject, SettleSettings, Sim, SimError};

/// Position of the object on the table, m: near the centre of the workspace.
const PLACE: DVec3 = DVec3::new(0.5, 0.0, 0.0);
/// Height from which the object is dropped, m: just above the table, so that it starts without penetration.
const DROP_M: f64 = 0.0005;
/// Maximum settling time, and (`DRIFT_S`) duration of the drift measurement, simulated seconds. Chosen by hand.
const SETTLE_S: f64 = 3.0;
const DRIFT_S: f64 = 2.0;
/// Rate of the physics steps, Hz.
const STEPS_HZ: f64 = 480.0;

/// Result of the resting test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtRest {
    /// True if it came to rest within 3 s.
    pub settled: bool,
    /// Maximum distance from the settled position in the following 2 s, mm.
    pub drift_mm: f64,
    /// Maximum penetration depth into the table, mm.
    pub penetration_mm: f64,
    /// Tilt relative to the initial pose, rad.
    pub tilt_rad: f64,
    /// Final direction of the world's z axis in the object's frame.
    pub up: DVec3,
}

/// Places an object on the table in a pose, lets it settle, and measures its drift for 2 s.
///
/// # Errors
/// If the simulator rejects the object or diverges.
pub fn at_rest(model: &Arc<ObjectModel>, pose: &Pose, joints: &[f64], world: &World) -> Result<AtRest, SimError> {
    let start = Pose { position: pose.position + PLACE + DVec3::Z * DROP_M, ..*pose };
    let joint_positions = if joints.is_empty() { vec![0.0; model.joint_count()] } else { joints.to_vec() };
    let physics = PhysicsFactors::default();
    let object = SceneObject { name: "0".into(), model: Arc::clone(model), pose: start, joint_positions, physics };
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, &[object])?));
    let settings = SettleSettings { max_seconds: SETTLE_S, ..SettleSettings::default() };
    let report = sim.settle(&settings)?;
    let before = sim.object_states()[0].pose;
    let mut drift = 0.0_f64;
    let steps = (DRIFT_S * STEPS_HZ) as u32;
    for _ in 0..8 {
        sim.advance(steps / 8)?;
        let now = sim.object_states()[0].pose;
        // Drift is measured at the centre of the bounding box, so that a rotation about a distant origin does not
        // count.
        let middle = |pose: &Pose| pose.transform_point(DVec3::Z * model.card.size_m.z / 2.0);
        drift = drift.max(middle(&now).distance(middle(&before)));
    }
    let up = sim.object_states()[0].pose.rotation.inverse() * DVec3::Z;
    Ok(AtRest {
        settled: report.settled,
        drift_mm: drift * 1e3,
        penetration_mm: sim.penetration() * 1e3,
        tilt_rad: up.angle_between(start.rotation.inverse() * DVec3::Z),
        up,
    })
}

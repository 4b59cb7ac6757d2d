//! Whether an object stays where it is put.

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{ObjectModel, PhysicsFactors, Pose, World};
use genmanip_sim::{Scene, SceneObject, SettleSettings, Sim, SimError};

/// Where an object stands, m: in the middle of the workspace of the table.
const PLACE: DVec3 = DVec3::new(0.5, 0.0, 0.0);
/// How far above its place it is let go, m.
const DROP_M: f64 = 0.0005;
/// Longest settling and the time during which drift counts, simulated seconds.
const SETTLE_S: f64 = 3.0;
const WATCH_S: f64 = 2.0;
/// Physics steps a second.
const STEPS_HZ: f64 = 480.0;

/// An object that was put on the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtRest {
    /// Whether it came to rest within 3 s.
    pub settled: bool,
    /// Farthest from there in the 2 s after, mm.
    pub drift_mm: f64,
    /// How deep it sinks in, mm.
    pub penetration_mm: f64,
    /// By which angle it turned against its pose, rad.
    pub tilt_rad: f64,
    /// The direction that is up then, in the object's frame.
    pub up: DVec3,
}

/// Puts an object on the table in a pose about its place there, lets it settle, and watches it for 2 s.
///
/// # Errors
/// When the simulator refuses it or diverges.
pub fn at_rest(model: &Arc<ObjectModel>, pose: &Pose, joints: &[f64], world: &World) -> Result<AtRest, SimError> {
    let start = Pose { position: pose.position + PLACE + DVec3::Z * DROP_M, ..*pose };
    let joint_positions = if joints.is_empty() { vec![0.0; model.joint_count()] } else { joints.to_vec() };
    let physics = PhysicsFactors::default();
    let object = SceneObject { name: "0".into(), model: Arc::clone(model), pose: start, joint_positions, physics };
    let mut sim = Sim::new(Arc::new(Scene::compile_without_robot(world, &[object])?));
    let settings = SettleSettings { max_seconds: SETTLE_S, ..SettleSettings::default() };
    let report = sim.settle(&settings)?;
    let before = sim.object_states()[0].pose;
    let mut drift = 0.0_f64;
    let steps = (WATCH_S * STEPS_HZ) as u32;
    for _ in 0..8 {
        sim.advance(steps / 8)?;
        let now = sim.object_states()[0].pose;
        // Of the bounds' middle, so that turning on the spot about a far origin does not count twice.
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

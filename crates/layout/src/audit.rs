//! Physics checks of layouts: settling, stability, and the audit of finished scenarios.

use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::{Atom, ObjectState, PhysicsFactors, Pose, RobotModel, Scenario, World};
use genmanip_relations::{PosedObject, PosedScene, Rest, ShapeCache, judge_edges, judge_goal, judge_states};
use genmanip_sim::{Model, SceneObject, SettleSettings, Sim, SimError};

use crate::LayoutSettings;
use crate::attempt::AttemptError;
use crate::rejection::{NamedObject, Rejection};
use crate::visibility::first_hidden;

/// Interval of the stability check [s, simulated]. Chosen long against contact vibration.
const INTERVAL_S: f64 = 0.25;
/// Negligible share of the maximum drift. Chosen: 0.1 mm by default.
const NEGLIGIBLE_DRIFT_SHARE: f64 = 0.2;
/// Maximum speed ratio between two intervals without acceleration. Chosen: toppling objects are several times faster,
/// see the tests.
const MAX_SPEEDUP: f64 = 1.5;
/// Lever that converts angular to linear speed (m). Chosen: half of a large object.
const LEVER_M: f64 = 0.1;

/// Settles the objects without a robot; returns a rejection if they do not come to rest or fall over.
pub(crate) fn settle(scene: &mut PosedScene, world: &World, settings: &LayoutSettings) -> Result<(), AttemptError> {
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let compiled = Model::compile_without_robot(world, &objects).map_err(AttemptError::of_physics)?;
    let mut sim = Sim::new(Arc::new(compiled));
    let rest = SettleSettings { max_seconds: settings.settle_s, ..SettleSettings::default() };
    let report = sim.settle(&rest).map_err(AttemptError::of_physics)?;
    let named: Vec<NamedObject> = scene.objects().map(NamedObject::of).collect();
    if !report.settled {
        return Err(Rejection::NoRest.into());
    }
    if let Some(index) = report.displacement.iter().position(|&shift| shift > settings.max_settle_shift_m) {
        return Err(Rejection::Slides(named[index].clone()).into());
    }
    if let Some(index) = report.rotation.iter().position(|&turn| turn > settings.max_settle_tilt_rad) {
        return Err(Rejection::FallsOver(named[index].clone()).into());
    }
    if report.final_penetration > settings.max_penetration_m {
        return Err(Rejection::Penetration.into());
    }
    for (index, state) in sim.object_states().into_iter().enumerate() {
        scene.set_pose(index, state.pose, &state.joint_positions);
    }
    Ok(())
}

/// Rest poses of objects without a robot; `None` if they do not settle, fall over, or penetrate each other.
pub(crate) fn rest_poses(
    objects: &[SceneObject],
    world: &World,
    settings: &LayoutSettings,
) -> Result<Option<Vec<Pose>>, SimError> {
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, objects)?));
    let rest = SettleSettings { max_seconds: settings.settle_s, ..SettleSettings::default() };
    let report = sim.settle(&rest)?;
    let is_upright = report.rotation.iter().all(|&turn| turn <= settings.max_settle_tilt_rad);
    let is_valid = report.settled && is_upright && report.final_penetration <= settings.max_penetration_m;
    Ok(is_valid.then(|| sim.object_states().into_iter().map(|object| object.pose).collect()))
}

/// Simulates a settled layout without a robot; returns a rejection if something starts to roll or topple.
///
/// Ends early once nothing accelerates and the extrapolated drift is negligible.
pub(crate) fn check_stability(
    scene: &PosedScene,
    world: &World,
    settings: &LayoutSettings,
) -> Result<(), AttemptError> {
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let compiled = Model::compile_without_robot(world, &objects).map_err(AttemptError::of_physics)?;
    let mut sim = Sim::new(Arc::new(compiled));
    let start = sim.object_states();
    let mut previous_m_s = 0.0;
    let intervals = (settings.stay_s / INTERVAL_S).ceil() as u32;
    for interval in 1..=intervals {
        sim.advance(steps(INTERVAL_S, world)).map_err(AttemptError::of_physics)?;
        let current = sim.object_states();
        let drift_m = drift_m(&start, &current);
        let drifts = scene.objects().zip(&drift_m).find(|&(_, &drift_m)| drift_m > settings.max_drift_m);
        if let Some((object, _)) = drifts {
            return Err(Rejection::Drifts(NamedObject::of(object)).into());
        }
        // An object that starts to topple may rotate about its origin.
        let speed_m_s =
            current.iter().map(|object| object.speed.max(LEVER_M * object.angular_speed)).fold(0.0, f64::max);
        let left_s = INTERVAL_S * f64::from(intervals - interval);
        let extrapolated_m = drift_m.into_iter().fold(0.0, f64::max) + speed_m_s * left_s;
        if speed_m_s <= MAX_SPEEDUP * previous_m_s && extrapolated_m <= NEGLIGIBLE_DRIFT_SHARE * settings.max_drift_m {
            return Ok(());
        }
        previous_m_s = speed_m_s;
    }
    Ok(())
}

/// Initial penetration and displacement of each object's origin after some time without sleeping (m).
pub(crate) fn simulate_drift(
    world: &World,
    objects: &[SceneObject],
    seconds: f64,
) -> Result<(f64, Vec<f64>), SimError> {
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, objects)?));
    let penetration_m = sim.penetration();
    let before = sim.object_states();
    sim.advance(steps(seconds, world))?;
    Ok((penetration_m, drift_m(&before, &sim.object_states())))
}

/// Displacement of each object's origin (m).
fn drift_m(before: &[ObjectState], after: &[ObjectState]) -> Vec<f64> {
    before.iter().zip(after).map(|(from, to)| from.pose.position.distance(to.pose.position)).collect()
}

fn steps(seconds: f64, world: &World) -> u32 {
    (seconds * f64::from(world.physics.physics_rate_hz)).round() as u32
}

pub(crate) fn scene_object(object: &PosedObject) -> SceneObject {
    SceneObject {
        name: object.id.clone(),
        model: Arc::clone(&object.model),
        pose: object.pose,
        joint_positions: object.joint_positions.clone(),
        physics: PhysicsFactors::default(),
    }
}

/// Audit of a layout: independent of the code that created it, but with the same relation checks.
#[derive(Clone, Debug, PartialEq)]
pub struct LayoutAudit {
    /// Maximum initial penetration (m).
    pub penetration_m: f64,
    /// Maximum displacement of any object (m).
    pub drift_m: f64,
    /// Number of edges and states of the initial graph that were evaluated.
    pub checked: usize,
    /// Those that do not hold.
    pub failed: Vec<Atom>,
    /// True if some goal alternative already holds.
    pub goal_holds: bool,
    /// Reason if some task object is not visible.
    pub hidden: Option<Rejection>,
}

/// Evaluates a scenario, then simulates it without sleeping and measures penetration and drift.
///
/// # Errors
/// Fails if an object is unknown, the simulation fails, or the images cannot be rendered.
pub fn audit(
    scenario: &Scenario,
    assets: &dyn AssetSource,
    robot: &Arc<RobotModel>,
    settings: &LayoutSettings,
    seconds: f64,
) -> Result<LayoutAudit, AuditError> {
    let scene = posed(scenario, assets, &mut ShapeCache::default())?;
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let (penetration_m, drift_m) = simulate_drift(&scenario.world, &objects, seconds)?;
    let drift_m = drift_m.into_iter().fold(0.0, f64::max);
    let (task, relations) = (&scenario.task, &scenario.world.relations);
    let mut verdicts = judge_edges(&scene, &task.scene_graph, relations);
    verdicts.extend(judge_states(&scene, &task.scene_graph, relations));
    Ok(LayoutAudit {
        penetration_m,
        drift_m,
        checked: verdicts.len(),
        failed: verdicts.into_iter().filter(|verdict| !verdict.holds).map(|verdict| verdict.atom).collect(),
        goal_holds: judge_goal(&scene, &task.judged_goal(), &Rest::default(), relations).success,
        hidden: first_hidden(&scene, &scenario.world, task.scene_graph.nodes.len(), robot, settings)?,
    })
}

/// Builds the posed scene of a scenario.
///
/// # Errors
/// Fails if an object is unknown or its physics has changed.
pub fn posed(
    scenario: &Scenario,
    assets: &dyn AssetSource,
    shapes: &mut ShapeCache,
) -> Result<PosedScene, genmanip_assets::AssetError> {
    let objects = scenario.objects.iter().map(|placed| {
        Ok(PosedObject {
            id: placed.id.clone(),
            model: assets.instance(placed)?,
            pose: placed.pose,
            joint_positions: placed.joint_positions.clone(),
        })
    });
    Ok(PosedScene::new(
        objects.collect::<Result<Vec<_>, genmanip_assets::AssetError>>()?,
        &scenario.world.surfaces,
        shapes,
    ))
}

/// Error of an audit.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// An object is unknown or its physics has changed.
    #[error(transparent)]
    Asset(#[from] genmanip_assets::AssetError),
    /// The simulation failed.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The images cannot be rendered.
    #[error(transparent)]
    Render(#[from] genmanip_render::RenderError),
}

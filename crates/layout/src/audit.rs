//! Physics checks of layouts: settling, stability, and the audit of finished scenarios.

use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::{Atom, InstanceId, ObjectState, PhysicsFactors, ReferenceId, RobotModel, Scenario, World};
use genmanip_relations::{PosedObject, PosedScene, Rest, ShapeCache, judge_edges, judge_goal, judge_states};
use genmanip_sim::{BodyId, Model, SceneObject, SettleSettings, Sim, SimError};

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

/// States of objects at rest without a robot; `None` if they do not settle, fall over, or penetrate each other.
pub(crate) fn rest_states(
    objects: &[SceneObject],
    world: &World,
    settings: &LayoutSettings,
) -> Result<Option<Vec<ObjectState>>, SimError> {
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, objects)?));
    let rest = SettleSettings { max_seconds: settings.settle_s, ..SettleSettings::default() };
    let report = sim.settle(&rest)?;
    let is_upright = report.rotation.iter().all(|&turn| turn <= settings.max_settle_tilt_rad);
    let is_valid = report.settled && is_upright && report.final_penetration <= settings.max_penetration_m;
    Ok(is_valid.then(|| sim.object_states()))
}

/// Simulates a settled layout without a robot; returns a rejection if something starts to roll or topple.
pub(crate) fn check_stability(
    scene: &PosedScene,
    world: &World,
    settings: &LayoutSettings,
) -> Result<(), AttemptError> {
    let drift = first_drift(scene, world, settings).map_err(AttemptError::of_physics)?;
    match drift.and_then(|drift| scene.objects().nth(drift.object)) {
        Some(object) => Err(Rejection::Drifts(NamedObject::of(object)).into()),
        None => Ok(()),
    }
}

/// An object that does not stay where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// Index of the object in the scene.
    pub object: usize,
    /// Displacement of its origin when it exceeded the limit, m.
    pub drift_m: f64,
}

/// The first object of a layout that starts to roll or topple when simulated without a robot; `None` if none does.
///
/// Ends early once nothing accelerates and the extrapolated drift is negligible.
///
/// # Errors
/// Fails if the simulation fails.
pub fn first_drift(scene: &PosedScene, world: &World, settings: &LayoutSettings) -> Result<Option<Drift>, SimError> {
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, &objects)?));
    let start = sim.object_states();
    let mut previous_m_s = 0.0;
    let intervals = (settings.stay_s / INTERVAL_S).ceil() as u32;
    for interval in 1..=intervals {
        sim.advance(steps(INTERVAL_S, world))?;
        let current = sim.object_states();
        let drift_m = drift_m(&start, &current);
        let drifts = drift_m.iter().enumerate().find(|&(_, &drift_m)| drift_m > settings.max_drift_m);
        if let Some((object, &drift_m)) = drifts {
            return Ok(Some(Drift { object, drift_m }));
        }
        // An object that starts to topple may rotate about its origin.
        let speed_m_s =
            current.iter().map(|object| object.speed.max(LEVER_M * object.angular_speed)).fold(0.0, f64::max);
        let left_s = INTERVAL_S * f64::from(intervals - interval);
        let extrapolated_m = drift_m.into_iter().fold(0.0, f64::max) + speed_m_s * left_s;
        if speed_m_s <= MAX_SPEEDUP * previous_m_s && extrapolated_m <= NEGLIGIBLE_DRIFT_SHARE * settings.max_drift_m {
            return Ok(None);
        }
        previous_m_s = speed_m_s;
    }
    Ok(None)
}

/// Two bodies that interpenetrate.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Index of the object in the scene.
    pub object: usize,
    /// Id of the other object, of a surface, or `floor`.
    pub other: ReferenceId,
    /// Deepest penetration of any contact of the two bodies, m.
    pub depth_m: f64,
}

/// Pairs of bodies that interpenetrate by more than the limit of settled layouts, as the simulation sees them.
///
/// # Errors
/// Fails if the simulation fails.
pub fn overlaps(scene: &PosedScene, world: &World, settings: &LayoutSettings) -> Result<Vec<Overlap>, SimError> {
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let mut sim = Sim::new(Arc::new(Model::compile_without_robot(world, &objects)?));
    let ids: Vec<&InstanceId> = scene.objects().map(|object| &object.id).collect();
    let surface = |index: usize| {
        world.surfaces.get(index).map_or_else(|| "table".into(), |surface| ReferenceId::from(surface.id.clone()))
    };
    let mut found: Vec<Overlap> = Vec::new();
    for contact in sim.contacts().into_iter().filter(|contact| -contact.distance > settings.max_penetration_m) {
        let depth_m = -contact.distance;
        let (object, other) = match (contact.a, contact.b) {
            (BodyId::Object { object, .. }, other) | (other, BodyId::Object { object, .. }) => (object, other),
            _ => continue,
        };
        let other: ReferenceId = match other {
            BodyId::Object { object, .. } => ids[object].clone().into(),
            BodyId::Table => surface(0),
            BodyId::Surface { surface: index } => surface(index),
            BodyId::Floor => "floor".into(),
            BodyId::Robot { .. } => continue,
        };
        match found.iter_mut().find(|known| known.object == object && known.other == other) {
            Some(known) => known.depth_m = known.depth_m.max(depth_m),
            None => found.push(Overlap { object, other, depth_m }),
        }
    }
    Ok(found)
}

/// Initial penetration, and displacement of each object's origin after some time of simulation without sleeping (m).
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
        name: object.id.to_string(),
        model: Arc::clone(&object.model),
        pose: object.pose,
        joint_positions: object.joint_positions.clone(),
        physics: PhysicsFactors::default(),
    }
}

/// Audit of a layout: independent of the code that created it, but with the same relation checks.
#[derive(Clone, Debug, PartialEq)]
pub struct LayoutAudit {
    /// Maximum penetration in the initial poses (m).
    pub penetration_m: f64,
    /// Maximum displacement of any object (m).
    pub drift_m: f64,
    /// Number of edges and states of the initial graph that were evaluated.
    pub checked: usize,
    /// Edges and states of the initial graph that do not hold.
    pub failed: Vec<Atom>,
    /// True if some goal alternative already holds.
    pub goal_holds: bool,
    /// Reason if some task object is not visible; `None` if all are.
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

/// Reason why a layout cannot be audited.
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

//! Physics as the judge of a layout: settling it, and auditing one that was returned.

use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::{Atom, ObjectState, PhysicsFactors, Pose, RobotModel, Scenario, World};
use genmanip_relations::{PosedObject, PosedScene, Rest, ShapeCache, judge_edges, judge_goal, judge_states};
use genmanip_sim::{Scene, SceneObject, SettleSettings, Sim, SimError};

use crate::LayoutSettings;
use crate::refusal::Refusal;
use crate::rejection::{NamedObject, Rejection};
use crate::visibility::hidden;

/// How often a layout that is left alone is looked at, simulated seconds; chosen, long against a contact's vibration.
const SPELL_S: f64 = 0.25;
/// Part of the permitted drift that is not worth waiting for; chosen, a tenth of a millimetre by default.
const CREEP: f64 = 0.2;
/// By how much things may be faster than a spell ago; chosen: what tips over is several times as fast, as the tests of
/// things on their edge show.
const STEADY: f64 = 1.5;
/// Distance from its middle at which the turning of a thing is looked at, metres; chosen, half of a large object.
const LEVER_M: f64 = 0.1;

/// Lets the objects come to rest without a robot; the reason when they do not, or fall over.
pub(crate) fn settle(scene: &mut PosedScene, world: &World, settings: &LayoutSettings) -> Result<(), Refusal> {
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let compiled = Scene::compile_without_robot(world, &objects).map_err(Refusal::of_physics)?;
    let mut sim = Sim::new(Arc::new(compiled));
    let rest = SettleSettings { max_seconds: settings.settle_s, ..SettleSettings::default() };
    let report = sim.settle(&rest).map_err(Refusal::of_physics)?;
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

/// Where objects come to rest without a robot; `None` when they do not, fall over, or end inside each other.
pub(crate) fn settled(
    objects: &[SceneObject],
    world: &World,
    settings: &LayoutSettings,
) -> Result<Option<Vec<Pose>>, SimError> {
    let mut sim = Sim::new(Arc::new(Scene::compile_without_robot(world, objects)?));
    let rest = SettleSettings { max_seconds: settings.settle_s, ..SettleSettings::default() };
    let report = sim.settle(&rest)?;
    let is_upright = report.rotation.iter().all(|&turn| turn <= settings.max_settle_tilt_rad);
    let is_sound = report.settled && is_upright && report.final_penetration <= settings.max_penetration_m;
    Ok(is_sound.then(|| sim.object_states().into_iter().map(|object| object.pose).collect()))
}

/// Leaves a settled layout alone for a while, without a robot; the reason when something starts to roll or tip.
///
/// Ends early once nothing gets faster, and everything is so slow that the rest of the time would not bring it anywhere.
pub(crate) fn leave_alone(scene: &PosedScene, world: &World, settings: &LayoutSettings) -> Result<(), Refusal> {
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let compiled = Scene::compile_without_robot(world, &objects).map_err(Refusal::of_physics)?;
    let mut sim = Sim::new(Arc::new(compiled));
    let start = sim.object_states();
    let mut before_m_s = 0.0;
    let spells = (settings.stay_s / SPELL_S).ceil() as u32;
    for spell in 1..=spells {
        sim.advance(steps(SPELL_S, world)).map_err(Refusal::of_physics)?;
        let now = sim.object_states();
        let drift_m = drift_m(&start, &now);
        let drifts = scene.objects().zip(&drift_m).find(|&(_, &drift_m)| drift_m > settings.max_drift_m);
        if let Some((object, _)) = drifts {
            return Err(Rejection::Drifts(NamedObject::of(object)).into());
        }
        // What tips first turns about a point that may be where its origin is.
        let pace_m_s = now.iter().map(|object| object.speed.max(LEVER_M * object.angular_speed)).fold(0.0, f64::max);
        let left_s = SPELL_S * f64::from(spells - spell);
        let in_the_end_m = drift_m.into_iter().fold(0.0, f64::max) + pace_m_s * left_s;
        if pace_m_s <= STEADY * before_m_s && in_the_end_m <= CREEP * settings.max_drift_m {
            return Ok(());
        }
        before_m_s = pace_m_s;
    }
    Ok(())
}

/// Penetration at the start, and how far each object's origin moves in this time, sleep off; metres.
pub(crate) fn left_alone(world: &World, objects: &[SceneObject], seconds: f64) -> Result<(f64, Vec<f64>), SimError> {
    let mut sim = Sim::new(Arc::new(Scene::compile_without_robot(world, objects)?));
    let penetration_m = sim.penetration();
    let before = sim.object_states();
    sim.advance(steps(seconds, world))?;
    Ok((penetration_m, drift_m(&before, &sim.object_states())))
}

/// How far each object's origin moved between two moments, metres.
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

/// What a returned layout is worth, found without the code that made it but with the same judges.
#[derive(Clone, Debug, PartialEq)]
pub struct LayoutAudit {
    /// Deepest penetration at the start, metres.
    pub penetration_m: f64,
    /// Farthest any object moved, metres.
    pub drift_m: f64,
    /// Edges and states of the initial graph that were judged.
    pub checked: usize,
    /// Those of them that do not hold.
    pub failed: Vec<Atom>,
    /// Whether some alternative of the goal holds already.
    pub goal_holds: bool,
    /// Why some object of the task is not seen, when one is not.
    pub hidden: Option<Rejection>,
}

/// Judges a scenario, then leaves it alone for some simulated seconds, sleep off, and measures penetration and drift.
///
/// # Errors
/// When an object is unknown, physics refuses the scene, or its pictures cannot be drawn.
pub fn audit(
    scenario: &Scenario,
    assets: &dyn AssetSource,
    robot: &Arc<RobotModel>,
    settings: &LayoutSettings,
    seconds: f64,
) -> Result<LayoutAudit, AuditError> {
    let scene = posed(scenario, assets, &mut ShapeCache::default())?;
    let objects: Vec<SceneObject> = scene.objects().map(scene_object).collect();
    let (penetration_m, drift_m) = left_alone(&scenario.world, &objects, seconds)?;
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
        hidden: hidden(&scene, &scenario.world, task.scene_graph.nodes.len(), robot, settings)?,
    })
}

/// The objects of a scenario at their poses.
///
/// # Errors
/// When an object is unknown or its physics have changed.
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

/// Why a scenario cannot be audited.
#[derive(Debug, thiserror::Error)]
pub enum AuditError {
    /// An object is unknown or its physics have changed.
    #[error(transparent)]
    Asset(#[from] genmanip_assets::AssetError),
    /// Physics refuses the scene.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// What the cameras see cannot be drawn.
    #[error(transparent)]
    Render(#[from] genmanip_render::RenderError),
}

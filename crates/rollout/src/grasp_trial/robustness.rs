//! Robustness trials: grasps of a catalogue object, each executed several times with errors.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Grasp, InstanceId, MassProperties, ObjectModel, Pose, Seed, VerifiedGrasp};
use genmanip_layout::obstacles;
use genmanip_relations::{PosedObject, PosedScene, ShapeCache};
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::arm::{self, TrialEnding};
use super::{GraspTrials, Table, TrialError};

/// Number of trials per grasp, and the errors of each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RobustnessSettings {
    /// Number of trials per grasp.
    pub trials: u32,
    /// Number of failed trials after which no further trials of a grasp are made.
    pub most_lost: u32,
    /// Maximum position error of the gripper along each axis, m.
    pub offset_m: f64,
    /// Maximum orientation error of the gripper, rad.
    pub turn_rad: f64,
    /// Minimum friction of the pads as a share of the robot's own value; each trial draws a share between this and 1.
    pub least_friction: f64,
    /// Maximum relative change of the object's mass.
    pub mass_spread: f64,
    /// Number of object yaws tried until a grasp is feasible for the arm.
    pub yaws: usize,
}

impl Default for RobustnessSettings {
    fn default() -> Self {
        Self {
            // Five trials, three millimetres, three degrees, down to 0.57 of the friction and 30 % of the mass are what
            // earlier experiments with this gripper used to distinguish robust grasps from lucky ones. Their nominal
            // friction was 0.7; it is 1 now, and the share is the same.
            trials: 5,
            // Chosen: with two of five failed, a grasp is below the share of 0.8 required by layout and expert.
            most_lost: 2,
            offset_m: 0.003,
            turn_rad: 0.052,
            least_friction: 0.57,
            mass_spread: 0.3,
            // Chosen: every 30 degrees; the arm's reach changes little in between.
            yaws: 12,
        }
    }
}

impl RobustnessSettings {
    /// Faster settings for interactive use: three trials without pose errors, mass and friction changed by up to 20 %.
    pub fn fast() -> Self {
        Self {
            trials: 3,
            most_lost: 1,
            offset_m: 0.0,
            turn_rad: 0.0,
            least_friction: 0.8,
            mass_spread: 0.2,
            ..Self::default()
        }
    }
}

/// Number of robust grasps to find in interactive use: about 2 s of CPU time, [`MAX_FAILED_GRASPS`] included.
pub const WANTED_GRASPS: usize = 4;
/// Number of failed grasps after which the search in interactive use ends; see [`WANTED_GRASPS`].
pub const MAX_FAILED_GRASPS: usize = 8;

/// Success counts of the exact generator's candidates for an object upright on the table: by share of successes, then
/// by score; object frame.
///
/// Candidates that are infeasible for the arm at all yaws are omitted.
///
/// # Errors
/// If the physics engine fails, or a piece of the object has no volume.
pub fn verified_grasps(
    trials: &GraspTrials,
    model: &Arc<ObjectModel>,
    settings: &RobustnessSettings,
    seed: Seed,
) -> Result<Vec<VerifiedGrasp>, TrialError> {
    let (table, candidates) = candidates(trials, model, seed)?;
    let mut tried = Vec::new();
    for (index, grasp) in candidates.into_iter().enumerate() {
        tried.extend(try_out(trials, &table, grasp, settings, seed.fork("trials").fork_index(index as u64))?);
    }
    tried.sort_by(|a, b| b.share().total_cmp(&a.share()).then(b.grasp.score.total_cmp(&a.grasp.score)));
    Ok(tried)
}

/// The best candidates that held in every trial: at most `enough`, trying at most `most` failing ones.
///
/// # Errors
/// As [`verified_grasps`].
pub fn robust_grasps(
    trials: &GraspTrials,
    model: &Arc<ObjectModel>,
    settings: &RobustnessSettings,
    enough: usize,
    most: usize,
    seed: Seed,
) -> Result<Vec<VerifiedGrasp>, TrialError> {
    let (table, candidates) = candidates(trials, model, seed)?;
    let (mut robust, mut lost) = (Vec::new(), 0);
    for (index, grasp) in candidates.into_iter().enumerate() {
        if lost == most || robust.len() == enough {
            break;
        }
        let seed = seed.fork("trials").fork_index(index as u64);
        let Some(grasp) = try_out(trials, &table, grasp, settings, seed)? else { continue };
        if grasp.held == settings.trials {
            robust.push(grasp);
        } else {
            lost += 1;
        }
    }
    Ok(robust)
}

/// The object upright on the table, and the exact generator's candidates, best first.
fn candidates(trials: &GraspTrials, model: &Arc<ObjectModel>, seed: Seed) -> Result<(Table, Vec<Grasp>), TrialError> {
    let table = Table::with_one(Arc::clone(model), &trials.world)?;
    let object = PosedObject {
        id: InstanceId::new(&model.card.uid, 1),
        model: Arc::clone(model),
        pose: table.poses[0],
        joint_positions: Vec::new(),
    };
    let scene = PosedScene::new(vec![object], &trials.world.surfaces, &mut ShapeCache::default());
    let candidates = obstacles::generated_grasps(&trials.planner, &scene, 0, seed)?;
    Ok((table, candidates))
}

fn try_out(
    trials: &GraspTrials,
    table: &Table,
    grasp: Grasp,
    settings: &RobustnessSettings,
    seed: Seed,
) -> Result<Option<VerifiedGrasp>, TrialError> {
    let mut tried = VerifiedGrasp { grasp, trials: 0, held: 0 };
    while tried.trials < settings.trials && tried.trials - tried.held < settings.most_lost {
        match try_once(trials, table, &tried.grasp, settings, seed.fork_index(u64::from(tried.trials)))? {
            TrialEnding::OutOfReach => return Ok(None),
            ending => tried.held += u32::from(ending == TrialEnding::Held),
        }
        tried.trials += 1;
    }
    Ok(Some(tried))
}

/// One trial with random errors from the seed.
fn try_once(
    trials: &GraspTrials,
    table: &Table,
    grasp: &Grasp,
    settings: &RobustnessSettings,
    seed: Seed,
) -> Result<TrialEnding, TrialError> {
    let mut rng = seed.rng();
    let mut spread = |most: f64| most * (2.0 * rng.random::<f64>() - 1.0);
    let offset = DVec3::new(spread(settings.offset_m), spread(settings.offset_m), spread(settings.offset_m));
    let mass = 1.0 + spread(settings.mass_spread);
    let friction = 1.0 - (1.0 - settings.least_friction) * rng.random::<f64>();
    let turn = settings.turn_rad * rng.random::<f64>();
    let error = Pose { position: offset, rotation: DQuat::from_axis_angle(direction(&mut rng), turn) };
    let first = rng.random::<f64>();

    let mut robot = (*trials.robot).clone();
    if let Some(drives) = &mut robot.drives {
        drives.pad_friction[0] *= friction;
    }
    let trials = GraspTrials { robot: Arc::new(robot), ..trials.clone() };
    let heavier = Arc::new(with_mass(&table.models[0], mass));
    for yaw in 0..settings.yaws {
        let yaw = TAU * (first + yaw as f64 / settings.yaws as f64);
        let table = Table { models: vec![Arc::clone(&heavier)], poses: vec![turned(&table.poses[0], yaw)] };
        let aimed = Grasp { pose: table.poses[0] * grasp.pose * error, ..grasp.clone() };
        if let Some(ending) = arm::execute_one(&trials, &table, &aimed, trials.planner.opening(grasp))? {
            return Ok(ending);
        }
    }
    Ok(TrialEnding::OutOfReach)
}

/// Pose rotated about the vertical axis through its origin.
fn turned(world_from_object: &Pose, yaw: f64) -> Pose {
    let turn = DQuat::from_rotation_z(yaw);
    Pose { rotation: turn * world_from_object.rotation, ..*world_from_object }
}

/// Uniformly distributed unit vector.
fn direction(rng: &mut impl Rng) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
}

fn with_mass(model: &ObjectModel, share: f64) -> ObjectModel {
    let mut changed = model.clone();
    for link in &mut changed.links {
        let MassProperties { mass_kg, center, inertia } = link.mass;
        link.mass = MassProperties { mass_kg: mass_kg * share, center, inertia: inertia * share };
    }
    changed
}

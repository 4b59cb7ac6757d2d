//! Execution of a grasp by the arm: approach, close, lift, shake, hold.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Grasp, Pose, RobotModel, Seed, SupportSurface};
use genmanip_motion::{
    AllowedCollisions, CollisionWorld, FeasibilitySettings, FeasibleGrasp, HalfTurn, PickQuery, PickedObject,
    PlanningScene,
};
use genmanip_sim::{Model, Sim};
use rand::RngExt;
use serde::Serialize;

use super::trial::Candidate;
use super::{CandidateChoice, ExecutedGrasp, GraspTrials, Table, TrialError};

/// Length of the straight approach, m: starts clear of the object, and is short enough to be reachable in most
/// postures.
const APPROACH_M: f64 = 0.1;
/// Height of the lift, m: clearance for shaking an object that hangs down by the gripper's maximum width.
const LIFT_M: f64 = 0.18;
/// Minimum rise of the centre of mass to count as lifted, m; an object held at one end sags by up to half its length.
const LIFTED_M: f64 = 0.1;
/// Control steps (60 Hz) of each phase: 1.2 s for the approach and 1.4 s for the lift, so that the gripper accelerates
/// by less than 0.6 m/s²; 1.1 s for closing, of which the travel from 8 cm to 0 takes 0.8 s; 1 s of holding.
const APPROACH_STEPS: usize = 72;
const CLOSE_STEPS: usize = 66;
const LIFT_STEPS: usize = 84;
const HOLD_STEPS: usize = 60;
/// Control steps before the gripper moves, for the arm to catch up: 0.2 s are several time constants of its drives.
const REST_STEPS: usize = 12;
/// Maximum rate of change of the gripper opening, m/s: two fingers at 5 cm/s each according to the Franka Hand's data
/// sheet.
const FINGERS_M_S: f64 = 0.1;
/// Control rate, Hz.
const RATE_HZ: f64 = 60.0;
/// Number of arm configurations tried per grasp, nearest to home first. Chosen by hand.
const CONFIGURATIONS: usize = 4;
/// Shaking: a second of 2 Hz along each axis, up to 4.7 m/s², and a second of 1 Hz about two axes, up to 14 rad/s²,
/// which is about the limit of the arm's wrist.
const SHAKE_STEPS: usize = 60;
const SHAKE_PERIODS: f64 = 2.0;
const SHAKE_M: f64 = 0.03;
const TURN_PERIODS: f64 = 1.0;
const TURN_RAD: f64 = 0.35;
/// Maximum joint step between two control steps, rad: about three times what a joint can do (2.6 rad/s at 60 Hz are
/// 0.044); larger steps indicate a singular posture.
const JOINT_STEP: f64 = 0.12;

/// Success of a trial, or the phase in which it failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TrialEnding {
    /// The object was lifted and shaken and is still in the grip.
    Held,
    /// The sampler found no candidate.
    NoGrasp,
    /// No candidate is feasible for the arm.
    OutOfReach,
    /// The gripper closed on nothing or on another object.
    Missed,
    /// The grip was lost during the lift.
    LostInLift,
    /// The grip was lost during the shaking.
    LostInShake,
    /// The grip was lost during the hold.
    LostInHold,
    /// The object was in the grip at the end, but not lifted enough.
    NotLifted,
}

/// Joint positions per control step of a grasp.
struct Motion {
    approach: Vec<Vec<f64>>,
    lift: Vec<Vec<f64>>,
    shake: Vec<Vec<f64>>,
}

/// Executes the first feasible candidate, in order of score or in random order; the arm avoids the points of other
/// objects.
pub(super) fn execute(
    trials: &GraspTrials,
    table: &Table,
    seen: &[DVec3],
    grasps: &[Candidate],
    pick: CandidateChoice,
    seed: Seed,
) -> Result<(TrialEnding, Option<ExecutedGrasp>), TrialError> {
    let mut order: Vec<usize> = (0..grasps.len()).collect();
    if pick == CandidateChoice::Any {
        let mut rng = seed.rng();
        for index in (1..order.len()).rev() {
            order.swap(index, rng.random_range(0..=index));
        }
    }
    let obstacles = Obstacles::new(table, &trials.world.surfaces, seen);
    let reachable = order.into_iter().find_map(|rank| {
        let motion = motion(trials, &obstacles, &grasps[rank].grasp)?;
        Some((rank, motion))
    });
    let Some((rank, motion)) = reachable else {
        let ending = if grasps.is_empty() { TrialEnding::NoGrasp } else { TrialEnding::OutOfReach };
        return Ok((ending, None));
    };
    let (ending, final_width) = simulate(trials, table, &motion, grasps[rank].opening)?;
    let Candidate { grasp, features, .. } = &grasps[rank];
    Ok((ending, Some(ExecutedGrasp { rank, score: grasp.score, width: grasp.width, features: *features, final_width })))
}

/// Executes one grasp (world frame) of the table's first object; `None` if it is not feasible for the arm.
pub(super) fn execute_one(
    trials: &GraspTrials,
    table: &Table,
    grasp: &Grasp,
    opening: f64,
) -> Result<Option<TrialEnding>, TrialError> {
    let obstacles = Obstacles::new(table, &trials.world.surfaces, &[]);
    let Some(motion) = motion(trials, &obstacles, grasp) else { return Ok(None) };
    Ok(Some(simulate(trials, table, &motion, opening)?.0))
}

/// Obstacles of the arm's motion.
struct Obstacles {
    /// Geometry of the objects, which the start configuration must not touch.
    objects: CollisionWorld,
    /// Points of the objects seen by the cameras.
    seen: CollisionWorld,
}

impl Obstacles {
    fn new(table: &Table, surfaces: &[SupportSurface], points: &[DVec3]) -> Self {
        let mut seen = CollisionWorld::new();
        if !points.is_empty() {
            // A camera's points, which are finite, are always accepted.
            let _ = seen.add_points(SEEN, points, SEEN_RADIUS_M);
        }
        Self { objects: neighbours(table, surfaces), seen }
    }
}

/// Name of the observed points in the collision world, and (`SEEN_RADIUS_M`) radius of each, m.
const SEEN: &str = "seen";
const SEEN_RADIUS_M: f64 = 0.003;

/// Collision world of support surfaces and objects, for a collision-free start configuration.
fn neighbours(table: &Table, surfaces: &[SupportSurface]) -> CollisionWorld {
    let mut world = CollisionWorld::new();
    // A checked world's boxes, finite poses and the models' own pieces are always accepted.
    for surface in surfaces {
        let _ = world.add(surface.id.as_str(), &surface.pieces(), &surface.world_from_surface());
    }
    for (index, (model, pose)) in table.models.iter().zip(&table.poses).enumerate() {
        let _ = world.add(&index.to_string(), &model.links[0].pieces, pose);
    }
    world
}

/// Feasibility settings without clearance checks: the sampler has checked the gripper's clearance, so only reachability
/// remains.
fn feasibility(max_width: f64) -> FeasibilitySettings {
    FeasibilitySettings {
        wanted: usize::MAX,
        configurations: CONFIGURATIONS,
        configurations_kept: CONFIGURATIONS,
        half_turn: HalfTurn::Both,
        clearance_m: 0.0,
        object_clearance_m: None,
        // The gripper starts fully open.
        finger_room_m: Some(max_width),
        approach_m: APPROACH_M,
        tests_pregrasp: false,
        lift_m: LIFT_M,
        release_heights_m: Vec::new(),
        goal_configurations: 0,
    }
}

/// Joint motions for a grasp or its half turn; `None` if the arm cannot execute it.
fn motion(trials: &GraspTrials, obstacles: &Obstacles, grasp: &Grasp) -> Option<Motion> {
    let planner = &*trials.planner;
    let wide = planner.gripper().max_width;
    let nothing = AllowedCollisions::none();
    let objects = PlanningScene { world: &obstacles.objects, attached: None, allowed: &nothing, gripper_width: wide };
    let start = planner.checker(&objects, 0.0);
    let query = PickQuery {
        planner,
        world: &obstacles.seen,
        object: PickedObject { name: SEEN, world_from_object: Pose::IDENTITY, pieces: &[] },
        goals: &[],
        arm: &planner.robot().home,
        settings: &feasibility(wide),
    };
    let follow = |from: &[f64], poses: &mut dyn Iterator<Item = Pose>| planner.follow(from, poses, JOINT_STEP);
    query.grasps(std::iter::once(grasp.clone())).find_map(|FeasibleGrasp { object_from_tcp: grasp, config, .. }| {
        let back = |distance: f64| Pose { position: grasp.pose.position - grasp.approach() * distance, ..grasp.pose };
        let mut approach =
            follow(&config, &mut (0..=APPROACH_STEPS).map(|step| back(APPROACH_M * eased(step, APPROACH_STEPS))))?;
        approach.reverse();
        if !start.is_free(&approach[0]) {
            return None;
        }
        let raised = |height: f64| Pose { position: grasp.pose.position + DVec3::Z * height, ..grasp.pose };
        let lift = follow(&config, &mut (1..=LIFT_STEPS).map(|step| raised(LIFT_M * eased(step, LIFT_STEPS))))?;
        let shake = follow(lift.last()?, &mut shaken(raised(LIFT_M)))?;
        Some(Motion { approach, lift, shake })
    })
}

/// Minimum-jerk profile from 0 to 1.
fn eased(step: usize, steps: usize) -> f64 {
    let t = step as f64 / steps as f64;
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}

/// Oscillations along x, y and z, then rotations about the tool's x and z axes.
fn shaken(pose: Pose) -> impl Iterator<Item = Pose> {
    (0..5).flat_map(move |phase| {
        (1..=SHAKE_STEPS).map(move |step| {
            let t = step as f64 / SHAKE_STEPS as f64;
            let periods = if phase < 3 { SHAKE_PERIODS } else { TURN_PERIODS };
            let swing = (TAU * periods * t).sin() * (6.0 * t).min(6.0 * (1.0 - t)).min(1.0);
            match phase {
                0..=2 => Pose { position: pose.position + DVec3::AXES[phase] * (SHAKE_M * swing), ..pose },
                3 => pose * Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(TURN_RAD * swing) },
                _ => pose * Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_z(TURN_RAD * swing) },
            }
        })
    })
}

/// Simulates the motions: the ending, and the gripper opening at the end.
///
/// Steps the simulation itself: there is no task to judge and nothing to record, the robot starts at the pregrasp pose
/// instead of at home, and only the final state of a few hundred steps matters.
fn simulate(
    trials: &GraspTrials,
    table: &Table,
    motion: &Motion,
    opening: f64,
) -> Result<(TrialEnding, f64), TrialError> {
    let robot = RobotModel { home: motion.approach[0].clone(), ..(*trials.robot).clone() };
    let scene = Arc::new(Model::compile(&trials.world, &robot, &table.objects())?);
    let mut sim = Sim::new(scene);
    let center = table.models[0].links[0].mass.center;
    let height = |sim: &Sim| sim.object_states()[0].pose.transform_point(center).z;
    let before = height(&sim);
    let drive = |arm: &[f64], width: f64, sim: &mut Sim| -> Result<Option<usize>, TrialError> {
        let command: Vec<f32> = arm.iter().chain([&width]).map(|&value| value as f32).collect();
        Ok(sim.control_step(&command)?.grasped)
    };
    // The gripper starts fully open and first closes to the opening.
    let wait = REST_STEPS + ((trials.robot.gripper.max_width - opening) / FINGERS_M_S * RATE_HZ).ceil() as usize;
    for _ in 0..wait {
        drive(&motion.approach[0], opening, &mut sim)?;
    }
    for arm in &motion.approach {
        drive(arm, opening, &mut sim)?;
    }
    let Some(grasp) = motion.approach.last() else { return Ok((TrialEnding::OutOfReach, 0.0)) };
    for _ in 0..REST_STEPS {
        drive(grasp, opening, &mut sim)?;
    }
    for _ in 0..CLOSE_STEPS {
        drive(grasp, 0.0, &mut sim)?;
    }
    let last = motion.shake.last().cloned().unwrap_or_default();
    let hold = vec![last; HOLD_STEPS];
    let phases = [
        (&motion.lift, TrialEnding::LostInLift),
        (&motion.shake, TrialEnding::LostInShake),
        (&hold, TrialEnding::LostInHold),
    ];
    if sim.grasped() != Some(0) {
        return Ok((TrialEnding::Missed, sim.gripper_width()));
    }
    for (steps, ending) in phases {
        for arm in steps {
            drive(arm, 0.0, &mut sim)?;
        }
        if sim.grasped() != Some(0) {
            return Ok((ending, sim.gripper_width()));
        }
    }
    Ok((
        if height(&sim) - before >= LIFTED_M { TrialEnding::Held } else { TrialEnding::NotLifted },
        sim.gripper_width(),
    ))
}

//! The arm carries a grasp out: in, close, lift, shake, hold.

use std::f64::consts::TAU;
use std::sync::Arc;

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Grasp, Pose, RobotModel, Seed, SupportSurface};
use genmanip_motion::{
    Allowed, CloudGrasp, CollisionWorld, FeasibilitySettings, FeasibleGrasp, HalfTurn, PickQuery, PickedObject,
    PlanningScene,
};
use genmanip_sim::{Scene, Sim};
use rand::RngExt;
use serde::Serialize;

use super::{GraspTrials, Pick, Table, TrialError, Tried};

/// The straight way in, m: the hand is clear of the thing before it, and no arm posture is lost for it.
const APPROACH_M: f64 = 0.1;
/// Height of the lift, m: room for shaking with a thing as long as the hand is wide hanging from it.
const LIFT_M: f64 = 0.18;
/// A thing whose centre of mass has risen less at the end is not lifted, m; what is held at one end sags by up to half
/// its length.
const LIFTED_M: f64 = 0.1;
/// Control steps (60 Hz) of each phase: 1.2 s for the approach and 1.4 s for the lift, so that the hand accelerates by
/// less than 0.6 m/s²; 1.1 s for the fingers, which travel from 8 cm to 0 in 0.8 s and then build up force; 1 s at rest.
const APPROACH_STEPS: usize = 72;
const CLOSE_STEPS: usize = 66;
const LIFT_STEPS: usize = 84;
const HOLD_STEPS: usize = 60;
/// Control steps before the fingers move, for the arm to catch up: 0.2 s are several time constants of its drives.
const REST_STEPS: usize = 12;
/// How fast the opening changes, m/s: two fingers at 5 cm/s each, as in the Franka Hand's data sheet.
const FINGERS_M_S: f64 = 0.1;
/// Control steps per second.
const RATE_HZ: f64 = 60.0;
/// Arm configurations tried per grasp: the nearest to home.
const CONFIGURATIONS: usize = 4;
/// Shaking: a second of 2 Hz along each axis, up to 4.7 m/s², and a second of 1 Hz about two axes, up to 14 rad/s²,
/// which is about what the arm's wrist can do.
const SHAKE_STEPS: usize = 60;
const SHAKE_PERIODS: f64 = 2.0;
const SHAKE_M: f64 = 0.03;
const TURN_PERIODS: f64 = 1.0;
const TURN_RAD: f64 = 0.35;
/// Largest joint step between two controls, rad: about three times what a joint can do (2.6 rad/s at 60 Hz are 0.044);
/// beyond, the way leads through a singular posture.
const JOINT_STEP: f64 = 0.12;

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Lifted, shaken, and still in the grip.
    Held,
    /// The sampler had no candidate.
    NoGrasp,
    /// The arm can carry out none of the candidates.
    OutOfReach,
    /// The fingers closed on nothing or on something else.
    Missed,
    /// It left the grip while it was lifted.
    LostInLift,
    /// It left the grip while it was shaken.
    LostInShake,
    /// It left the grip while it was held still.
    LostInHold,
    /// It was in the grip at the end, but not as high as the hand was lifted.
    NotLifted,
}

/// Where the hand goes after it has closed, as joint positions per control step.
struct Motion {
    approach: Vec<Vec<f64>>,
    lift: Vec<Vec<f64>>,
    shake: Vec<Vec<f64>>,
}

/// Carries out the first candidate that the arm can carry out, best first or in a drawn order; its links keep clear of
/// what was seen of other things.
pub(super) fn carry_out(
    trials: &GraspTrials,
    table: &Table,
    seen: &[DVec3],
    grasps: &[CloudGrasp],
    pick: Pick,
    seed: Seed,
) -> Result<(Ending, Option<Tried>), TrialError> {
    let mut order: Vec<usize> = (0..grasps.len()).collect();
    if pick == Pick::Any {
        let mut rng = seed.rng();
        for index in (1..order.len()).rev() {
            order.swap(index, rng.random_range(0..=index));
        }
    }
    let around = Around::new(table, &trials.world.surfaces, seen);
    let reachable = order.into_iter().find_map(|rank| {
        let motion = motion(trials, &around, &grasps[rank].grasp)?;
        Some((rank, motion))
    });
    let Some((rank, motion)) = reachable else {
        let ending = if grasps.is_empty() { Ending::NoGrasp } else { Ending::OutOfReach };
        return Ok((ending, None));
    };
    let (ending, final_width) = simulate(trials, table, &motion, grasps[rank].opening)?;
    let CloudGrasp { grasp, features, .. } = &grasps[rank];
    Ok((ending, Some(Tried { rank, score: grasp.score, width: grasp.width, features: *features, final_width })))
}

/// Carries out one grasp (world frame) of the table's first thing; `None` when the arm cannot.
pub(super) fn carry_out_one(
    trials: &GraspTrials,
    table: &Table,
    grasp: &Grasp,
    opening: f64,
) -> Result<Option<Ending>, TrialError> {
    let around = Around::new(table, &trials.world.surfaces, &[]);
    let Some(motion) = motion(trials, &around, grasp) else { return Ok(None) };
    Ok(Some(simulate(trials, table, &motion, opening)?.0))
}

/// What the arm has to avoid.
struct Around {
    /// The things as they are: the arm starts where it touches none.
    things: CollisionWorld,
    /// What the cameras saw of them.
    seen: CollisionWorld,
}

impl Around {
    fn new(table: &Table, surfaces: &[SupportSurface], points: &[DVec3]) -> Self {
        let mut seen = CollisionWorld::new();
        if !points.is_empty() {
            // A camera's points, which are finite, are always accepted.
            let _ = seen.add_points(SEEN, points, SEEN_RADIUS_M);
        }
        Self { things: neighbours(table, surfaces), seen }
    }
}

/// Name and radius of the points that the arm avoids, m.
const SEEN: &str = "seen";
const SEEN_RADIUS_M: f64 = 0.003;

/// Support surfaces and neighbours, for starting the arm where it touches nothing.
fn neighbours(table: &Table, surfaces: &[SupportSurface]) -> CollisionWorld {
    let mut world = CollisionWorld::new();
    // A checked world's boxes, finite poses and the models' own pieces are always accepted.
    for surface in surfaces {
        let _ = world.add(&surface.id, &surface.pieces(), &surface.world_from_surface());
    }
    for (index, (model, pose)) in table.models.iter().zip(&table.poses).enumerate() {
        let _ = world.add(&index.to_string(), &model.links[0].pieces, pose);
    }
    world
}

/// What counts as feasible here: the sampler has found room for the hand, so the arm only has to get there.
fn feasibility(max_width: f64) -> FeasibilitySettings {
    FeasibilitySettings {
        wanted: usize::MAX,
        configurations: CONFIGURATIONS,
        configurations_kept: CONFIGURATIONS,
        half_turn: HalfTurn::Both,
        clearance_m: 0.0,
        object_clearance_m: None,
        // The fingers start wide open.
        finger_room_m: Some(max_width),
        approach_m: APPROACH_M,
        tests_pregrasp: false,
        lift_m: LIFT_M,
        release_heights_m: Vec::new(),
        goal_configurations: 0,
    }
}

/// Joint motions for a grasp or for its half turn; `None` when the arm cannot.
fn motion(trials: &GraspTrials, around: &Around, grasp: &Grasp) -> Option<Motion> {
    let planner = &*trials.planner;
    let wide = planner.gripper().max_width;
    let nothing = Allowed::none();
    let things = PlanningScene { world: &around.things, attached: None, allowed: &nothing, gripper_width: wide };
    let start = planner.checker(&things, 0.0);
    let query = PickQuery {
        planner,
        world: &around.seen,
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

/// From 0 to 1 with speed and acceleration 0 at both ends.
fn eased(step: usize, steps: usize) -> f64 {
    let t = step as f64 / steps as f64;
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}

/// Back and forth along x, y and z, then turns about the hand's closing axis' neighbours.
fn shaken(pose: Pose) -> impl Iterator<Item = Pose> {
    (0..5).flat_map(move |way| {
        (1..=SHAKE_STEPS).map(move |step| {
            let t = step as f64 / SHAKE_STEPS as f64;
            let periods = if way < 3 { SHAKE_PERIODS } else { TURN_PERIODS };
            let swing = (TAU * periods * t).sin() * (6.0 * t).min(6.0 * (1.0 - t)).min(1.0);
            match way {
                0..=2 => Pose { position: pose.position + DVec3::AXES[way] * (SHAKE_M * swing), ..pose },
                3 => pose * Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_x(TURN_RAD * swing) },
                _ => pose * Pose { position: DVec3::ZERO, rotation: DQuat::from_rotation_z(TURN_RAD * swing) },
            }
        })
    })
}

/// Physics: how it ended, and the opening between the pads at the end.
///
/// It steps the simulation itself: there is no task to judge and nothing to record, the robot starts before the grasp
/// instead of at home, and a trial is a few hundred steps of which only the last look counts.
fn simulate(trials: &GraspTrials, table: &Table, motion: &Motion, opening: f64) -> Result<(Ending, f64), TrialError> {
    let robot = RobotModel { home: motion.approach[0].clone(), ..(*trials.robot).clone() };
    let scene = Arc::new(Scene::compile(&trials.world, &robot, &table.objects())?);
    let mut sim = Sim::new(scene);
    let center = table.models[0].links[0].mass.center;
    let height = |sim: &Sim| sim.object_states()[0].pose.transform_point(center).z;
    let before = height(&sim);
    let drive = |arm: &[f64], width: f64, sim: &mut Sim| -> Result<Option<usize>, TrialError> {
        let command: Vec<f32> = arm.iter().chain([&width]).map(|&value| value as f32).collect();
        Ok(sim.control_step(&command)?.grasped)
    };
    // The fingers start wide open and take the opening first.
    let wait = REST_STEPS + ((trials.robot.gripper.max_width - opening) / FINGERS_M_S * RATE_HZ).ceil() as usize;
    for _ in 0..wait {
        drive(&motion.approach[0], opening, &mut sim)?;
    }
    for arm in &motion.approach {
        drive(arm, opening, &mut sim)?;
    }
    let Some(grasp) = motion.approach.last() else { return Ok((Ending::OutOfReach, 0.0)) };
    for _ in 0..REST_STEPS {
        drive(grasp, opening, &mut sim)?;
    }
    for _ in 0..CLOSE_STEPS {
        drive(grasp, 0.0, &mut sim)?;
    }
    let last = motion.shake.last().cloned().unwrap_or_default();
    let hold = vec![last; HOLD_STEPS];
    let phases =
        [(&motion.lift, Ending::LostInLift), (&motion.shake, Ending::LostInShake), (&hold, Ending::LostInHold)];
    if sim.grasped() != Some(0) {
        return Ok((Ending::Missed, sim.gripper_width()));
    }
    for (steps, ending) in phases {
        for arm in steps {
            drive(arm, 0.0, &mut sim)?;
        }
        if sim.grasped() != Some(0) {
            return Ok((ending, sim.gripper_width()));
        }
    }
    Ok((if height(&sim) - before >= LIFTED_M { Ending::Held } else { Ending::NotLifted }, sim.gripper_width()))
}

//! Hidden arms: random parameters, sensors, effects that the model lacks, and recordings in which a parameter cannot be
//! seen.

use std::sync::Arc;

use genmanip_core::{RobotModel, Seed, World};
use genmanip_identify::IdentifyError;
use genmanip_identify::motions::{ExcitationSettings, excitation, push, slip, with_payload};
use genmanip_identify::parameters::{Parameter, Values};
use genmanip_identify::recording::{Block, Payload, Recording};
use genmanip_identify::synthetic::{Effect, HiddenArm, Sensors, record};
use genmanip_motion::{Planner, PlannerSettings};
use genmanip_workspace::{WorkspaceError, worlds};
use rand::{Rng, RngExt};
use serde::Serialize;

/// Effect that the model lacks, by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Lacking {
    /// Play between motor and joint.
    Backlash,
    /// Friction that is larger near standstill.
    Stribeck,
    /// Another time step of the simulator.
    TimeStep,
}

/// Parameter that the recordings do not show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plant {
    /// The last joint stands still.
    StillJoint,
    /// No recording has a payload.
    NoPayload,
    /// The gripper stops before the block.
    NoTouch,
    /// The grip stays firm.
    NoSlip,
}

/// Centre of the payload that the recordings state; the true one lies up to 3 cm away along each axis.
const STATED_CENTER_M: [f64; 3] = [0.0, 0.0, 0.11];

/// One hidden arm with its recordings.
pub struct HiddenCase {
    /// Robot.
    pub robot: Arc<RobotModel>,
    /// World as the identification knows it.
    pub world: World,
    /// True values.
    pub truth: Values,
    /// Effect that the model lacks; `None` if the model is right.
    pub lacking: Option<Lacking>,
    /// Parameters that the recordings do not show.
    pub planted: Vec<Parameter>,
    /// Recordings to identify from.
    pub recordings: Vec<Recording>,
    /// Recording of another motion, to measure the tracking error on.
    pub held_out: Recording,
}

/// Hidden arm of a series: every fourth lacks something in the model, every fifth is a UR5e (which pushes and grips
/// nothing), and two thirds hold a parameter that the recordings do not show.
///
/// # Errors
/// When a motion is out of reach, or a hidden arm cannot be simulated.
pub fn hidden_case(index: usize, seed: Seed) -> Result<HiddenCase, WorkspaceError> {
    let rng = &mut seed.fork("case").rng();
    let is_ur = index % 5 == 4;
    let world = worlds::read_world_with(None, is_ur.then_some("ur5e_2f85"))?;
    let planner = worlds::planner(&world, &PlannerSettings::default())?;
    let robot = Arc::clone(planner.robot());
    let lacking = (index % 4 == 1).then(|| [Lacking::Backlash, Lacking::Stribeck, Lacking::TimeStep][index / 4 % 3]);
    let plant =
        [Some(Plant::StillJoint), None, Some(Plant::NoPayload), Some(Plant::NoTouch), Some(Plant::NoSlip), None]
            [index % 6];
    let mut truth = values(&world, &robot, rng);
    let last = robot.arm_dof() - 1;
    if plant == Some(Plant::StillJoint) {
        // Enough to hold the joint against the motion of the others and a payload beside its axis.
        truth.arm.friction_loss[last] = 0.2 * robot.arm_joints().nth(last).map_or(0.0, |it| it.max_effort);
    }
    let hidden = HiddenArm {
        world: world.clone(),
        values: truth.clone(),
        effect: effect(lacking, rng),
        sensors: Sensors {
            joint_rad: log_uniform(rng, 2e-5, 2e-4),
            joint_step_rad: log_uniform(rng, 1e-5, 1e-4),
            block_m: log_uniform(rng, 3e-4, 1.5e-3),
        },
    };
    let broken = |error: IdentifyError| WorkspaceError::broken(format!("hidden arm {index} cannot be made"), error);
    let made = motions(&planner, &world, plant, seed).map_err(broken)?;
    let (held_out, training) = made.split_last().map_or((None, &[][..]), |(last, rest)| (Some(last), rest));
    let execute = |(number, motion): (usize, &Recording)| {
        record(&hidden, &robot, motion, seed.fork("noise").fork_index(number as u64))
            .map_err(|error| broken(error.into()))
    };
    let recordings = training.iter().enumerate().map(execute).collect::<Result<Vec<_>, _>>()?;
    let held_out = execute((made.len(), held_out.unwrap_or(&made[0])))?;
    let planted = match plant {
        Some(Plant::StillJoint) => {
            vec![Parameter::Kp(last), Parameter::Kv(last), Parameter::Damping(last), Parameter::FrictionLoss(last)]
        }
        Some(Plant::NoPayload) => {
            [Parameter::PayloadMass].into_iter().chain((0..3).map(Parameter::PayloadCenter)).collect()
        }
        Some(Plant::NoTouch) if !is_ur => vec![Parameter::TableFriction],
        Some(Plant::NoSlip) if !is_ur => vec![Parameter::PadFriction],
        _ => Vec::new(),
    };
    Ok(HiddenCase { robot, world, truth, lacking, planted, recordings, held_out })
}

/// True values, around those of the robot's file.
fn values(world: &World, robot: &RobotModel, rng: &mut impl Rng) -> Values {
    let mut truth = Values::of(world, robot);
    for (joint, limits) in robot.arm_joints().enumerate() {
        truth.arm.kp[joint] *= rng.random_range(0.7..1.4);
        truth.arm.kv[joint] *= rng.random_range(0.7..1.4);
        truth.arm.damping[joint] *= rng.random_range(0.5..4.0);
        truth.arm.friction_loss[joint] = limits.max_effort * rng.random_range(0.005..0.03);
    }
    truth.arm.latency_s = rng.random_range(0.002..0.08);
    truth.payload_kg = rng.random_range(0.2..2.0);
    truth.payload_center_m = [0.02, 0.02, 0.03].map(|off| rng.random_range(-off..off));
    truth.payload_center_m[2] += STATED_CENTER_M[2];
    truth.table_friction = rng.random_range(0.2..0.8);
    truth.pad_friction = rng.random_range(0.5..1.3);
    truth
}

fn effect(lacking: Option<Lacking>, rng: &mut impl Rng) -> Effect {
    match lacking {
        None => Effect::None,
        // 0.1 to 0.3 degrees: a worn gear.
        Some(Lacking::Backlash) => Effect::Backlash { width_rad: rng.random_range(0.002..0.005) },
        Some(Lacking::Stribeck) => {
            Effect::Stribeck { share: rng.random_range(0.5..1.5), speed_rad_s: rng.random_range(0.05..0.15) }
        }
        Some(Lacking::TimeStep) => Effect::TimeStep { rate_hz: [960, 1920][usize::from(rng.random_bool(0.5))] },
    }
}

/// Motions to identify from, and one to be held out, last.
fn motions(
    planner: &Planner,
    world: &World,
    plant: Option<Plant>,
    seed: Seed,
) -> Result<Vec<Recording>, IdentifyError> {
    let joints = planner.robot().arm_dof();
    let moving = if plant == Some(Plant::StillJoint) { (0..joints - 1).collect() } else { Vec::new() };
    let settings = ExcitationSettings { joints: moving, ..ExcitationSettings::default() };
    let free = |label: &str, duration_s: f64| {
        let settings = ExcitationSettings { duration_s, ..settings.clone() };
        excitation(planner, world, &settings, seed.fork(label))
    };
    let mut made = vec![free("motion", 6.0)?];
    if plant != Some(Plant::NoPayload) {
        let payload = Payload { center_m: STATED_CENTER_M, gyration_m: 0.03 };
        made.push(with_payload(&free("payload", 4.0)?, payload));
    }
    if planner.robot().name == "panda" {
        let block = |size_m: [f64; 3], mass_kg: f64, x: f64| Block {
            size_m,
            mass_kg,
            base_m: [x, 0.0, 0.0],
            track_m: Vec::new(),
        };
        let mut pushed = push(planner, block([0.08, 0.08, 0.05], 2.0, 0.38), 0.5)?;
        if let (Some(Plant::NoTouch), Some(block)) = (plant, &mut pushed.block) {
            block.base_m[0] += 0.3;
        }
        let mut slipped = slip(planner, block([0.04, 0.03, 0.08], 0.75, 0.5))?;
        if plant == Some(Plant::NoSlip) {
            let firm = slipped.width_m.iter().copied().fold(f64::INFINITY, f64::min);
            let closed = slipped.width_m.iter().position(|width| *width == firm).unwrap_or_default();
            slipped.width_m[closed..].fill(firm);
        }
        made.extend([pushed, slipped]);
    }
    made.push(free("held out", 4.0)?);
    Ok(made)
}

fn log_uniform(rng: &mut impl Rng, low: f64, high: f64) -> f64 {
    low * (high / low).powf(rng.random_range(0.0..1.0))
}

//! Simulated recordings with known truth, for rehearsals and measurements.

use std::sync::Arc;

use genmanip_core::{RobotModel, Seed, World};
use genmanip_real::synthetic::normal;
use genmanip_sim::{Sim, SimError};
use rand::RngExt;

use crate::parameters::Values;
use crate::recording::{Motion, Recording};
use crate::replay::{Sampler, compile};
use crate::set_points::SetPoints;

/// Time before the recording in which the arm comes to its start position from nearby, s: dry friction then holds it a
/// little off its command, as it does a real arm.
const APPROACH_S: f64 = 0.8;
/// Largest distance of each joint from the start position before that, rad.
const APPROACH_RAD: f64 = 0.01;
/// Speed over which the Stribeck torque changes its sign, rad/s: the simulator's friction is stiff, this one explicit.
const SIGN_RAD_S: f64 = 0.02;

/// A simulated arm whose parameters are hidden from the identification.
#[derive(Clone, Debug)]
pub struct HiddenArm {
    /// World; its `physics.arm` is replaced by the values.
    pub world: World,
    /// True values of all parameters.
    pub values: Values,
    /// Effect that the model of the identification lacks.
    pub effect: Effect,
    /// Noise and resolution of the sensors.
    pub sensors: Sensors,
}

/// Noise and resolution of the sensors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensors {
    /// Standard deviation of a joint position, rad.
    pub joint_rad: f64,
    /// Step between two joint positions, rad; 0 for none.
    pub joint_step_rad: f64,
    /// Standard deviation of the block's position per axis, m.
    pub block_m: f64,
}

/// Effect of a real arm that the model lacks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Effect {
    /// None: the model is right.
    #[default]
    None,
    /// Play between motor and joint: the joint's set point follows only beyond half this angle on either side.
    Backlash {
        /// Full width of the play, rad.
        width_rad: f64,
    },
    /// Dry friction is larger near standstill, and falls over a typical speed (Stribeck).
    Stribeck {
        /// Additional friction at standstill, as a share of the dry friction.
        share: f64,
        /// Speed at which it has fallen to 1/e, rad/s.
        speed_rad_s: f64,
    },
    /// The simulator runs with another time step.
    TimeStep {
        /// Physics rate, Hz.
        rate_hz: u32,
    },
}

/// Executes a motion on a hidden arm with its whole collision geometry and its own delay lines; the result is the
/// motion with measurements.
///
/// # Errors
/// When the simulator refuses the model or diverges.
pub fn record(hidden: &HiddenArm, robot: &RobotModel, motion: &Recording, seed: Seed) -> Result<Recording, SimError> {
    let mut rng = seed.rng();
    let mut world = hidden.world.clone();
    if let Effect::TimeStep { rate_hz } = hidden.effect {
        world.physics.physics_rate_hz = rate_hz;
    }
    let mut before = motion.clone();
    for position in &mut before.command_rad[0] {
        *position += rng.random_range(-APPROACH_RAD..APPROACH_RAD);
    }
    before.joint_rad.clear();
    let mut sim = Sim::new(Arc::new(compile(&before, &world, robot, &hidden.values)?));
    let commands = SetPoints::of(motion);
    let (first, start_s) = (motion.start_command(), motion.time_s[0]);
    let step_s = world.physics.timestep_s();
    let mut played = before.command_rad[0].clone();
    // A block that is dropped falls from the first moment on.
    let approach = if motion.motion == Motion::Drop { 0.0 } else { (APPROACH_S / step_s).round() };
    let mut sampler = None;
    let mut step = -approach;
    loop {
        if step >= 0.0 && sampler.is_none() {
            sampler = Some(Sampler::new(motion, &sim));
        }
        if sampler.as_ref().is_some_and(Sampler::is_done) {
            break;
        }
        let at = |number: f64| -> Vec<f64> {
            if number >= 0.0 {
                return commands.positions(start_s + number * step_s);
            }
            let share = ((number + approach) / (0.4 * approach)).min(1.0);
            before.command_rad[0].iter().zip(&first).map(|(from, to)| from + (to - from) * share).collect()
        };
        let last = played.clone();
        let wanted = at(step + 1.0);
        match hidden.effect {
            Effect::Backlash { width_rad } => played.iter_mut().zip(&wanted).for_each(|(played, wanted)| {
                *played = played.clamp(wanted - 0.5 * width_rad, wanted + 0.5 * width_rad);
            }),
            _ => played = wanted,
        }
        let speeds: Vec<f64> = played.iter().zip(&last).map(|(now, last)| (now - last) / step_s).collect();
        match commands.width_m(start_s + (step + 1.0).max(0.0) * step_s) {
            Some(width_m) => drop(sim.robot_step(&played, &speeds, width_m)?),
            None => sim.drive_step(&played, &speeds, &stribeck(hidden, &sim))?,
        }
        step += 1.0;
        if let Some(sampler) = &mut sampler {
            sampler.take(start_s + step * step_s, &sim);
        }
    }
    let track = sampler.map(|sampler| sampler.track).unwrap_or_default();
    let Sensors { joint_rad, joint_step_rad, block_m } = hidden.sensors;
    let mut measured = |value: f64, noise: f64, step: f64| {
        let noisy = value + noise * normal(&mut rng);
        if step > 0.0 { (noisy / step).round() * step } else { noisy }
    };
    let mut recording = motion.clone();
    recording.joint_rad = track
        .joints
        .iter()
        .map(|row| row.iter().map(|&position| measured(position, joint_rad, joint_step_rad)).collect())
        .collect();
    if let Some(block) = &mut recording.block {
        block.track_m = track.block.iter().map(|point| point.to_array().map(|it| measured(it, block_m, 0.0))).collect();
    }
    Ok(recording)
}

/// Torque of the Stribeck effect on each joint, N·m.
fn stribeck(hidden: &HiddenArm, sim: &Sim) -> Vec<f64> {
    let speeds = sim.joint_velocities();
    let Effect::Stribeck { share, speed_rad_s } = hidden.effect else { return vec![0.0; speeds.len()] };
    let torque = |(speed, friction): (f64, &f64)| {
        -share * friction * (-(speed / speed_rad_s).powi(2)).exp() * (speed / SIGN_RAD_S).tanh()
    };
    speeds.into_iter().zip(&hidden.values.arm.friction_loss).map(torque).collect()
}

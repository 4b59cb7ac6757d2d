//! Motions that show parameters: excitation of the joints, a push, and a slip.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{Pose, RobotModel, Seed, World};
use genmanip_motion::{AllowedCollisions, CollisionWorld, Planner, PlanningScene};
use rand::RngExt;

use crate::error::IdentifyError;
use crate::recording::{Block, Motion, Payload, Recording};

/// Shape of the exciting motion: a finite Fourier series per joint (Swevers et al., 1997) that starts and ends at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationSettings {
    /// Duration, s.
    pub duration_s: f64,
    /// Time at rest before and after, s.
    pub rest_s: f64,
    /// Rate of the commands and measurements, Hz.
    pub rate_hz: f64,
    /// Number of harmonics of the duration.
    pub harmonics: usize,
    /// Share of the joints' maximum velocity and acceleration that is used.
    pub effort: f64,
    /// Distance kept from the joint limits, rad.
    pub margin_rad: f64,
    /// Joints that move, from the base; all if empty.
    pub joints: Vec<usize>,
}

impl Default for ExcitationSettings {
    fn default() -> Self {
        Self {
            duration_s: 6.0,
            rest_s: 0.5,
            rate_hz: 100.0,
            harmonics: 5,
            effort: 0.7,
            margin_rad: 0.1,
            joints: Vec::new(),
        }
    }
}

/// Factor by which the amplitude shrinks while the motion would touch something, and number of attempts.
const SHRINK: (f64, usize) = (0.85, 16);
/// Fraction of the duration in which the motion fades in, and out.
const FADE: f64 = 0.12;

/// A random exciting motion about the home position that stays inside the limits and touches nothing.
///
/// # Errors
/// [`IdentifyError::NoPath`] when even small motions about the home position touch something.
pub fn excitation(
    planner: &Planner,
    world: &World,
    settings: &ExcitationSettings,
    seed: Seed,
) -> Result<Recording, IdentifyError> {
    let robot = planner.robot();
    let mut rng = seed.rng();
    let around = surroundings(world);
    let allowed = AllowedCollisions::none();
    let open = robot.gripper.max_width;
    let free = PlanningScene { world: &around, attached: None, allowed: &allowed, gripper_width: open };
    let moving_s = settings.duration_s - 2.0 * settings.rest_s;
    let count = (settings.duration_s * settings.rate_hz).round() as usize + 1;
    let times: Vec<f64> = (0..count).map(|index| index as f64 / settings.rate_hz).collect();
    let mut waves: Vec<Vec<f64>> = Vec::new();
    for (index, (joint, home)) in robot.arm_joints().zip(&robot.home).enumerate() {
        let terms: Vec<[f64; 2]> = (0..settings.harmonics)
            .map(|_| [rng.random_range(0.3..1.0), rng.random_range(0.0..std::f64::consts::TAU)])
            .collect();
        let wave = |time: f64| {
            let at = ((time - settings.rest_s) / moving_s).clamp(0.0, 1.0);
            let sum: f64 = (1..)
                .zip(&terms)
                .map(|(order, [amplitude, phase])| {
                    let order = f64::from(order);
                    amplitude / order.sqrt() * (std::f64::consts::TAU * order * at + phase).sin()
                })
                .sum();
            fade(at / FADE) * fade((1.0 - at) / FADE) * sum
        };
        let raw: Vec<f64> = times.iter().map(|&time| wave(time)).collect();
        let is_moving = settings.joints.is_empty() || settings.joints.contains(&index);
        let scale = if is_moving { largest(&raw, joint, *home, settings) } else { 0.0 };
        waves.push(raw.into_iter().map(|it| it * scale).collect());
    }
    let mut scale = 1.0;
    for _ in 0..SHRINK.1 {
        let rows: Vec<Vec<f64>> = (0..count)
            .map(|row| robot.home.iter().zip(&waves).map(|(home, wave)| home + scale * wave[row]).collect())
            .collect();
        if rows.iter().step_by(2).all(|row| planner.check(&free, row).is_none()) {
            return Ok(recording(robot, Motion::Arm, times, rows));
        }
        scale *= SHRINK.0;
    }
    Err(IdentifyError::NoPath {
        message: format!("motions of robot `{}` about its home position touch the table or the arm itself", robot.name),
    })
}

/// The same motion with a payload on the hand.
#[must_use]
pub fn with_payload(motion: &Recording, payload: Payload) -> Recording {
    Recording { motion: Motion::Payload, payload: Some(payload), ..motion.clone() }
}

/// Largest amplitude of a wave about a joint's home position within the limits of position, velocity, acceleration.
fn largest(wave: &[f64], joint: &genmanip_core::RobotJoint, home: f64, settings: &ExcitationSettings) -> f64 {
    let rate = settings.rate_hz;
    let peak = |values: &mut dyn Iterator<Item = f64>| values.fold(1e-9_f64, |peak, it| peak.max(it.abs()));
    let speed = peak(&mut wave.windows(2).map(|two| (two[1] - two[0]) * rate));
    let acceleration = peak(&mut wave.windows(3).map(|three| (three[2] - 2.0 * three[1] + three[0]) * rate * rate));
    let room = (joint.upper - home).min(home - joint.lower) - settings.margin_rad;
    let limits = [
        settings.effort * joint.max_velocity / speed,
        settings.effort * joint.max_acceleration / acceleration,
        room.max(0.0) / peak(&mut wave.iter().copied()),
        // No useful motion takes a joint further.
        1.2 / peak(&mut wave.iter().copied()),
    ];
    limits.into_iter().fold(f64::INFINITY, f64::min)
}

/// Smooth step of degree five from 0 at 0 to 1 at 1.
fn fade(at: f64) -> f64 {
    let t = at.clamp(0.0, 1.0);
    t * t * t * (t * (6.0 * t - 15.0) + 10.0)
}

/// Rate of pushing and slipping motions, Hz.
const RATE_HZ: f64 = 100.0;
/// Duration of a drop, s: a block that keeps 0.7 of its speed has come to rest.
const DROP_S: f64 = 1.5;
/// Lowest drop, m.
const LOWEST_DROP_M: f64 = 0.05;
/// Speed at which the fingers meet the block, m/s.
const CREEP_M_S: f64 = 0.03;
/// Deceleration of the fingers, m/s²: harder than friction brakes the block, which slides on.
const BRAKE_M_S2: f64 = 12.0;
/// Lowest friction coefficient at which the block comes to rest within the motion.
const LEAST_FRICTION: f64 = 0.15;
/// Height of the tool while it pushes, m.
const PUSH_HEIGHT_M: f64 = 0.03;

/// A push of a block along +x: the closed gripper accelerates it to a speed (m/s), and stops; the block slides on.
///
/// # Errors
/// [`IdentifyError::NoPath`] when the path is out of reach.
pub fn push(planner: &Planner, block: Block, speed_m_s: f64) -> Result<Recording, IdentifyError> {
    // Half the depth of the closed fingers along x, and a gap.
    let start_x = block.base_m[0] - block.size_m[0] / 2.0 - 0.025;
    let (rest_s, creep_s, rise_s, cruise_s) = (1.1, 0.7, 0.35, 0.25);
    let (brake_s, after_s) = (speed_m_s / BRAKE_M_S2, 0.25 + speed_m_s / (LEAST_FRICTION * 9.81));
    // The fingers meet the block slowly, so that it does not bounce, take it along smoothly, and stop.
    let speed = |time: f64| {
        let t = time - rest_s;
        let brake = ((t - creep_s - rise_s - cruise_s) / brake_s).clamp(0.0, 1.0);
        let creep = CREEP_M_S * fade(t / 0.1);
        (creep + (speed_m_s - CREEP_M_S) * fade((t - creep_s) / rise_s)) * (1.0 - brake)
    };
    // Integral by the midpoint rule.
    let mut travelled = vec![0.0];
    let duration_s = rest_s + creep_s + rise_s + cruise_s + brake_s + after_s;
    for step in 0..(duration_s * 1e3) as usize {
        travelled.push(travelled[step] + 1e-3 * speed((step as f64 + 0.5) * 1e-3));
    }
    let travel = |time: f64| travelled[((time * 1e3).round() as usize).min(travelled.len() - 1)];
    let y = block.base_m[1];
    let path = |time: f64| DVec3::new(start_x + travel(time), y, PUSH_HEIGHT_M);
    tool_motion(planner, Motion::Push, block, duration_s, path, |_| 0.0)
}

/// A slip: the gripper closes about a block, lifts it, and loosens its grip until the block slips.
///
/// # Errors
/// [`IdentifyError::NoPath`] when the path is out of reach, or the block does not fit between the fingers.
pub fn slip(planner: &Planner, block: Block) -> Result<Recording, IdentifyError> {
    let robot = planner.robot();
    let (rest_s, close_s, lift_s, loosen_s, after_s) = (0.4, 0.9, 0.6, 1.8, 0.3);
    let width = block.size_m[1];
    let Some(drives) = robot.drives.as_ref().filter(|_| width + 0.004 < robot.gripper.max_width) else {
        return Err(IdentifyError::NoPath {
            message: format!("a block {width} m wide does not fit between the fingers of `{}`", robot.name),
        });
    };
    // Closed further than the block by this much, the drive presses with full force.
    let squeeze = 0.5 * drives.grip_force_n / drives.grip_kp;
    let [x, y, _] = block.base_m;
    let height = block.size_m[2] * 0.6;
    let path = |time: f64| {
        let lift = fade((time - rest_s - close_s) / lift_s);
        DVec3::new(x, y, height + 0.05 * lift)
    };
    let opening = |time: f64| {
        let closed = ((time - rest_s) / close_s).clamp(0.0, 1.0);
        let loosened = ((time - rest_s - close_s - lift_s) / loosen_s).clamp(0.0, 1.0);
        let open = robot.gripper.max_width;
        open + (width - squeeze - open) * closed + squeeze * loosened
    };
    let duration_s = rest_s + close_s + lift_s + loosen_s + after_s;
    tool_motion(planner, Motion::Slip, block, duration_s, path, opening)
}

/// A drop: a block falls from the height of its base above the table, and the arm stands still at home.
///
/// # Errors
/// [`IdentifyError::NoPath`] for a block that is not above the table.
pub fn drop_block(robot: &RobotModel, block: Block) -> Result<Recording, IdentifyError> {
    if block.base_m[2] < LOWEST_DROP_M {
        let message = format!("a block {} m above the table does not fall far enough", block.base_m[2]);
        return Err(IdentifyError::NoPath { message });
    }
    let times: Vec<f64> = (0..=(DROP_S * RATE_HZ) as usize).map(|index| index as f64 / RATE_HZ).collect();
    let rows = vec![robot.home.clone(); times.len()];
    Ok(Recording { block: Some(block), ..recording(robot, Motion::Drop, times, rows) })
}

/// Motion of the downward tool along a path of positions, with an opening width of the gripper.
fn tool_motion(
    planner: &Planner,
    motion: Motion,
    block: Block,
    duration_s: f64,
    path: impl Fn(f64) -> DVec3,
    width_m: impl Fn(f64) -> f64,
) -> Result<Recording, IdentifyError> {
    let robot = planner.robot();
    let down = DQuat::from_rotation_x(std::f64::consts::PI);
    let count = (duration_s * RATE_HZ).round() as usize + 1;
    let times: Vec<f64> = (0..count).map(|index| index as f64 / RATE_HZ).collect();
    let pose = |time: &f64| Pose::new(path(*time), down);
    let out_of_reach = || IdentifyError::NoPath {
        message: format!("a {} at ({:.2}, {:.2}) m is out of reach", motion.name(), block.base_m[0], block.base_m[1]),
    };
    let start = planner.ik(&pose(&0.0), &robot.home).into_iter().next().ok_or_else(out_of_reach)?;
    let rows = planner.follow(&start, times.iter().map(pose), 0.2).ok_or_else(out_of_reach)?;
    let widths = times.iter().map(|time| width_m(*time)).collect();
    let mut made = recording(robot, motion, times, rows);
    made.width_m = widths;
    made.block = Some(block);
    Ok(made)
}

fn recording(robot: &RobotModel, motion: Motion, time_s: Vec<f64>, command_rad: Vec<Vec<f64>>) -> Recording {
    Recording {
        robot: robot.name.clone(),
        motion,
        time_s,
        command_rad,
        joint_rad: Vec::new(),
        width_m: Vec::new(),
        payload: None,
        block: None,
    }
}

/// Support surfaces as obstacles.
fn surroundings(world: &World) -> CollisionWorld {
    let mut around = CollisionWorld::new();
    for surface in &world.surfaces {
        // Boxes of a validated world and finite poses cannot be rejected.
        let _ = around.add(surface.id.as_str(), &surface.pieces(), &surface.world_from_surface());
    }
    around
}

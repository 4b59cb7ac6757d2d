//! Conversion of commands to actuator set points.
//!
//! The arm's position servos keep the last applied command in the saved state (`ctrl`), so that the interpolation of
//! the next interval starts from the same bits after a restore.

use genmanip_core::{Drives, RobotModel};

use crate::SimError;

/// Set point (m) of the width drive for a commanded opening width (m).
///
/// Equals the width, but below `grip_overclose_m` it falls twice as fast and reaches `-grip_overclose_m` at width 0, so
/// that thin objects are also held with full force.
pub(crate) fn setpoint_from_width(width: f64, drives: &Drives) -> f64 {
    let overclose = drives.grip_overclose_m;
    if width >= overclose { width } else { 2.0 * width - overclose }
}

/// Set point of the width drive at the end of an interval, limited by the fingers' maximum velocity.
pub(crate) fn next_setpoint(current: f64, width: f64, robot: &RobotModel, drives: &Drives, period_s: f64) -> f64 {
    let fingers = robot.gripper.fingers.iter().filter_map(|&link| robot.links.get(link)?.joint.as_ref());
    let limit = fingers.map(|joint| joint.max_velocity).sum::<f64>() * period_s;
    setpoint_from_width(width, drives).clamp(current - limit, current + limit)
}

/// Command as it is applied: rounded to f32, clamped to the joint ranges and maximum velocities.
///
/// Idempotent, so that recorded commands replay exactly.
pub(crate) fn applied_command(
    command: &[f32],
    previous_targets: &[f64],
    robot: &RobotModel,
    period_s: f64,
) -> Result<Vec<f32>, SimError> {
    let expected = robot.arm_dof() + 1;
    if command.len() != expected {
        return Err(SimError::CommandLength { expected, got: command.len() });
    }
    if let Some((index, &value)) = command.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        return Err(SimError::CommandNotFinite { index, value });
    }
    let mut applied: Vec<f32> = robot
        .arm_joints()
        .zip(previous_targets)
        .zip(command)
        .map(|((joint, &previous), &target)| {
            let limit = joint.max_velocity * period_s;
            let reachable = f64::from(target).clamp(previous - limit, previous + limit);
            reachable.clamp(joint.lower, joint.upper) as f32
        })
        .collect();
    applied.extend(command.last().map(|&width| width.clamp(0.0, robot.gripper.max_width as f32)));
    Ok(applied)
}

/// Linear interpolation, exactly `to` at `t` = 1.
pub(crate) fn lerp(from: f64, to: f64, t: f64) -> f64 {
    if t >= 1.0 { to } else { from + (to - from) * t }
}

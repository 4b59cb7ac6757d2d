//! Conversion of motions to 60 Hz commands: joint targets and a gripper width.

use crate::path::Path;
use crate::planner::Planner;

/// Commands along a path at a share (0 to 1) of the robot's velocity and acceleration limits, with a constant gripper
/// width (m).
pub fn follow(planner: &Planner, path: &Path, width: f64, speed: f64) -> Vec<Vec<f32>> {
    planner.time(path, speed).configs.iter().map(|arm| command(arm, width)).collect()
}

/// Commands to hold a configuration for a number of control steps.
pub fn wait(arm: &[f64], width: f64, steps: usize) -> Vec<Vec<f32>> {
    vec![command(arm, width); steps]
}

/// Commands to move the fingers with a fixed arm: a ramp over half of the steps, then time to build up or release
/// force.
pub fn fingers(arm: &[f64], from: f64, to: f64, steps: usize) -> Vec<Vec<f32>> {
    let ramp = (steps / 2).max(1);
    (1..=steps)
        .map(|step| {
            let t = (step as f64 / ramp as f64).min(1.0);
            command(arm, from + (to - from) * t)
        })
        .collect()
}

/// One command: arm joint targets (rad) and gripper width (m).
pub fn command(arm: &[f64], width: f64) -> Vec<f32> {
    arm.iter().chain([&width]).map(|&value| value as f32).collect()
}

//! Accuracy to expect from a motion, before it is executed.

use std::cell::RefCell;

use genmanip_core::{RobotModel, World};
use serde::Serialize;

use crate::error::IdentifyError;
use crate::identify::{parameters_of, unknown};
use crate::parameters::{Parameter, Values};
use crate::problem::{Measured, Problem};
use crate::recording::{Motion, Recording};
use crate::replay::{bare, replay};
use crate::uncertainty::{Uncertainty, WIDEST, Z};

/// Dry friction of a joint without a value of its own, in typical sizes.
const FRICTION: f64 = 0.7;
/// Latency without a value of its own, s.
const LATENCY_S: f64 = 0.02;
/// Mass of the payload, kg.
const PAYLOAD_KG: f64 = 1.0;

/// Accuracy to expect of one parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Expected {
    /// Name, such as `joint3.damping`.
    pub name: String,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Value that was assumed.
    pub value: f64,
    /// Half-width of the 95 % interval.
    pub half_width: f64,
    /// Half-width as a share of the value or of the typical size, whichever is larger.
    pub share: f64,
    /// True if that would count as identified.
    pub is_identified: bool,
}

/// Accuracy to expect from free motions, by parameter, if the arm is like the world's and its joint sensors have white
/// noise of that standard deviation (rad). Missing dry friction and latency are assumed to be typical.
///
/// # Errors
/// For motions that do not fit the robot or cannot be simulated.
pub fn expected(
    world: &World,
    robot: &RobotModel,
    motions: &[Recording],
    noise_rad: f64,
) -> Result<Vec<Expected>, IdentifyError> {
    let nominal = Values::of(world, robot).with_center_of(motions);
    let mut values = Values { payload_kg: PAYLOAD_KG, ..nominal.clone() };
    for joint in 0..robot.arm_dof() {
        let parameter = Parameter::FrictionLoss(joint);
        if values.get(parameter) == 0.0 {
            values.set(parameter, FRICTION * parameter.scale(&nominal, robot));
        }
    }
    if values.arm.latency_s == 0.0 {
        values.arm.latency_s = LATENCY_S;
    }
    let bare = bare(robot, false);
    let free: Vec<&Recording> =
        motions.iter().filter(|motion| matches!(motion.motion, Motion::Arm | Motion::Payload)).collect();
    let mut filled = Vec::new();
    for motion in &free {
        motion.check_robot(robot)?;
        let joint_rad = replay(motion, world, &bare, &values)?.joints;
        filled.push(Recording { joint_rad, ..(*motion).clone() });
    }
    let parameters = parameters_of(&free, robot);
    let problem = Problem {
        recordings: filled.iter().map(|recording| (recording, recording.settled()..recording.len())).collect(),
        world,
        robot: &bare,
        measured: Measured::Joints,
        unknowns: parameters.iter().map(|&parameter| unknown(parameter, &nominal, robot, &values)).collect(),
        base: values.clone(),
        noise: vec![noise_rad; robot.arm_dof()],
        held: Vec::new(),
        derivatives: RefCell::default(),
    };
    let point = problem.start();
    let evaluation = problem.evaluate(&point, f64::INFINITY).ok_or(IdentifyError::Start)?;
    let uncertainty = Uncertainty::of(&evaluation, &problem.noise, &point).ok_or(IdentifyError::Start)?;
    let each = parameters.iter().zip(&problem.unknowns).enumerate().map(|(index, (&parameter, unknown))| {
        let scale = unknown.members[0].1;
        let share = Z * uncertainty.sd[index] / point[index].abs().max(1.0);
        Expected {
            name: parameter.name(robot),
            unit: parameter.unit(),
            value: point[index] * scale,
            half_width: Z * uncertainty.sd[index] * scale,
            share,
            is_identified: share <= WIDEST && !evaluation.columns[index].is_empty(),
        }
    });
    Ok(each.collect())
}

//! Conversion of policy actions to native joint commands.
//!
//! Actions in any space but the native one are executed only through this module; the inverse, from recorded commands
//! to actions, is [`ActionSpec::encode`]. End-effector actions become joint targets by inverse kinematics, seeded with
//! the reference configuration. Unreachable poses are an error; [`crate::Driver`] then holds the command in force.
//!
//! Deltas from the command are relative to the last request, not to the state reached by then, so that tracking errors
//! do not accumulate. That reference stays within [`MAX_LEAD_M`], [`MAX_LEAD_RAD`] or [`MAX_LEAD_JOINT_RAD`] of the
//! measured state, so that an arm that is blocked or too slow does not wind up.

mod path_follower;
#[cfg(test)]
mod tests;

pub use path_follower::Pending;

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{ActionMismatch, ActionSpace, ActionSpec, DeltaFrom, Interpolation, Pose, RobotModel};
use genmanip_motion::{Chain, IkSettings, InverseKinematics, ModelError};
use path_follower::Follower;

/// Maximum distance between the reference of tool deltas and the measured tool, m. Chosen by hand: several times the
/// tracking error of free motion, less than half of the usual largest delta.
pub const MAX_LEAD_M: f64 = 0.02;
/// Maximum angle between the reference of tool deltas and the measured tool, rad. Chosen in the same way.
pub const MAX_LEAD_RAD: f64 = 0.2;
/// Maximum difference between the reference of joint deltas and velocities and the measured joint, rad. Chosen in the
/// same way.
pub const MAX_LEAD_JOINT_RAD: f64 = 0.1;

/// Converts actions of one specification for one robot.
#[derive(Clone, Debug)]
pub struct Adapter {
    spec: ActionSpec,
    robot: Arc<RobotModel>,
    /// Inverse kinematics; `None` for joint spaces.
    kinematics: Option<InverseKinematics>,
    /// Maximum rotation of each arm joint during an action, rad.
    reach: Vec<f64>,
    control_period_s: f64,
    /// Number of control steps per action.
    repeat: usize,
}

/// An action as native commands.
#[derive(Clone, Debug, PartialEq)]
pub struct NativeAction {
    /// One command per control step.
    pub commands: Vec<Vec<f32>>,
    /// Part of the path not executed yet, for the next action; only in end-effector spaces.
    pub pending: Pending,
}

/// Reference of relative actions; joint values in rad, base to tip.
#[derive(Clone, Copy, Debug)]
pub struct ArmReference<'a> {
    /// Arm joint targets of the command in force; the robot's home before the first one.
    pub command: &'a [f64],
    /// Gripper opening of the command in force, m; fully open before the first one.
    pub width_m: f32,
    /// Measured arm joint positions.
    pub measured: &'a [f64],
    /// Arm joint positions when the chunk was requested.
    pub chunk_start: &'a [f64],
    /// Rest of the path that earlier actions have not executed.
    pub pending: &'a Pending,
}

/// Reason why an action is rejected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AdapterError {
    /// An invalid action specification.
    #[error(transparent)]
    Contract(#[from] ActionMismatch),
    /// The robot has no kinematics for end-effector motions.
    #[error(transparent)]
    Robot(#[from] ModelError),
    /// An action of the wrong length.
    #[error("expected {expected} numbers ({spec}), got {got}")]
    Length {
        /// Length that the specification requires.
        expected: usize,
        /// Meaning of the action's entries, from the specification.
        spec: String,
        /// Length of the action.
        got: usize,
    },
    /// A NaN or infinite value.
    #[error("number {index} of the action is {value}, expected a finite one")]
    NotFinite {
        /// Index of the value in the action.
        index: usize,
        /// Value at that index.
        value: f32,
    },
    /// Numbers that do not encode a rotation.
    #[error("expected a rotation as {encoding}, got {numbers:?}")]
    NoRotation {
        /// Name of the rotation encoding.
        encoding: &'static str,
        /// Entries of the action that should encode the rotation.
        numbers: Vec<f64>,
    },
    /// A pose that no configuration of the arm reaches.
    #[error("no configuration of the arm brings the tcp to x {x_m:.3}, y {y_m:.3}, z {z_m:.3} m in that orientation")]
    OutOfReach {
        /// Position along x in the world frame, metres.
        x_m: f64,
        /// Position along y in the world frame, metres.
        y_m: f64,
        /// Position along z in the world frame, metres.
        z_m: f64,
    },
}

impl Adapter {
    /// Converter for actions that last `repeat` control steps of `control_period_s`.
    ///
    /// # Errors
    /// If the specification is invalid, or the robot has no inverse kinematics.
    pub fn new(
        spec: ActionSpec,
        robot: &Arc<RobotModel>,
        ik: &IkSettings,
        control_period_s: f64,
        repeat: usize,
    ) -> Result<Self, AdapterError> {
        spec.check()?;
        let kinematics = match spec.space.is_joint() {
            true => None,
            false => Some(InverseKinematics::new(Chain::new(robot)?, ik.clone())),
        };
        let repeat = repeat.max(1);
        let duration_s = control_period_s * repeat as f64;
        let reach = robot.arm_joints().map(|joint| joint.max_velocity * duration_s).collect();
        Ok(Self { spec, robot: Arc::clone(robot), kinematics, reach, control_period_s, repeat })
    }

    /// Number of control steps per action.
    pub fn repeat(&self) -> usize {
        self.repeat
    }

    /// Tool pose that the last action requested; for other spaces than `ee_pose` and `ee_delta`, that of the command.
    pub fn requested_pose(&self, command: &[f64], pending: &Pending) -> Pose {
        pending.requested.unwrap_or_else(|| self.robot.tcp_pose(command))
    }

    /// Converts an action to native commands.
    ///
    /// # Errors
    /// If the action has the wrong length, a non-finite value, no valid rotation, or is out of reach.
    pub fn to_native(&self, action: &[f32], from: ArmReference) -> Result<NativeAction, AdapterError> {
        let dof = self.robot.arm_dof();
        let expected = self.spec.length(dof);
        if action.len() != expected {
            return Err(AdapterError::Length { expected, spec: self.spec.to_string(), got: action.len() });
        }
        if let Some((index, &value)) = action.iter().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(AdapterError::NotFinite { index, value });
        }
        let (motion, grip) = action.split_at(expected - 1);
        let motion: Vec<f64> = motion.iter().copied().map(f64::from).collect();
        let width = self.spec.gripper.width_m(grip[0], &self.robot.gripper);
        let reference = self.reference(from);
        let command = |arm: &[f64]| arm.iter().map(|&q| q as f32).chain([width]).collect::<Vec<f32>>();
        let moved = |factor: f64| reference.iter().zip(&motion).map(|(q, v)| q + v * factor).collect::<Vec<f64>>();
        let (world_from_tcp, kept) = match self.spec.space {
            ActionSpace::EePose => (Some(self.decode_pose(&motion)?), from.pending.clone()),
            ActionSpace::EeDelta => {
                let (reference, kept) = self.reference_pose(from);
                (Some(self.spec.frame.apply(&self.decode_pose(&motion)?, &reference)), kept)
            }
            ActionSpace::JointPosition
            | ActionSpace::JointDegrees
            | ActionSpace::JointDelta
            | ActionSpace::JointVelocity => (None, Pending::default()),
        };
        let mut pending = Pending::default();
        let arm = match (self.spec.space, &world_from_tcp) {
            (ActionSpace::JointVelocity, _) => {
                let steps = 1..=self.repeat;
                let commands = steps.map(|step| command(&moved(step as f64 * self.control_period_s))).collect();
                return Ok(NativeAction { commands, pending: Pending::default() });
            }
            (ActionSpace::JointDelta, _) => moved(1.0),
            (ActionSpace::JointDegrees, _) => motion.into_iter().map(f64::to_radians).collect(),
            (_, Some(world_from_tcp)) => {
                let followed;
                (followed, pending) = self.follow_pose(*world_from_tcp, &reference, kept)?;
                followed
            }
            (_, None) => motion,
        };
        let target = command(&arm);
        let step = |step: usize| match self.spec.between {
            Interpolation::Linear if step < self.repeat => {
                let share = step as f64 / self.repeat as f64;
                let in_force = from.command.iter().copied().chain([f64::from(from.width_m)]);
                in_force.zip(&target).map(|(old, &new)| (old + (f64::from(new) - old) * share) as f32).collect()
            }
            // The last command must be bit-identical to the target.
            Interpolation::Linear | Interpolation::Hold => target.clone(),
        };
        Ok(NativeAction { commands: (1..=self.repeat).map(step).collect(), pending })
    }

    /// Arm configuration (rad) to which joint deltas and velocities are added, and from which poses are solved.
    fn reference(&self, from: ArmReference) -> Vec<f64> {
        match (self.spec.space, self.spec.delta_from) {
            // Poses are solved from the command, so that the arm keeps its posture.
            (ActionSpace::JointPosition | ActionSpace::JointDegrees | ActionSpace::EePose, _)
            | (ActionSpace::EeDelta, DeltaFrom::Command) => from.command.to_vec(),
            (ActionSpace::JointDelta | ActionSpace::JointVelocity, DeltaFrom::Command) => {
                let lead = |(q, at): (&f64, &f64)| q.clamp(at - MAX_LEAD_JOINT_RAD, at + MAX_LEAD_JOINT_RAD);
                from.command.iter().zip(from.measured).map(lead).collect()
            }
            (_, DeltaFrom::Measured) => from.measured.to_vec(),
            (_, DeltaFrom::ChunkStart) => from.chunk_start.to_vec(),
        }
    }

    /// Reference pose of a tool delta, and the part of the path that is still followed.
    fn reference_pose(&self, from: ArmReference) -> (Pose, Pending) {
        let joints = match self.spec.delta_from {
            DeltaFrom::Command => from.command,
            // Deltas from a measured pose start anew with each action.
            DeltaFrom::Measured => return (self.robot.tcp_pose(from.measured), Pending::default()),
            DeltaFrom::ChunkStart => return (self.robot.tcp_pose(from.chunk_start), Pending::default()),
        };
        let requested = from.pending.requested.unwrap_or_else(|| self.robot.tcp_pose(joints));
        let measured = self.robot.tcp_pose(from.measured);
        let distance_m = measured.position.distance(requested.position);
        let share = (MAX_LEAD_M / distance_m).min(MAX_LEAD_RAD / measured.angle_to(&requested));
        match share < 1.0 {
            true => (measured.interpolate(&requested, share), Pending::default()),
            false => (requested, from.pending.clone()),
        }
    }

    fn follow_pose(
        &self,
        world_from_tcp: Pose,
        reference: &[f64],
        pending: Pending,
    ) -> Result<(Vec<f64>, Pending), AdapterError> {
        let DVec3 { x: x_m, y: y_m, z: z_m } = world_from_tcp.position;
        let out_of_reach = || AdapterError::OutOfReach { x_m, y_m, z_m };
        let kinematics = self.kinematics.as_ref().ok_or_else(out_of_reach)?;
        let duration_s = self.control_period_s * self.repeat as f64;
        let follower = Follower { robot: &self.robot, kinematics, reach: &self.reach, duration_s };
        follower.follow(world_from_tcp, reference, pending).ok_or_else(out_of_reach)
    }

    fn decode_pose(&self, motion: &[f64]) -> Result<Pose, AdapterError> {
        let (position, numbers) = motion.split_at(3);
        let rotation = self.spec.rotation.decode(numbers).ok_or_else(|| AdapterError::NoRotation {
            encoding: self.spec.rotation.description(),
            numbers: numbers.to_vec(),
        })?;
        Ok(Pose::new(DVec3::from_slice(position), rotation))
    }
}

//! Actions of every space as native commands, and back.
//!
//! This is the only place where actions of another space than the native one are executed; how recorded commands become
//! actions stands beside the contract, in [`ActionSpec::encode`].
//! End-effector motions become joint targets by inverse kinematics that continues from where the motion is counted
//! from; a pose that no configuration reaches is refused, never replaced by another.
//!
//! Changes of the tool are counted from the pose that was asked for, not from where the arm's speeds let the command get:
//! what it missed it makes up for, and is not lost to all actions after.

#[cfg(test)]
mod tests;
mod way;

pub use way::Pending;

use std::sync::Arc;

use genmanip_core::glam::DVec3;
use genmanip_core::{ActionMismatch, ActionSpace, ActionSpec, DeltaFrom, Interpolation, Pose, RobotModel};
use genmanip_motion::{Chain, IkSettings, InverseKinematics, ModelError};
use way::Follower;

/// Reads and writes actions of one contract for one robot.
#[derive(Clone, Debug)]
pub struct Adapter {
    spec: ActionSpec,
    robot: Arc<RobotModel>,
    /// Only for end-effector spaces.
    kinematics: Option<InverseKinematics>,
    /// How far each arm joint can turn while an action lasts, rad.
    reach: Vec<f64>,
    control_period_s: f64,
    /// Control steps that one action lasts.
    repeat: usize,
}

/// An action as native commands.
#[derive(Clone, Debug, PartialEq)]
pub struct NativeAction {
    /// One per control step that the action lasts.
    pub commands: Vec<Vec<f32>>,
    /// What is still to be done, for the action after; only in end-effector spaces.
    pub pending: Pending,
}

/// Where changes are counted from; all in radians, base to hand.
#[derive(Clone, Copy, Debug)]
pub struct ArmReference<'a> {
    /// Arm joint targets of the command in force; the robot's home before the first one.
    pub command: &'a [f64],
    /// Opening of the command in force, metres; the open hand before the first one.
    pub width_m: f32,
    /// Arm joint positions now.
    pub measured: &'a [f64],
    /// Arm joint positions when the chunk was asked for.
    pub chunk_start: &'a [f64],
    /// What the actions before asked for and was not done yet.
    pub pending: &'a Pending,
}

/// Why an action is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum AdapterError {
    /// A contract that cannot be kept.
    #[error(transparent)]
    Contract(#[from] ActionMismatch),
    /// The robot has no kinematics for end-effector motions.
    #[error(transparent)]
    Robot(#[from] ModelError),
    /// An action of another length.
    #[error("expected {expected} numbers ({spec}), got {got}")]
    Length {
        /// Number of numbers.
        expected: usize,
        /// What they mean.
        spec: String,
        /// What was given.
        got: usize,
    },
    /// A number that is none.
    #[error("number {index} of the action is {value}, expected a finite one")]
    NotFinite {
        /// Its index.
        index: usize,
        /// Its value.
        value: f32,
    },
    /// Numbers that are no rotation.
    #[error("expected a rotation as {encoding}, got {numbers:?}")]
    NoRotation {
        /// Name of the encoding.
        encoding: &'static str,
        /// What was given.
        numbers: Vec<f64>,
    },
    /// A pose that no configuration of the arm reaches.
    #[error("no configuration of the arm brings the tcp to x {x_m:.3}, y {y_m:.3}, z {z_m:.3} m in that orientation")]
    OutOfReach {
        /// Along x, metres.
        x_m: f64,
        /// Along y, metres.
        y_m: f64,
        /// Along z, metres.
        z_m: f64,
    },
}

impl Adapter {
    /// For actions of a contract, each of which lasts `repeat` control steps of `control_period_s`.
    ///
    /// # Errors
    /// A contract that contradicts itself, or a robot without kinematics.
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

    /// Control steps that one action lasts.
    pub fn repeat(&self) -> usize {
        self.repeat
    }

    /// The native commands of an action.
    ///
    /// # Errors
    /// An action of the wrong length, with a number that is none, with no rotation, or out of reach.
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
        let moved = |share: f64| reference.iter().zip(&motion).map(|(q, v)| q + v * share).collect::<Vec<f64>>();
        let world_from_tcp = match self.spec.space {
            ActionSpace::EePose => Some(self.decode_pose(&motion)?),
            ActionSpace::EeDelta => {
                Some(self.spec.frame.apply(&self.decode_pose(&motion)?, &self.reference_pose(from)))
            }
            _ => None,
        };
        let mut pending = Pending::default();
        let arm = match (self.spec.space, &world_from_tcp) {
            (ActionSpace::JointVelocity, _) => {
                let steps = 1..=self.repeat;
                let commands = steps.map(|step| command(&moved(step as f64 * self.control_period_s))).collect();
                return Ok(NativeAction { commands, pending: Pending::default() });
            }
            (ActionSpace::JointDelta, _) => moved(1.0),
            (_, Some(world_from_tcp)) => {
                let followed;
                (followed, pending) = self.followed(*world_from_tcp, from)?;
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
            // To the last bit.
            Interpolation::Linear | Interpolation::Hold => target.clone(),
        };
        Ok(NativeAction { commands: (1..=self.repeat).map(step).collect(), pending })
    }

    fn reference<'a>(&self, from: ArmReference<'a>) -> &'a [f64] {
        match (self.spec.space, self.spec.delta_from) {
            // An absolute pose continues from the command, so that the arm does not change its posture on the way.
            (ActionSpace::JointPosition | ActionSpace::EePose, _) | (_, DeltaFrom::Command) => from.command,
            (_, DeltaFrom::Measured) => from.measured,
            (_, DeltaFrom::ChunkStart) => from.chunk_start,
        }
    }

    /// Where a change of the tool is counted from.
    fn reference_pose(&self, from: ArmReference) -> Pose {
        match (self.spec.delta_from, from.pending.asked) {
            (DeltaFrom::Command, Some(asked)) => asked,
            _ => self.robot.tcp_pose(self.reference(from)),
        }
    }

    fn followed(&self, world_from_tcp: Pose, from: ArmReference) -> Result<(Vec<f64>, Pending), AdapterError> {
        let DVec3 { x: x_m, y: y_m, z: z_m } = world_from_tcp.position;
        let out_of_reach = || AdapterError::OutOfReach { x_m, y_m, z_m };
        let kinematics = self.kinematics.as_ref().ok_or_else(out_of_reach)?;
        let duration_s = self.control_period_s * self.repeat as f64;
        let follower = Follower { robot: &self.robot, kinematics, reach: &self.reach, duration_s };
        // A change from what is measured begins anew each time.
        let late = match (self.spec.space, self.spec.delta_from) {
            (ActionSpace::EePose, _) | (_, DeltaFrom::Command) => from.pending.clone(),
            _ => Pending::default(),
        };
        follower.follow(world_from_tcp, self.reference(from), late).ok_or_else(out_of_reach)
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

//! Encodes native commands as actions of a contract, for recorded demonstrations.
//!
//! Decoding needs inverse kinematics and lives in `rollout::adapter`.

use crate::{ActionFrame, ActionSpace, ActionSpec, Pose, RobotModel};

impl ActionSpec {
    /// The action that takes the arm from the joint positions `reference` (rad, base to end effector) to the native
    /// `command` (arm joint targets, then opening width) within `duration_s`. Absolute spaces ignore the reference.
    ///
    /// Lossy for encodings that hold less than the command, e.g. a gripper with a threshold.
    pub fn encode(&self, robot: &RobotModel, command: &[f32], reference: &[f64], duration_s: f64) -> Vec<f32> {
        let (arm, width) = command.split_at(command.len().saturating_sub(1));
        let arm: Vec<f64> = arm.iter().copied().map(f64::from).collect();
        let moved = |divisor: f64| arm.iter().zip(reference).map(|(to, from)| (to - from) / divisor).collect();
        let motion: Vec<f64> = match self.space {
            ActionSpace::JointPosition => arm,
            ActionSpace::JointDegrees => arm.into_iter().map(f64::to_degrees).collect(),
            ActionSpace::JointDelta => moved(1.0),
            ActionSpace::JointVelocity => moved(duration_s),
            ActionSpace::EePose => self.encode_pose(&robot.tcp_pose(&arm)),
            ActionSpace::EeDelta => {
                self.encode_pose(&self.frame.change(&robot.tcp_pose(reference), &robot.tcp_pose(&arm)))
            }
        };
        let width = width.first().copied().unwrap_or_default();
        motion.into_iter().map(|value| value as f32).chain([self.gripper.number(width, &robot.gripper)]).collect()
    }

    /// Names of the vector's entries, for an arm with these joints.
    pub fn names(&self, joints: &[&str]) -> Vec<String> {
        let prefix = match self.space {
            ActionSpace::JointDegrees => {
                return joints.iter().chain(&["gripper"]).map(|name| format!("{name}.pos")).collect();
            }
            ActionSpace::JointPosition | ActionSpace::EePose => "",
            ActionSpace::JointDelta | ActionSpace::EeDelta => "delta_",
            ActionSpace::JointVelocity => "velocity_",
        };
        let motion: Vec<&str> = match self.space.is_joint() {
            true => joints.to_vec(),
            false => ["x", "y", "z"].iter().chain(self.rotation.names()).copied().collect(),
        };
        let gripper = match self.gripper.encoding {
            crate::GripperEncoding::WidthM => "gripper_width",
            _ => "gripper",
        };
        motion.into_iter().map(|name| format!("{prefix}{name}")).chain([gripper.to_owned()]).collect()
    }

    /// Measured arm joint positions (rad) and opening width (m), in the units of the actions where these are
    /// [`ActionSpace::JointDegrees`], and unchanged for all other spaces.
    pub fn encode_state(&self, arm: &[f64], width_m: f64, robot: &RobotModel) -> Vec<f32> {
        let native = || arm.iter().chain([&width_m]).map(|value| *value as f32).collect::<Vec<f32>>();
        if self.space == ActionSpace::JointDegrees { self.encode(robot, &native(), arm, 1.0) } else { native() }
    }

    /// Arm joint positions (rad) and opening width (m) of a state from [`Self::encode_state`].
    pub fn decode_state(&self, state: &[f64], robot: &RobotModel) -> (Vec<f64>, f64) {
        let (arm, width) = state.split_at(state.len().saturating_sub(1));
        let width = width.first().copied().unwrap_or_default();
        match self.space {
            ActionSpace::JointDegrees => (
                arm.iter().map(|degrees| degrees.to_radians()).collect(),
                f64::from(self.gripper.width_m(width as f32, &robot.gripper)),
            ),
            _ => (arm.to_vec(), width),
        }
    }

    /// Names of the entries of [`Self::encode_state`].
    pub fn state_names(&self, joints: &[&str]) -> Vec<String> {
        match self.space {
            ActionSpace::JointDegrees => self.names(joints),
            _ => ActionSpec::native().names(joints),
        }
    }

    fn encode_pose(&self, pose: &Pose) -> Vec<f64> {
        let mut numbers = pose.position.to_array().to_vec();
        numbers.extend(self.rotation.encode(pose.rotation));
        numbers
    }
}

impl ActionFrame {
    /// Applies a TCP displacement expressed along these axes.
    pub fn apply(self, change: &Pose, world_from_tcp: &Pose) -> Pose {
        match self {
            Self::EndEffector => *world_from_tcp * *change,
            Self::World => {
                Pose::new(world_from_tcp.position + change.position, change.rotation * world_from_tcp.rotation)
            }
        }
    }

    /// TCP displacement between two poses, expressed along these axes.
    pub fn change(self, world_from_old: &Pose, world_from_new: &Pose) -> Pose {
        match self {
            Self::EndEffector => world_from_old.inverse() * *world_from_new,
            Self::World => Pose::new(
                world_from_new.position - world_from_old.position,
                world_from_new.rotation * world_from_old.rotation.inverse(),
            ),
        }
    }
}

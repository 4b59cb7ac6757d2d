//! Compiled kinematic chain of a robot arm: one moving frame per joint with its axis along z.

use genmanip_core::{JointKind, Pose, RobotModel};
use glam::{DMat3, DQuat, DVec3};

use crate::rigid::Rigid;

/// Robot model that cannot be compiled into a [`Chain`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A parent link comes after its child or does not exist.
    #[error("link {link} of robot {robot}: parent index {got} is not before the link itself (index {index})")]
    ParentOrder {
        /// Name of the robot.
        robot: String,
        /// Name of the link.
        link: String,
        /// Index of the link in [`RobotModel::links`].
        index: usize,
        /// Index of its parent, at least `index`.
        got: usize,
    },
    /// The home configuration does not have one value per arm joint.
    #[error("robot {robot}: home holds {got} positions, expected one for each of its {expected} arm joints")]
    HomeLength {
        /// Name of the robot.
        robot: String,
        /// Number of arm joints.
        expected: usize,
        /// Length of [`RobotModel::home`].
        got: usize,
    },
    /// A limit, axis or frame is not finite, empty, or has zero length.
    #[error("robot {robot}, joint {joint}: {what}")]
    BadJoint {
        /// Name of the robot.
        robot: String,
        /// Name of the joint.
        joint: String,
        /// Description of the problem.
        what: String,
    },
    /// The index of the hand or a finger is out of range.
    #[error("robot {robot}: {what} is link {got}, but there are {expected} links")]
    NoSuchLink {
        /// Name of the robot.
        robot: String,
        /// Link that the index should name: `hand` or `finger`.
        what: &'static str,
        /// Number of links.
        expected: usize,
        /// The index out of range.
        got: usize,
    },
}

/// Forward kinematics of a robot arm.
///
/// Frame 0 is the base (= world); frame `k + 1` moves with joint `k`, z along the joint axis. Without coupled joints,
/// joint `k` is degree of freedom `k`. Fixed links are merged into the frame that carries them.
#[derive(Clone, Debug)]
pub struct Chain {
    /// Every moving frame, parents first.
    moving: Vec<ChainJoint>,
    /// The degrees of freedom (joints that are not coupled to another one), in the order of a configuration.
    joints: Vec<ChainJoint>,
    tcp_frame: usize,
    frame_from_tcp: Rigid,
    /// Number of degrees of freedom that move the TCP.
    tool_dof: usize,
    links: Vec<LinkMount>,
}

#[derive(Clone, Debug)]
pub(crate) struct ChainJoint {
    pub(crate) parent_frame: usize,
    pub(crate) parent_from_joint: Rigid,
    pub(crate) is_prismatic: bool,
    pub(crate) lower: f64,
    pub(crate) upper: f64,
    /// True without position limits: positions a full turn apart are the same posture.
    pub(crate) continuous: bool,
    /// Index of the degree of freedom that sets the position, see [`ChainJoint::position`].
    pub(crate) driver: usize,
    /// Multiplier and offset of a coupled joint; `None` if the joint is a degree of freedom itself.
    pub(crate) coupling: Option<[f64; 2]>,
}

impl ChainJoint {
    /// Position of the joint at a configuration [rad or m].
    pub(crate) fn position(&self, config: &[f64]) -> f64 {
        let q = config[self.driver];
        self.coupling.map_or(q, |[multiplier, offset]| q * multiplier + offset)
    }

    /// Joint motion per unit motion of its degree of freedom, absolute.
    pub(crate) fn ratio(&self) -> f64 {
        self.coupling.map_or(1.0, |[multiplier, _]| multiplier.abs())
    }

    /// Range to sample positions from: the limits, or one turn of a continuous joint.
    pub(crate) fn sampled(&self) -> std::ops::RangeInclusive<f64> {
        if self.continuous { -std::f64::consts::PI..=std::f64::consts::PI } else { self.lower..=self.upper }
    }

    /// Margin to the joint limits: `largest`, but at most a twentieth of the range, so that short prismatic joints keep
    /// most of theirs.
    pub(crate) fn margin(&self, largest: f64) -> f64 {
        largest.min(0.05 * (self.upper - self.lower))
    }
}

/// Mount of a link: its moving frame, its pose in that frame with a closed gripper, and its displacement per opening
/// width (0 except for fingers).
#[derive(Clone, Debug)]
struct LinkMount {
    frame: usize,
    frame_from_link: Rigid,
    per_width: DVec3,
}

impl Chain {
    /// Compiles the arm of `robot`.
    pub fn new(robot: &RobotModel) -> Result<Self, ModelError> {
        check_indices(robot)?;
        let mut moving: Vec<ChainJoint> = Vec::new();
        let drivers: Vec<usize> = robot.arm_links().collect();
        let mut links: Vec<LinkMount> = Vec::with_capacity(robot.links.len());
        for (index, link) in robot.links.iter().enumerate() {
            let base = LinkMount { frame: 0, frame_from_link: Rigid::IDENTITY, per_width: DVec3::ZERO };
            let parent = link.parent.and_then(|parent| links.get(parent)).cloned().unwrap_or(base);
            let frame_from_link = parent.frame_from_link * Rigid::from(&link.parent_from_link);
            links.push(match &link.joint {
                None => LinkMount { frame_from_link, ..parent },
                Some(joint) if robot.gripper.fingers.contains(&index) => {
                    LinkMount { frame_from_link, per_width: frame_from_link.rotation * joint.axis * 0.5, ..parent }
                }
                Some(joint) => {
                    check_joint(robot, joint)?;
                    let driving = joint.mimic.map_or(index, |mimic| mimic.link);
                    let Some(driver) = drivers.iter().position(|link| *link == driving) else {
                        let what = format!("follows link {driving}, which no joint of its own moves");
                        return Err(ModelError::BadJoint {
                            robot: robot.name.clone(),
                            joint: joint.name.clone(),
                            what,
                        });
                    };
                    let link_from_joint = Rigid {
                        rotation: DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, joint.axis.normalize())),
                        translation: DVec3::ZERO,
                    };
                    moving.push(ChainJoint {
                        parent_frame: parent.frame,
                        parent_from_joint: frame_from_link * link_from_joint,
                        is_prismatic: joint.kind == JointKind::Prismatic,
                        lower: joint.lower,
                        upper: joint.upper,
                        continuous: joint.continuous,
                        driver,
                        coupling: joint.mimic.map(|mimic| [mimic.multiplier, mimic.offset]),
                    });
                    LinkMount {
                        frame: moving.len(),
                        frame_from_link: link_from_joint.inverse(),
                        per_width: DVec3::ZERO,
                    }
                }
            });
        }
        let joints: Vec<ChainJoint> = moving.iter().filter(|joint| joint.coupling.is_none()).cloned().collect();
        if robot.home.len() != joints.len() {
            let (expected, got) = (joints.len(), robot.home.len());
            return Err(ModelError::HomeLength { robot: robot.name.clone(), expected, got });
        }
        let hand = &links[robot.hand];
        let (tcp_frame, frame_from_tcp) = (hand.frame, hand.frame_from_link * Rigid::from(&robot.hand_from_tcp));
        let above = std::iter::successors(Some(tcp_frame), |frame| Some(moving[frame.checked_sub(1)?].parent_frame));
        let mut movers: Vec<usize> = above.filter(|frame| *frame > 0).map(|frame| moving[frame - 1].driver).collect();
        movers.sort_unstable();
        movers.dedup();
        Ok(Self { tool_dof: movers.len(), moving, joints, tcp_frame, frame_from_tcp, links })
    }

    /// Number of arm joints that are degrees of freedom: the length of a configuration.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Number of degrees of freedom that move the TCP.
    pub fn tool_dof(&self) -> usize {
        self.tool_dof
    }

    /// Lower limit of each joint [rad or m].
    pub fn lower(&self) -> impl Iterator<Item = f64> {
        self.joints.iter().map(|joint| joint.lower)
    }

    /// Upper limit of each joint [rad or m].
    pub fn upper(&self) -> impl Iterator<Item = f64> {
        self.joints.iter().map(|joint| joint.upper)
    }

    /// Minimum distance of a configuration to a joint limit [rad or m]; negative outside.
    pub fn limit_margin(&self, config: &[f64]) -> f64 {
        let margins = self.joints.iter().zip(config).map(|(joint, q)| (q - joint.lower).min(joint.upper - q));
        margins.fold(f64::INFINITY, f64::min)
    }

    /// `world_from_tcp` at a configuration.
    pub fn tcp_pose(&self, config: &[f64]) -> Pose {
        self.tcp(&self.frames(config)).pose()
    }

    /// Columns of the geometric TCP Jacobian: linear velocity [m/s], then angular [rad/s], world axes, per unit joint
    /// velocity.
    pub fn jacobian(&self, config: &[f64]) -> Vec<[f64; 6]> {
        self.jacobian_at(&self.frames(config))
    }

    /// Yoshikawa's manipulability √det(J·Jᵀ); 0 at a singularity.
    pub fn manipulability(&self, config: &[f64]) -> f64 {
        let jacobian = self.jacobian(config);
        let mut gram = [[0.0; 6]; 6];
        for column in &jacobian {
            for (row, a) in gram.iter_mut().zip(column) {
                for (cell, b) in row.iter_mut().zip(column) {
                    *cell += a * b;
                }
            }
        }
        crate::linear::determinant(gram).max(0.0).sqrt()
    }

    /// The degrees of freedom, in the order of a configuration.
    pub(crate) fn joints(&self) -> &[ChainJoint] {
        &self.joints
    }

    /// The joint of every moving frame, coupled ones included.
    pub(crate) fn moving(&self) -> &[ChainJoint] {
        &self.moving
    }

    /// Moving frame of the TCP, and `frame_from_tcp`.
    pub(crate) fn tcp_mount(&self) -> (usize, Rigid) {
        (self.tcp_frame, self.frame_from_tcp)
    }

    /// Moving frame of a link, and `frame_from_link` at an opening width.
    pub(crate) fn link_mount(&self, link: usize, gripper_width: f64) -> (usize, Rigid) {
        let place = &self.links[link];
        let translation = place.frame_from_link.translation + place.per_width * gripper_width;
        (place.frame, Rigid { translation, ..place.frame_from_link })
    }

    /// `world_from_frame` for every frame.
    pub(crate) fn frames(&self, config: &[f64]) -> Vec<Rigid> {
        let mut frames = Vec::with_capacity(self.moving.len() + 1);
        self.frames_into(config, &mut frames);
        frames
    }

    pub(crate) fn frames_into(&self, config: &[f64], frames: &mut Vec<Rigid>) {
        frames.clear();
        frames.push(Rigid::IDENTITY);
        for joint in &self.moving {
            let q = joint.position(config);
            let rest = frames[joint.parent_frame] * joint.parent_from_joint;
            frames.push(if joint.is_prismatic {
                Rigid { translation: rest.translation + rest.rotation.z_axis * q, ..rest }
            } else {
                let (sin, cos) = q.sin_cos();
                rest.rotated_z(sin, cos)
            });
        }
    }

    pub(crate) fn tcp(&self, frames: &[Rigid]) -> Rigid {
        frames[self.tcp_frame] * self.frame_from_tcp
    }

    pub(crate) fn jacobian_at(&self, frames: &[Rigid]) -> Vec<[f64; 6]> {
        let tip = self.tcp(frames).translation;
        let mut moves_tcp = vec![false; frames.len()];
        let mut frame = self.tcp_frame;
        while frame > 0 {
            moves_tcp[frame] = true;
            frame = self.moving[frame - 1].parent_frame;
        }
        let mut columns = vec![[0.0; 6]; self.joints.len()];
        for (index, joint) in self.moving.iter().enumerate().filter(|(index, _)| moves_tcp[index + 1]) {
            let axis = frames[index + 1].rotation.z_axis;
            let (linear, angular) = if joint.is_prismatic {
                (axis, DVec3::ZERO)
            } else {
                (axis.cross(tip - frames[index + 1].translation), axis)
            };
            let column = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
            let ratio = joint.coupling.map_or(1.0, |[multiplier, _]| multiplier);
            for (sum, part) in columns[joint.driver].iter_mut().zip(column) {
                *sum += part * ratio;
            }
        }
        columns
    }
}

fn check_indices(robot: &RobotModel) -> Result<(), ModelError> {
    let count = robot.links.len();
    let named = [("hand", robot.hand), ("finger", robot.gripper.fingers[0]), ("finger", robot.gripper.fingers[1])];
    if let Some((what, got)) = named.into_iter().find(|(_, index)| *index >= count) {
        return Err(ModelError::NoSuchLink { robot: robot.name.clone(), what, expected: count, got });
    }
    for (index, link) in robot.links.iter().enumerate() {
        if let Some(got) = link.parent.filter(|parent| *parent >= index) {
            let (robot, link) = (robot.name.clone(), link.name.clone());
            return Err(ModelError::ParentOrder { robot, link, index, got });
        }
    }
    Ok(())
}

fn check_joint(robot: &RobotModel, joint: &genmanip_core::RobotJoint) -> Result<(), ModelError> {
    let bad = |what: String| Err(ModelError::BadJoint { robot: robot.name.clone(), joint: joint.name.clone(), what });
    if !(joint.axis.is_finite() && joint.axis.length() > 1e-9) {
        return bad(format!("axis {} has no direction", joint.axis));
    }
    if !(joint.lower.is_finite() && joint.upper.is_finite() && joint.lower <= joint.upper) {
        return bad(format!("limits {}..{} are not an interval", joint.lower, joint.upper));
    }
    if !(joint.max_velocity > 0.0 && joint.max_acceleration > 0.0) {
        return bad("velocity and acceleration limits must be positive".into());
    }
    Ok(())
}

//! Robots: a serial arm with a parallel gripper.

use glam::DVec3;

use crate::{JointKind, MassProperties, Piece, Pose, VisualPart};

/// An arm with a two-finger gripper, as the simulator, the planner and the renderer need it.
///
/// Links are listed parents first; link 0 is the base, fixed at the world's origin.
/// The arm's joints come first in `joints()` order, the two finger joints last.
#[derive(Clone, Debug)]
pub struct RobotModel {
    /// Name, e.g. `panda`.
    pub name: String,
    /// Bodies, parents first.
    pub links: Vec<RobotLink>,
    /// Index of the hand's link, to which the `wrist` camera is mounted.
    pub hand: usize,
    /// The tool frame: midpoint between the pads, axes of the hand (z = approach, y = closing).
    pub hand_from_tcp: Pose,
    /// The gripper.
    pub gripper: Gripper,
    /// Arm joint positions at the start of an episode.
    pub home: Vec<f64>,
    /// Pairs of links that are never tested against each other (neighbours and pairs that cannot meet).
    pub never_colliding: Vec<(usize, usize)>,
}

/// One body of the robot.
#[derive(Clone, Debug)]
pub struct RobotLink {
    /// Name, e.g. `link4`.
    pub name: String,
    /// Index of the parent link; `None` for the base.
    pub parent: Option<usize>,
    /// Where the link's frame sits in the parent's frame at joint position 0.
    pub parent_from_link: Pose,
    /// The joint between the parent and this link; `None` when it is rigidly attached.
    pub joint: Option<RobotJoint>,
    /// Surfaces to draw.
    pub visual: Vec<VisualPart>,
    /// Exact convex collision bodies.
    pub pieces: Vec<Piece>,
    /// Mass, centre and inertia.
    pub mass: MassProperties,
}

/// A joint with the limits its maker publishes.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotJoint {
    /// Name, e.g. `joint4`.
    pub name: String,
    /// Turning or sliding.
    pub kind: JointKind,
    /// Unit axis in the link's frame.
    pub axis: DVec3,
    /// Smallest position, rad or m.
    pub lower: f64,
    /// Largest position, rad or m.
    pub upper: f64,
    /// Largest speed, rad/s or m/s.
    pub max_velocity: f64,
    /// Largest acceleration, rad/s² or m/s².
    pub max_acceleration: f64,
    /// Largest jerk, rad/s³ or m/s³.
    pub max_jerk: f64,
    /// Largest torque or force, N·m or N.
    pub max_effort: f64,
}

/// A parallel gripper: two mirrored fingers.
#[derive(Clone, Debug, PartialEq)]
pub struct Gripper {
    /// Links of the two fingers; the first moves along +y of the hand, the second along -y.
    pub fingers: [usize; 2],
    /// Largest opening between the pads.
    pub max_width: f64,
    /// Largest grip force (sum over the fingers as the maker publishes it).
    pub max_force: f64,
    /// Size of a pad: along the closing direction, across, along the finger.
    pub pad_size: DVec3,
}

impl RobotModel {
    /// Number of arm joints (the fingers do not count).
    pub fn arm_dof(&self) -> usize {
        self.home.len()
    }

    /// The arm's joints, base to hand.
    pub fn arm_joints(&self) -> impl Iterator<Item = &RobotJoint> {
        self.links
            .iter()
            .enumerate()
            .filter(|(index, _)| !self.gripper.fingers.contains(index))
            .filter_map(|(_, link)| link.joint.as_ref())
    }

    /// `world_from_link` for every link, for arm joint positions and an opening width between the pads.
    pub fn link_poses(&self, arm: &[f64], gripper_width: f64) -> Vec<Pose> {
        let mut poses: Vec<Pose> = Vec::with_capacity(self.links.len());
        let mut arm = arm.iter().copied();
        for (index, link) in self.links.iter().enumerate() {
            let parent = link.parent.and_then(|parent| poses.get(parent)).copied().unwrap_or_default();
            let motion = match &link.joint {
                None => Pose::IDENTITY,
                Some(joint) => {
                    let position = if self.gripper.fingers.contains(&index) {
                        gripper_width / 2.0
                    } else {
                        arm.next().unwrap_or(0.0)
                    };
                    match joint.kind {
                        JointKind::Revolute => {
                            Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_axis_angle(joint.axis, position) }
                        }
                        JointKind::Prismatic => Pose::from_position(joint.axis * position),
                    }
                }
            };
            poses.push(parent * link.parent_from_link * motion);
        }
        poses
    }

    /// `world_from_tcp` for arm joint positions.
    pub fn tcp_pose(&self, arm: &[f64]) -> Pose {
        self.link_poses(arm, 0.0).get(self.hand).copied().unwrap_or_default() * self.hand_from_tcp
    }
}

//! Gripper geometry in the TCP frame.

use genmanip_core::{Aabb, Grasp, RobotModel};
use glam::DVec3;

use crate::collision::RobotShape;
use crate::collision::convex::Convex;
use crate::rigid::Rigid;

/// A parallel gripper for grasp sampling: exact pieces of hand and fingers, and the pads.
#[derive(Clone, Debug)]
pub struct Gripper {
    /// Pad size along the closing direction, across, and along the finger (m).
    pub pad_size: DVec3,
    /// Maximum opening between the pads (m).
    pub max_width: f64,
    /// Extent of the fingers beyond the TCP along the approach direction (m).
    pub tip: f64,
    /// Distance of the palm behind the TCP (m).
    pub palm: f64,
    /// Extent of a finger outwards from its pad face (m).
    pub finger_reach: f64,
    pub(crate) hand: Vec<Convex>,
    /// Bounds of the hand, TCP frame.
    pub(crate) hand_bounds: Aabb,
    pub(crate) tcp_from_hand: Rigid,
    /// Pieces of each finger, its pose with the gripper closed, and its motion per metre of opening.
    pub(crate) fingers: [Finger; 2],
}

#[derive(Clone, Debug)]
pub(crate) struct Finger {
    pub(crate) pieces: Vec<Convex>,
    closed: Rigid,
    per_width: DVec3,
}

impl Gripper {
    /// Geometry of a robot's gripper, from its compiled collision pieces.
    pub(crate) fn of(robot: &RobotModel, shape: &RobotShape) -> Self {
        let (_, frame_from_tcp) = shape.chain.tcp_mount();
        let tcp_from_link = |link: usize, width: f64| frame_from_tcp.inverse() * shape.chain.link_mount(link, width).1;
        let finger = |link: usize| {
            let (closed, open) = (tcp_from_link(link, 0.0), tcp_from_link(link, 1.0));
            let pieces = shape.links[link].pieces.clone();
            Finger { pieces, per_width: open.translation - closed.translation, closed }
        };
        let fingers = robot.gripper.fingers.map(finger);
        let hand = shape.links[robot.hand].pieces.clone();
        let tcp_from_hand = tcp_from_link(robot.hand, 0.0);
        let highest = |pieces: &[Convex], tcp_from_link: &Rigid| {
            let direction = tcp_from_link.rotation.transpose() * DVec3::Z;
            let along = pieces.iter().map(|piece| tcp_from_link.point(piece.support(direction)).z);
            along.fold(f64::NEG_INFINITY, f64::max)
        };
        let tip =
            fingers.iter().map(|finger| highest(&finger.pieces, &finger.closed)).fold(f64::NEG_INFINITY, f64::max);
        let palm = -highest(&hand, &tcp_from_hand);
        let mut hand_bounds = Aabb::EMPTY;
        for direction in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| [axis, -axis]) {
            let local = tcp_from_hand.rotation.transpose() * direction;
            for piece in &hand {
                hand_bounds = hand_bounds.including(tcp_from_hand.point(piece.support(local)));
            }
        }
        let half_pad = robot.gripper.pad_size.z / 2.0;
        let reach = |finger: &Finger, direction: DVec3| {
            let local = finger.closed.rotation.transpose() * direction;
            let along = finger.pieces.iter().map(|piece| finger.closed.point(piece.support(local)).dot(direction));
            along.fold(robot.gripper.pad_size.x, f64::max)
        };
        let finger_reach = reach(&fingers[0], DVec3::Y).max(reach(&fingers[1], DVec3::NEG_Y));
        Self {
            pad_size: robot.gripper.pad_size,
            max_width: robot.gripper.max_width,
            tip: if tip.is_finite() { tip } else { half_pad },
            palm: if palm.is_finite() { palm } else { half_pad },
            finger_reach,
            hand,
            hand_bounds,
            tcp_from_hand,
            fingers,
        }
    }

    /// Gripper opening for the approach (m): grasp width plus `clearance` on either side, at most
    /// [`Gripper::max_width`].
    pub fn opening_for(&self, grasp: &Grasp, clearance: f64) -> f64 {
        (grasp.width + 2.0 * clearance).min(self.max_width)
    }
}

impl Finger {
    /// `tcp_from_finger` at an opening width.
    pub(crate) fn place(&self, width: f64) -> Rigid {
        Rigid { translation: self.closed.translation + self.per_width * width, ..self.closed }
    }
}

//! Grasps of a parallel gripper.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Pose;

/// A way to close a parallel gripper on something.
///
/// The pose is that of the *tcp* (midpoint between the pads; z = approach, y = closing direction)
/// in the frame the producer documents: the object's, or the world's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Grasp {
    /// Pose of the tcp.
    pub pose: Pose,
    /// Distance between the two contacts.
    pub width: f64,
    /// Quality, larger is better, 0-1.
    pub score: f64,
}

impl Grasp {
    /// Direction in which the hand moves towards the object.
    pub fn approach(&self) -> DVec3 {
        self.pose.transform_vector(DVec3::Z)
    }

    /// The same contacts with the hand turned half around its approach axis.
    #[must_use]
    pub fn flipped(&self) -> Self {
        let turn = Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_rotation_z(std::f64::consts::PI) };
        Self { pose: self.pose * turn, ..self.clone() }
    }
}

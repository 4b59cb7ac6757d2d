//! Grasps of a parallel gripper.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Pose;

/// A grasp pose and opening width of a parallel gripper.
///
/// The pose is that of the TCP (midpoint between the pads; z = approach, y = closing direction) in the frame that the
/// producer documents: the object's or the world's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Grasp {
    /// Pose of the TCP.
    pub pose: Pose,
    /// Distance between the two contacts, m.
    pub width: f64,
    /// Quality, larger is better, 0-1.
    pub score: f64,
}

impl Grasp {
    /// Approach direction, towards the object.
    pub fn approach(&self) -> DVec3 {
        self.pose.transform_vector(DVec3::Z)
    }

    /// The same contacts with the gripper rotated by π about the approach axis.
    #[must_use]
    pub fn flipped(&self) -> Self {
        let turn = Pose { position: DVec3::ZERO, rotation: glam::DQuat::from_rotation_z(std::f64::consts::PI) };
        Self { pose: self.pose * turn, ..self.clone() }
    }
}

/// A grasp with the results of its physics trials.
#[derive(Clone, Debug, PartialEq)]
pub struct VerifiedGrasp {
    /// The grasp, in the object's frame.
    pub grasp: Grasp,
    /// Number of physics trials.
    pub trials: u32,
    /// Number of trials in which the gripper held the object.
    pub held: u32,
}

impl VerifiedGrasp {
    /// Success rate over the trials, 0-1.
    pub fn share(&self) -> f64 {
        f64::from(self.held) / f64::from(self.trials.max(1))
    }
}

/// A grasp in the GraspNet convention, in the frame of its pose.
///
/// A GraspNet row is `[score, width, height, depth, R (9, row-major), t (3), object id]`.
/// The columns of R are the approach, closing and height directions, `R = [z, y, -x]` in our TCP axes; the origin lies
/// `depth` behind the fingertips, where our TCP is: `tcp = t + depth · approach`.
///
/// ```
/// use genmanip_core::grasp::GraspNetGrasp;
/// let mut row = [0.0; 17];
/// (row[0], row[1], row[2], row[3], row[16]) = (0.8, 0.05, 0.02, 0.03, 7.0);
/// (row[4], row[8], row[12]) = (1.0, 1.0, 1.0);
/// let grasp = GraspNetGrasp::from_graspnet(&row)?;
/// assert!(grasp.to_graspnet().iter().zip(&row).all(|(back, number)| (back - number).abs() < 1e-15));
/// assert!((grasp.grasp.pose.position.x - 0.03).abs() < 1e-15, "the tips are ahead of the origin");
/// # Ok::<(), genmanip_core::grasp::GraspNetError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct GraspNetGrasp {
    /// Pose of the TCP, contact distance and score.
    pub grasp: Grasp,
    /// Finger extent across the closing and approach directions, m.
    pub height_m: f64,
    /// Distance from the origin of the row's pose to the fingertips, m.
    pub depth_m: f64,
    /// Object id; -1 if unknown.
    pub object_id: i64,
}

/// Reason why a GraspNet row is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GraspNetError {
    /// A number is NaN or infinite.
    #[error("number {index} of a GraspNet row is not finite")]
    NotFinite {
        /// Index of the number in the row.
        index: usize,
    },
    /// The rotation is not orthonormal.
    #[error("numbers 4-12 of a GraspNet row are not a rotation matrix: deviation {deviation:.1e}, expected ≤ 1e-4")]
    NoRotation {
        /// Largest absolute deviation of RᵀR or of the determinant from identity.
        deviation: f64,
    },
    /// The object id is not a whole number.
    #[error("the object id of a GraspNet row must be a whole number, got {got}")]
    ObjectId {
        /// Value at index 16 of the row.
        got: f64,
    },
}

impl GraspNetGrasp {
    /// Grasp from a 17-number row; the pose is in the row's frame (the camera frame for the original service).
    ///
    /// # Errors
    /// For non-finite numbers, a matrix that is not a rotation, or an invalid object id.
    pub fn from_graspnet(row: &[f64; 17]) -> Result<Self, GraspNetError> {
        if let Some(index) = row.iter().position(|value| !value.is_finite()) {
            return Err(GraspNetError::NotFinite { index });
        }
        let column = |index: usize| DVec3::new(row[4 + index], row[7 + index], row[10 + index]);
        let [approach, closing, height] = [0, 1, 2].map(column);
        let products = [
            approach.dot(closing),
            closing.dot(height),
            height.dot(approach),
            approach.length_squared() - 1.0,
            closing.length_squared() - 1.0,
            height.length_squared() - 1.0,
            approach.cross(closing).dot(height) - 1.0,
        ];
        let deviation = products.iter().fold(0.0, |largest: f64, product| largest.max(product.abs()));
        if deviation > 1e-4 {
            return Err(GraspNetError::NoRotation { deviation });
        }
        if row[16].fract() != 0.0 || row[16].abs() > 9e15 {
            return Err(GraspNetError::ObjectId { got: row[16] });
        }
        let [score, width, height_m, depth_m] = [row[0], row[1], row[2], row[3]];
        let tips = DVec3::new(row[13], row[14], row[15]) + approach * depth_m;
        let pose = Pose::from_axes(tips, -height, closing, approach);
        Ok(Self { grasp: Grasp { pose, width, score }, height_m, depth_m, object_id: row[16] as i64 })
    }

    /// The 17-number row; inverse of [`from_graspnet`](Self::from_graspnet) up to rounding.
    pub fn to_graspnet(&self) -> [f64; 17] {
        let pose = &self.grasp.pose;
        let axis = |axis: DVec3| pose.transform_vector(axis);
        let (approach, closing, height) = (axis(DVec3::Z), axis(DVec3::Y), -axis(DVec3::X));
        let origin = pose.position - approach * self.depth_m;
        let mut row = [0.0; 17];
        row[..4].copy_from_slice(&[self.grasp.score, self.grasp.width, self.height_m, self.depth_m]);
        for (index, (a, (c, h))) in
            approach.to_array().into_iter().zip(closing.to_array().into_iter().zip(height.to_array())).enumerate()
        {
            row[4 + 3 * index..7 + 3 * index].copy_from_slice(&[a, c, h]);
        }
        row[13..16].copy_from_slice(&origin.to_array());
        row[16] = self.object_id as f64;
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A row with an arbitrary rotation, rounded to 32-bit floats if `single` is set.
    fn row(axis: [f64; 3], angle: f64, numbers: [f64; 7], object: i32, single: bool) -> [f64; 17] {
        let axis = DVec3::from_array(axis).try_normalize().unwrap_or(DVec3::Z);
        let rotation = glam::DMat3::from_axis_angle(axis, angle).transpose().to_cols_array();
        let mut row = [0.0; 17];
        row[..4].copy_from_slice(&numbers[..4]);
        row[4..13].copy_from_slice(&rotation);
        row[13..16].copy_from_slice(&numbers[4..]);
        row[16] = f64::from(object);
        if single { row.map(|value| f64::from(value as f32)) } else { row }
    }

    proptest! {
        #[test]
        fn rows_round_trip(
            axis in prop::array::uniform3(-1.0..1.0), angle in -3.2..3.2, numbers in prop::array::uniform7(-1.0..1.0),
            object in -1..100_000_i32, single in any::<bool>(),
        ) {
            let row = row(axis, angle, numbers, object, single);
            let grasp = GraspNetGrasp::from_graspnet(&row).unwrap();
            let tolerance = if single { 1e-6 } else { 1e-12 };
            for (got, expected) in grasp.to_graspnet().into_iter().zip(row) {
                prop_assert!((got - expected).abs() < tolerance, "{got} {expected}");
            }
            let again = GraspNetGrasp::from_graspnet(&grasp.to_graspnet()).unwrap();
            prop_assert!(again.grasp.pose.position.distance(grasp.grasp.pose.position) < 1e-12);
            prop_assert!(again.grasp.pose.angle_to(&grasp.grasp.pose) < 1e-6);
            prop_assert_eq!(again.object_id, i64::from(object));
            // Approach is the first column, closing the second, whatever the rotation.
            let approach = DVec3::new(row[4], row[7], row[10]);
            prop_assert!(grasp.grasp.approach().distance(approach) < 1e-6);
        }
    }

    #[test]
    fn broken_rows_are_refused() {
        let good = row([0.0, 0.0, 1.0], 0.3, [0.5, 0.05, 0.02, 0.03, 0.1, 0.2, 0.3], 4, false);
        let with = |index: usize, value: f64| {
            let mut row = good;
            row[index] = value;
            GraspNetGrasp::from_graspnet(&row).unwrap_err()
        };
        assert_eq!(with(14, f64::NAN), GraspNetError::NotFinite { index: 14 });
        assert!(matches!(with(4, 0.5), GraspNetError::NoRotation { .. }));
        assert_eq!(with(16, 1.5), GraspNetError::ObjectId { got: 1.5 });
        let mut mirrored = good;
        for index in [6, 9, 12] {
            mirrored[index] = -mirrored[index];
        }
        assert!(matches!(GraspNetGrasp::from_graspnet(&mirrored), Err(GraspNetError::NoRotation { .. })));
    }
}

//! Rotation encodings of action vectors.

use glam::{DMat3, DQuat, DVec3, EulerRot};

use crate::{Pose, RotationEncoding};

/// Length below which a vector counts as having no direction.
const MIN_LENGTH: f64 = 1e-6;

impl RotationEncoding {
    /// Decodes a rotation; `None` if the numbers encode none. Quaternions and matrix columns need not be normalised.
    pub fn decode(self, numbers: &[f64]) -> Option<DQuat> {
        let quaternion = |quaternion: DQuat| (quaternion.length() > MIN_LENGTH).then(|| quaternion.normalize());
        match (self, numbers) {
            (Self::QuatWxyz, &[w, x, y, z]) => quaternion(DQuat::from_xyzw(x, y, z, w)),
            (Self::QuatXyzw, &[x, y, z, w]) => quaternion(DQuat::from_xyzw(x, y, z, w)),
            (Self::SixD, &[ax, ay, az, bx, by, bz]) => {
                let a = DVec3::new(ax, ay, az);
                let x = (a.length() > MIN_LENGTH).then(|| a.normalize())?;
                let b = DVec3::new(bx, by, bz);
                let across = b - x * x.dot(b);
                let y = (across.length() > MIN_LENGTH).then(|| across.normalize())?;
                Some(DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize())
            }
            // Extrinsic x-y-z equals intrinsic z-y-x.
            (Self::FixedXyzEuler, &[x, y, z]) => Some(DQuat::from_euler(EulerRot::ZYX, z, y, x)),
            (Self::AxisAngle, &[x, y, z]) => Some(DQuat::from_scaled_axis(DVec3::new(x, y, z))),
            _ => None,
        }
    }

    /// Encodes a rotation: quaternions with w ≥ 0, angles of at most π.
    pub fn encode(self, rotation: DQuat) -> Vec<f64> {
        let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
        match self {
            Self::QuatWxyz => vec![rotation.w, rotation.x, rotation.y, rotation.z],
            Self::QuatXyzw => vec![rotation.x, rotation.y, rotation.z, rotation.w],
            Self::SixD => {
                let matrix = DMat3::from_quat(rotation);
                [matrix.x_axis.to_array(), matrix.y_axis.to_array()].concat()
            }
            Self::FixedXyzEuler => Pose::new(DVec3::ZERO, rotation).to_fixed_xyz_euler().to_vec(),
            Self::AxisAngle => rotation.to_scaled_axis().to_array().to_vec(),
        }
    }

    /// Description of the expected numbers, for error messages.
    pub fn description(self) -> &'static str {
        match self {
            Self::QuatWxyz => "a quaternion, w first",
            Self::QuatXyzw => "a quaternion, w last",
            Self::SixD => "two columns of a rotation matrix",
            Self::FixedXyzEuler => "angles about the fixed axes x, y, z",
            Self::AxisAngle => "an axis times an angle",
        }
    }

    /// Names of the numbers, as dataset column names.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::QuatWxyz => &["qw", "qx", "qy", "qz"],
            Self::QuatXyzw => &["qx", "qy", "qz", "qw"],
            Self::SixD => &["x_axis_x", "x_axis_y", "x_axis_z", "y_axis_x", "y_axis_y", "y_axis_z"],
            Self::FixedXyzEuler => &["rotation_x", "rotation_y", "rotation_z"],
            Self::AxisAngle => &["axis_angle_x", "axis_angle_y", "axis_angle_z"],
        }
    }

    /// Number of values of the encoding.
    pub fn length(self) -> usize {
        self.names().len()
    }
}

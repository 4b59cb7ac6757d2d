//! Rigid transforms.

use std::ops::Mul;

use glam::{DMat3, DQuat, DVec3, EulerRot};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A rigid transform, named after the frames it connects: `world_from_object * object_from_grasp`.
///
/// File format: `{"position_m": [x, y, z], "orientation_wxyz": [w, x, y, z]}`.
/// Reading rejects non-finite numbers and quaternions that are not normalised.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "PoseFile", into = "PoseFile")]
pub struct Pose {
    /// Origin of the inner frame in the outer frame, metres.
    pub position: DVec3,
    /// Rotation from the inner to the outer frame, unit length.
    pub rotation: DQuat,
}

impl Pose {
    /// The identity transform.
    pub const IDENTITY: Self = Self { position: DVec3::ZERO, rotation: DQuat::IDENTITY };

    /// Pose from a position and a rotation, which is normalised.
    pub fn new(position: DVec3, rotation: DQuat) -> Self {
        Self { position, rotation: rotation.normalize() }
    }

    /// A pure translation.
    pub fn from_position(position: DVec3) -> Self {
        Self { position, rotation: DQuat::IDENTITY }
    }

    /// Upright pose at `position`, rotated by `yaw` radians about +z.
    pub fn from_position_yaw(position: DVec3, yaw: f64) -> Self {
        Self { position, rotation: DQuat::from_rotation_z(yaw) }
    }

    /// Pose from the inner frame's origin and axes expressed in the outer frame.
    pub fn from_axes(position: DVec3, x: DVec3, y: DVec3, z: DVec3) -> Self {
        Self::new(position, DQuat::from_mat3(&DMat3::from_cols(x, y, z)))
    }

    /// Pose from the `[w, x, y, z]` order that MuJoCo and this project's files use.
    pub fn from_wxyz_array(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Self {
        Self::new(DVec3::from_array(position), DQuat::from_xyzw(x, y, z, w))
    }

    /// The rotation in `[w, x, y, z]` order.
    pub fn to_wxyz_array(&self) -> [f64; 4] {
        let [x, y, z, w] = self.rotation.to_array();
        [w, x, y, z]
    }

    /// Position (m), then the rotation in `[w, x, y, z]` order.
    pub fn to_row(&self) -> [f64; 7] {
        let ([x, y, z], [qw, qx, qy, qz]) = (self.position.to_array(), self.to_wxyz_array());
        [x, y, z, qw, qx, qy, qz]
    }

    /// Homogeneous 4x4 matrix, row by row.
    pub fn to_matrix(&self) -> [f64; 16] {
        let (p, [x, y, z]) = (self.position, [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| self.rotation * axis));
        [x.x, y.x, z.x, p.x, x.y, y.y, z.y, p.y, x.z, y.z, z.z, p.z, 0.0, 0.0, 0.0, 1.0]
    }

    /// The inverse transform.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { position: rotation * -self.position, rotation }
    }

    /// Transforms a point from the inner to the outer frame.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.position
    }

    /// Rotates a direction from the inner to the outer frame.
    pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// Heading: angle about +z of the inner x axis projected to the xy plane, rad.
    pub fn yaw(&self) -> f64 {
        let x = self.rotation * DVec3::X;
        x.y.atan2(x.x)
    }

    /// Euler angles about the fixed axes x, y, z in this order (extrinsic), rad: R = Rz · Ry · Rx.
    pub fn to_fixed_xyz_euler(&self) -> [f64; 3] {
        let (z, y, x) = self.rotation.to_euler(EulerRot::ZYX);
        [x, y, z]
    }

    /// Angle between two orientations, rad.
    pub fn angle_to(&self, other: &Self) -> f64 {
        2.0 * self.rotation.dot(other.rotation).abs().min(1.0).acos()
    }

    /// Linear interpolation of the position, spherical of the rotation; `t` in 0..=1.
    #[must_use]
    pub fn interpolate(&self, other: &Self, t: f64) -> Self {
        Self::new(self.position.lerp(other.position, t), self.rotation.slerp(other.rotation, t))
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Mul for Pose {
    type Output = Self;

    fn mul(self, inner: Self) -> Self {
        Self::new(self.transform_point(inner.position), self.rotation * inner.rotation)
    }
}

#[derive(Clone, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Pose")]
struct PoseFile {
    position_m: [f64; 3],
    orientation_wxyz: [f64; 4],
}

impl TryFrom<PoseFile> for Pose {
    type Error = String;

    fn try_from(file: PoseFile) -> Result<Self, String> {
        if !file.position_m.iter().chain(&file.orientation_wxyz).all(|value| value.is_finite()) {
            return Err("a pose holds a number that is not finite".into());
        }
        let [w, x, y, z] = file.orientation_wxyz;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        if (rotation.length() - 1.0).abs() > 1e-6 {
            return Err(format!(
                "orientation_wxyz has length {:.6}, expected 1 (order: w, x, y, z)",
                rotation.length()
            ));
        }
        Ok(Self { position: DVec3::from_array(file.position_m), rotation })
    }
}

impl From<Pose> for PoseFile {
    fn from(pose: Pose) -> Self {
        Self { position_m: pose.position.to_array(), orientation_wxyz: pose.to_wxyz_array() }
    }
}

impl JsonSchema for Pose {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        PoseFile::schema_name()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        PoseFile::json_schema(generator)
    }
}

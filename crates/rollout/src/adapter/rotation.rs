//! Rotations as numbers of an action.

use genmanip_core::glam::{DMat3, DQuat, DVec3, EulerRot};
use genmanip_core::{Pose, RotationEncoding};

/// Shorter than this, numbers name no direction.
const SHORTEST: f64 = 1e-6;

/// The rotation that the numbers mean; `None` when they mean none. Quaternions and columns need not be of unit length.
pub(super) fn decode(encoding: RotationEncoding, numbers: &[f64]) -> Option<DQuat> {
    let quaternion = |quaternion: DQuat| (quaternion.length() > SHORTEST).then(|| quaternion.normalize());
    match (encoding, numbers) {
        (RotationEncoding::QuatWxyz, &[w, x, y, z]) => quaternion(DQuat::from_xyzw(x, y, z, w)),
        (RotationEncoding::QuatXyzw, &[x, y, z, w]) => quaternion(DQuat::from_xyzw(x, y, z, w)),
        (RotationEncoding::SixD, &[ax, ay, az, bx, by, bz]) => {
            let a = DVec3::new(ax, ay, az);
            let x = (a.length() > SHORTEST).then(|| a.normalize())?;
            let b = DVec3::new(bx, by, bz);
            let across = b - x * x.dot(b);
            let y = (across.length() > SHORTEST).then(|| across.normalize())?;
            Some(DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize())
        }
        // Fixed axes x, y, z are the turning axes z, y, x.
        (RotationEncoding::FixedXyzEuler, &[x, y, z]) => Some(DQuat::from_euler(EulerRot::ZYX, z, y, x)),
        (RotationEncoding::AxisAngle, &[x, y, z]) => Some(DQuat::from_scaled_axis(DVec3::new(x, y, z))),
        _ => None,
    }
}

/// The numbers of a rotation: quaternions with w not negative, angles of at most half a turn.
pub(super) fn encode(encoding: RotationEncoding, rotation: DQuat) -> Vec<f64> {
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    match encoding {
        RotationEncoding::QuatWxyz => vec![rotation.w, rotation.x, rotation.y, rotation.z],
        RotationEncoding::QuatXyzw => vec![rotation.x, rotation.y, rotation.z, rotation.w],
        RotationEncoding::SixD => {
            let matrix = DMat3::from_quat(rotation);
            [matrix.x_axis.to_array(), matrix.y_axis.to_array()].concat()
        }
        RotationEncoding::FixedXyzEuler => Pose::new(DVec3::ZERO, rotation).to_fixed_xyz_euler().to_vec(),
        RotationEncoding::AxisAngle => rotation.to_scaled_axis().to_array().to_vec(),
    }
}

/// What is expected, in words.
pub(super) fn words(encoding: RotationEncoding) -> &'static str {
    match encoding {
        RotationEncoding::QuatWxyz => "a quaternion, w first",
        RotationEncoding::QuatXyzw => "a quaternion, w last",
        RotationEncoding::SixD => "two columns of a rotation matrix",
        RotationEncoding::FixedXyzEuler => "angles about the fixed axes x, y, z",
        RotationEncoding::AxisAngle => "an axis times an angle",
    }
}

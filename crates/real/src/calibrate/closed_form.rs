//! Hand-eye calibration in closed form: A X = X B from relative motions.

use genmanip_core::Pose;
use genmanip_core::glam::{DQuat, DVec3};

use crate::least_squares::rotation_vector;
use crate::linear::Square;

/// Minimum and maximum angle of the relative motions that are used, rad: the axis of smaller rotations is noisy, that
/// of rotations near half a turn ambiguous.
pub const USABLE_RAD: [f64; 2] = [0.09, 2.97];

/// Relative motion of the carrier and of the camera between two views.
#[derive(Clone, Copy, Debug)]
pub struct Motion {
    /// Motion of the carrier: the frame that the camera is fixed to.
    pub carrier: Pose,
    /// Motion of the camera frame.
    pub camera: Pose,
}

/// Relative motions between all pairs of views, from `other_from_carrier` and `camera_from_board` of each view; motions
/// with unusable angles are omitted.
pub fn motions(views: &[(Pose, Pose)]) -> Vec<Motion> {
    let mut motions = Vec::new();
    for (index, (carrier, board)) in views.iter().enumerate() {
        for (other_carrier, other_board) in &views[..index] {
            let motion = Motion { carrier: other_carrier.inverse() * *carrier, camera: *other_board * board.inverse() };
            let angle = rotation_vector(motion.carrier.rotation).length();
            if (USABLE_RAD[0]..USABLE_RAD[1]).contains(&angle) {
                motions.push(motion);
            }
        }
    }
    motions
}

/// `carrier_from_camera` after Park and Martin (1994): least squares of the rotation vectors, then of the translation.
/// `None` if the motions do not determine it.
pub fn park_martin(motions: &[Motion]) -> Option<Pose> {
    // Rotation that maps the camera's rotation vectors to the carrier's (Horn 1987).
    let mut sum = Square::zero(4);
    for motion in motions {
        let (a, b) = (rotation_vector(motion.carrier.rotation), rotation_vector(motion.camera.rotation));
        // |R b − a| of a unit quaternion q is |a q − q b|, which is linear in q.
        let difference = (a - b).to_array();
        sum.add_outer(&[0.0, difference[0], difference[1], difference[2]], 1.0);
        cross_rows(a - b, a + b).iter().for_each(|row| sum.add_outer(row, 1.0));
    }
    let best = sum.eigen().swap_remove(0).1;
    with_translation(DQuat::from_xyzw(best[1], best[2], best[3], best[0]), motions)
}

/// `carrier_from_camera` after Daniilidis (1999): rotation and translation together, from dual quaternions. `None` if
/// the motions do not determine it.
pub fn daniilidis(motions: &[Motion]) -> Option<Pose> {
    let mut sum = Square::zero(8);
    for motion in motions {
        let (a, a_dual) = dual_quaternion(&motion.carrier);
        let (b, b_dual) = dual_quaternion(&motion.camera);
        let difference = cross_rows(a - b, a + b);
        let dual = cross_rows(a_dual - b_dual, a_dual + b_dual);
        for (row, dual) in difference.iter().zip(&dual) {
            let mut full = [0.0; 8];
            full[..4].copy_from_slice(row);
            sum.add_outer(&full, 1.0);
            full[..4].copy_from_slice(dual);
            full[4..].copy_from_slice(row);
            sum.add_outer(&full, 1.0);
        }
    }
    let pairs = sum.eigen();
    let (first, second) = (&pairs[0].1, &pairs[1].1);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    // λ first + μ second, scaled so that its real part is a unit quaternion orthogonal to the dual part.
    let (u1, v1, u2, v2) = (&first[..4], &first[4..], &second[..4], &second[4..]);
    let (a, b, c) = (dot(u1, v1), dot(u1, v2) + dot(u2, v1), dot(u2, v2));
    let ratios = if a.abs() < 1e-15 {
        [-c / b, -c / b]
    } else {
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        [(-b + root) / (2.0 * a), (-b - root) / (2.0 * a)]
    };
    let length = |s: f64| s * s * dot(u1, u1) + 2.0 * s * dot(u1, u2) + dot(u2, u2);
    let s = if length(ratios[0]) >= length(ratios[1]) { ratios[0] } else { ratios[1] };
    let mu = 1.0 / length(s).sqrt();
    let part = |index: usize| mu * (s * first[index] + second[index]);
    let rotation = DQuat::from_xyzw(part(1), part(2), part(3), part(0));
    let dual = DQuat::from_xyzw(part(5), part(6), part(7), part(4));
    let shift = dual * rotation.conjugate();
    let pose = Pose::new(2.0 * DVec3::new(shift.x, shift.y, shift.z), rotation);
    (pose.position.is_finite() && pose.rotation.is_finite()).then_some(pose)
}

/// Pose with a known rotation, and the least-squares translation t of (R_A − I) t = R t_B − t_A. `None` if the motions
/// do not determine the translation.
fn with_translation(rotation: DQuat, motions: &[Motion]) -> Option<Pose> {
    let (mut left, mut right) = (Square::zero(3), [0.0; 3]);
    for motion in motions {
        let known = (rotation * motion.camera.position - motion.carrier.position).to_array();
        let columns = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| (motion.carrier.rotation * axis - axis).to_array());
        for row in 0..3 {
            let factors = columns.map(|column| column[row]);
            left.add_outer(&factors, 1.0);
            for (sum, factor) in right.iter_mut().zip(factors) {
                *sum += factor * known[row];
            }
        }
    }
    let position = left.cholesky()?.solve(&right);
    Some(Pose::new(DVec3::new(position[0], position[1], position[2]), rotation))
}

/// Vector parts of the real and the dual quaternion of a motion, with the sign that makes the scalar part non-negative.
fn dual_quaternion(pose: &Pose) -> (DVec3, DVec3) {
    let rotation = if pose.rotation.w < 0.0 { -pose.rotation } else { pose.rotation };
    let shift = DQuat::from_xyzw(pose.position.x, pose.position.y, pose.position.z, 0.0);
    let dual = shift * rotation;
    (DVec3::new(rotation.x, rotation.y, rotation.z), 0.5 * DVec3::new(dual.x, dual.y, dual.z))
}

/// Rows (difference, [sum]×) of Daniilidis' equations, for quaternions in the order (w, x, y, z).
fn cross_rows(difference: DVec3, sum: DVec3) -> [[f64; 4]; 3] {
    [[difference.x, 0.0, -sum.z, sum.y], [difference.y, sum.z, 0.0, -sum.x], [difference.z, -sum.y, sum.x, 0.0]]
}

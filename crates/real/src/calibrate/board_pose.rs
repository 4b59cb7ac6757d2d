//! Pose of a flat board in one view: homography, then least squares of the reprojection error.

use genmanip_core::Pose;
use genmanip_core::glam::{DQuat, DVec2, DVec3};

use super::views::{CameraModel, View};
use crate::homography::homography;
use crate::least_squares::{Normal, minimise, moved};

/// Minimum angle between the board normals of two poses that count as different solutions, rad. Chosen by hand.
const DIFFERENT_RAD: f64 = 0.05;

/// Pose of the board in one view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardPose {
    /// Board in the camera frame.
    pub camera_from_board: Pose,
    /// Root-mean-square reprojection error of the corners, px.
    pub rms_px: f64,
    /// Root-mean-square reprojection error of the best pose with the flipped normal (planar pose ambiguity); infinite
    /// if there is none.
    pub flipped_rms_px: f64,
}

/// Pose of the board in a view; `None` if its corners fit no pose in front of the camera.
pub fn board_pose(camera: &CameraModel, view: &View) -> Option<BoardPose> {
    let start = from_homography(camera, view)?;
    let (found, rms) = refined(camera, view, start)?;
    let other =
        refined(camera, view, flipped(&found, view)).filter(|(other, _)| normal_angle(&found, other) > DIFFERENT_RAD);
    Some(match other {
        Some((other, other_rms)) if other_rms < rms => {
            BoardPose { camera_from_board: other, rms_px: other_rms, flipped_rms_px: rms }
        }
        other => {
            let flipped_rms_px = other.map_or(f64::INFINITY, |(_, rms)| rms);
            BoardPose { camera_from_board: found, rms_px: rms, flipped_rms_px }
        }
    })
}

/// Derivative of the projected pixel by the point in the camera frame, px per m: rows of u and v; `None` behind the
/// camera.
pub fn pixel_derivative(camera: &CameraModel, point: DVec3) -> Option<[DVec3; 2]> {
    let step = 1e-5 * point.z;
    let mut rows = [DVec3::ZERO; 2];
    for axis in 0..3 {
        let mut by = DVec3::ZERO;
        by[axis] = step;
        let change = (camera.pixel(point + by)? - camera.pixel(point - by)?) / (2.0 * step);
        (rows[0][axis], rows[1][axis]) = (change.x, change.y);
    }
    Some(rows)
}

fn normal_angle(a: &Pose, b: &Pose) -> f64 {
    (a.rotation * DVec3::Z).angle_between(b.rotation * DVec3::Z)
}

/// Centroid of a view's corners in the board frame, m.
fn middle(view: &View) -> DVec3 {
    view.corners.iter().map(|(point, _)| *point).sum::<DVec3>() / view.corners.len() as f64
}

/// Second solution of the planar pose ambiguity: the board normal mirrored at the view ray to the board's centre, which
/// projects almost identically from afar.
fn flipped(pose: &Pose, view: &View) -> Pose {
    let center = middle(view);
    let center_in_camera = pose.transform_point(center);
    let view_ray = center_in_camera.normalize();
    let normal = pose.rotation * DVec3::Z;
    let mirrored = (2.0 * normal.dot(view_ray) * view_ray - normal).normalize();
    let rotation = DQuat::from_rotation_arc(normal, mirrored) * pose.rotation;
    Pose::new(center_in_camera - rotation * center, rotation)
}

/// Pose that minimises the reprojection error, from a start pose, with the root-mean-square error, px. `None` if a
/// corner lies behind the camera at the start.
fn refined(camera: &CameraModel, view: &View, start: Pose) -> Option<(Pose, f64)> {
    let evaluate = |pose: &Pose| {
        let mut normal = Normal::new(6);
        for &(point, pixel) in &view.corners {
            let seen = pose.transform_point(point);
            let miss = camera.pixel(seen)? - pixel;
            for (by_point, residual) in pixel_derivative(camera, seen)?.into_iter().zip(miss.to_array()) {
                let by_board = pose.rotation.inverse() * by_point;
                normal.add(residual, &entries(0, point.cross(by_board), by_board), 1.0);
            }
        }
        Some(normal)
    };
    let (pose, normal) = minimise(start, evaluate, moved)?;
    Some((pose, (normal.cost / view.corners.len() as f64).sqrt()))
}

/// Column indices and entries of a Jacobian row from column `at`: rotation, then translation.
pub fn entries(at: usize, rotation: DVec3, translation: DVec3) -> [(usize, f64); 6] {
    let (r, t) = (rotation.to_array(), translation.to_array());
    [(at, r[0]), (at + 1, r[1]), (at + 2, r[2]), (at + 3, t[0]), (at + 4, t[1]), (at + 5, t[2])]
}

/// Pose from the homography between board and image plane. `None` if a pixel cannot be undistorted or the corners are
/// collinear.
fn from_homography(camera: &CameraModel, view: &View) -> Option<Pose> {
    let center = middle(view);
    let seen: Vec<DVec2> = view.corners.iter().map(|&(_, pixel)| camera.on_plane(pixel)).collect::<Option<_>>()?;
    let points = view.corners.iter().map(|(point, _)| (*point - center).truncate());
    let map = homography(points.zip(seen.iter().copied()))?;
    let size = f64::midpoint(map.x_axis.length(), map.y_axis.length()) * map.z_axis.z.signum();
    let (x, y, position) = (map.x_axis / size, map.y_axis / size, map.z_axis / size);
    // Nearest pair of orthogonal unit vectors.
    let (sum, difference) = ((x + y).normalize(), (x - y).normalize());
    let (x, y) = ((sum + difference).normalize(), (sum - difference).normalize());
    let pose = Pose::from_axes(position, x, y, x.cross(y));
    let pose = Pose::new(pose.position - pose.rotation * center, pose.rotation);
    (pose.position.is_finite() && pose.rotation.is_finite()).then_some(pose)
}

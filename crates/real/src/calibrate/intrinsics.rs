//! Check of the stated intrinsics against those estimated from the views of the board alone.

use genmanip_core::{Intrinsics, Pose};
use serde::Serialize;

use super::board_pose::{entries, pixel_derivative};
use super::views::{CameraModel, View};
use crate::least_squares::{Normal, minimise, moved};

/// Number of estimated intrinsics: two focal lengths and the principal point.
const SHARED: usize = 4;
/// Minimum deviation that is reported, in standard deviations and in pixels at the image border; both must be exceeded.
const SUSPICIOUS: (f64, f64) = (4.0, 1.0);

/// Stated intrinsics and those with the least reprojection error; the lens distortion stays as stated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntrinsicsCheck {
    /// fx, fy, cx, cy as stated, px.
    pub stated: [f64; 4],
    /// fx, fy, cx, cy as estimated, px.
    pub estimated: [f64; 4],
    /// Standard deviations of the estimated fx, fy, cx, cy, px.
    pub sd: [f64; 4],
    /// Root-mean-square reprojection error with the stated intrinsics and free board poses, px.
    pub stated_rms_px: f64,
    /// Root-mean-square reprojection error with the estimated intrinsics, px.
    pub estimated_rms_px: f64,
    /// True if the estimate deviates significantly and by more than a pixel at the image border.
    pub is_suspicious: bool,
}

/// Checks intrinsics, from the pose of the board in each view; `None` if the views do not determine them.
pub fn check_intrinsics(camera: &CameraModel, views: &[&View], poses: &[Pose]) -> Option<IntrinsicsCheck> {
    let size = SHARED + 6 * views.len();
    let corners = views.iter().map(|view| view.corners.len()).sum::<usize>() as f64;
    let with = |values: [f64; 4]| {
        let [fx, fy, cx, cy] = values;
        CameraModel { intrinsics: Intrinsics { fx, fy, cx, cy, ..camera.intrinsics }, ..camera.clone() }
    };
    let Intrinsics { fx, fy, cx, cy, width, height } = camera.intrinsics;
    let stated = [fx, fy, cx, cy];
    let evaluate = |(values, poses): &([f64; 4], Vec<Pose>)| {
        if values[0] <= 0.0 || values[1] <= 0.0 {
            return None;
        }
        let model = with(*values);
        let mut normal = Normal::new(size);
        for (index, (view, pose)) in views.iter().zip(poses).enumerate() {
            for &(point, pixel) in &view.corners {
                let seen = pose.transform_point(point);
                let shown = model.pixel(seen)?;
                let by_intrinsics = [(shown.x - values[2]) / values[0], (shown.y - values[3]) / values[1]];
                let residuals = (shown - pixel).to_array();
                for (axis, by_point) in pixel_derivative(&model, seen)?.into_iter().enumerate() {
                    let by_board = pose.rotation.inverse() * by_point;
                    let mut row = vec![(axis, by_intrinsics[axis]), (2 + axis, 1.0)];
                    row.extend(entries(SHARED + 6 * index, point.cross(by_board), by_board));
                    normal.add(residuals[axis], &row, 1.0);
                }
            }
        }
        Some(normal)
    };
    let step = |(values, poses): &([f64; 4], Vec<Pose>), change: &[f64]| {
        let mut next = *values;
        next.iter_mut().zip(change).for_each(|(value, change)| *value += change);
        let poses = poses.iter().enumerate().map(|(index, pose)| moved(pose, &change[SHARED + 6 * index..]));
        (next, poses.collect())
    };
    let start = (stated, poses.to_vec());
    let stated_rms_px = (evaluate(&start)?.cost / corners).sqrt();
    let ((estimated, _), normal) = minimise(start, evaluate, step)?;
    let variance = normal.cost / (2.0 * corners - size as f64).max(1.0);
    let block = normal.hessian.cholesky()?.inverse_block(SHARED);
    let sd = [0, 1, 2, 3].map(|index| (variance * block.get(index, index)).sqrt());
    // Effect at the image's edge, px.
    let edge = [f64::from(width) / 2.0 / fx, f64::from(height) / 2.0 / fy, 1.0, 1.0];
    let is_off = |index: usize| {
        let off = (estimated[index] - stated[index]).abs();
        off > SUSPICIOUS.0 * sd[index] && off * edge[index] > SUSPICIOUS.1
    };
    let is_suspicious = (0..SHARED).any(is_off);
    Some(IntrinsicsCheck {
        stated,
        estimated,
        sd,
        stated_rms_px,
        estimated_rms_px: (normal.cost / corners).sqrt(),
        is_suspicious,
    })
}

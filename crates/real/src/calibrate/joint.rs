//! Bundle adjustment: joint refinement of camera, board and robot poses by the reprojection error.

use genmanip_core::Pose;
use genmanip_core::glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::board_pose::{entries, pixel_derivative};
use super::views::{CameraModel, Mounting, View};
use crate::least_squares::{Normal, minimise, moved, tangent};
use crate::linear::Square;

/// Number of unknowns that all views share: six each of camera and board, and the board's scale.
const SHARED: usize = 13;
/// Threshold of the Huber loss, in standard deviations of the pixel noise.
const HUBER: f64 = 3.0;
/// Prior standard deviation of the logarithm of the board's scale where the scale is estimated: practically none.
const FREE_SCALE: f64 = 10.0;
/// Prior standard deviation of the logarithm of the board's scale where the scale is fixed.
const FIXED_SCALE: f64 = 1e-9;

/// Standard deviations of the measurement noise that the refinement assumes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Noise {
    /// Standard deviation of a corner's pixel coordinates, px.
    pub corner_px: f64,
    /// Standard deviation of each coordinate of the hand's position, m.
    pub hand_m: f64,
    /// Standard deviation of the hand's orientation about each axis, rad.
    pub hand_rad: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self {
            // Corner detectors with subpixel refinement reach 0.05 to 0.3 px on sharp images.
            corner_px: 0.15,
            // Absolute accuracy (not repeatability) of collaborative arms after their own calibration.
            hand_m: 1e-4,
            hand_rad: 0.05_f64.to_radians(),
        }
    }
}

/// Unknowns of the refinement.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Pose of the camera in the frame of its mount.
    pub mount_from_camera: Pose,
    /// Pose of the board in the frame that it is fixed to.
    pub mount_from_board: Pose,
    /// Natural logarithm of the board's true size over its stated size.
    pub log_scale: f64,
    /// True poses `base_from_hand` of the views.
    pub hands: Vec<Pose>,
}

/// Result of the refinement.
#[derive(Clone, Debug)]
pub struct Refined {
    /// Unknowns at the minimum of the cost.
    pub setup: Setup,
    /// Cost: weighted sum of squared residuals.
    pub cost: f64,
    /// Covariance of 13 unknowns: camera (rotation vector in rad and translation in m, in the camera's own frame),
    /// board (likewise) and logarithm of the scale.
    pub covariance: Square,
}

impl Setup {
    /// Pose of the board in the camera's frame, for a pose of the hand.
    pub fn camera_from_board(&self, mounting: Mounting, base_from_hand: &Pose) -> Pose {
        self.mount_from_camera.inverse() * carrier(mounting, base_from_hand).inverse() * self.mount_from_board
    }

    /// Root-mean-square reprojection error of a view, px; infinite if a corner lies behind the camera.
    pub fn rms_px(&self, camera: &CameraModel, mounting: Mounting, view: &View, base_from_hand: &Pose) -> f64 {
        let pose = self.camera_from_board(mounting, base_from_hand);
        let scale = self.log_scale.exp();
        let square = |(point, pixel): &(DVec3, DVec2)| {
            let seen = camera.pixel(pose.transform_point(scale * *point));
            seen.map_or(f64::INFINITY, |seen| seen.distance_squared(*pixel))
        };
        (view.corners.iter().map(square).sum::<f64>() / view.corners.len() as f64).sqrt()
    }
}

/// Pose of the camera's mount in the frame that the board is fixed to.
pub fn carrier(mounting: Mounting, base_from_hand: &Pose) -> Pose {
    match mounting {
        Mounting::EyeInHand => *base_from_hand,
        Mounting::EyeToHand => base_from_hand.inverse(),
    }
}

/// Refines a setup. Corners and robot poses deviate by their noise; the board's scale is estimated or fixed. `None` if
/// a corner lies behind the camera at the start, or the views do not determine the unknowns.
pub fn refine(
    camera: &CameraModel,
    mounting: Mounting,
    views: &[View],
    start: Setup,
    noise: &Noise,
    is_scale_free: bool,
) -> Option<Refined> {
    let size = SHARED + 6 * views.len();
    let scale_sigma = if is_scale_free { FREE_SCALE } else { FIXED_SCALE };
    let evaluate = |setup: &Setup| {
        let mut normal = Normal::new(size);
        normal.add(setup.log_scale, &[(SHARED - 1, 1.0)], scale_sigma.powi(-2));
        for (index, view) in views.iter().enumerate() {
            let at = SHARED + 6 * index;
            let hand = &setup.hands[index];
            add_view(&mut normal, camera, mounting, view, setup, hand, at, noise)?;
            let deviation = tangent(&(view.base_from_hand.inverse() * *hand));
            for (axis, residual) in deviation.into_iter().enumerate() {
                let sigma = if axis < 3 { noise.hand_rad } else { noise.hand_m };
                normal.add(residual, &[(at + axis, 1.0)], sigma.powi(-2));
            }
        }
        Some(normal)
    };
    let step = |setup: &Setup, change: &[f64]| Setup {
        mount_from_camera: moved(&setup.mount_from_camera, &change[..6]),
        mount_from_board: moved(&setup.mount_from_board, &change[6..12]),
        log_scale: (setup.log_scale + change[12]).clamp(-3.0, 3.0),
        hands: setup
            .hands
            .iter()
            .enumerate()
            .map(|(index, hand)| moved(hand, &change[SHARED + 6 * index..SHARED + 6 * index + 6]))
            .collect(),
    };
    let (setup, normal) = minimise(start, evaluate, step)?;
    let covariance = normal.hessian.cholesky()?.inverse_block(SHARED);
    Some(Refined { setup, cost: normal.cost, covariance })
}

/// Fisher information matrix of one view on camera and board (12 unknowns), with the noise of the hand's pose
/// marginalised. `None` if a corner lies behind the camera.
pub fn information(
    camera: &CameraModel,
    mounting: Mounting,
    view: &View,
    setup: &Setup,
    noise: &Noise,
) -> Option<Square> {
    let mut normal = Normal::new(SHARED + 6);
    add_view(&mut normal, camera, mounting, view, setup, &setup.hands[0], SHARED, noise)?;
    let full = &normal.hessian;
    let mut hand = Square::zero(6);
    for row in 0..6 {
        let sigma = if row < 3 { noise.hand_rad } else { noise.hand_m };
        hand.add(row, row, sigma.powi(-2));
        (0..6).for_each(|column| hand.add(row, column, full.get(SHARED + row, SHARED + column)));
    }
    let factor = hand.cholesky()?;
    let mut information = Square::zero(SHARED - 1);
    for column in 0..SHARED - 1 {
        let coupling: Vec<f64> = (0..6).map(|row| full.get(SHARED + row, column)).collect();
        let explained = factor.solve(&coupling);
        for row in 0..SHARED - 1 {
            let by_hand: f64 = (0..6).map(|index| full.get(row, SHARED + index) * explained[index]).sum();
            information.add(row, column, full.get(row, column) - by_hand);
        }
    }
    Some(information)
}

/// Adds the corners of a view; the unknowns of its hand pose start at index `at`. `None` if a corner lies behind the
/// camera.
#[allow(clippy::too_many_arguments)] // the loop body of `refine`
fn add_view(
    normal: &mut Normal,
    camera: &CameraModel,
    mounting: Mounting,
    view: &View,
    setup: &Setup,
    hand: &Pose,
    at: usize,
    noise: &Noise,
) -> Option<()> {
    let camera_from_mount = setup.mount_from_camera.inverse();
    let board_in_camera = setup.camera_from_board(mounting, hand);
    let scale = setup.log_scale.exp();
    // Pose of the hand in the camera frame, and the sign with which a motion of the hand moves the point in it.
    let (camera_from_hand, sign) = match mounting {
        Mounting::EyeInHand => (camera_from_mount, -1.0),
        Mounting::EyeToHand => (camera_from_mount * *hand, 1.0),
    };
    let hand_from_camera = camera_from_hand.inverse();
    for &(point, pixel) in &view.corners {
        let point = scale * point;
        let seen = board_in_camera.transform_point(point);
        let miss = camera.pixel(seen)? - pixel;
        let by_point = pixel_derivative(camera, seen)?;
        let deviation = miss.length() / noise.corner_px;
        let weight = (HUBER / deviation.max(HUBER)) / noise.corner_px.powi(2);
        let in_hand = hand_from_camera.transform_point(seen);
        for (by_point, residual) in by_point.into_iter().zip(miss.to_array()) {
            let by_board = board_in_camera.rotation.inverse() * by_point;
            let by_hand = sign * (hand_from_camera.rotation * by_point);
            let mut row = Vec::with_capacity(19);
            row.extend(entries(0, by_point.cross(seen), -by_point));
            row.extend(entries(6, point.cross(by_board), by_board));
            row.push((SHARED - 1, by_board.dot(point)));
            row.extend(entries(at, in_hand.cross(by_hand), by_hand));
            normal.add(residual, &row, weight);
        }
    }
    Some(())
}

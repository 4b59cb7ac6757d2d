//! Planning of hand poses that make a calibration well-conditioned.

use genmanip_core::Pose;
use genmanip_core::glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::joint::{Noise, Setup, information};
use super::views::{Board, CameraModel, Mounting, View};
use crate::linear::Square;

/// Number of unknowns: poses of camera and board, six each.
const PLANNED: usize = 12;

/// Grid of candidate poses of the board in the camera frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanSettings {
    /// Distances of the board's centre from the camera, m.
    pub distances_m: Vec<f64>,
    /// Tilts of the board's normal against the optical axis, rad.
    pub tilts_rad: Vec<f64>,
    /// Number of evenly spaced tilt directions.
    pub directions: usize,
    /// Rotations about the optical axis, rad.
    pub rolls_rad: Vec<f64>,
    /// Width of the image border that the board must not enter, as a share of the image size.
    pub border: f64,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self {
            distances_m: vec![0.3, 0.4, 0.55],
            // Nearly parallel to the image plane, the board's pose would be ambiguous.
            tilts_rad: vec![0.25, 0.5, 0.7],
            directions: 8,
            rolls_rad: vec![-1.0, -0.4, 0.4, 1.0],
            border: 0.04,
        }
    }
}

/// Hand pose from which the camera sees the whole board.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Pose of the hand link in the robot's base frame.
    pub base_from_hand: Pose,
    /// Fisher information matrix of this view on the poses of camera and board.
    information: Square,
}

/// Chosen hand poses with the expected accuracy of the calibration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Planned {
    /// Poses of the hand link in the robot's base frame, in the order of choice: each is the most informative after
    /// those before it.
    pub base_from_hand: Vec<Pose>,
    /// Expected standard deviation of the camera's position along its own axes, m.
    pub position_sd_m: [f64; 3],
    /// Expected standard deviation of the camera's orientation about its own axes, rad.
    pub rotation_sd_rad: [f64; 3],
}

/// Poses of the hand that show the whole board, from approximate poses of camera and board in the frames they are fixed
/// to.
pub fn candidates(
    camera: &CameraModel,
    mounting: Mounting,
    board: &Board,
    [mount_from_camera, mount_from_board]: [Pose; 2],
    noise: &Noise,
    settings: &PlanSettings,
) -> Vec<Candidate> {
    let corners = board.corners();
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let size = DVec2::new(f64::from(camera.intrinsics.width), f64::from(camera.intrinsics.height));
    let is_in_image =
        |pixel: DVec2| pixel.cmpge(size * settings.border).all() && pixel.cmple(size * (1.0 - settings.border)).all();
    // The board is seen from its side of positive z.
    let facing = DQuat::from_rotation_x(std::f64::consts::PI);
    let mut found = Vec::new();
    for &distance in &settings.distances_m {
        for &tilt in &settings.tilts_rad {
            for direction in 0..settings.directions {
                for &roll in &settings.rolls_rad {
                    let azimuth = std::f64::consts::TAU * direction as f64 / settings.directions.max(1) as f64;
                    let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
                    let rotation = DQuat::from_axis_angle(axis, tilt) * DQuat::from_rotation_z(roll) * facing;
                    let position = DVec3::new(0.0, 0.0, distance) - rotation * middle;
                    let camera_from_board = Pose::new(position, rotation);
                    let base_from_hand = match mounting {
                        Mounting::EyeInHand => {
                            mount_from_board * camera_from_board.inverse() * mount_from_camera.inverse()
                        }
                        Mounting::EyeToHand => mount_from_camera * camera_from_board * mount_from_board.inverse(),
                    };
                    let pixels: Option<Vec<(DVec3, DVec2)>> = corners
                        .iter()
                        .map(|&point| {
                            let pixel = camera.pixel(camera_from_board.transform_point(point))?;
                            is_in_image(pixel).then_some((point, pixel))
                        })
                        .collect();
                    let Some(corners) = pixels else { continue };
                    let view = View { id: String::new(), base_from_hand, corners };
                    let setup =
                        Setup { mount_from_camera, mount_from_board, log_scale: 0.0, hands: vec![base_from_hand] };
                    if let Some(information) = information(camera, mounting, &view, &setup, noise) {
                        found.push(Candidate { base_from_hand, information });
                    }
                }
            }
        }
    }
    found
}

/// Greedy D-optimal design: each pose is the one that increases the determinant of the information matrix most. `None`
/// if the camera's pose stays undetermined.
pub fn choose(candidates: &[Candidate], count: usize) -> Option<Planned> {
    let mut left: Vec<&Candidate> = candidates.iter().collect();
    let mut sum = Square::zero(PLANNED);
    // A weak prior, so that the first views can be compared: 1 m and 1 rad.
    (0..PLANNED).for_each(|index| sum.add(index, index, 1.0));
    let mut chosen = Vec::new();
    while chosen.len() < count && !left.is_empty() {
        let gain = |candidate: &Candidate| {
            let mut with = sum.clone();
            with.add_all(&candidate.information);
            with.cholesky().map_or(f64::NEG_INFINITY, |factor| factor.log_determinant())
        };
        let gains: Vec<f64> = left.iter().map(|candidate| gain(candidate)).collect();
        let best = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b]))?;
        let best = left.swap_remove(best);
        sum.add_all(&best.information);
        chosen.push(best.base_from_hand);
    }
    let inverse = sum.cholesky()?.inverse_block(6);
    let sd = |index: usize| inverse.get(index, index).sqrt();
    Some(Planned {
        base_from_hand: chosen,
        position_sd_m: [sd(3), sd(4), sd(5)],
        rotation_sd_rad: [sd(0), sd(1), sd(2)],
    })
}

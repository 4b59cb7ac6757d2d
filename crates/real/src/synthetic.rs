//! Synthetic views of a board with known truth, for rehearsals of a calibration and for measuring its accuracy.

use genmanip_core::glam::{DQuat, DVec2, DVec3};
use genmanip_core::{Intrinsics, Pose, Seed};
use rand::{Rng, RngExt};
use serde::Serialize;

use crate::calibrate::{Board, CameraModel, Mounting, Noise, PlanSettings, View, candidates};

/// Synthetic calibration setup with its ground truth.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Projection of the camera.
    pub camera: CameraModel,
    /// Mounting of the camera.
    pub mounting: Mounting,
    /// Board as described to the calibration.
    pub board: Board,
    /// True pose of the camera in the frame that it is fixed to.
    pub mount_from_camera: Pose,
    /// True pose of the board in the frame that it is fixed to.
    pub mount_from_board: Pose,
    /// True poses `base_from_hand`, one per view.
    pub hands: Vec<Pose>,
}

/// Defects of views that leave the camera's pose undetermined or contradict the description.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Degeneracy {
    /// Only two orientations of the hand.
    TwoRotations,
    /// All relative rotations about one axis.
    ParallelAxes,
    /// All relative rotations below 10 degrees.
    SmallTurns,
    /// Tiny board (6 × 4 mm) at the usual distances, whose pose is ambiguous.
    PlanarFlip,
    /// Board that is larger than its description says.
    WrongScale,
    /// Camera with the other mounting than stated.
    OtherMounting,
    /// Robot poses assigned to the ids of other images.
    ShuffledIds,
}

impl Degeneracy {
    /// All defects.
    pub const ALL: [Self; 7] = [
        Self::TwoRotations,
        Self::ParallelAxes,
        Self::SmallTurns,
        Self::PlanarFlip,
        Self::WrongScale,
        Self::OtherMounting,
        Self::ShuffledIds,
    ];
}

impl Scene {
    /// Random setup with `count` views in which the whole board, of 7 × 5 corners, is visible.
    pub fn random(mounting: Mounting, count: usize, seed: Seed) -> Self {
        Self::of_board(mounting, count, seed, |spacing_m| Board::Grid { columns: 7, rows: 5, spacing_m })
    }

    /// Random setup with the board that `board` makes from a random spacing between 20 and 30 mm.
    pub fn of_board(mounting: Mounting, count: usize, seed: Seed, board: impl Fn(f64) -> Board) -> Self {
        let mut rng = seed.rng();
        let [width, height, focal_px] = [[1280.0, 720.0, 910.0], [640.0, 480.0, 605.0]][rng.random_range(0..2)];
        let intrinsics = Intrinsics {
            width: width as u32,
            height: height as u32,
            fx: focal_px * rng.random_range(0.95..1.05),
            fy: focal_px * rng.random_range(0.95..1.05),
            cx: width / 2.0 + rng.random_range(-10.0..10.0),
            cy: height / 2.0 + rng.random_range(-10.0..10.0),
        };
        let camera = CameraModel { name: "calibrated".into(), intrinsics, distortion: None };
        let board = board(rng.random_range(0.02..0.03));
        let down = DQuat::from_rotation_x(std::f64::consts::PI);
        let (mount_from_camera, mount_from_board) = match mounting {
            // The hand's z axis points ahead, as does the camera's.
            Mounting::EyeInHand => (
                Pose::new(vector(&mut rng, 0.03) + DVec3::new(0.05, 0.0, 0.03), turn(&mut rng, 0.3)),
                Pose::new(vector(&mut rng, 0.1) * DVec3::new(1.0, 1.0, 0.05) + DVec3::X * 0.5, turn(&mut rng, 0.05)),
            ),
            Mounting::EyeToHand => (
                Pose::new(vector(&mut rng, 0.1) + DVec3::new(0.5, 0.0, 1.0), turn(&mut rng, 0.3) * down),
                Pose::new(vector(&mut rng, 0.03) + DVec3::Z * 0.1, turn(&mut rng, 0.3)),
            ),
        };
        let poses = [mount_from_camera, mount_from_board];
        let all = candidates(&camera, mounting, &board, poses, &Noise::default(), &PlanSettings::default());
        let hands = (0..count)
            .map(|_| {
                let hand = all[rng.random_range(0..all.len())].base_from_hand;
                // Small random offset: nobody reaches a planned pose exactly. The board stays in the image.
                hand * Pose::new(vector(&mut rng, 0.005), turn(&mut rng, 0.02))
            })
            .collect();
        Self { camera, mounting, board, mount_from_camera, mount_from_board, hands }
    }

    /// Views of the setup: corners and robot poses with noise. Corners outside of the image are missing.
    pub fn views(&self, noise: &Noise, seed: Seed) -> Vec<View> {
        let mut rng = seed.rng();
        let size = DVec2::new(f64::from(self.camera.intrinsics.width), f64::from(self.camera.intrinsics.height));
        let corners = self.board.corners();
        let view = |(index, hand): (usize, &Pose)| {
            let pose = self.camera_from_board(hand);
            let mut seen = Vec::new();
            for &corner in &corners {
                let Some(pixel) = self.camera.pixel(pose.transform_point(corner)) else { continue };
                let pixel = pixel + DVec2::new(normal(&mut rng), normal(&mut rng)) * noise.corner_px;
                if pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all() {
                    seen.push((corner, pixel));
                }
            }
            let shift = DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng)) * noise.hand_m;
            let tilt = DVec3::new(normal(&mut rng), normal(&mut rng), normal(&mut rng)) * noise.hand_rad;
            let base_from_hand = *hand * Pose::new(shift, DQuat::from_scaled_axis(tilt));
            View { id: format!("{index:03}"), base_from_hand, corners: seen }
        };
        self.hands.iter().enumerate().map(view).collect()
    }

    /// The setup and its views with one defect; the scene holds the stated description.
    pub fn degenerate(&self, how: Degeneracy, noise: &Noise, seed: Seed) -> (Self, Vec<View>) {
        let mut scene = self.clone();
        let mut rng = seed.fork("degenerate").rng();
        let first = self.hands[0];
        let from = |change: Pose, scene: &Self| match scene.mounting {
            Mounting::EyeInHand => first * change,
            Mounting::EyeToHand => change * first,
        };
        match how {
            Degeneracy::TwoRotations => {
                for (index, hand) in scene.hands.iter_mut().enumerate() {
                    let rotation = if index % 2 == 0 { first.rotation } else { self.hands[1].rotation };
                    *hand = Pose::new(hand.position, rotation);
                }
                // Positions near those of the first two hands: elsewhere these orientations would turn the board out of
                // the image.
                scene.hands.iter_mut().enumerate().for_each(|(index, hand)| {
                    let base = self.hands[index % 2];
                    *hand = Pose::new(base.position + vector(&mut rng, 0.02), hand.rotation);
                });
            }
            Degeneracy::ParallelAxes => {
                let count = scene.hands.len() as f64;
                for index in 0..scene.hands.len() {
                    let angle = 1.2 * (index as f64 / count - 0.5);
                    // Rotation about the optical axis, which passes through the middle of the image.
                    scene.hands[index] = match scene.mounting {
                        Mounting::EyeInHand => {
                            let spin = Pose::new(vector(&mut rng, 0.01), DQuat::from_rotation_z(angle));
                            first * (self.mount_from_camera * spin * self.mount_from_camera.inverse())
                        }
                        Mounting::EyeToHand => {
                            let spin = Pose::new(vector(&mut rng, 0.01), DQuat::from_rotation_z(angle));
                            self.mount_from_camera * spin * self.mount_from_camera.inverse() * first
                        }
                    };
                }
            }
            Degeneracy::SmallTurns => {
                for hand in &mut scene.hands {
                    let change = Pose::new(vector(&mut rng, 0.01), turn(&mut rng, 0.04));
                    let around = Pose::from_position(first.position);
                    *hand = match self.mounting {
                        Mounting::EyeInHand => from(change, self),
                        Mounting::EyeToHand => around * change * around.inverse() * first,
                    };
                }
            }
            Degeneracy::PlanarFlip => {
                scene.board = Board::Grid { columns: 4, rows: 3, spacing_m: 0.002 };
            }
            Degeneracy::WrongScale => {
                let views = scene.views(noise, seed);
                let factor = rng.random_range(1.03..1.1);
                let Board::Grid { columns, rows, spacing_m } = self.board else { return (scene, views) };
                scene.board = Board::Grid { columns, rows, spacing_m: spacing_m / factor };
                let shrink = |view: View| View {
                    corners: view.corners.into_iter().map(|(point, pixel)| (point / factor, pixel)).collect(),
                    ..view
                };
                return (scene, views.into_iter().map(shrink).collect());
            }
            Degeneracy::OtherMounting => {
                let views = scene.views(noise, seed);
                scene.mounting = scene.mounting.other();
                return (scene, views);
            }
            Degeneracy::ShuffledIds => {
                let mut views = scene.views(noise, seed);
                let hands: Vec<Pose> = views.iter().map(|view| view.base_from_hand).collect();
                let shift = rng.random_range(1..hands.len());
                for (index, view) in views.iter_mut().enumerate() {
                    view.base_from_hand = hands[(index + shift) % hands.len()];
                }
                return (scene, views);
            }
        }
        let views = scene.views(noise, seed);
        (scene, views)
    }

    /// Position errors (m) of a grid of points on the table (z = 0 in the base frame), per visible point and pose of
    /// the camera: exact positions in the camera's frame, transformed to the base frame with the calibrated camera
    /// pose.
    pub fn table_errors_m(&self, mount_from_camera: &Pose) -> Vec<f64> {
        let table: Vec<DVec3> = (0..25)
            .map(|index| DVec3::new(0.3 + 0.1 * f64::from(index % 5), -0.2 + 0.1 * f64::from(index / 5), 0.0))
            .collect();
        let mut errors = Vec::new();
        for hand in &self.hands {
            let (truth, found) = match self.mounting {
                Mounting::EyeInHand => (*hand * self.mount_from_camera, *hand * *mount_from_camera),
                Mounting::EyeToHand => (self.mount_from_camera, *mount_from_camera),
            };
            let seen = table.iter().map(|point| (point, truth.inverse().transform_point(*point)));
            let is_shown = |at: DVec3| {
                let Intrinsics { width, height, .. } = self.camera.intrinsics;
                let size = DVec2::new(f64::from(width), f64::from(height));
                let pixel = self.camera.pixel(at);
                pixel.is_some_and(|pixel| pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all())
            };
            errors.extend(
                seen.filter(|(_, at)| is_shown(*at)).map(|(point, at)| found.transform_point(at).distance(*point)),
            );
            if self.mounting == Mounting::EyeToHand {
                break;
            }
        }
        errors
    }

    /// Pose of the board in the camera's frame for a pose of the hand.
    pub fn camera_from_board(&self, hand: &Pose) -> Pose {
        let carrier = match self.mounting {
            Mounting::EyeInHand => *hand,
            Mounting::EyeToHand => hand.inverse(),
        };
        self.mount_from_camera.inverse() * carrier.inverse() * self.mount_from_board
    }
}

/// Random vector with coordinates of magnitude up to `most`.
fn vector(rng: &mut impl Rng, most: f64) -> DVec3 {
    let mut coordinate = || rng.random_range(-most..most);
    DVec3::new(coordinate(), coordinate(), coordinate())
}

/// Random rotation by up to about `most` radians about each axis.
fn turn(rng: &mut impl Rng, most: f64) -> DQuat {
    DQuat::from_scaled_axis(vector(rng, most))
}

/// Standard normal variate (Box–Muller).
pub fn normal(rng: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random_range(0.0..1.0));
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

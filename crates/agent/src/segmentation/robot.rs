//! Projection of the robot into an image, from its joint positions.

use genmanip_core::{Pose, RgbdImage, RobotModel};
use genmanip_motion::{GeometryError, triangulate};
use glam::{DVec2, DVec3};

/// Depth of the near clipping plane (m).
const NEAR_M: f64 = 0.02;

/// Triangulated collision pieces of the robot, rasterised into a silhouette.
#[derive(Clone, Debug)]
pub struct RobotSilhouette {
    robot: RobotModel,
    /// Link index, vertices in the link frame, triangles.
    pieces: Vec<(usize, Vec<DVec3>, Vec<[u32; 3]>)>,
    /// Depth margin in front of the pieces that still counts as the robot (m): the pieces are approximate and depth is
    /// noisy.
    pub margin_m: f64,
    /// Dilation of the silhouette (px), for the same reason.
    pub widened_px: usize,
}

impl RobotSilhouette {
    /// Triangulates the robot's collision pieces.
    ///
    /// # Errors
    /// Fails if a piece is invalid.
    pub fn new(robot: &RobotModel) -> Result<Self, GeometryError> {
        let mut pieces = Vec::new();
        for (link, model) in robot.links.iter().enumerate() {
            for piece in &model.pieces {
                let (corners, triangles) = triangulate(piece)?;
                pieces.push((link, corners, triangles));
            }
        }
        // 15 mm: padding of the pieces and a margin, chosen from images of the robot at home.
        Ok(Self { robot: robot.clone(), pieces, margin_m: 0.015, widened_px: 2 })
    }

    /// True for each pixel that sees the robot at the given arm joint positions (rad) and gripper opening (m).
    ///
    /// A pixel without depth counts as robot if the robot projects onto it.
    pub fn pixels(&self, arm: &[f64], gripper_width: f64, image: &RgbdImage) -> Vec<bool> {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let world_from_link = self.robot.link_poses(arm, gripper_width);
        let camera_from_world = image.world_from_camera.inverse();
        let mut nearest = vec![f32::INFINITY; width * height];
        for (link, corners, triangles) in &self.pieces {
            let camera_from_link: Pose = camera_from_world * world_from_link[*link];
            let seen: Vec<Option<(DVec2, f64)>> = corners
                .iter()
                .map(|corner| {
                    let point = camera_from_link.transform_point(*corner);
                    (point.z > NEAR_M).then(|| image.intrinsics.project(point).map(|pixel| (pixel, point.z)))?
                })
                .collect();
            for triangle in triangles {
                let [Some(a), Some(b), Some(c)] = triangle.map(|corner| seen[corner as usize]) else { continue };
                fill(&mut nearest, [width, height], [a, b, c]);
            }
        }
        let nearest = widened(&nearest, width, self.widened_px);
        let is_robot = |(index, nearest): (usize, &f32)| {
            let depth_m = image.depth_m.get(index).copied().unwrap_or(0.0);
            let is_seen = depth_m > 0.0 && depth_m.is_finite();
            nearest.is_finite() && !(is_seen && f64::from(depth_m) < f64::from(*nearest) - self.margin_m)
        };
        nearest.iter().enumerate().map(is_robot).collect()
    }
}

/// Rasterises a triangle's depth with a depth test.
fn fill(nearest: &mut [f32], [width, height]: [usize; 2], corners: [(DVec2, f64); 3]) {
    let [(a, za), (b, zb), (c, zc)] = corners;
    let area = (b - a).perp_dot(c - a);
    let low = a.min(b).min(c).max(DVec2::ZERO).ceil();
    let high = a.max(b).max(c).floor();
    if area.abs() < 1e-9 || high.x < 0.0 || high.y < 0.0 {
        return;
    }
    let (last_x, last_y) =
        ((high.x as usize).min(width.saturating_sub(1)), (high.y as usize).min(height.saturating_sub(1)));
    for y in low.y as usize..=last_y {
        for x in low.x as usize..=last_x {
            let pixel = DVec2::new(x as f64, y as f64);
            let (u, v) = ((b - pixel).perp_dot(c - pixel) / area, (c - pixel).perp_dot(a - pixel) / area);
            let w = 1.0 - u - v;
            if u < 0.0 || v < 0.0 || w < 0.0 {
                continue;
            }
            let depth_m = 1.0 / (u / za + v / zb + w / zc);
            let place = &mut nearest[y * width + x];
            *place = place.min(depth_m as f32);
        }
    }
}

/// Minimum filter of radius `by` (px), separable.
fn widened(values: &[f32], width: usize, by: usize) -> Vec<f32> {
    let height = values.len() / width.max(1);
    let along = |values: &[f32], step: usize, position: &dyn Fn(usize) -> usize, count: usize| -> Vec<f32> {
        (0..values.len())
            .map(|index| {
                let at = position(index);
                let (back, ahead) = (at.min(by), (count - 1 - at).min(by));
                (index - back * step..=index + ahead * step).step_by(step).fold(f32::INFINITY, |m, i| m.min(values[i]))
            })
            .collect()
    };
    let rows = along(values, 1, &|index| index % width, width);
    along(&rows, width, &|index| index / width, height)
}

//! Motion blur during the exposure.
//!
//! A blurred image is the mean, in linear light, of sharp images of states that are evenly spread over the exposure;
//! the latest of them is the present state. Bodies move linearly between known states.

#[cfg(test)]
mod tests;

use genmanip_core::{Camera, Pose};
use glam::{DVec2, DVec3};

use crate::job::{FrameBuffers, FrameState};
use crate::scene::assets::RenderAssets;
use crate::scene::texture::{linear_from_srgb8, srgb8_from_linear};

/// Motion in the image below which an image stays sharp (px).
const SHARP_PX: f64 = 0.5;
/// Largest number of averaged images; otherwise one per pixel of motion.
const MOST_PICTURES: usize = 16;
/// Distance between evaluated pixels along rows and columns (px).
const STRIDE: usize = 3;
/// Distance at which the motion of the background is computed (m); practically infinite.
const FAR_M: f64 = 1000.0;

/// Present and recent states of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Past<'a> {
    /// States, newest first; index 0 is the present. Before the last one everything is taken to be at rest.
    pub moments: &'a [FrameState],
    /// Time between two states (s).
    pub step_s: f64,
}

impl Past<'_> {
    /// Number of states, the present one included, that cover an exposure time.
    pub fn moments_within(shutter_s: f64, step_s: f64) -> usize {
        1 + (shutter_s / step_s - 1e-9).ceil().max(0.0) as usize
    }

    /// State `ago_s` before the present, interpolated linearly between known states.
    fn at(&self, ago_s: f64) -> FrameState {
        let (place, last) = (ago_s / self.step_s, self.moments.len() - 1);
        let index = (place as usize).min(last);
        let (later, earlier) = (&self.moments[index], &self.moments[(index + 1).min(last)]);
        let share = (place - index as f64).min(1.0);
        let poses = later.body_poses.iter().zip(&earlier.body_poses);
        FrameState { body_poses: poses.map(|(later, earlier)| later.interpolate(earlier, share)).collect() }
    }
}

/// States to be averaged with the present one for a camera; none for a sharp image.
///
/// Their number follows from the longest image motion of the surfaces in `picture`, the present [`super::pinhole`]
/// image with depth and parts.
pub fn moments(
    assets: &RenderAssets,
    pinhole: &Camera,
    picture: &FrameBuffers,
    past: Past<'_>,
    shutter_s: f64,
) -> Vec<FrameState> {
    if shutter_s <= 0.0 || past.moments.len() < 2 {
        return Vec::new();
    }
    let way_px = longest_way_px(assets, pinhole, picture, past, shutter_s);
    let count = if way_px < SHARP_PX { 1 } else { (way_px.ceil() as usize).min(MOST_PICTURES) };
    (1..count).map(|index| past.at(shutter_s * index as f64 / count as f64)).collect()
}

/// Longest motion of any evaluated pixel's surface in the image during the exposure (px).
fn longest_way_px(
    assets: &RenderAssets,
    pinhole: &Camera,
    picture: &FrameBuffers,
    past: Past<'_>,
    shutter_s: f64,
) -> f64 {
    let knots = Past::moments_within(shutter_s, past.step_s).min(past.moments.len());
    let times = (0..knots).map(|knot| (knot as f64 * past.step_s).min(shutter_s));
    let states: Vec<FrameState> = times.map(|ago_s| past.at(ago_s)).collect();
    let cameras: Vec<Pose> =
        states.iter().map(|state| pinhole.world_from_camera(&assets.world_from_hand(state))).collect();
    // Transformations from present to earlier camera axes, for points that move with a body; `None` is fixed in the
    // world, like the background.
    let then_from_now = |body: Option<usize>| -> Vec<Pose> {
        let camera_from = |index: usize| {
            cameras[index].inverse() * body.map_or(Pose::IDENTITY, |body| states[index].body_poses[body])
        };
        let part_from_camera = camera_from(0).inverse();
        (1..states.len()).map(|index| camera_from(index) * part_from_camera).collect()
    };
    let ways: Vec<Vec<Pose>> =
        std::iter::once(None).chain(assets.parts.iter().map(|part| part.body)).map(then_from_now).collect();
    let (width, intrinsics) = (picture.width as usize, &pinhole.intrinsics);
    let mut longest: f64 = 0.0;
    for row in (0..picture.height as usize).step_by(STRIDE) {
        for column in (0..width).step_by(STRIDE) {
            let pixel = row * width + column;
            let part = usize::from(picture.parts[pixel]);
            let depth_m = if part == 0 { FAR_M } else { f64::from(picture.depth_m[pixel]) };
            let mut last = DVec2::new(column as f64, row as f64);
            let point: DVec3 = intrinsics.unproject(last, depth_m);
            let mut way = 0.0;
            for then_from_now in &ways[part] {
                // A point that was behind the camera has no image position then.
                let Some(place) = intrinsics.project(then_from_now.transform_point(point)) else { break };
                way += place.distance(last);
                last = place;
            }
            longest = longest.max(way);
        }
    }
    longest
}

/// Mean in linear light of 8-bit sRGB images of the same size.
pub fn mean(pictures: &[Vec<u8>]) -> Vec<u8> {
    let Some(first) = pictures.first() else { return Vec::new() };
    let share = 1.0 / pictures.len() as f32;
    let pixel = |index: usize| {
        let light = |picture: &Vec<u8>| linear_from_srgb8([picture[index], picture[index + 1], picture[index + 2]]);
        srgb8_from_linear(pictures.iter().map(light).sum::<glam::Vec3A>() * share)
    };
    (0..first.len()).step_by(3).flat_map(pixel).collect()
}

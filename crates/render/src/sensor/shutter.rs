//! A shutter that is open for a while: what moves meanwhile is blurred.
//!
//! A blurred picture is the mean of sharp ones, in linear light, of moments spread evenly over the time that the shutter
//! is open; the last one is the moment of the picture. Between known moments bodies are taken to move evenly.

#[cfg(test)]
mod tests;

use genmanip_core::{Camera, Pose};
use glam::{DVec2, DVec3};

use crate::job::{FrameBuffers, FrameState};
use crate::scene::assets::RenderAssets;
use crate::scene::texture::{linear_from_srgb8, srgb8_from_linear};

/// What moves less on the image while the shutter is open is sharp, pixels.
const SHARP_PX: f64 = 0.5;
/// Most pictures that one is made of; as many as the longest way on the image has pixels, if that is fewer.
const MOST_PICTURES: usize = 16;
/// Pixels between those whose ways are looked at, across and down.
const STRIDE: usize = 3;
/// How far the background is away, m.
const FAR_M: f64 = 1000.0;

/// Where everything was until now.
#[derive(Clone, Copy, Debug)]
pub struct Past<'a> {
    /// This moment, and the ones before it, one after the other; nothing moved before the last of them.
    pub moments: &'a [FrameState],
    /// Time between two of them, s.
    pub step_s: f64,
}

impl Past<'_> {
    /// How many moments tell all that happened while a shutter was open.
    pub fn moments_within(shutter_s: f64, step_s: f64) -> usize {
        1 + (shutter_s / step_s - 1e-9).ceil().max(0.0) as usize
    }

    /// Where everything was a while ago.
    fn at(&self, ago_s: f64) -> FrameState {
        let (place, last) = (ago_s / self.step_s, self.moments.len() - 1);
        let index = (place as usize).min(last);
        let (later, earlier) = (&self.moments[index], &self.moments[(index + 1).min(last)]);
        let share = (place - index as f64).min(1.0);
        let poses = later.body_poses.iter().zip(&earlier.body_poses);
        FrameState { body_poses: poses.map(|(later, earlier)| later.interpolate(earlier, share)).collect() }
    }
}

/// The moments besides the present one whose pictures, with its own, make up the picture of a camera: none for a sharp
/// one.
///
/// How many there are follows from the longest way of what its [`super::pinhole`] shows now, a picture with depth and
/// parts; what is no longer in view is not looked at.
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

/// The longest way on the image of anything in a picture while the shutter was open, pixels.
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
    // From camera axes now to camera axes then, for what moves with each part; the background stands with the world.
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
                // What was behind the camera has no place on the image.
                let Some(place) = intrinsics.project(then_from_now.transform_point(point)) else { break };
                way += place.distance(last);
                last = place;
            }
            longest = longest.max(way);
        }
    }
    longest
}

/// The mean of pictures of one size in 8-bit sRGB, in linear light.
pub fn mean(pictures: &[Vec<u8>]) -> Vec<u8> {
    let Some(first) = pictures.first() else { return Vec::new() };
    let share = 1.0 / pictures.len() as f32;
    let pixel = |index: usize| {
        let light = |picture: &Vec<u8>| linear_from_srgb8([picture[index], picture[index + 1], picture[index + 2]]);
        srgb8_from_linear(pictures.iter().map(light).sum::<glam::Vec3A>() * share)
    };
    (0..first.len()).step_by(3).flat_map(pixel).collect()
}

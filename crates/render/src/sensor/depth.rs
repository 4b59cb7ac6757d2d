//! Stereo depth: occlusion in the second imager, weak returns and disparity noise.

use genmanip_core::glam::DVec2;
use genmanip_core::{DepthSensor, Intrinsics, Seed};
use glam::Vec3;
use rand::{Rng, RngExt};

use super::noise::bell;
use crate::job::FrameBuffers;

/// Relative difference in depth from which neighbouring pixels count as different surfaces. Chosen by hand.
const EDGE: f32 = 0.02;
/// Probabilities that a pixel at a depth edge has no depth, or the depth of a neighbour. Chosen by hand.
const EDGE_LOST: f32 = 0.25;
const EDGE_MIXED: f32 = 0.25;
/// Difference in disparity (px) from which a nearer surface occludes a pixel in the second imager. On slanted surfaces,
/// half of the neighbouring pixels differ by less.
const HIDING_PX: f32 = 1.0;
/// Size (px) of patches with weaker or stronger returns, and relative amplitude. Chosen by hand: patches make missing
/// pixels connected, as in real cameras.
const PATCH_PX: usize = 6;
const PATCH_SHARE: f32 = 0.6;

/// Depth (m) that the sensor measures from an ideal image, row by row; 0 for no measurement.
///
/// `returns` is the retroreflected share of light of each part; `picture` must hold depth, normals and parts.
pub(super) fn measured(
    settings: &DepthSensor,
    intrinsics: &Intrinsics,
    picture: &FrameBuffers,
    returns: &[f32],
    seed: Seed,
) -> Vec<f32> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let seen = Seen { settings, intrinsics, width, height, depth_m: &picture.depth_m };
    let hidden = seen.hidden();
    let error = smooth_noise(width, height, &mut seed.fork("disparity").rng());
    let patches = Patches::new(width, height, &mut seed.fork("patches").rng());
    let edges = &mut seed.fork("edges").rng();
    let disparity_m = (settings.focal_length_px * settings.baseline_m.abs()) as f32;
    let (step, sigma) = (settings.disparity_step_px as f32, settings.disparity_error_px as f32);
    let (least_cosine, least_return) = (settings.least_cosine as f32, settings.least_return as f32);
    let [near, far] = settings.range_m.map(|limit| limit as f32);
    let mut depth_m = Vec::with_capacity(width * height);
    for index in 0..width * height {
        let (column, row) = (index % width, index / width);
        // Every pixel draws two numbers, so that the noise of one does not depend on the others.
        let (coin, side) = (edges.random::<f32>(), edges.random_range(0..4_usize));
        let mut is_lost = hidden[index] || !seen.is_in_view(column, row);
        let mut true_m = picture.depth_m[index];
        let around = seen.around(column, row);
        if around.iter().any(|other| (other - true_m).abs() > EDGE * true_m) {
            is_lost |= coin < EDGE_LOST;
            if coin > 1.0 - EDGE_MIXED {
                true_m = around[side];
            }
        }
        let cosine = seen.cosine(column, row, picture.normal[index]);
        let returned = usize::from(picture.parts[index]).checked_sub(1).and_then(|part| returns.get(part));
        let strength = returned.map_or(0.0, |returned| returned * cosine) * patches.at(column, row);
        is_lost |= cosine < least_cosine || strength < least_return || true_m <= 0.0;
        let measured = if is_lost {
            0.0
        } else {
            let disparity = disparity_m / true_m + sigma * error[index];
            let stepped = if step > 0.0 { (disparity / step).round() * step } else { disparity };
            disparity_m / stepped
        };
        depth_m.push(if (near..=far).contains(&measured) { measured } else { 0.0 });
    }
    depth_m
}

/// Ideal depth image (m, 0 for the background), with the sensor that measures it.
struct Seen<'a> {
    settings: &'a DepthSensor,
    intrinsics: &'a Intrinsics,
    width: usize,
    height: usize,
    depth_m: &'a [f32],
}

impl Seen<'_> {
    /// Per pixel: true if it is occluded in the second imager, or outside that imager's field of view.
    fn hidden(&self) -> Vec<bool> {
        let Intrinsics { fx, cx, .. } = *self.intrinsics;
        let shift = (fx * self.settings.baseline_m) as f32;
        let edge = (self.settings.field_of_view_deg[0].to_radians() / 2.0).tan() * fx;
        let (first, last) = ((cx - edge) as f32, (cx + edge) as f32);
        // Row of the second imager: largest disparity per pixel. The row is twice as wide as the image, to hold shifted
        // pixels.
        let reach = self.width * 2;
        let mut nearest = vec![0.0_f32; reach];
        let mut hidden = Vec::with_capacity(self.depth_m.len());
        for row in self.depth_m.chunks_exact(self.width) {
            nearest.fill(0.0);
            let disparity = |depth: f32| if depth > 0.0 { shift / depth } else { 0.0 };
            // Index in that row of an image column; the row begins half an image width to the left of the image, and
            // indices are clamped.
            let column = |at: f32| ((at + 0.5 * self.width as f32).max(0.0) as usize).min(reach - 1);
            for (index, &depth) in row.iter().enumerate() {
                let disparity = disparity(depth);
                let at = index as f32 - disparity;
                // A shifted pixel is one pixel wide; an overlap of less than a quarter is ignored.
                for place in [column(at + 0.25), column(at + 0.75)] {
                    nearest[place] = nearest[place].max(disparity.abs());
                }
            }
            hidden.extend(row.iter().enumerate().map(|(index, &depth)| {
                let disparity = disparity(depth);
                let at = index as f32 - disparity;
                let is_outside = at < first || at > last;
                is_outside || nearest[column(at + 0.5)] > disparity.abs() + HIDING_PX
            }));
        }
        hidden
    }

    /// True if a pixel lies in the field of view of the first imager.
    fn is_in_view(&self, column: usize, row: usize) -> bool {
        let [horizontal, vertical] = self.settings.field_of_view_deg.map(|angle| (angle.to_radians() / 2.0).tan());
        let Intrinsics { fx, fy, cx, cy, .. } = *self.intrinsics;
        ((column as f64 - cx) / fx).abs() <= horizontal && ((row as f64 - cy) / fy).abs() <= vertical
    }

    /// Depth (m) of the four neighbours of a pixel; beyond the image border the pixel's own depth.
    fn around(&self, column: usize, row: usize) -> [f32; 4] {
        let at = |column: usize, row: usize| self.depth_m[row * self.width + column];
        [
            at(column.saturating_sub(1), row),
            at((column + 1).min(self.width - 1), row),
            at(column, row.saturating_sub(1)),
            at(column, (row + 1).min(self.height - 1)),
        ]
    }

    /// Cosine between a normal (times 127) and the direction to the camera; 0 for the background.
    fn cosine(&self, column: usize, row: usize, normal: [i8; 3]) -> f32 {
        let ray = self.intrinsics.unproject(DVec2::new(column as f64, row as f64), 1.0).as_vec3();
        -ray.normalize().dot(Vec3::from_array(normal.map(f32::from)).normalize_or_zero())
    }
}

/// Noise of variance 1 per pixel, correlated like that of a stereo matcher with a window: three times the mean of white
/// noise over 3×3 pixels.
fn smooth_noise(width: usize, height: usize, rng: &mut impl Rng) -> Vec<f32> {
    let mut across = |_| {
        let white: Vec<f32> = (0..width + 2).map(|_| bell(rng)).collect();
        white.windows(3).map(|three| three[0] + three[1] + three[2]).collect::<Vec<f32>>()
    };
    let mut rows: Vec<Vec<f32>> = (0..2).map(&mut across).collect();
    let mut noise = Vec::with_capacity(width * height);
    for row in 0..height {
        rows.push(across(row));
        let [above, own, below] = [&rows[row], &rows[row + 1], &rows[row + 2]];
        noise.extend((0..width).map(|column| (above[column] + own[column] + below[column]) / 3.0));
        rows[row] = Vec::new();
    }
    noise
}

/// Factors on the returned light, bilinearly interpolated between random values around 1.
struct Patches {
    columns: usize,
    factors: Vec<f32>,
}

impl Patches {
    fn new(width: usize, height: usize, rng: &mut impl Rng) -> Self {
        let (columns, rows) = (width / PATCH_PX + 2, height / PATCH_PX + 2);
        let factors = (0..columns * rows).map(|_| 1.0 + PATCH_SHARE * (2.0 * rng.random::<f32>() - 1.0)).collect();
        Self { columns, factors }
    }

    fn at(&self, column: usize, row: usize) -> f32 {
        let (x, y) = (column as f32 / PATCH_PX as f32, row as f32 / PATCH_PX as f32);
        let first = row / PATCH_PX * self.columns + column / PATCH_PX;
        let (right, down) = (x.fract(), y.fract());
        let mix = |from: usize| self.factors[from] * (1.0 - right) + self.factors[from + 1] * right;
        mix(first) * (1.0 - down) + mix(first + self.columns) * down
    }
}

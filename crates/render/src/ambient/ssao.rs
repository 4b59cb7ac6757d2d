//! Screen-space ambient occlusion (SSAO) after McGuire et al., "Scalable Ambient Obscurance", 2012.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::Vec2;
use multiversion::multiversion;

use crate::gbuffer::points::{PATTERN, Points};
use crate::gbuffer::view::CameraView;
use crate::scene::variation::RenderVariation;
use crate::shadow::pcss::turn_of;
use crate::simd::{BatchColumn, Column, dot, nearest_integer, whole_registers, within};

/// Number of taps per point. Chosen by hand.
const TAPS: usize = 8;
/// Scale of the occlusion at strength 1. Fitted to path-traced images.
const DARKNESS: f32 = 1.375;
/// Height above a support surface below which taps do not occlude (m). Chosen by hand: thinner objects cause no visible
/// occlusion.
const FLAT_M: f32 = 0.004;
/// Largest radius of the taps in the image (px).
pub(crate) const MAX_REACH: f32 = 64.0;

/// Writes the share of the ambient light that reaches each point, at least 0.15, to `taps.share`. A support surface at
/// height `ground` (m) does not occlude, since its reflection is part of the ambient light.
pub(crate) fn occlude(
    points: &Points,
    depth: &[f32],
    size: [usize; 2],
    camera: &CameraView,
    ground: Option<f32>,
    variation: &RenderVariation,
    taps: &mut SsaoTaps,
) {
    let focal = camera.focal.x;
    let radius = variation.occlusion_radius_m;
    taps.begin(points, focal, radius);
    place_taps(taps, points, size);
    for (index, seen) in taps.index.iter().zip(&mut taps.depth) {
        for i in 0..points.count {
            seen[i] = depth[index[i] as usize];
        }
    }
    let up = camera.turn.row(2).to_array();
    add_taps(taps, points, focal, radius, (up, ground.map_or(f32::NEG_INFINITY, |top| top + FLAT_M)));
    let scale = DARKNESS * variation.occlusion_strength / (radius.powi(5) * TAPS as f32);
    for i in 0..whole_registers(points.count) {
        let share = 1.0 - taps.darkening[i] * scale;
        taps.share[i] = if share > 0.15 { share } else { 0.15 };
    }
}

/// Taps around each point of a batch, and the results.
#[derive(Debug, Default)]
pub(crate) struct SsaoTaps {
    cosine: BatchColumn,
    sine: BatchColumn,
    /// Offset of each tap from the point (px).
    dx: [BatchColumn; TAPS],
    dy: [BatchColumn; TAPS],
    index: [Column<u32>; TAPS],
    depth: [BatchColumn; TAPS],
    darkening: BatchColumn,
    pub share: BatchColumn,
}

impl SsaoTaps {
    /// Sets the rotation and the image radius of each point's taps.
    fn begin(&mut self, points: &Points, focal: f32, radius: f32) {
        for i in 0..points.count {
            let reach = within(radius * focal / points.place_in_camera[2][i], 3.0, MAX_REACH);
            // Points lie at every second pixel; the rotations repeat after 4×4 points.
            let turn = |lane: &BatchColumn| nearest_integer(lane[i]) as usize / 2 % 4;
            let (sine, cosine) = turn_of(PATTERN[turn(&points.row)][turn(&points.column)]);
            (self.cosine[i], self.sine[i]) = (cosine * reach, sine * reach);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn place_taps(taps: &mut SsaoTaps, points: &Points, [width, height]: [usize; 2]) {
    let (last_column, last_row, width) = ((width - 1) as i32 as f32, (height - 1) as i32 as f32, width as u32);
    let (cosines, sines) = (&taps.cosine, &taps.sine);
    let places = taps.dx.iter_mut().zip(&mut taps.dy).zip(&mut taps.index);
    for (offset, ((dx, dy), index)) in spiral().iter().zip(places) {
        for i in 0..whole_registers(points.count) {
            let column = offset[0].mul_add(cosines[i], offset[1].mul_add(-sines[i], points.column[i]));
            let row = offset[0].mul_add(sines[i], offset[1].mul_add(cosines[i], points.row[i]));
            let (column, row) = (within(column, 0.0, last_column), within(row, 0.0, last_row));
            let (column, row) = (nearest_integer(column), nearest_integer(row));
            dx[i] = column as i32 as f32 - points.column[i];
            dy[i] = row as i32 as f32 - points.row[i];
            index[i] = row * width + column;
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_taps(taps: &mut SsaoTaps, points: &Points, focal: f32, radius: f32, (up, lowest): ([f32; 3], f32)) {
    let inverse_focal = 1.0 / focal;
    let square_radius = radius * radius;
    for i in 0..whole_registers(points.count) {
        let (x, y, z) = (points.place_in_camera[0][i], points.place_in_camera[1][i], points.place_in_camera[2][i]);
        let normal = [points.normal_in_camera[0][i], points.normal_in_camera[1][i], points.normal_in_camera[2][i]];
        let bias = z.mul_add(0.002, 0.001);
        let above_lowest = points.place[2][i] - lowest;
        let mut darkening = 0.0;
        for tap in 0..TAPS {
            let depth = taps.depth[tap][i];
            // The tap's view ray is the point's view ray shifted by whole pixels. The background (depth 0) lies outside
            // the radius.
            let stretch = depth / z - 1.0;
            let step = depth * inverse_focal;
            let beside = |shift: f32, place: f32| stretch.mul_add(place, shift * step);
            let toward = [beside(taps.dx[tap][i], x), beside(taps.dy[tap][i], y), depth - z];
            let square = dot(toward, toward);
            let near = if square_radius > square { square_radius - square } else { 0.0 };
            let above = dot(toward, normal) - bias;
            let above = if above > 0.0 && dot(toward, up) + above_lowest > 0.0 { above } else { 0.0 };
            darkening += near * near * near * above / (square + 1e-5);
        }
        taps.darkening[i] = darkening;
    }
}

/// Offsets of the taps on a spiral in the unit disc.
fn spiral() -> &'static [[f32; 2]; TAPS] {
    static TABLE: std::sync::OnceLock<[[f32; 2]; TAPS]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|tap| {
            let share = (tap as f32 + 0.5) / TAPS as f32;
            (Vec2::from_angle(std::f32::consts::TAU * share * 3.0) * share).to_array()
        })
    })
}

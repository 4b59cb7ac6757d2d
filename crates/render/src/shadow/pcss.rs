//! Shadow-map taps of percentage-closer soft shadows (PCSS).

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use std::sync::OnceLock;

use glam::Vec2;
use multiversion::multiversion;

use crate::raster::VisibilityBuffer;
use crate::simd::{BatchColumn, CHUNK, Column, nearest_integer, whole_registers, within};

/// Shadow mask of points that face away from the light, and of pixels without a value.
pub(crate) const UNKNOWN: f32 = -1.0;
/// Number of taps of the blocker search, and of the filter.
pub(crate) const TAPS: usize = 8;
/// Share of the key light that transparent casters block; their texels have the lowest bit set. Fitted to path-traced
/// images: more than clear glass reflects, since its edges are seen at grazing angles.
pub(crate) const GLASS_SHADE: f32 = 0.5;
/// Exponent that concentrates the taps of the blocker search. Fitted to path-traced images.
const NEAR: f32 = 2.0;
/// Number of rotations of the sampling pattern.
const TURNS: usize = 16;

/// Batch of unresolved shadow samples.
#[derive(Debug, Default)]
pub(crate) struct SampleQueue {
    pub count: usize,
    pub pixel: Column<u32>,
    /// Position in the shadow map (texels) with its reversed z, gradient of the receiving plane's reversed z, rotation
    /// of the sampling pattern, and its radius (texels).
    pub x: BatchColumn,
    pub y: BatchColumn,
    pub reversed_z: BatchColumn,
    pub tilt_x: BatchColumn,
    pub tilt_y: BatchColumn,
    pub cosine: BatchColumn,
    pub sine: BatchColumn,
    pub radius: BatchColumn,
}

impl SampleQueue {
    /// Copies sample `from` of another queue with a new radius; returns true if this queue is then full.
    #[inline(always)]
    pub fn push(&mut self, other: &Self, from: usize, radius: f32) -> bool {
        let to = self.count;
        self.pixel[to] = other.pixel[from];
        (self.x[to], self.y[to], self.reversed_z[to]) = (other.x[from], other.y[from], other.reversed_z[from]);
        (self.tilt_x[to], self.tilt_y[to]) = (other.tilt_x[from], other.tilt_y[from]);
        (self.cosine[to], self.sine[to], self.radius[to]) = (other.cosine[from], other.sine[from], radius);
        self.count += 1;
        self.count == CHUNK
    }
}

/// Tap positions on the unit disc.
pub(crate) type Pattern = [[f32; 2]; TAPS];

/// Counts the taps that are closer to the light than the receiving plane, and sums their distances in reversed z;
/// transparent casters count with [`GLASS_SHADE`].
pub(crate) fn tap(queue: &SampleQueue, map: &VisibilityBuffer, pattern: &Pattern, taps: &mut PcfTaps) {
    place_taps(queue, [map.width, map.stride], pattern, taps);
    for (index, stored) in taps.index.iter().zip(&mut taps.stored) {
        for i in 0..queue.count {
            stored[i] = map.reversed_z[index[i] as usize];
        }
    }
    add_taps(taps, queue.count);
}

/// Shadow-map lookups (taps) of a batch of samples, and their sums.
#[derive(Debug, Default)]
pub(crate) struct PcfTaps {
    index: [Column<u32>; TAPS],
    /// Reversed z of the receiving plane at the taps.
    plane: [BatchColumn; TAPS],
    stored: [BatchColumn; TAPS],
    pub blockers: BatchColumn,
    pub distance: BatchColumn,
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn place_taps(queue: &SampleQueue, [width, stride]: [usize; 2], pattern: &Pattern, taps: &mut PcfTaps) {
    let limit = (width - 1) as i32 as f32;
    let stride = stride as u32;
    for ((offset, index), plane) in pattern.iter().zip(&mut taps.index).zip(&mut taps.plane) {
        for i in 0..whole_registers(queue.count) {
            let (cosine, sine, radius) = (queue.cosine[i], queue.sine[i], queue.radius[i]);
            let dx = offset[0].mul_add(cosine, -offset[1] * sine) * radius;
            let dy = offset[0].mul_add(sine, offset[1] * cosine) * radius;
            let column = nearest_integer(within(queue.x[i] + dx, 0.0, limit));
            let row = nearest_integer(within(queue.y[i] + dy, 0.0, limit));
            index[i] = row * stride + column;
            plane[i] = dx.mul_add(queue.tilt_x[i], dy.mul_add(queue.tilt_y[i], queue.reversed_z[i]));
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn add_taps(taps: &mut PcfTaps, count: usize) {
    for i in 0..whole_registers(count) {
        let (mut blockers, mut distance) = (0.0, 0.0);
        for (stored, plane) in taps.stored.iter().zip(&taps.plane) {
            let ahead = stored[i] - plane[i];
            let weight = if stored[i].to_bits() & 1 == 1 { GLASS_SHADE } else { 1.0 };
            blockers += if ahead > 0.0 { weight } else { 0.0 };
            distance = (if ahead > 0.0 { ahead } else { 0.0 }).mul_add(weight, distance);
        }
        (taps.blockers[i], taps.distance[i]) = (blockers, distance);
    }
}

/// Pattern of the filter, of uniform density.
pub(crate) fn even_pattern() -> &'static Pattern {
    static PATTERN: OnceLock<Pattern> = OnceLock::new();
    PATTERN.get_or_init(|| vogel_spiral(0.5))
}

/// Pattern of the blocker search, denser near its centre: blockers close to the receiver cast the sharpest shadows.
pub(crate) fn near_pattern() -> &'static Pattern {
    static PATTERN: OnceLock<Pattern> = OnceLock::new();
    PATTERN.get_or_init(|| vogel_spiral(NEAR))
}

/// Vogel spiral on the unit disc; `power` is the exponent of the radii, 0.5 for uniform density.
fn vogel_spiral(power: f32) -> Pattern {
    std::array::from_fn(|tap| {
        (Vec2::from_angle(tap as f32 * 2.399_963) * ((tap as f32 + 0.5) / TAPS as f32).powf(power)).to_array()
    })
}

/// Sine and cosine of rotation number `turn`, modulo [`TURNS`].
pub(crate) fn turn_of(turn: u8) -> (f32, f32) {
    static TABLE: OnceLock<[(f32, f32); TURNS]> = OnceLock::new();
    let turns = TABLE
        .get_or_init(|| std::array::from_fn(|turn| (turn as f32 * std::f32::consts::TAU / TURNS as f32).sin_cos()));
    turns[turn as usize % TURNS]
}

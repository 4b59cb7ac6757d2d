//! Means of arriving light over five by five pixels, within one surface.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use std::ops::Range;

use multiversion::multiversion;

use super::upsample::HALF;
use super::{Changes, LightBuffer, ON_TOP, SAME_DEPTH, put};
use crate::gbuffer::static_layer::{TILE, marked_around};
use crate::shadow::pcss::UNKNOWN;

/// Values around one that its blur reads, on each side.
const MARGIN: usize = 2;
/// How much each of five values counts, and all of them.
const WEIGHTS: [f32; 5] = [0.5, 1.0, 1.0, 1.0, 0.5];
const WEIGHT: f32 = 4.0;
/// Rows and columns of a tile with its surroundings.
const WINDOW: usize = TILE + 2 * MARGIN;
/// The same where four pixels share a value.
const COARSE_WINDOW: usize = TILE + 4 * MARGIN;
/// The same of the coarse grid of the ambient light.
const HALF_WINDOW: usize = HALF + 2 * MARGIN;

impl LightBuffer {
    /// Blurs tiles among some, whole rows of them, where estimates in them or next to them have changed.
    pub fn blur(&mut self, tiles: Range<usize>) {
        let mut windows = std::mem::take(&mut self.windows);
        for tile in marked_around(&self.changed.estimates, self.columns, tiles) {
            self.planar_around[tile] = self.is_planar_around(tile);
            let key = |own: &Self| own.square(&own.shadow_mask, tile);
            let half = |own: &Self| own.half_square(&own.half_ao, tile);
            let Changes { light, estimates, .. } = &self.changed;
            let [is_lit_anew, is_new] = [light[tile], estimates[tile]];
            self.changed.light[tile] = self.alters(is_lit_anew, key, |own| own.blur_key(tile, &mut windows));
            self.changed.blurred[tile] = self.alters(is_new, half, |own| own.blur_half(tile, &mut windows));
        }
        self.windows = windows;
    }

    fn blur_key(&mut self, tile: usize, windows: &mut Windows) {
        if self.tiles[tile].top.is_some() {
            return;
        }
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.range_around(tile, &self.ranges.key);
        if low >= high && !self.tiles[tile].has_top {
            // One value all around, which is also that of what faces away from the light.
            self.shadow_mask.fill(tile, [columns, rows], if low == high { low } else { UNKNOWN });
            return;
        }
        self.shadow_mask.set_varying(tile);
        let at = [columns.start, rows.start];
        let blurred = if low >= high {
            [[if low == high { low } else { UNKNOWN }; TILE]; TILE]
        } else if self.tiles[tile].is_coarse && self.tiles[tile].is_planar {
            // Four pixels have one value.
            let weighted = || blur_half_tile::<1>(&mut windows.half, self, &self.raw_shadow_mask, at.map(|at| at / 2));
            let shared = self
                .blur_planar::<2, HALF_WINDOW, HALF>(tile, &self.raw_shadow_mask, self.width, at)
                .unwrap_or_else(weighted);
            std::array::from_fn(|row| std::array::from_fn(|column| shared[row / 2][column / 2]))
        } else if self.tiles[tile].is_coarse {
            blur_coarse_tile(&mut windows.coarse, self, &self.raw_shadow_mask, at)
        } else {
            let weighted = || blur_tile(&mut windows.fine, self, &self.raw_shadow_mask, at);
            self.blur_planar::<1, WINDOW, TILE>(tile, &self.raw_shadow_mask, self.width, at).unwrap_or_else(weighted)
        };
        for (row, line) in rows.zip(&blurred) {
            let pixels = row * self.width + columns.start..row * self.width + columns.end;
            if self.tiles[tile].has_top {
                for ((key, &raw), &blurred) in
                    self.shadow_mask[pixels.clone()].iter_mut().zip(&self.raw_shadow_mask[pixels]).zip(line)
                {
                    *key = if raw > ON_TOP { blurred } else { *key };
                }
            } else {
                put(&mut self.shadow_mask[pixels], line);
            }
        }
    }

    /// [`blur_planar_tile`] for a tile whose values begin at a column and row, if it and those next to it are level.
    #[inline(always)]
    fn blur_planar<const STEP: usize, const SIDE: usize, const OUT: usize>(
        &self,
        tile: usize,
        values: &[f32],
        width: usize,
        at: [usize; 2],
    ) -> Option<[[f32; OUT]; OUT]> {
        self.planar_around[tile]
            .then(|| blur_planar_tile::<STEP, SIDE, OUT>(values, width, at.map(|at| at - MARGIN * STEP)))?
    }

    fn blur_half(&mut self, tile: usize, windows: &mut Windows) {
        let [columns, rows] = self.pixels_of(tile);
        let (columns, rows) = (columns.start / 2..columns.end.div_ceil(2), rows.start / 2..rows.end.div_ceil(2));
        let [low, high] = self.range_around(tile, &self.ranges.ambient);
        self.ranges.ambient_around[tile] = [low, high];
        if low >= high {
            if let Some(value) = self.raw_half_ao.constant(tile) {
                self.half_ao.fill(tile, [columns, rows], value);
                return;
            }
            self.half_ao.set_varying(tile);
            for row in rows {
                let range = row * self.half_width + columns.start..row * self.half_width + columns.end;
                self.half_ao[range.clone()].copy_from_slice(&self.raw_half_ao[range]);
            }
            return;
        }
        self.half_ao.set_varying(tile);
        let at = [columns.start, rows.start];
        let weighted = || blur_half_tile::<2>(&mut windows.half, self, &self.raw_half_ao, at);
        let blurred = self
            .blur_planar::<1, HALF_WINDOW, HALF>(tile, &self.raw_half_ao, self.half_width, at)
            .unwrap_or_else(weighted);
        for (row, line) in rows.zip(&blurred) {
            put(&mut self.half_ao[row * self.half_width..][columns.clone()], line);
        }
    }
}

/// What blurs are made of; memory.
#[derive(Debug, Default)]
pub(super) struct Windows {
    fine: Window<WINDOW, 1>,
    coarse: Window<COARSE_WINDOW, 2>,
    half: Window<HALF_WINDOW, 1>,
}

/// A tile and its surroundings, of which every `STEP`th value counts.
#[derive(Debug)]
struct Window<const SIDE: usize, const STEP: usize> {
    surface: [[u32; SIDE]; SIDE],
    depth: [[f32; SIDE]; SIDE],
    value: [[f32; SIDE]; SIDE],
}

impl<const SIDE: usize, const STEP: usize> Default for Window<SIDE, STEP> {
    fn default() -> Self {
        let zero = [[0.0; SIDE]; SIDE];
        Self { surface: [[0; SIDE]; SIDE], depth: zero, value: [[UNKNOWN; SIDE]; SIDE] }
    }
}

impl<const SIDE: usize, const STEP: usize> Window<SIDE, STEP> {
    /// Values beside the tile on each side.
    const BESIDE: usize = MARGIN * STEP;

    /// Every so many pixels, from values of which there is one per `GRID` pixels; nothing is known beyond the picture.
    #[inline(always)]
    fn load<const PIXELS: usize, const GRID: usize>(
        &mut self,
        light_buffer: &LightBuffer,
        values: &[f32],
        [x0, y0]: [usize; 2],
    ) {
        let (width, height) = match PIXELS {
            1 => (light_buffer.width, light_buffer.height),
            _ => (light_buffer.half_width, light_buffer.half_height),
        };
        let stride = if GRID == 1 { light_buffer.width } else { light_buffer.half_width };
        let from = Self::BESIDE.saturating_sub(x0);
        let to = SIDE.min(width + Self::BESIDE - x0);
        for row in 0..SIDE {
            let Some(y) = (y0 + row).checked_sub(Self::BESIDE).filter(|&y| y < height) else {
                self.value[row] = [UNKNOWN; SIDE];
                continue;
            };
            let x = x0 + from - Self::BESIDE;
            let (values, fine) = (&values[(y * stride + x) * PIXELS / GRID..], (y * light_buffer.width + x) * PIXELS);
            let (depths, surfaces) = (&light_buffer.depth[fine..], &light_buffer.surface[fine..]);
            if to - from == SIDE {
                self.load_line::<PIXELS, GRID>(row, 0..SIDE, [values, depths], surfaces);
            } else {
                self.value[row] = [UNKNOWN; SIDE];
                self.load_line::<PIXELS, GRID>(row, from..to, [values, depths], surfaces);
            }
        }
    }

    /// Some columns of a row, the first of which begin the lists.
    #[inline(always)]
    fn load_line<const PIXELS: usize, const GRID: usize>(
        &mut self,
        row: usize,
        columns: Range<usize>,
        [values, depths]: [&[f32]; 2],
        surfaces: &[u16],
    ) {
        let count = columns.len();
        let last = (count - 1) * PIXELS + 1;
        let last_value = (count - 1) * PIXELS / GRID + 1;
        let (values, depths, surfaces) = (&values[..last_value], &depths[..last], &surfaces[..last]);
        let (value, depth) = (&mut self.value[row][columns.clone()], &mut self.depth[row][columns.clone()]);
        let surface = &mut self.surface[row][columns];
        for i in 0..count {
            value[i] = values[i * PIXELS / GRID];
            depth[i] = depths[i * PIXELS];
            surface[i] = u32::from(surfaces[i * PIXELS]);
        }
    }

    /// Means over five by five, half weight at the borders, within one surface.
    #[inline(always)]
    fn blurred<const OUT: usize>(&self) -> [[f32; OUT]; OUT] {
        let mut lines = [[UNKNOWN; OUT]; SIDE];
        for row in 0..SIDE {
            for column in 0..OUT {
                let (surface, depth) =
                    (self.surface[row][column + Self::BESIDE], self.depth[row][column + Self::BESIDE]);
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = self.value[row][column + tap * STEP];
                    let is_same = (self.surface[row][column + tap * STEP] == surface)
                        & ((self.depth[row][column + tap * STEP] - depth).abs() < SAME_DEPTH * depth)
                        & (value >= 0.0);
                    let weight = if is_same { WEIGHTS[tap] } else { 0.0 };
                    sum += weight * value;
                    total += weight;
                }
                lines[row][column] = if total > 0.0 { sum / total } else { UNKNOWN };
            }
        }
        let mut out = [[UNKNOWN; OUT]; OUT];
        for row in 0..OUT {
            for column in 0..OUT {
                let (surface, depth) = (
                    self.surface[row + Self::BESIDE][column + Self::BESIDE],
                    self.depth[row + Self::BESIDE][column + Self::BESIDE],
                );
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = lines[row + tap * STEP][column];
                    let is_same = (self.surface[row + tap * STEP][column + Self::BESIDE] == surface)
                        & ((self.depth[row + tap * STEP][column + Self::BESIDE] - depth).abs() < SAME_DEPTH * depth)
                        & (value >= 0.0);
                    let weight = if is_same { WEIGHTS[tap] } else { 0.0 };
                    sum += weight * value;
                    total += weight;
                }
                out[row][column] = if total > 0.0 { sum / total } else { UNKNOWN };
            }
        }
        out
    }
}

/// Means over five by five among values of one surface, of which every so many in a row and every so many rows count, from
/// a first column and row on; `None` if any is not known.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn blur_planar_tile<const STEP: usize, const SIDE: usize, const OUT: usize>(
    values: &[f32],
    width: usize,
    [x, y]: [usize; 2],
) -> Option<[[f32; OUT]; OUT]> {
    let mut window = [[0.0; SIDE]; SIDE];
    let mut low = [0.0_f32; SIDE];
    for (row, line) in window.iter_mut().enumerate() {
        let values = &values[(y + row * STEP) * width + x..][..(SIDE - 1) * STEP + 1];
        for column in 0..SIDE {
            line[column] = values[column * STEP];
            low[column] = if line[column] < low[column] { line[column] } else { low[column] };
        }
    }
    if low.iter().fold(false, |is_unknown, &low| is_unknown | (low < 0.0)) {
        return None;
    }
    let (mut lines, mut out) = ([[0.0; OUT]; SIDE], [[0.0; OUT]; OUT]);
    for row in 0..SIDE {
        for column in 0..OUT {
            let sum = (0..5).fold(0.0, |sum, tap| sum + WEIGHTS[tap] * window[row][column + tap]);
            lines[row][column] = sum * (1.0 / WEIGHT);
        }
    }
    for row in 0..OUT {
        for column in 0..OUT {
            let sum = (0..5).fold(0.0, |sum, tap| sum + WEIGHTS[tap] * lines[row + tap][column]);
            out[row][column] = sum * (1.0 / WEIGHT);
        }
    }
    Some(out)
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn blur_tile(
    window: &mut Window<WINDOW, 1>,
    light_buffer: &LightBuffer,
    key: &[f32],
    at: [usize; 2],
) -> [[f32; TILE]; TILE] {
    window.load::<1, 1>(light_buffer, key, at);
    window.blurred()
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn blur_coarse_tile(
    window: &mut Window<COARSE_WINDOW, 2>,
    light_buffer: &LightBuffer,
    key: &[f32],
    at: [usize; 2],
) -> [[f32; TILE]; TILE] {
    window.load::<1, 1>(light_buffer, key, at);
    window.blurred()
}

/// A mean at every other row and column.
#[multiversion(targets("x86_64+avx2+fma"))]
fn blur_half_tile<const GRID: usize>(
    window: &mut Window<HALF_WINDOW, 1>,
    light_buffer: &LightBuffer,
    values: &[f32],
    at: [usize; 2],
) -> [[f32; HALF]; HALF] {
    window.load::<2, GRID>(light_buffer, values, at);
    window.blurred()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// On one level surface, means need no weights and have the same bits.
    #[test]
    fn level_tiles_have_the_means_of_others() {
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let (mut light_buffer, mut windows) = (LightBuffer::default(), Windows::default());
        light_buffer.reset(40, 32);
        light_buffer.surface.fill(1);
        light_buffer.depth.fill(0.5);
        for _ in 0..20 {
            let [key, half]: [Vec<f32>; 2] = [40 * 32, 20 * 16].map(|count| (0..count).map(|_| draw()).collect());
            let fine = blur_planar_tile::<1, WINDOW, TILE>(&key, 40, [8 - MARGIN, 16 - MARGIN]);
            assert_eq!(fine, Some(blur_tile(&mut windows.fine, &light_buffer, &key, [8, 16])));
            let shared = blur_planar_tile::<2, HALF_WINDOW, HALF>(&key, 40, [8 - 2 * MARGIN, 16 - 2 * MARGIN]);
            assert_eq!(shared, Some(blur_half_tile::<1>(&mut windows.half, &light_buffer, &key, [4, 8])));
            let ambient = blur_planar_tile::<1, HALF_WINDOW, HALF>(&half, 20, [4 - MARGIN, 8 - MARGIN]);
            assert_eq!(ambient, Some(blur_half_tile::<2>(&mut windows.half, &light_buffer, &half, [4, 8])));
        }
        assert_eq!(blur_planar_tile::<1, WINDOW, TILE>(&[UNKNOWN; 40 * 32], 40, [0, 0]), None);
    }
}

//! Means of arriving light over five by five pixels, within one surface.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use std::ops::Range;

use multiversion::multiversion;

use super::{Arrival, Changes, LEVEL, ON_TOP, put};
use crate::layers::{TILE, marked_around};
use crate::refine::{HALF, UNKNOWN};

/// Values around one that its blur reads, on each side.
const MARGIN: usize = 2;
/// Rows and columns of a tile with its surroundings.
const WINDOW: usize = TILE + 2 * MARGIN;
/// The same where four pixels share a value.
const COARSE_WINDOW: usize = TILE + 4 * MARGIN;
/// The same of the coarse grid of the ambient light.
const HALF_WINDOW: usize = HALF + 2 * MARGIN;

impl Arrival {
    /// Blurs tiles among some, whole rows of them, where estimates in them or next to them have changed.
    pub fn blur(&mut self, tiles: Range<usize>) {
        let mut windows = std::mem::take(&mut self.windows);
        for tile in marked_around(&self.changed.estimates, self.columns, tiles) {
            let key = |own: &Self| own.square(&own.key, tile);
            let half = |own: &Self| own.half_square(&own.half, tile);
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
        let [low, high] = self.range_around(tile, |tile| tile.key);
        if low >= high && !self.tiles[tile].has_top {
            // One value all around, which is also that of what faces away from the light.
            self.key.fill(tile, [columns, rows], if low == high { low } else { UNKNOWN });
            return;
        }
        self.key.forget(tile);
        let blurred = if low >= high {
            [[if low == high { low } else { UNKNOWN }; TILE]; TILE]
        } else if self.tiles[tile].is_coarse {
            blur_coarse_tile(&mut windows.coarse, self, &self.raw_key, [columns.start, rows.start])
        } else {
            blur_tile(&mut windows.fine, self, &self.raw_key, [columns.start, rows.start])
        };
        for (row, line) in rows.zip(&blurred) {
            let pixels = row * self.width + columns.start..row * self.width + columns.end;
            if self.tiles[tile].has_top {
                for ((key, &raw), &blurred) in self.key[pixels.clone()].iter_mut().zip(&self.raw_key[pixels]).zip(line)
                {
                    *key = if raw > ON_TOP { blurred } else { *key };
                }
            } else {
                put(&mut self.key[pixels], line);
            }
        }
    }

    fn blur_half(&mut self, tile: usize, windows: &mut Windows) {
        let [columns, rows] = self.pixels_of(tile);
        let (columns, rows) = (columns.start / 2..columns.end.div_ceil(2), rows.start / 2..rows.end.div_ceil(2));
        let [low, high] = self.range_around(tile, |tile| tile.ambient);
        self.tiles[tile].ambient_around = [low, high];
        if low >= high {
            if let Some(value) = self.raw_half.even(tile) {
                self.half.fill(tile, [columns, rows], value);
                return;
            }
            self.half.forget(tile);
            for row in rows {
                let range = row * self.half_width + columns.start..row * self.half_width + columns.end;
                self.half[range.clone()].copy_from_slice(&self.raw_half[range]);
            }
            return;
        }
        self.half.forget(tile);
        let blurred = blur_half_tile(&mut windows.half, self, &self.raw_half, [columns.start, rows.start]);
        for (row, line) in rows.zip(&blurred) {
            let out = &mut self.half[row * self.half_width..][columns.clone()];
            out.copy_from_slice(&line[..out.len()]);
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

    /// From values on a grid with a step of so many pixels; nothing is known beyond the picture.
    #[inline(always)]
    fn load<const PIXELS: usize>(&mut self, arrival: &Arrival, values: &[f32], [x0, y0]: [usize; 2]) {
        let width = if PIXELS == 1 { arrival.width } else { arrival.half_width };
        let height = values.len() / width;
        let from = Self::BESIDE.saturating_sub(x0);
        let to = SIDE.min(width + Self::BESIDE - x0);
        for row in 0..SIDE {
            let Some(y) = (y0 + row).checked_sub(Self::BESIDE).filter(|&y| y < height) else {
                self.value[row] = [UNKNOWN; SIDE];
                continue;
            };
            let x = x0 + from - Self::BESIDE;
            let (values, fine) = (&values[y * width + x..], y * PIXELS * arrival.width + x * PIXELS);
            let (depths, surfaces) = (&arrival.depth[fine..], &arrival.surface[fine..]);
            if to - from == SIDE {
                self.load_line::<PIXELS>(row, 0..SIDE, [values, depths], surfaces);
            } else {
                self.value[row] = [UNKNOWN; SIDE];
                self.load_line::<PIXELS>(row, from..to, [values, depths], surfaces);
            }
        }
    }

    /// Some columns of a row, the first of which begin the lists.
    #[inline(always)]
    fn load_line<const PIXELS: usize>(
        &mut self,
        row: usize,
        columns: Range<usize>,
        [values, depths]: [&[f32]; 2],
        surfaces: &[u16],
    ) {
        let count = columns.len();
        let last = (count - 1) * PIXELS + 1;
        let (values, depths, surfaces) = (&values[..count], &depths[..last], &surfaces[..last]);
        let (value, depth) = (&mut self.value[row][columns.clone()], &mut self.depth[row][columns.clone()]);
        let surface = &mut self.surface[row][columns];
        for i in 0..count {
            value[i] = values[i];
            depth[i] = depths[i * PIXELS];
            surface[i] = u32::from(surfaces[i * PIXELS]);
        }
    }

    /// Means over five by five, half weight at the borders, within one surface.
    #[inline(always)]
    fn blurred<const OUT: usize>(&self) -> [[f32; OUT]; OUT] {
        const WEIGHTS: [f32; 5] = [0.5, 1.0, 1.0, 1.0, 0.5];
        let mut lines = [[UNKNOWN; OUT]; SIDE];
        for row in 0..SIDE {
            for column in 0..OUT {
                let (surface, depth) =
                    (self.surface[row][column + Self::BESIDE], self.depth[row][column + Self::BESIDE]);
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = self.value[row][column + tap * STEP];
                    let is_same = (self.surface[row][column + tap * STEP] == surface)
                        & ((self.depth[row][column + tap * STEP] - depth).abs() < LEVEL * depth)
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
                        & ((self.depth[row + tap * STEP][column + Self::BESIDE] - depth).abs() < LEVEL * depth)
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

#[multiversion(targets("x86_64+avx2+fma"))]
fn blur_tile(window: &mut Window<WINDOW, 1>, arrival: &Arrival, key: &[f32], at: [usize; 2]) -> [[f32; TILE]; TILE] {
    window.load::<1>(arrival, key, at);
    window.blurred()
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn blur_coarse_tile(
    window: &mut Window<COARSE_WINDOW, 2>,
    arrival: &Arrival,
    key: &[f32],
    at: [usize; 2],
) -> [[f32; TILE]; TILE] {
    window.load::<1>(arrival, key, at);
    window.blurred()
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn blur_half_tile(
    window: &mut Window<HALF_WINDOW, 1>,
    arrival: &Arrival,
    half: &[f32],
    at: [usize; 2],
) -> [[f32; HALF]; HALF] {
    window.load::<2>(arrival, half, at);
    window.blurred()
}

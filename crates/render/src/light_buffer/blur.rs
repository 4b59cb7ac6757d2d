//! Bilateral 5×5 filters of shadow mask and ambient occlusion, within one surface.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use multiversion::multiversion;

use super::buffer::{HALF, LightBuffer, SAME_DEPTH, fill};
use crate::gbuffer::static_layer::TILE;
use crate::raster::read_window;
use crate::shadow::pcss::UNKNOWN;

/// Number of values that the filter reads on each side of its centre.
const MARGIN: usize = 2;
/// Filter weights along a row or column. The half weights at the ends make the filter cover one period of 4 pixels.
const WEIGHTS: [f32; 5] = [0.5, 1.0, 1.0, 1.0, 0.5];
/// Number of values along a side of a tile with its margin, at full and at half resolution.
const WINDOW: usize = TILE + 2 * MARGIN;
const HALF_WINDOW: usize = HALF + 2 * MARGIN;

impl LightBuffer {
    /// Filters the shadow mask and half-resolution AO of tiles.
    pub fn blur(&mut self, tiles: &[usize], windows: &mut Windows) {
        for &tile in tiles {
            self.blur_shadow_mask(tile, windows);
            self.blur_ao(tile, windows);
        }
    }

    fn blur_shadow_mask(&mut self, tile: usize, windows: &mut Windows) {
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.range_around(tile, &self.shadow_range);
        if low >= high {
            // The tile and its neighbours have one value. Without any value, the tile faces away from the light.
            let constant = if low == high { low } else { UNKNOWN };
            fill(&mut self.shadow_mask, self.width, [columns, rows], constant);
            return;
        }
        let blurred = blur_tile(&mut windows.full, self, [columns.start, rows.start]);
        for (row, line) in rows.zip(&blurred) {
            self.shadow_mask[row * self.width..][columns.clone()].copy_from_slice(line);
        }
    }

    fn blur_ao(&mut self, tile: usize, windows: &mut Windows) {
        let ([columns, rows], width) = (self.half_pixels_of(tile), self.width / 2);
        let [low, high] = self.range_around(tile, &self.ao_range);
        if low >= high {
            let constant = if low == high { low } else { UNKNOWN };
            fill(&mut self.half_ao, width, [columns, rows], constant);
            return;
        }
        let blurred = blur_half_tile(&mut windows.half, self, [columns.start, rows.start]);
        for (row, line) in rows.zip(&blurred) {
            self.half_ao[row * width..][columns.clone()].copy_from_slice(line);
        }
    }
}

/// Scratch memory of the filters.
#[derive(Debug, Default)]
pub(crate) struct Windows {
    full: Window<WINDOW>,
    half: Window<HALF_WINDOW>,
}

/// Values of a tile with its margin; beyond the image the border values are repeated.
#[derive(Debug)]
struct Window<const SIDE: usize> {
    surface: [[u16; SIDE]; SIDE],
    depth: [[f32; SIDE]; SIDE],
    value: [[f32; SIDE]; SIDE],
}

impl<const SIDE: usize> Default for Window<SIDE> {
    fn default() -> Self {
        Self { surface: [[0; SIDE]; SIDE], depth: [[0.0; SIDE]; SIDE], value: [[UNKNOWN; SIDE]; SIDE] }
    }
}

impl<const SIDE: usize> Window<SIDE> {
    /// Loads a tile with its margin from images of this width; `place` is the tile's first column and row.
    #[inline(always)]
    fn load(&mut self, width: usize, surface: &[u16], depth: &[f32], value: &[f32], place: [usize; 2]) {
        let first = place.map(|at| at as isize - MARGIN as isize);
        read_window(surface, [width, width], first, &mut self.surface);
        read_window(depth, [width, width], first, &mut self.depth);
        read_window(value, [width, width], first, &mut self.value);
    }

    /// Weighted means along rows, then columns, over known values of the same surface at about the same depth.
    #[inline(always)]
    fn blurred<const OUT: usize>(&self) -> [[f32; OUT]; OUT] {
        let mut lines = [[UNKNOWN; OUT]; SIDE];
        for row in 0..SIDE {
            for column in 0..OUT {
                let center = [row, column + MARGIN];
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = self.value[row][column + tap];
                    let weight = self.weight(center, [row, column + tap], value, WEIGHTS[tap]);
                    sum += weight * value;
                    total += weight;
                }
                lines[row][column] = if total > 0.0 { sum / total } else { UNKNOWN };
            }
        }
        let mut out = [[UNKNOWN; OUT]; OUT];
        for row in 0..OUT {
            for column in 0..OUT {
                let center = [row + MARGIN, column + MARGIN];
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = lines[row + tap][column];
                    let weight = self.weight(center, [row + tap, column + MARGIN], value, WEIGHTS[tap]);
                    sum += weight * value;
                    total += weight;
                }
                out[row][column] = if total > 0.0 { sum / total } else { UNKNOWN };
            }
        }
        out
    }

    /// Weight of a tap: 0 for an unknown value, nearly 0 for another surface than at the centre.
    #[inline(always)]
    fn weight(&self, [row, column]: [usize; 2], [tap_row, tap_column]: [usize; 2], value: f32, weight: f32) -> f32 {
        let depth = self.depth[row][column];
        let is_same = (self.surface[tap_row][tap_column] == self.surface[row][column])
            & ((self.depth[tap_row][tap_column] - depth).abs() < SAME_DEPTH * depth);
        // The small weight lets thin objects that no other sample shows take the values around them.
        let weight = if is_same { weight } else { 1e-4 * weight };
        if value >= 0.0 { weight } else { 0.0 }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn blur_tile(window: &mut Window<WINDOW>, buffer: &LightBuffer, at: [usize; 2]) -> [[f32; TILE]; TILE] {
    window.load(buffer.width, &buffer.surface, &buffer.depth, &buffer.raw_shadow_mask, at);
    window.blurred()
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn blur_half_tile(window: &mut Window<HALF_WINDOW>, buffer: &LightBuffer, at: [usize; 2]) -> [[f32; HALF]; HALF] {
    window.load(buffer.width / 2, &buffer.half_surface, &buffer.half_depth, &buffer.raw_half_ao, at);
    window.blurred()
}

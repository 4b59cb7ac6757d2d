//! Bilateral upsampling of ambient occlusion from half to full resolution.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use multiversion::multiversion;

use super::buffer::{HALF, LightBuffer, SAME_DEPTH, fill};
use crate::gbuffer::static_layer::TILE;
use crate::raster::read_window;

/// A tile and the AO samples around it: for each pixel column, the samples to its left and to its right.
#[derive(Debug, Default)]
pub(crate) struct UpsampleWindow {
    surface: [[u16; TILE]; TILE],
    depth: [[f32; TILE]; TILE],
    /// By row of AO samples, side (left, right) and pixel column.
    coarse_surface: [[[u16; TILE]; 2]; HALF + 1],
    coarse_depth: [[[f32; TILE]; 2]; HALF + 1],
    value: [[[f32; TILE]; 2]; HALF + 1],
}

impl LightBuffer {
    /// Upsamples the filtered half-resolution AO of tiles into `ambient`; `window` is scratch memory.
    pub fn upsample(&mut self, tiles: &[usize], window: &mut UpsampleWindow) {
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            let [low, high] = self.range_around(tile, &self.ao_range);
            if low >= high {
                // The tile and its neighbours have one value. Without any value, nothing is occluded.
                fill(&mut self.ambient, self.width, [columns, rows], if low == high { low } else { 1.0 });
                continue;
            }
            self.fill_window(columns.start, rows.start, window);
            for (row, line) in rows.zip(&upsample_tile(window)) {
                self.ambient[row * self.width..][columns.clone()].copy_from_slice(line);
            }
        }
    }

    /// Gathers a tile and the AO samples around it; beyond the image the border samples are repeated.
    fn fill_window(&self, first_column: usize, first_row: usize, window: &mut UpsampleWindow) {
        let (half_width, half_height) = (self.width / 2, self.height / 2);
        let (x, y) = (first_column / 2, first_row / 2);
        let first = [first_column as isize, first_row as isize];
        read_window(&self.surface, [self.width; 2], first, &mut window.surface);
        read_window(&self.depth, [self.width; 2], first, &mut window.depth);
        for row in 0..=HALF {
            let y = (y + row).min(half_height - 1);
            for column in 0..TILE {
                for (side, step) in [column / 2, column / 2 + column % 2].into_iter().enumerate() {
                    let x = (x + step).min(half_width - 1);
                    let sample = y * half_width + x;
                    window.coarse_surface[row][side][column] = self.half_surface[sample];
                    window.coarse_depth[row][side][column] = self.half_depth[sample];
                    window.value[row][side][column] = self.half_ao[sample];
                }
            }
        }
    }
}

/// AO of each pixel of a tile: weighted mean of the four AO samples around it, 1 if none has a value. Samples without a
/// value (negative) have weight 0, those on another surface or at another depth 1e-4.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn upsample_tile(window: &UpsampleWindow) -> [[f32; TILE]; TILE] {
    let mut out = [[1.0; TILE]; TILE];
    for row in 0..TILE {
        let taps = [(row / 2, 0), (row / 2, 1), (row / 2 + row % 2, 0), (row / 2 + row % 2, 1)];
        let (mut sums, mut totals) = ([0.0; TILE], [0.0; TILE]);
        for (coarse, side) in taps {
            for column in 0..TILE {
                let (surface, depth) = (window.surface[row][column], window.depth[row][column]);
                let value = window.value[coarse][side][column];
                let is_same = (window.coarse_surface[coarse][side][column] == surface)
                    & ((window.coarse_depth[coarse][side][column] - depth).abs() < SAME_DEPTH * depth);
                // The small weight lets thin objects that no AO sample shows take the values around them.
                let weight = if is_same { 1.0 } else { 1e-4 };
                let weight = if value < 0.0 { 0.0 } else { weight };
                sums[column] += weight * value;
                totals[column] += weight;
            }
        }
        for column in 0..TILE {
            out[row][column] = if totals[column] > 0.0 { sums[column] / totals[column] } else { 1.0 };
        }
    }
    out
}

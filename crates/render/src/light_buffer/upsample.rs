//! Bilateral upsampling of ambient occlusion from half to full resolution.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use multiversion::multiversion;

use super::buffer::{HALF, LightBuffer, SAME_DEPTH, fill, line_of, put};
use crate::gbuffer::static_layer::TILE;
use crate::shadow::pcss::UNKNOWN;

/// A tile and the AO samples around it, each beside the pixels to its left or right.
#[derive(Debug)]
pub(crate) struct UpsampleWindow {
    surface: [[u32; TILE]; TILE],
    depth: [[f32; TILE]; TILE],
    /// By AO row: samples to the left and to the right of each column.
    coarse_surface: [[[u32; TILE]; 2]; HALF + 1],
    coarse_depth: [[[f32; TILE]; 2]; HALF + 1],
    value: [[[f32; TILE]; 2]; HALF + 1],
}

impl Default for UpsampleWindow {
    fn default() -> Self {
        Self {
            surface: [[0; TILE]; TILE],
            depth: [[0.0; TILE]; TILE],
            coarse_surface: [[[0; TILE]; 2]; HALF + 1],
            coarse_depth: [[[0.0; TILE]; 2]; HALF + 1],
            value: [[[UNKNOWN; TILE]; 2]; HALF + 1],
        }
    }
}

impl LightBuffer {
    /// Upsamples the AO of some tiles.
    pub fn upsample(&mut self, tiles: &[usize], window: &mut UpsampleWindow) {
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            let [low, high] = self.range_around(tile, &self.ao_range);
            if low >= high {
                // One value all around; without any sample, nothing is occluded.
                fill(&mut self.ambient, self.width, [columns, rows], if low == high { low } else { 1.0 });
                continue;
            }
            self.fill_window(columns.start, rows.start, window);
            for (row, line) in rows.zip(&upsample_tile(window)) {
                put(&mut self.ambient[row * self.width..][columns.clone()], line);
            }
        }
    }

    /// Gathers a tile and the AO samples around it.
    fn fill_window(&self, first_column: usize, first_row: usize, window: &mut UpsampleWindow) {
        let (x, y) = (first_column / 2, first_row / 2);
        for row in 0..TILE.min(self.height - first_row) {
            let fine = (first_row + row) * self.width + first_column;
            let pixels = fine..fine + TILE.min(self.width - first_column);
            window.surface[row] = line_of(&self.surface[pixels.clone()], 0).map(u32::from);
            window.depth[row] = line_of(&self.depth[pixels], 0.0);
        }
        for row in 0..=HALF {
            let y = (y + row).min(self.half_height - 1);
            let (fine, coarse) = (2 * y * self.width + 2 * x, y * self.half_width + x);
            let (surfaces, depths) = (&self.surface[fine..], &self.depth[fine..]);
            let (mut surface, mut depth, mut value) = ([0; HALF + 1], [0.0; HALF + 1], [UNKNOWN; HALF + 1]);
            if let (Some(surfaces), Some(depths), true) = (
                surfaces.first_chunk::<{ TILE + 1 }>(),
                depths.first_chunk::<{ TILE + 1 }>(),
                x + HALF < self.half_width,
            ) {
                surface = std::array::from_fn(|column| u32::from(surfaces[2 * column]));
                depth = std::array::from_fn(|column| depths[2 * column]);
                value.copy_from_slice(&self.half_ao[coarse..][..=HALF]);
            } else {
                for column in 0..=HALF {
                    let right = column.min(self.half_width - 1 - x);
                    surface[column] = u32::from(surfaces[2 * right]);
                    depth[column] = depths[2 * right];
                    value[column] = self.half_ao[coarse + right];
                }
            }
            for column in 0..TILE {
                for (side, x) in [column / 2, column / 2 + column % 2].into_iter().enumerate() {
                    window.coarse_surface[row][side][column] = surface[x];
                    window.coarse_depth[row][side][column] = depth[x];
                    window.value[row][side][column] = value[x];
                }
            }
        }
    }
}

/// Mean of the four AO samples around each pixel that belong to the same surface at about the same depth.
#[multiversion(targets("x86_64+avx2+fma"))]
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
                // Thin objects between samples take the values around them.
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

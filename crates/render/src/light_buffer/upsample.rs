//! Ambient light at every pixel from estimates at every other row and column.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use multiversion::multiversion;

use crate::gbuffer::static_layer::TILE;
use crate::shadow::pcss::UNKNOWN;

/// Estimates along the side of a tile.
pub(crate) const HALF: usize = TILE / 2;

/// A tile and the coarse estimates around it, each of them beside the pixels that it is to the left or the right of.
#[derive(Debug)]
pub(crate) struct UpsampleWindow {
    pub surface: [[u32; TILE]; TILE],
    pub depth: [[f32; TILE]; TILE],
    /// By coarse row: to the left and to the right of each column.
    pub coarse_surface: [[[u32; TILE]; 2]; HALF + 1],
    pub coarse_depth: [[[f32; TILE]; 2]; HALF + 1],
    pub value: [[[f32; TILE]; 2]; HALF + 1],
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

/// [`upsample_tile`] where all belong to the same surface, from the first coarse estimate of the tile on.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(crate) fn upsample_planar_tile(coarse: &[f32], width: usize) -> [[f32; TILE]; TILE] {
    let mut lines = [[0.0; TILE]; HALF + 1];
    for (row, line) in lines.iter_mut().enumerate() {
        let coarse = &coarse[row * width..][..=HALF];
        for column in 0..HALF {
            line[2 * column] = coarse[column];
            line[2 * column + 1] = 0.5 * (coarse[column] + coarse[column + 1]);
        }
    }
    let mut out = [[0.0; TILE]; TILE];
    for row in 0..HALF {
        out[2 * row] = lines[row];
        for column in 0..TILE {
            out[2 * row + 1][column] = 0.5 * (lines[row][column] + lines[row + 1][column]);
        }
    }
    out
}

/// At every pixel the mean of the coarse estimates around it that belong to the same surface.
#[multiversion(targets("x86_64+avx2+fma"))]
pub(crate) fn upsample_tile(window: &UpsampleWindow) -> [[f32; TILE]; TILE] {
    let mut out = [[1.0; TILE]; TILE];
    for row in 0..TILE {
        let taps = [(row / 2, 0), (row / 2, 1), (row / 2 + row % 2, 0), (row / 2 + row % 2, 1)];
        let (mut sums, mut totals) = ([0.0; TILE], [0.0; TILE]);
        for (coarse, side) in taps {
            for column in 0..TILE {
                let (surface, depth) = (window.surface[row][column], window.depth[row][column]);
                let value = window.value[coarse][side][column];
                let is_same = (window.coarse_surface[coarse][side][column] == surface)
                    & ((window.coarse_depth[coarse][side][column] - depth).abs() < 0.02 * depth);
                // A thin thing between the coarse pixels takes what is known around it.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// On one level surface, means need no weights and have the same bits.
    #[test]
    fn level_tiles_have_the_means_of_others() {
        const WIDTH: usize = HALF + 3;
        let coarse: Vec<f32> = (0..WIDTH * (HALF + 1)).map(|index| (index * 37 % 64) as f32 / 64.0).collect();
        let mut window =
            UpsampleWindow { surface: [[1; TILE]; TILE], depth: [[0.5; TILE]; TILE], ..Default::default() };
        for row in 0..=HALF {
            for side in 0..2 {
                window.coarse_surface[row][side] = [1; TILE];
                window.coarse_depth[row][side] = [0.5; TILE];
                window.value[row][side] =
                    std::array::from_fn(|column| coarse[row * WIDTH + column / 2 + side * (column % 2)]);
            }
        }
        assert_eq!(upsample_planar_tile(&coarse, WIDTH), upsample_tile(&window));
    }
}

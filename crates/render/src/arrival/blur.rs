//! Means of arriving light over five by five pixels, within one surface.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use multiversion::multiversion;

use super::{Arrival, LEVEL, put};
use crate::layers::TILE;
use crate::refine::{HALF, UNKNOWN};

/// Pixels around a tile that its blur reads.
const MARGIN: usize = 2;
/// Rows and columns of a tile with its surroundings.
const WINDOW: usize = TILE + 2 * MARGIN;
/// The same of the coarse grid of the ambient light.
const HALF_WINDOW: usize = HALF + 2 * MARGIN;

impl Arrival {
    /// Blurs tiles; the estimates of those next to them must be up to date.
    pub fn blur(&mut self, tiles: &[usize]) {
        for &tile in tiles {
            self.blur_key(tile);
            self.blur_half(tile);
        }
    }

    fn blur_key(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.range_around(tile, |tile| tile.key);
        if low >= high {
            // One value all around, which is also that of what faces away from the light.
            let values = [if low == high { low } else { UNKNOWN }; TILE];
            rows.for_each(|row| put(&mut self.key[row * self.width..][columns.clone()], &values));
            return;
        }
        let mut window = Window::<WINDOW>::default();
        window.load(self, &self.raw_key, self.width, [columns.start, rows.start], 1);
        let blurred = blur_tile(&window);
        for (row, line) in rows.zip(&blurred) {
            put(&mut self.key[row * self.width..][columns.clone()], line);
        }
    }

    fn blur_half(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        let (columns, rows) = (columns.start / 2..columns.end.div_ceil(2), rows.start / 2..rows.end.div_ceil(2));
        let [low, high] = self.range_around(tile, |tile| tile.ambient);
        if low >= high {
            for row in rows {
                let range = row * self.half_width + columns.start..row * self.half_width + columns.end;
                self.half[range.clone()].copy_from_slice(&self.raw_half[range]);
            }
            return;
        }
        let mut window = Window::<HALF_WINDOW>::default();
        window.load(self, &self.raw_half, self.half_width, [columns.start, rows.start], 2);
        let blurred = blur_half_tile(&window);
        for (row, line) in rows.zip(&blurred) {
            let out = &mut self.half[row * self.half_width..][columns.clone()];
            out.copy_from_slice(&line[..out.len()]);
        }
    }
}

/// A tile and its surroundings.
struct Window<const SIDE: usize> {
    surface: [[u32; SIDE]; SIDE],
    depth: [[f32; SIDE]; SIDE],
    value: [[f32; SIDE]; SIDE],
}

impl<const SIDE: usize> Default for Window<SIDE> {
    fn default() -> Self {
        let zero = [[0.0; SIDE]; SIDE];
        Self { surface: [[0; SIDE]; SIDE], depth: zero, value: [[UNKNOWN; SIDE]; SIDE] }
    }
}

impl<const SIDE: usize> Window<SIDE> {
    /// From values on a grid with a step of so many pixels.
    fn load(&mut self, arrival: &Arrival, values: &[f32], width: usize, [x0, y0]: [usize; 2], step: usize) {
        let height = values.len() / width;
        let from = MARGIN.saturating_sub(x0);
        let to = SIDE.min(width + MARGIN - x0);
        for row in 0..SIDE {
            let Some(y) = (y0 + row).checked_sub(MARGIN).filter(|&y| y < height) else { continue };
            let x = x0 + from - MARGIN;
            self.value[row][from..to].copy_from_slice(&values[y * width + x..][..to - from]);
            let fine = y * step * arrival.width + x * step;
            let depths = arrival.depth[fine..].iter().step_by(step);
            self.depth[row][from..to].iter_mut().zip(depths).for_each(|(out, &depth)| *out = depth);
            let surfaces = arrival.surface[fine..].iter().step_by(step);
            self.surface[row][from..to].iter_mut().zip(surfaces).for_each(|(out, &surface)| *out = u32::from(surface));
        }
    }

    /// Means over five by five, half weight at the borders, within one surface.
    #[inline(always)]
    fn blurred<const OUT: usize>(&self) -> [[f32; OUT]; OUT] {
        const WEIGHTS: [f32; 5] = [0.5, 1.0, 1.0, 1.0, 0.5];
        let mut lines = [[UNKNOWN; OUT]; SIDE];
        for row in 0..SIDE {
            for column in 0..OUT {
                let (surface, depth) = (self.surface[row][column + MARGIN], self.depth[row][column + MARGIN]);
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = self.value[row][column + tap];
                    let is_same = (self.surface[row][column + tap] == surface)
                        & ((self.depth[row][column + tap] - depth).abs() < LEVEL * depth)
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
                let (surface, depth) =
                    (self.surface[row + MARGIN][column + MARGIN], self.depth[row + MARGIN][column + MARGIN]);
                let (mut sum, mut total) = (0.0, 0.0);
                for tap in 0..5 {
                    let value = lines[row + tap][column];
                    let is_same = (self.surface[row + tap][column + MARGIN] == surface)
                        & ((self.depth[row + tap][column + MARGIN] - depth).abs() < LEVEL * depth)
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

#[multiversion(targets("x86_64+avx2"))]
fn blur_tile(window: &Window<WINDOW>) -> [[f32; TILE]; TILE] {
    window.blurred()
}

#[multiversion(targets("x86_64+avx2"))]
fn blur_half_tile(window: &Window<HALF_WINDOW>) -> [[f32; HALF]; HALF] {
    window.blurred()
}

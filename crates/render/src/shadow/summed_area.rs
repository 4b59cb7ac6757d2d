//! Summed-area table of the occluders above a horizontal plane, and penumbrae computed from it.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::ops::Range;

use multiversion::multiversion;

use crate::gbuffer::static_layer::TILE;
use crate::lights::key_light::{KeyLight, MAX_RADIUS};
use crate::raster::VisibilityBuffer;
use crate::shadow::pcss::GLASS_SHADE;
use crate::simd::{floor, nearest_integer, within};

/// Half side of the square with the area of a disc, relative to its radius.
const SQUARE: f32 = 0.886_227;
/// Weight of an opaque texel.
const FULL: u32 = 10;
/// Quantisation of distances [1/m].
const STEPS_PER_M: f32 = 1024.0;
/// Bits of the occluder weight in a cell and in a sum; the higher bits hold weighted distances.
const CELL_BITS: u32 = 8;
const COVER_BITS: u32 = 24;

/// Occluders above a plane, by cell, including a margin for all filter sizes.
#[derive(Debug)]
pub(super) struct SummedAreaTable {
    /// Texels along the side of a cell, and cells along the side of the map.
    pub step: usize,
    side: usize,
    /// Reversed z of the plane at the first texel, and its change per column and row.
    reversed_z: [f32; 3],
    /// Margin (cells), whole tiles of the map.
    margin: usize,
    /// First column and row with the margin; cells outside the map are empty.
    first: [isize; 2],
    columns: usize,
    rows: usize,
    /// Packed occluder weight and distance by cell, see [`occluder_tile`].
    covered: Vec<u32>,
    /// Summed-area table of a window, one row and column larger than its cells.
    sums: Vec<u64>,
    /// First column and row of the window, and its columns.
    window: [usize; 3],
    /// Half side of the blocker search (cells).
    search: usize,
    /// Penumbra radius per metre of occluder distance [texels/m].
    radius_per_m: f32,
    /// Inverse of the largest occluder weight in a square, by its half side.
    inverse_full: Vec<f32>,
}

impl SummedAreaTable {
    pub fn new(step: usize, reversed_z: [f32; 3], light: &KeyLight, first: [usize; 2], blocks: [usize; 2]) -> Self {
        let search = half_side(light.search_radius() / step as f32).round() as usize;
        let widest = half_side(MAX_RADIUS / step as f32) as usize + 1;
        let margin = widest.max(search).next_multiple_of(TILE);
        let [columns, rows] = blocks.map(|blocks| blocks * TILE + 2 * margin);
        let full = |half: usize| ((2 * half + 1) * (2 * half + 1) * step * step) as f32 * FULL as f32;
        Self {
            step,
            side: light.size / step,
            reversed_z,
            margin,
            first: first.map(|block| (block * TILE) as isize - margin as isize),
            covered: vec![0; columns * rows],
            sums: vec![0; (columns + 1) * (rows + 1)],
            window: [0; 3],
            columns,
            rows,
            search,
            radius_per_m: light.radius_per_m(),
            inverse_full: (0..=widest.max(search)).map(|half| 1.0 / full(half)).collect(),
        }
    }

    /// Reads the map tiles that changed.
    pub fn follow(&mut self, map: &VisibilityBuffer, changed: &[bool]) {
        let (tiles, in_tile) = (map.width / TILE, TILE / self.step);
        let [from_column, from_row] = self.first.map(|first| first.max(0) as usize / in_tile);
        let end = |axis: usize, count: usize| (self.first[axis] + count as isize).max(0) as usize;
        let end = |axis: usize, count: usize| self.side.min(end(axis, count)).div_ceil(in_tile);
        let (end_column, end_row) = (end(0, self.columns), end(1, self.rows));
        for tile_row in from_row..end_row {
            for tile_column in from_column..end_column {
                if changed[tile_row * tiles + tile_column] {
                    self.read_tile(map, tile_column, tile_row);
                }
            }
        }
    }

    fn read_tile(&mut self, map: &VisibilityBuffer, tile_column: usize, tile_row: usize) {
        let [at, per_column, per_row] = self.reversed_z;
        let (x, y) = (tile_column * TILE, tile_row * TILE);
        let plane = [at + per_column * x as f32 + per_row * y as f32, per_column, per_row];
        let cells = occluder_tile(&map.reversed_z[y * map.stride + x..], map.stride, plane, self.step);
        let in_tile = TILE / self.step;
        for (dy, line) in cells.chunks_exact(in_tile).take(in_tile).enumerate() {
            let row = (tile_row * in_tile + dy) as isize - self.first[1];
            let column = (tile_column * in_tile) as isize - self.first[0];
            // The margin consists of whole tiles.
            if let (Ok(row), Ok(column)) = (usize::try_from(row), usize::try_from(column))
                && row < self.rows
                && column + in_tile <= self.columns
            {
                self.covered[row * self.columns + column..][..in_tile].copy_from_slice(line);
            }
        }
    }

    /// Sums the cells that some columns and rows of blocks (8×8 cells) depend on.
    pub fn add_up(&mut self, blocks: [Range<usize>; 2]) {
        let widest = self.inverse_full.len() - 1;
        let reach = |blocks: &Range<usize>| {
            blocks.start * TILE + self.margin - widest..blocks.end * TILE + self.margin + widest
        };
        let [columns, rows] = [reach(&blocks[0]), reach(&blocks[1])];
        let width = columns.len() + 1;
        self.window = [columns.start, rows.start, columns.len()];
        self.sums[..width].fill(0);
        for (step, row) in rows.enumerate() {
            let (above, own) = self.sums[step * width..].split_at_mut(width);
            let mut sum = 0;
            own[0] = 0;
            let covered = &self.covered[row * self.columns..][columns.clone()];
            for ((own, above), &covered) in own[1..].iter_mut().zip(&above[1..]).zip(covered) {
                sum += u64::from(covered >> CELL_BITS) << COVER_BITS | u64::from(covered & ((1 << CELL_BITS) - 1));
                *own = above + sum;
            }
        }
    }

    /// Index of a cell's upper left corner in the sums, and corners per row.
    #[inline(always)]
    fn corner(&self, [x, y]: [usize; 2]) -> (usize, usize) {
        let [column, row, columns] = self.window;
        ((y - row) * (columns + 1) + x - column, columns + 1)
    }

    /// Sum over a square of cells.
    #[inline(always)]
    fn within(&self, first: [usize; 2], side: usize) -> u64 {
        let (top, width) = self.corner(first);
        let bottom = top + side * width;
        self.sums[bottom + side] + self.sums[top] - self.sums[bottom] - self.sums[top + side]
    }

    /// Shadow mask at the cell centres of a summed block, and the distance (cells) within which cells were read.
    pub fn shares(&self, column: usize, row: usize) -> ([[f32; TILE]; TILE], usize) {
        let [x, y] = [column + self.margin, row + self.margin];
        let around = |half: usize| unpack(self.within([x - half, y - half], TILE + 2 * half)).0;
        if around(self.search) == 0 {
            return ([[1.0; TILE]; TILE], self.search);
        }
        let widest = self.inverse_full.len() - 1;
        let texels = ((TILE + 2 * widest) * self.step) as u32;
        if around(widest) == texels * texels * FULL {
            return ([[0.0; TILE]; TILE], widest);
        }
        let half = self.search;
        let (first, width) = self.corner([x - half, y - half]);
        let mut found = search_block(&self.sums[first..], width, 2 * half + 1);
        find_half_widths(&mut found, self.radius_per_m, self.step);
        let (mut shares, mut reach) = ([[1.0; TILE]; TILE], self.search);
        for (dy, (sums, halves)) in found.sums.iter().zip(&found.half_widths).enumerate() {
            for (dx, (_, &half)) in sums.iter().zip(halves).enumerate().filter(|(_, (sum, _))| **sum > 0) {
                let whole = nearest_integer(floor(half)) as usize;
                let lit = |half: usize| {
                    let (cover, _) = unpack(self.within([x + dx - half, y + dy - half], 2 * half + 1));
                    1.0 - cover as f32 * self.inverse_full[half]
                };
                let (inner, outer) = (lit(whole), lit(whole + 1));
                shares[dy][dx] = inner + (outer - inner) * (half - whole as f32);
                reach = reach.max(whole + 1);
            }
        }
        (shares, reach)
    }
}

/// Blocker search of a block of cells.
struct Found {
    sums: [[u64; TILE]; TILE],
    /// Half side of the filter square of each cell with blockers.
    half_widths: [[f32; TILE]; TILE],
}

/// Filter size from the mean blocker distance.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn find_half_widths(found: &mut Found, radius_per_m: f32, step: usize) {
    let step = step as i32 as f32;
    for row in 0..TILE {
        for column in 0..TILE {
            let (cover, distance) = unpack(found.sums[row][column]);
            // Both are far below 2³¹.
            let mean = distance as i32 as f32 / (cover as i32 as f32 * STEPS_PER_M);
            let half = half_side(within(mean * radius_per_m, 1.2, MAX_RADIUS) / step);
            found.half_widths[row][column] = within(half, 0.0, MAX_RADIUS);
        }
    }
}

/// Sums over squares around the cells of a block; `sums` begins at the first square.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn search_block(sums: &[u64], width: usize, side: usize) -> Found {
    let mut found = Found { sums: [[0; TILE]; TILE], half_widths: [[0.0; TILE]; TILE] };
    for (row, line) in found.sums.iter_mut().enumerate() {
        let (top, bottom) = (&sums[row * width..], &sums[(row + side) * width..]);
        let corners = [&top[..TILE], &top[side..][..TILE], &bottom[..TILE], &bottom[side..][..TILE]];
        for cell in 0..TILE {
            line[cell] = corners[3][cell] + corners[0][cell] - corners[2][cell] - corners[1][cell];
        }
    }
    found
}

/// Half side, in cells beside the centre, of the square with the area of a disc.
fn half_side(radius: f32) -> f32 {
    SQUARE * radius - 0.5
}

fn unpack(sum: u64) -> (u32, u32) {
    ((sum & ((1 << COVER_BITS) - 1)) as u32, (sum >> COVER_BITS) as u32)
}

/// Packed occluders of the cells of a map tile, row by row: weights ([`FULL`] for an opaque texel) in the low
/// [`CELL_BITS`], above them weighted distances in [`STEPS_PER_M`].
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn occluder_tile(map: &[f32], stride: usize, [at, per_column, per_row]: [f32; 3], step: usize) -> [u32; TILE * TILE] {
    const GLASS: u32 = (GLASS_SHADE * FULL as f32) as u32;
    let mut texels = [[0_u32; TILE]; TILE];
    for (row, line) in texels.iter_mut().enumerate() {
        let stored = &map[row * stride..][..TILE];
        let first = at + per_row * row as i32 as f32;
        for column in 0..TILE {
            let ahead = stored[column] - (first + per_column * column as i32 as f32);
            let weight = if stored[column].to_bits() & 1 == 1 { GLASS } else { FULL };
            let distance = nearest_integer(within(ahead, 0.0, 4.0) * STEPS_PER_M) * weight;
            line[column] = if ahead > 0.0 { distance << CELL_BITS | weight } else { 0 };
        }
    }
    if step == 1 {
        return std::array::from_fn(|cell| texels[cell / TILE][cell % TILE]);
    }
    const IN_TILE: usize = TILE / 2;
    let mut cells = [0; TILE * TILE];
    for row in 0..IN_TILE {
        for column in 0..IN_TILE {
            let pair = |row: usize| texels[row][2 * column] + texels[row][2 * column + 1];
            cells[row * IN_TILE + column] = pair(2 * row) + pair(2 * row + 1);
        }
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 128;

    /// Cells of 2×2 texels over a plane at reversed z 1, seen from straight above with 512 texels per metre.
    fn cells(reversed_z: impl Fn(usize, usize) -> f32) -> SummedAreaTable {
        let (search, widest) = (8, 14);
        let (margin, blocks) = (16, SIDE / 2 / TILE);
        let count = blocks * TILE + 2 * margin;
        let full = |half: usize| ((2 * half + 1) * (2 * half + 1) * 4) as f32 * FULL as f32;
        let mut cells = SummedAreaTable {
            step: 2,
            side: SIDE / 2,
            reversed_z: [1.0, 0.0, 0.0],
            margin,
            first: [-16, -16],
            columns: count,
            rows: count,
            covered: vec![0; count * count],
            sums: vec![0; (count + 1) * (count + 1)],
            window: [0; 3],
            search,
            radius_per_m: 0.075 * 512.0,
            inverse_full: (0..=widest).map(|half| 1.0 / full(half)).collect(),
        };
        let mut map = VisibilityBuffer::default();
        map.reset::<false>(SIDE, SIDE, 1);
        for row in 0..SIDE {
            for column in 0..SIDE {
                map.reversed_z[row * map.stride + column] = f32::from_bits(reversed_z(column, row).to_bits() & !1);
            }
        }
        cells.follow(&map, &[true; (SIDE / TILE) * (SIDE / TILE)]);
        cells.add_up([0..blocks, 0..blocks]);
        cells
    }

    /// Shadow mask along the middle row.
    fn line(cells: &SummedAreaTable) -> Vec<f32> {
        (0..SIDE / 2 / TILE).flat_map(|block| cells.shares(block * TILE, SIDE / 4).0[0]).collect()
    }

    #[test]
    fn nothing_and_everything_before_the_light() {
        assert!(line(&cells(|_, _| 0.0)).iter().all(|&share| share == 1.0));
        let covered = line(&cells(|_, _| 1.3));
        assert!(covered[SIDE / 4..SIDE / 4 + 8].iter().all(|&share| share.abs() < 1e-5), "{covered:?}");
    }

    /// A half plane at a height: 0.5 at its edge, monotonic, and a penumbra that widens with the height.
    #[test]
    fn edges_are_as_soft_as_what_casts_them_is_high() {
        let width = |height: f32| {
            let shares = line(&cells(|column, _| if column < SIDE / 2 { 1.0 + height } else { 0.0 }));
            assert!(shares.windows(2).skip(16).take(32).all(|pair| pair[0] <= pair[1] + 1e-6), "{shares:?}");
            let middle = 0.5 * (shares[SIDE / 4 - 1] + shares[SIDE / 4]);
            assert!((middle - 0.5).abs() < 0.05, "{middle} on the edge");
            shares[16..48].iter().filter(|share| (0.02..0.98).contains(*share)).count()
        };
        let widths = [0.05, 0.2, 0.4].map(width);
        assert!(widths[0] < widths[1] && widths[1] < widths[2], "{widths:?}");
        // Twice the radius in cells, 0.075 · 0.4 m · 512 texels/m over 2 texels, as a square of the same area.
        assert!((12..=15).contains(&widths[2]), "{widths:?}");
    }

    /// Clear glass blocks its share.
    #[test]
    fn glass_lets_light_pass() {
        let glass = f32::from_bits(1.2_f32.to_bits() | 1);
        let cells = cells(|_, _| 0.0);
        let mut map = VisibilityBuffer::default();
        map.reset::<false>(SIDE, SIDE, 1);
        map.reversed_z.fill(glass);
        let mut cells = cells;
        cells.follow(&map, &[true; (SIDE / TILE) * (SIDE / TILE)]);
        cells.add_up([0..SIDE / 2 / TILE, 0..SIDE / 2 / TILE]);
        let share = line(&cells)[SIDE / 4];
        assert!((share - (1.0 - GLASS_SHADE)).abs() < 1e-4, "{share}");
    }

    /// Incremental updates of cells and windows equal a new table.
    #[test]
    fn following_is_reading_anew() {
        let mut map = VisibilityBuffer::default();
        map.reset::<false>(SIDE, SIDE, 1);
        let mut followed = cells(|_, _| 0.0);
        let tiles = SIDE / TILE;
        for step in 0..6 {
            let (column, row) = (step * 37 % tiles, step * 11 % tiles);
            let mut changed = vec![false; tiles * tiles];
            changed[row * tiles + column] = true;
            for y in 0..TILE {
                let first = (row * TILE + y) * map.stride + column * TILE;
                map.reversed_z[first..first + TILE].fill(f32::from_bits((1.1 + 0.1 * step as f32).to_bits() & !1));
            }
            followed.follow(&map, &changed);
            let anew = cells(|column, row| map.reversed_z[row * map.stride + column]);
            let blocks = SIDE / 2 / TILE;
            let [columns, rows] = [step % blocks..blocks, 0..step % blocks + 1];
            followed.add_up([columns.clone(), rows.clone()]);
            for (column, row) in columns.flat_map(|column| rows.clone().map(move |row| (column * TILE, row * TILE))) {
                assert_eq!(followed.shares(column, row), anew.shares(column, row), "step {step}");
            }
        }
    }
}

//! Tiles of samples that one triangle covers: held as that triangle until anything else is drawn on them.
//!
//! Most of a picture is the top of a table and walls, a few large triangles: their samples are neither cleared nor drawn nor
//! read one by one. Exact: a tile takes part as a triangle only where single samples would have the same bits.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::ops::Range;

use multiversion::multiversion;

use super::VisibilityBuffer;
use super::span::DepthGradient;
use super::triangle_setup::{Spans, Triangle};
use crate::simd::within;

/// Samples along the side of a tile: the tiles of a picture with two samples per pixel along each axis.
pub(crate) const SIDE: usize = 16;
/// Samples beyond a tile that its edges read: up to the centres of the pixels next to it.
const BORDER: usize = 2;
/// In place of the index of a cover: the samples of the tile are stored.
const STORED: u32 = u32::MAX;
/// Tiles along a side of the box around a triangle from which on it may cover some: smaller ones are just drawn. Measured.
const LARGE: usize = 4;
/// Index of the cover that shows nothing.
const NOTHING: u32 = 0;

/// The tiles of a target, and what covers them.
#[derive(Clone, Debug, Default)]
pub(super) struct TileCovers {
    /// Tiles per row.
    columns: usize,
    /// By tile: index of its cover; empty for a target that stores all samples.
    tiles: Vec<u32>,
    list: Vec<TileCover>,
    /// Whether tiles become covered; else they only stop to be.
    grow: bool,
}

/// What all samples of a tile show.
#[derive(Clone, Debug, Default)]
pub(crate) struct TileCover {
    /// Visibility id.
    pub id: u32,
    gradient: DepthGradient,
    /// By row of the tile: the column from which the reversed_z is counted, and the reversed_z there.
    from: [f32; SIDE],
    value: [f32; SIDE],
}

impl TileCover {
    fn new(id: u32, gradient: &DepthGradient, rows: &Spans<SIDE>) -> Self {
        let from = std::array::from_fn(|i| rows.starts[i] as i32 as f32 - rows.offsets[i]);
        Self { id, gradient: gradient.clone(), from, value: rows.values }
    }

    /// Reversed z of every so many samples in a row of the tile, from a column of the target on: the bits of
    /// [`super::span::Span::draw`].
    #[inline(always)]
    pub fn line<const N: usize, const STEP: usize>(&self, row: usize, column: usize) -> [f32; N] {
        let DepthGradient { dx, low, high, .. } = self.gradient;
        let (first, value) = (column as i32 as f32 - self.from[row], self.value[row]);
        let mut line = [0.0; N];
        for i in 0..N {
            line[i] = within((first + (i * STEP) as i32 as f32).mul_add(dx, value), low, high);
        }
        line
    }
}

impl DepthGradient {
    /// Bounds of the reversed_z at the samples of a tile of a target so many samples wide.
    fn bounds(&self, [column, row]: [usize; 2], width: usize) -> [f32; 2] {
        /// The first value of a row, the way from there and their sum are rounded to single precision, each by a
        /// 2²⁴th part: a few times as much.
        const ROUNDING: f64 = 1.0 / (1 << 20) as f64;
        let (dx, dy) = (f64::from(self.dx), f64::from(self.dy));
        let first = self.constant + (column * SIDE) as f64 * dx + (row * SIDE) as f64 * dy;
        let (right, down) = ((SIDE - 1) as f64 * dx, (SIDE - 1) as f64 * dy);
        let slack = (first.abs() + right.abs() + down.abs() + width as f64 * dx.abs()) * ROUNDING;
        let low = first + right.min(0.0) + down.min(0.0) - slack;
        let high = first + right.max(0.0) + down.max(0.0) + slack;
        [low, high].map(|value| within(value as f32, self.low, self.high))
    }
}

impl TileCovers {
    /// All tiles show nothing, and may be covered.
    pub fn reset(&mut self, width: usize, height: usize) {
        self.columns = width.div_ceil(SIDE);
        self.grow = true;
        self.tiles.clear();
        self.tiles.resize(self.columns * height.div_ceil(SIDE), NOTHING);
        self.list.clear();
        self.list.push(TileCover::default());
    }

    /// All samples are stored.
    pub fn clear(&mut self) {
        self.tiles.clear();
    }

    /// What a tile shows whose samples are not stored.
    #[inline(always)]
    pub fn of(&self, tile: usize) -> Option<&TileCover> {
        self.list.get(*self.tiles.get(tile)? as usize)
    }

    /// Whether a triangle may be drawn as if all samples were stored: a small one on tiles that are.
    #[inline(always)]
    pub fn are_clear_of(&self, triangle: &Triangle) -> bool {
        if self.tiles.is_empty() {
            return true;
        }
        let [[left, right], [top, bottom]] = reach(triangle);
        let at = |column: usize, row: usize| self.tiles.get(row * self.columns + column).copied().unwrap_or(NOTHING);
        right <= left + 1
            && bottom <= top + 1
            && at(left, top) & at(right, top) & at(left, bottom) & at(right, bottom) == STORED
    }

    /// Whether what covers a tile, whose samples are not stored, is nearer all over it.
    #[inline(always)]
    fn hide(&self, gradient: &DepthGradient, place: [usize; 2], width: usize) -> bool {
        let cover = &self.list[self.tiles[place[1] * self.columns + place[0]] as usize];
        gradient.bounds(place, width)[1] < cover.gradient.bounds(place, width)[0]
    }
}

/// First and last column and row of the tiles that a triangle may reach.
#[inline(always)]
fn reach(triangle: &Triangle) -> [[usize; 2]; 2] {
    let tiles = |[first, end]: [u32; 2]| [first as usize / SIDE, end.saturating_sub(1) as usize / SIDE];
    [tiles(triangle.columns), tiles([triangle.rows[0], triangle.rows[2]])]
}

impl VisibilityBuffer {
    /// Becomes a target of a size in pixels that shows nothing and holds what covers whole tiles as triangles, with ids
    /// and two samples per pixel along each axis.
    pub fn reset_covered(&mut self, width: usize, height: usize) {
        self.resize(width, height, 2);
        let samples = self.stride * self.height;
        // What is in them does not matter.
        self.reversed_z.resize(samples, 0.0);
        self.ids.resize(samples, 0);
        self.covers.reset(self.width, self.height);
    }

    /// What a tile of the picture shows whose samples are not stored.
    pub fn cover(&self, tile: usize) -> Option<&TileCover> {
        self.covers.of(tile)
    }

    /// The ids of what covers a tile that is not at the border and those next to it, row by row, where samples are not stored.
    pub fn covers_around(&self, tile: usize) -> [Option<u32>; 9] {
        if self.covers.tiles.is_empty() {
            return [None; 9];
        }
        let first = tile - self.covers.columns - 1;
        std::array::from_fn(|step| Some(self.cover(first + step / 3 * self.covers.columns + step % 3)?.id))
    }

    /// Reads the reversed_z of a tile that is not at the border, and of the samples beside its first row and column.
    pub fn read_tile(&self, tile: usize, out: &mut TileDepths) {
        let columns = self.width.div_ceil(SIDE);
        let tiles = [tile - columns - 1, tile - columns, tile - 1, tile];
        let place = [tile % columns * SIDE, tile / columns * SIDE];
        read_tile(tiles.map(|tile| self.cover(tile)), place, &self.reversed_z, self.stride, out);
    }

    /// Id and reversed_z of a sample.
    pub fn sample(&self, column: usize, row: usize) -> (u32, f32) {
        match self.cover(row / SIDE * self.covers.columns + column / SIDE) {
            Some(cover) => (cover.id, cover.line::<1, 1>(row % SIDE, column)[0]),
            None => {
                let sample = row * self.stride + column;
                (self.ids[sample], self.reversed_z[sample])
            }
        }
    }

    /// Whether a tile of the picture, or a sample beside its first row and column, may show anything.
    pub fn may_show(&self, tile: usize) -> bool {
        let (columns, tiles) = (self.width.div_ceil(SIDE), &self.covers.tiles);
        let (has_left, has_above) = (!tile.is_multiple_of(columns), tile >= columns);
        let is_something = |back: usize| tiles.get(tile - back) != Some(&NOTHING);
        is_something(0)
            || has_left && is_something(1)
            || has_above && is_something(columns)
            || has_left && has_above && is_something(columns + 1)
    }

    /// Stores the samples of a tile of the picture.
    pub fn expand(&mut self, tile: usize) {
        self.store(tile, [0..SIDE, 0..SIDE]);
        if let Some(index) = self.covers.tiles.get_mut(tile) {
            *index = STORED;
        }
    }

    /// Stores the samples of a tile of the picture, and those of the tiles next to it that lie within [`BORDER`] of it.
    pub fn expand_around(&mut self, tile: usize) {
        const SIDES: [(isize, Range<usize>); 3] = [(-1, SIDE - BORDER..SIDE), (0, 0..SIDE), (1, 0..BORDER)];
        let columns = self.covers.columns as isize;
        if self.covers.tiles.is_empty() {
            return;
        }
        self.expand(tile);
        let (column, row) = (tile as isize % columns, tile as isize / columns);
        for (down, rows) in &SIDES {
            for (right, part) in SIDES.iter().filter(|(right, _)| (0..columns).contains(&(column + right))) {
                if let Ok(beside) = usize::try_from((row + down) * columns + column + right) {
                    self.store(beside, [part.clone(), rows.clone()]);
                }
            }
        }
    }

    /// Writes some columns and rows of a tile that are not stored.
    fn store(&mut self, tile: usize, [columns, rows]: [Range<usize>; 2]) {
        let Some(cover) = self.covers.of(tile) else { return };
        let (column, row) = (tile % self.covers.columns * SIDE, tile / self.covers.columns * SIDE);
        let rows = rows.start..rows.end.min(self.height - row);
        let columns = columns.start..columns.end.min(self.width - column);
        let first = (row + rows.start) * self.stride + column;
        let (reversed_z, ids) = (&mut self.reversed_z[first..], &mut self.ids[first..]);
        store(cover, column, [columns, rows], self.stride, reversed_z, ids);
    }

    /// Stores all samples.
    #[cfg(test)]
    pub fn expand_all(&mut self) {
        (0..self.covers.tiles.len()).for_each(|tile| self.expand(tile));
    }

    /// Takes the covers of a layer of the same size; what is drawn from now on only stores samples.
    pub fn share_covers(&mut self, layer: &Self) {
        self.covers.clone_from(&layer.covers);
        self.covers.grow = false;
    }

    /// Takes a tile of a layer whose covers it shares, if it is covered there; else it must be copied.
    pub fn take_cover(&mut self, layer: &Self, tile: usize) -> bool {
        if let Some(index) = layer.covers.tiles.get(tile) {
            self.covers.tiles[tile] = *index;
            return *index != STORED;
        }
        false
    }

    /// Whether a tile is not that of a layer whose covers it shares, to the bit, if it is covered in either.
    pub fn differs_from_cover(&self, layer: &Self, tile: usize) -> Option<bool> {
        let cover = layer.cover(tile)?;
        if self.cover(tile).is_some() {
            return Some(self.covers.tiles[tile] != layer.covers.tiles[tile]);
        }
        let (column, row) = (tile % self.covers.columns * SIDE, tile / self.covers.columns * SIDE);
        let columns = SIDE.min(self.width - column);
        Some((0..SIDE.min(self.height - row)).any(|step| {
            let samples = (row + step) * self.stride + column..(row + step) * self.stride + column + columns;
            self.ids[samples.clone()].iter().any(|&id| id != cover.id)
                || self.reversed_z[samples] != cover.line::<SIDE, 1>(step, column)[..columns]
        }))
    }
}

/// Reversed z of the samples of a tile, after those beside its first row and column.
pub(crate) type TileDepths = [[f32; SIDE + 1]; SIDE + 1];

/// [`VisibilityBuffer::read_tile`], from what covers the tiles before and above, above, before, and itself.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn read_tile(
    covers: [Option<&TileCover>; 4],
    [column, row]: [usize; 2],
    reversed_z: &[f32],
    stride: usize,
    out: &mut TileDepths,
) {
    for (step, out) in out.iter_mut().enumerate() {
        let row = row + step - 1;
        let [before, own] = if step == 0 { [covers[0], covers[1]] } else { [covers[2], covers[3]] };
        let stored = &reversed_z[row * stride + column - 1..];
        out[0] = match before {
            Some(cover) => cover.line::<1, 1>(row % SIDE, column - 1)[0],
            None => stored[0],
        };
        if let (Some(out), Some(stored)) = (out[1..].first_chunk_mut::<SIDE>(), stored[1..].first_chunk::<SIDE>()) {
            *out = match own {
                Some(cover) => cover.line::<SIDE, 1>(row % SIDE, column),
                None => *stored,
            };
        }
    }
}

/// Writes some columns and rows of a tile, whose first column is one of the target; the lists begin in the first row.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn store(
    cover: &TileCover,
    column: usize,
    [columns, rows]: [Range<usize>; 2],
    stride: usize,
    reversed_z: &mut [f32],
    ids: &mut [u32],
) {
    for (step, row) in rows.enumerate() {
        let samples = step * stride + columns.start..step * stride + columns.end;
        let (reversed_z, ids) = (&mut reversed_z[samples.clone()], &mut ids[samples]);
        if let ([near, after], [id, id_after]) = (&mut *reversed_z, &mut *ids) {
            [*near, *after] = cover.line::<BORDER, 1>(row, column + columns.start);
            (*id, *id_after) = (cover.id, cover.id);
            continue;
        }
        let line = cover.line::<SIDE, 1>(row, column + columns.start);
        if let (Some(reversed_z), Some(ids)) = (reversed_z.first_chunk_mut(), ids.first_chunk_mut()) {
            (*reversed_z, *ids) = (line, [cover.id; SIDE]);
        } else {
            reversed_z.iter_mut().zip(line).for_each(|(reversed_z, value)| *reversed_z = value);
            ids.fill(cover.id);
        }
    }
}

/// Draws a triangle where not all samples are stored; says whether it must still be drawn as if they were.
#[inline(never)]
pub(super) fn draw_covered(triangle: &Triangle, id: u32, target: &mut VisibilityBuffer) -> bool {
    let [[left, right], [top, bottom]] = reach(triangle);
    let (right, columns) = (right.min(target.covers.columns - 1), target.covers.columns);
    if right >= left + LARGE || bottom >= top + LARGE {
        let mut rows = target.covers.tiles[top * columns..].chunks(columns).take(bottom + 1 - top);
        if rows.all(|row| row[left..=right].iter().fold(STORED, |all, index| all & index) == STORED) {
            return true;
        }
        draw_by_tiles(triangle, id, target);
        return false;
    }
    let mut is_seen = false;
    for row in top..=bottom {
        for column in left..=right {
            let tile = row * columns + column;
            // What is drawn on samples that are not stored has no effect.
            if target.covers.tiles[tile] == STORED
                || !target.covers.hide(&triangle.gradient, [column, row], target.width)
            {
                target.expand(tile);
                is_seen = true;
            }
        }
    }
    is_seen
}

/// Draws a triangle tile by tile: where it hides all that was there, or is hidden, no sample is touched.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn draw_by_tiles(triangle: &Triangle, id: u32, target: &mut VisibilityBuffer) {
    let [first, _, end] = triangle.rows.map(|row| row as usize);
    for tile_row in first / SIDE..end.div_ceil(SIDE) {
        let top = tile_row * SIDE;
        let rows = triangle.spans_from::<SIDE>(top as u32, target.width, target.scale as u32);
        let own = first.max(top) - top..end.min(top + SIDE) - top;
        let [outer, inner] = rows.extent(&own);
        let band = Band { id, tile_row, outer, inner, own, rows };
        band.draw(&triangle.gradient, target);
    }
}

/// Spans of a triangle in a row of tiles.
struct Band {
    id: u32,
    tile_row: usize,
    /// Columns that any row of the tiles covers, and those that all do.
    outer: [u32; 2],
    inner: [u32; 2],
    /// Spans of the tiles that the triangle has.
    own: Range<usize>,
    rows: Spans<SIDE>,
}

impl Band {
    #[inline(always)]
    fn draw(&self, gradient: &DepthGradient, target: &mut VisibilityBuffer) {
        let [left, right] = self.outer.map(|column| column as usize);
        let mut cover = None;
        let mut column = left / SIDE;
        while column < right.div_ceil(SIDE) {
            let first = column;
            while column < right.div_ceil(SIDE) && self.meets(column, gradient, target, &mut cover) {
                column += 1;
            }
            if first < column {
                for row in self.own.clone() {
                    let at = (self.tile_row * SIDE + row) * target.stride;
                    let part = self.rows.part(row, at, [first, column].map(|column| (column * SIDE) as u32));
                    part.draw::<true>(gradient, self.id, &mut target.reversed_z, &mut target.ids);
                }
            }
            column += 1;
        }
    }

    /// Whether samples of a tile must be drawn, which are stored then.
    #[inline(always)]
    fn meets(
        &self,
        column: usize,
        gradient: &DepthGradient,
        target: &mut VisibilityBuffer,
        own_cover: &mut Option<u32>,
    ) -> bool {
        let covers = &mut target.covers;
        let tile = self.tile_row * covers.columns + column;
        let index = covers.tiles[tile];
        if index == STORED {
            return true;
        }
        let [first, end] = [column, column + 1].map(|column| (column * SIDE) as u32);
        let fills = covers.grow && self.inner[0] <= first && end <= self.inner[1];
        let hides = index == NOTHING || {
            if covers.hide(gradient, [column, self.tile_row], target.width) {
                return false;
            }
            let bounds = |gradient: &DepthGradient| gradient.bounds([column, self.tile_row], target.width);
            fills && bounds(gradient)[0] > bounds(&covers.list[index as usize].gradient)[1]
        };
        if fills && hides {
            covers.tiles[tile] = *own_cover.get_or_insert_with(|| {
                covers.list.push(TileCover::new(self.id, gradient, &self.rows));
                covers.list.len() as u32 - 1
            });
            return false;
        }
        target.expand(tile);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::Corner;

    /// Triangles of all sizes, in front of and behind each other: tiles held as triangles give the samples that single
    /// ones have, on a target and on a layer that it follows.
    #[test]
    fn covered_tiles_have_the_bits_of_single_samples() {
        let mut state = 1_u32;
        let mut draw = |low: f32, high: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / 16_777_216.0
        };
        let (mut covered_tiles, samples) = (0, |target: &VisibilityBuffer| {
            let bits =
                |(reversed_z, ids): (&[f32], &[u32])| (reversed_z.iter().map(|n| n.to_bits()).collect(), ids.to_vec());
            target.rows().map(bits).collect::<Vec<(Vec<u32>, Vec<u32>)>>()
        });
        for round in 0..60 {
            let [width, height] = [100 + round % 7, 70 + round % 5];
            let (mut covered, mut single) = (VisibilityBuffer::default(), VisibilityBuffer::default());
            covered.reset_covered(width, height);
            single.reset::<true>(width, height, 2);
            let (mut over, mut over_single) = (VisibilityBuffer::default(), VisibilityBuffer::default());
            for id in 1..40 {
                let size = if draw(0.0, 1.0) < 0.4 { 400.0 } else { 30.0 };
                let (x, y, depth) = (draw(-20.0, 220.0), draw(-20.0, 160.0), draw(0.5, 2.0));
                // Some are level, some shared by two triangles of the same reversed_z.
                let tilt = if id % 3 == 0 { 0.0 } else { 0.4 };
                let mut corner = || Corner {
                    x: x + draw(-size, size),
                    y: y + draw(-size, size),
                    reversed_z: 1.0 / depth + draw(0.0, tilt),
                };
                let corners = [corner(), corner(), corner()];
                if id == 20 {
                    covered_tiles += (0..covered.covers.tiles.len())
                        .filter(|&tile| covered.cover(tile).is_some_and(|cover| cover.id > 0))
                        .count();
                    (over, over_single) = (covered.clone(), single.clone());
                    over.share_covers(&covered);
                }
                let [target, other] = if id < 20 { [&mut covered, &mut single] } else { [&mut over, &mut over_single] };
                target.draw::<true>(corners, id << 20);
                other.draw::<true>(corners, id << 20);
            }
            for tile in 0..over.covers.tiles.len() {
                let (column, row) = (tile % over.covers.columns * SIDE, tile / over.covers.columns * SIDE);
                let area = (column..(column + SIDE).min(over.width), row..(row + SIDE).min(over.height));
                if let Some(differs) = over.differs_from_cover(&covered, tile) {
                    assert_eq!(differs, over_single.differs(&single, area.0, area.1), "tile {tile} of round {round}");
                }
            }
            for (mut target, other) in [(covered, single), (over, over_single)] {
                target.expand_all();
                assert_eq!(samples(&target), samples(&other), "round {round}");
            }
        }
        assert!(covered_tiles > 500, "{covered_tiles} tiles are held as triangles");
    }
}

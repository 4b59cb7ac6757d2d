//! The tiles of a picture: where they lie, and what is next to them.

use std::ops::Range;

use super::{LightBuffer, NO_RANGE, SAME_DEPTH, SEVERAL, TileSummary};
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::{MIXED, packed, unpacked};
use crate::gbuffer::static_layer::TILE;

impl LightBuffer {
    /// Column and row of a tile among tiles.
    pub(super) fn place_of(&self, tile: usize) -> [usize; 2] {
        self.places[tile].map(usize::from)
    }

    /// Pixels of a tile: columns and rows.
    pub fn pixels_of(&self, tile: usize) -> [Range<usize>; 2] {
        let [column, row] = self.place_of(tile).map(|at| at * TILE);
        [column..(column + TILE).min(self.width), row..(row + TILE).min(self.height)]
    }

    /// Adds the pixels of a tile to the bins of their parts.
    pub(super) fn push_tile(&self, tile: usize, bins: &mut MaterialBins) {
        let [columns, rows] = self.pixels_of(tile);
        let surface = self.tiles[tile].surface;
        let is_whole = surface != SEVERAL && columns.len() * rows.len() == TILE * TILE;
        if surface > 0 && is_whole {
            bins.push_whole(surface, packed(columns.start, rows.start));
        } else if surface > 0 {
            for row in rows {
                for column in columns.clone() {
                    bins.push(self.surface[row * self.width + column], packed(column, row));
                }
            }
        }
    }

    /// Bins the pixels of some tiles by part.
    pub fn fill_bins(&self, parts: usize, tiles: &[usize], bins: &mut MaterialBins) {
        bins.clear(parts);
        tiles.iter().for_each(|&tile| self.push_tile(tile, bins));
    }

    /// The tile that begins at a packed pixel, and that pixel's index.
    pub fn tile_at(&self, place: u32) -> (usize, usize) {
        let [column, row] = unpacked(place).map(|at| at as usize);
        (row / TILE * self.columns + column / TILE, row * self.width + column)
    }

    /// Values of a whole tile, row by row, from the index of its first pixel on.
    pub fn lines<'a>(&self, values: &'a [f32], first: usize) -> [&'a [f32; TILE]; TILE] {
        let line = |row: usize| values[first + row * self.width..].first_chunk();
        std::array::from_fn(|row| line(row).expect("a whole tile lies within the picture"))
    }

    /// Whether no tile is next to a tile on some side, or only part of one.
    pub fn is_at_border(&self, tile: usize) -> bool {
        let [column, row] = self.place_of(tile);
        column == 0 || row == 0 || (column + 1) * TILE >= self.width || (row + 1) * TILE >= self.height
    }

    /// First and last column and row of the tiles within so many pixels of a tile.
    pub(super) fn around(&self, tile: usize, pixels: u16) -> [[isize; 2]; 2] {
        let reach = usize::from(pixels).div_ceil(TILE) as isize;
        let place = self.place_of(tile).map(|at| at as isize);
        [place.map(|at| at - reach), place.map(|at| at + reach)]
    }

    /// Whether all samples of a tile and of those next to it show one triangle, or nothing.
    pub fn shows_one(&self, tile: usize) -> bool {
        self.only_around[tile]
    }

    /// Finds the tiles that show one triangle together with those next to them.
    pub(super) fn find_alike(&mut self) {
        let Self { columns, rows, only, only_around: alike, .. } = self;
        // What lies next to a tile beyond the picture is the tile itself.
        let beside = |at: usize, count: usize| [at.saturating_sub(1), (at + 1).min(count - 1)];
        alike.clear();
        for row in 0..*rows {
            let line = |row: usize| &only[row * *columns..][..*columns];
            let [above, below] = beside(row, *rows);
            let (above, own, below) = (line(above), line(row), line(below));
            alike.extend((0..*columns).map(|at| (own[at] != MIXED) & (own[at] == above[at]) & (own[at] == below[at])));
        }
        let mut whole = vec![false; *columns];
        for row in 0..*rows {
            let (ids, line) = (&only[row * *columns..][..*columns], &mut alike[row * *columns..][..*columns]);
            for (at, whole) in whole.iter_mut().enumerate() {
                let [before, after] = beside(at, *columns);
                let is_one = (ids[before] == ids[at]) & (ids[after] == ids[at]);
                *whole = is_one & line[at] & line[before] & line[after];
            }
            line.copy_from_slice(&whole);
        }
    }

    /// Whether a tile and those next to it, which are whole and on all sides, show one surface at about one depth.
    pub(super) fn is_planar_around(&self, tile: usize) -> bool {
        let own = &self.tiles[tile];
        let is_alike = |other: &TileSummary| {
            let is_near = (other.low - own.low).abs() < SAME_DEPTH * own.low;
            other.is_planar & (other.surface == own.surface) & is_near
        };
        let [column, row] = self.place_of(tile);
        let is_inside = column > 0 && row > 0 && (column + 2) * TILE <= self.width && (row + 2) * TILE <= self.height;
        own.is_planar && own.surface > 0 && is_inside && {
            let first = tile - self.columns - 1;
            (0..3).all(|row| self.tiles[first + row * self.columns..][..3].iter().all(is_alike))
        }
    }

    /// Extremes over a tile and those next to it.
    pub(super) fn range_around(&self, tile: usize, ranges: &[[f32; 2]]) -> [f32; 2] {
        let [column, row] = self.place_of(tile);
        let columns = column.saturating_sub(1)..(column + 2).min(self.columns);
        let [mut lowest, mut highest] = NO_RANGE;
        for row in row.saturating_sub(1)..(row + 2).min(self.rows) {
            for &[low, high] in &ranges[row * self.columns..][columns.clone()] {
                lowest = if low < lowest { low } else { lowest };
                highest = if high > highest { high } else { highest };
            }
        }
        [lowest, highest]
    }
}

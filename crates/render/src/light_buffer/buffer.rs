//! The light buffer: depth, ids, shadow mask and ambient occlusion per pixel of the opaque surfaces, and what each tile shows.

use std::ops::Range;

use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::{MIXED, PixelCenters, packed, unpacked};
use crate::gbuffer::static_layer::{MarkCount, TILE};
use crate::shadow::map::MapFootprint;
use crate::shadow::pcss::UNKNOWN;
use crate::shadow::planar::Blocks;

/// Largest relative difference in depth between pixels on one piece of a surface.
pub(super) const SAME_DEPTH: f32 = 0.02;
/// Raw shadow mask of a pixel on a planar receiver, whose mask is read from the receiver instead.
pub(super) const ON_RECEIVER: f32 = -2.0;
/// Surface number of a tile that shows several surfaces.
pub(super) const SEVERAL: u16 = u16::MAX;
/// Range of no values.
pub(super) const NO_RANGE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];
/// AO samples along the side of a tile.
pub(super) const HALF: usize = TILE / 2;

/// Incoming light per pixel of the opaque surfaces, kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct LightBuffer {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) half_width: usize,
    pub(super) half_height: usize,
    /// Tiles per row, and rows of tiles.
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Depth along the optical axis (m), 0 for the background.
    pub depth: Vec<f32>,
    /// Visibility ids; 0 for the background.
    pub ids: Vec<u32>,
    /// Surface numbers (part number plus one); 0 for the background.
    pub surface: Vec<u16>,
    /// Shadow mask before and after filtering: share of the key light that arrives; [`UNKNOWN`] where it does not matter.
    pub(super) raw_shadow_mask: Vec<f32>,
    pub shadow_mask: Vec<f32>,
    /// Half-resolution ambient occlusion before and after filtering: share of the ambient light that arrives.
    pub(super) raw_half_ao: Vec<f32>,
    pub(super) half_ao: Vec<f32>,
    /// Ambient occlusion at full resolution.
    pub ambient: Vec<f32>,
    pub(super) tiles: Vec<TileSummary>,
    /// By tile: visibility id of the one triangle that all its samples show, or [`MIXED`].
    pub(super) only: Vec<u32>,
    /// By tile: true if it and its eight neighbours show one triangle.
    pub(super) only_around: Vec<bool>,
    /// By tile: range of the raw shadow mask and of the raw ambient occlusion.
    pub(super) shadow_range: Vec<[f32; 2]>,
    pub(super) ao_range: Vec<[f32; 2]>,
    /// By tile: true if no SSAO is needed (no depth edge within reach).
    pub(super) is_unoccluded: Vec<bool>,
    /// By tile: true if no fixture but the main support surface is within reach.
    pub(super) is_far_from_statics: Vec<bool>,
    /// Scratch summed-area table over tiles.
    pub(super) marks: MarkCount,
}

/// Summary of a tile.
#[derive(Clone, Debug, Default)]
pub(super) struct TileSummary {
    /// The one surface that it shows, or [`SEVERAL`].
    pub surface: u16,
    /// Reach of its SSAO taps on the image (px).
    pub reach: u16,
    /// Its bounds on the shadow map.
    pub footprint: MapFootprint,
    /// Cells of the planar receiver that it reads, if all its pixels lie on that receiver.
    pub receiver: Option<Blocks>,
    /// True if only some of its pixels may lie on a planar receiver.
    pub has_receiver: bool,
    /// True if it shows a fixture other than the main support surface.
    pub has_fixture: bool,
}

impl LightBuffer {
    /// Changes the size; all tiles must be estimated then.
    pub fn reset(&mut self, width: usize, height: usize) {
        if (self.width, self.height) == (width, height) {
            return;
        }
        (self.width, self.height) = (width, height);
        (self.half_width, self.half_height) = (width.div_ceil(2), height.div_ceil(2));
        (self.columns, self.rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let (pixels, tiles) = (width * height, self.columns * self.rows);
        self.depth = vec![0.0; pixels];
        self.ids = vec![0; pixels];
        self.surface = vec![0; pixels];
        for list in [&mut self.raw_shadow_mask, &mut self.shadow_mask, &mut self.ambient] {
            *list = vec![UNKNOWN; pixels];
        }
        for list in [&mut self.raw_half_ao, &mut self.half_ao] {
            *list = vec![UNKNOWN; self.half_width * self.half_height];
        }
        self.tiles = vec![TileSummary::default(); tiles];
        self.only = vec![MIXED; tiles];
        self.only_around = vec![false; tiles];
        for list in [&mut self.shadow_range, &mut self.ao_range] {
            *list = vec![NO_RANGE; tiles];
        }
    }

    /// Visible surfaces at the pixel centres.
    pub fn centers(&self) -> PixelCenters<'_> {
        PixelCenters { width: self.width, ids: &self.ids, depth: &self.depth, columns: self.columns, only: &self.only }
    }

    /// True if a tile may show the background.
    pub fn may_be_empty(&self, tile: usize) -> bool {
        matches!(self.tiles[tile].surface, 0 | SEVERAL)
    }

    /// Column and row of a tile.
    pub(super) fn place_of(&self, tile: usize) -> [usize; 2] {
        [tile % self.columns, tile / self.columns]
    }

    /// Columns and rows of the pixels of a tile.
    pub fn pixels_of(&self, tile: usize) -> [Range<usize>; 2] {
        let [column, row] = self.place_of(tile).map(|at| at * TILE);
        [column..(column + TILE).min(self.width), row..(row + TILE).min(self.height)]
    }

    /// Columns and rows of the AO samples of a tile.
    pub(super) fn half_pixels_of(&self, tile: usize) -> [Range<usize>; 2] {
        self.pixels_of(tile).map(|range| range.start / 2..range.end.div_ceil(2))
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

    /// Index of the tile that begins at a packed pixel, and index of that pixel.
    pub fn tile_at(&self, place: u32) -> (usize, usize) {
        let [column, row] = unpacked(place).map(|at| at as usize);
        (row / TILE * self.columns + column / TILE, row * self.width + column)
    }

    /// Rows of a whole tile, from the index of its first pixel.
    pub fn lines<'a>(&self, values: &'a [f32], first: usize) -> [&'a [f32; TILE]; TILE] {
        let line = |row: usize| values[first + row * self.width..].first_chunk();
        std::array::from_fn(|row| line(row).expect("a whole tile lies within the image"))
    }

    /// First and last column and row of the tiles within some pixels of a tile.
    pub(super) fn around(&self, tile: usize, pixels: u16) -> [[isize; 2]; 2] {
        let reach = usize::from(pixels).div_ceil(TILE) as isize;
        let place = self.place_of(tile).map(|at| at as isize);
        [place.map(|at| at - reach), place.map(|at| at + reach)]
    }

    /// True if all samples of a tile and its neighbours show one triangle, or the background.
    pub fn shows_one(&self, tile: usize) -> bool {
        self.only_around[tile]
    }

    /// Range of values over a tile and its neighbours.
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

/// Fills columns and rows of a list that is `width` wide.
pub(super) fn fill(list: &mut [f32], width: usize, [columns, rows]: [Range<usize>; 2], value: f32) {
    for row in rows {
        list[row * width..][columns.clone()].fill(value);
    }
}

/// Writes the first values of a tile's row; all of them without a call.
#[inline(always)]
pub(super) fn put<T: Copy, const SIDE: usize>(out: &mut [T], values: &[T; SIDE]) {
    match out.first_chunk_mut::<SIDE>() {
        Some(whole) => *whole = *values,
        // Two copies of a slice would become one call with a length.
        None => out.iter_mut().zip(values).for_each(|(out, value)| *out = *value),
    }
}

/// Reads the values of a tile's row; `beyond` stands for those outside the image.
#[inline(always)]
pub(super) fn line_of<T: Copy, const SIDE: usize>(values: &[T], beyond: T) -> [T; SIDE] {
    if let Some(whole) = values.first_chunk() {
        return *whole;
    }
    let mut line = [beyond; SIDE];
    line.iter_mut().zip(values).for_each(|(line, value)| *line = *value);
    line
}

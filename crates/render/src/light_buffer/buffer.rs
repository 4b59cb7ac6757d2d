//! Light buffer: depth, ids, shadow mask and ambient occlusion per pixel of opaque surfaces, with a summary per tile.

use std::ops::Range;

use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::{PixelCenters, packed};
use crate::gbuffer::static_layer::{MarkCount, TILE};
use crate::shadow::map::MapFootprint;
use crate::shadow::pcss::UNKNOWN;

/// Largest relative difference in depth between pixels that count as one piece of a surface.
pub(super) const SAME_DEPTH: f32 = 0.02;
/// Value in place of a surface number for a tile with several surfaces.
pub(super) const SEVERAL: u16 = u16::MAX;
/// Value in place of a visibility id for a tile with several visibility ids.
pub(super) const MIXED: u32 = u32::MAX;
/// Range (lowest, highest) of an empty set of values.
const NO_RANGE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];
/// Number of AO samples along a side of a tile.
pub(super) const HALF: usize = TILE / 2;

/// Light that arrives at each pixel of the opaque surfaces, kept from frame to frame; whole tiles.
#[derive(Debug, Default)]
pub(crate) struct LightBuffer {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Tiles per row, and rows of tiles.
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Depth along the optical axis (m), 0 for the background.
    pub depth: Vec<f32>,
    /// Visibility ids; 0 for the background.
    pub ids: Vec<u32>,
    /// Surface numbers (part number plus one); 0 for the background.
    pub surface: Vec<u16>,
    /// Depth and surface numbers of the AO samples.
    pub(super) half_depth: Vec<f32>,
    pub(super) half_surface: Vec<u16>,
    /// Shadow mask before and after filtering: unoccluded share of the key light, 0-1; [`UNKNOWN`] where a surface
    /// faces away or there is none.
    pub(super) raw_shadow_mask: Vec<f32>,
    pub shadow_mask: Vec<f32>,
    /// Half-resolution ambient occlusion before and after filtering: unoccluded share of the ambient light, 0-1.
    pub(super) raw_half_ao: Vec<f32>,
    pub(super) half_ao: Vec<f32>,
    /// Unoccluded share of the ambient light at full resolution, 0-1.
    pub ambient: Vec<f32>,
    pub(super) tiles: Vec<TileSummary>,
    /// By tile: range (lowest, highest) of the raw shadow mask, and of the raw ambient occlusion.
    pub(super) shadow_range: Vec<[f32; 2]>,
    pub(super) ao_range: Vec<[f32; 2]>,
    /// By tile: true if SSAO would find no occlusion; see `find_unoccluded`.
    pub(super) is_unoccluded: Vec<bool>,
    /// By tile: true if there is no fixture within reach of its SSAO taps, or only one support surface.
    pub(super) is_far_from_statics: Vec<bool>,
    /// Summed-area table over tiles, used as scratch memory.
    pub(super) marks: MarkCount,
}

/// Summary of a tile.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TileSummary {
    /// Number of the surface that the tile shows if it is only one, else [`SEVERAL`].
    pub surface: u16,
    /// Surface number of the fixture that the tile shows if it is only one, [`SEVERAL`] for more, 0 for none.
    pub fixture: u16,
    /// Visibility id that all samples of the tile have in common, else [`MIXED`].
    pub only: u32,
    /// Largest distance of SSAO taps from a pixel of the tile (px).
    pub reach: u16,
    /// Bounds of the tile's points in the shadow map.
    pub footprint: MapFootprint,
}

impl LightBuffer {
    /// Changes the size (px, a multiple of the tile size); all tiles must be estimated afterwards.
    pub fn reset(&mut self, width: usize, height: usize) {
        if (self.width, self.height) == (width, height) {
            return;
        }
        (self.width, self.height) = (width, height);
        (self.columns, self.rows) = (width / TILE, height / TILE);
        let (pixels, tiles) = (width * height, self.columns * self.rows);
        self.depth = vec![0.0; pixels];
        self.ids = vec![0; pixels];
        self.surface = vec![0; pixels];
        for list in [&mut self.raw_shadow_mask, &mut self.shadow_mask, &mut self.ambient] {
            *list = vec![UNKNOWN; pixels];
        }
        for list in [&mut self.raw_half_ao, &mut self.half_ao, &mut self.half_depth] {
            *list = vec![UNKNOWN; pixels / 4];
        }
        self.half_surface = vec![0; pixels / 4];
        self.tiles = vec![TileSummary::default(); tiles];
        for list in [&mut self.shadow_range, &mut self.ao_range] {
            *list = vec![NO_RANGE; tiles];
        }
    }

    /// Visible surface at each pixel centre.
    pub fn centers(&self) -> PixelCenters<'_> {
        PixelCenters { width: self.width, ids: &self.ids, depth: &self.depth }
    }

    /// True if a tile may show the background.
    pub fn may_be_empty(&self, tile: usize) -> bool {
        matches!(self.tiles[tile].surface, 0 | SEVERAL)
    }

    /// Column and row of a tile among tiles.
    pub(super) fn place_of(&self, tile: usize) -> [usize; 2] {
        [tile % self.columns, tile / self.columns]
    }

    /// Columns and rows of the pixels of a tile.
    pub fn pixels_of(&self, tile: usize) -> [Range<usize>; 2] {
        self.place_of(tile).map(|at| at * TILE..(at + 1) * TILE)
    }

    /// Columns and rows of the AO samples of a tile.
    pub(super) fn half_pixels_of(&self, tile: usize) -> [Range<usize>; 2] {
        self.place_of(tile).map(|at| at * HALF..(at + 1) * HALF)
    }

    /// Replaces the bins by the pixels of tiles, by part.
    pub fn fill_bins(&self, parts: usize, tiles: &[usize], bins: &mut MaterialBins) {
        bins.clear(parts);
        tiles.iter().for_each(|&tile| self.push_tile::<1>(tile, bins));
    }

    /// Adds the pixels of a tile to the bins of their parts; if it shows a single surface, only those on every `STEP`th
    /// diagonal.
    pub(super) fn push_tile<const STEP: usize>(&self, tile: usize, bins: &mut MaterialBins) {
        let ([columns, rows], surface) = (self.pixels_of(tile), self.tiles[tile].surface);
        if surface != SEVERAL {
            let first = packed(columns.start, rows.start);
            let [row, column] = [|i: usize| i / TILE, |i: usize| i % TILE + i / TILE % STEP];
            let places = (0..TILE * TILE / STEP).map(|i| first + packed(column(i * STEP), row(i * STEP)));
            return bins.extend(surface, places);
        }
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            bins.extend(self.surface[row * self.width + column], [packed(column, row)]);
        }
    }

    /// First and last (column, row) of the tiles within a distance (px) of a tile; may exceed the grid of tiles.
    pub(super) fn around(&self, tile: usize, pixels: u16) -> [[isize; 2]; 2] {
        let reach = usize::from(pixels).div_ceil(TILE) as isize;
        let place = self.place_of(tile).map(|at| at as isize);
        [place.map(|at| at - reach), place.map(|at| at + reach)]
    }

    /// Rows of a tile and its neighbours, as ranges of tiles.
    fn neighbours(&self, tile: usize) -> impl Iterator<Item = Range<usize>> {
        let ([column, row], columns) = (self.place_of(tile), self.columns);
        (row.saturating_sub(1)..(row + 2).min(self.rows))
            .map(move |row| row * columns + column.saturating_sub(1)..row * columns + (column + 2).min(columns))
    }

    /// Marks each tile in `range` that has a marked neighbour in `others`; returns all marked tiles in `range`.
    pub fn spread(&self, others: &[bool], range: Range<usize>, marks: &mut [bool]) -> Vec<usize> {
        let is_near = |tile: usize| self.neighbours(tile).any(|line| others[line].contains(&true));
        range.clone().for_each(|tile| marks[tile] |= is_near(tile));
        range.filter(|&tile| marks[tile]).collect()
    }

    /// True if all samples of a tile and its neighbours show the same triangle, or all show the background.
    pub fn shows_one(&self, tile: usize) -> bool {
        let only = self.tiles[tile].only;
        only != MIXED && self.neighbours(tile).all(|line| self.tiles[line].iter().all(|other| other.only == only))
    }

    /// Range of values over a tile and its neighbours.
    pub(super) fn range_around(&self, tile: usize, ranges: &[[f32; 2]]) -> [f32; 2] {
        let [mut lowest, mut highest] = NO_RANGE;
        for &[low, high] in self.neighbours(tile).flat_map(|line| &ranges[line]) {
            lowest = if low < lowest { low } else { lowest };
            highest = if high > highest { high } else { highest };
        }
        [lowest, highest]
    }
}

/// Sets the values at ranges of columns and rows of a buffer that is `width` wide.
pub(super) fn fill(list: &mut [f32], width: usize, [columns, rows]: [Range<usize>; 2], value: f32) {
    for row in rows {
        list[row * width..][columns.clone()].fill(value);
    }
}

//! Per pixel of the opaque surfaces: share of the key light and of the ambient light that arrives.
//!
//! Few taps whose pattern repeats every 4×4 pixels, then a mean over such a block without crossing from one surface
//! to another. Ambient light varies slowly: it is estimated at every other row and column.
//!
//! A tile depends on tiles within a known reach only, so that a frame can be continued where nothing changed.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use std::iter::StepBy;
use std::ops::Range;

use glam::Vec2;
use multiversion::multiversion;

use crate::ambient::irradiance_grid::IrradianceGrid;
use crate::ambient::ssao::{SsaoTaps, occlude};
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::{MIXED, PixelCenters, Pixels, Points, packed};
use crate::gbuffer::static_layer::{MarkCount, TILE, marked_around};
use crate::gbuffer::view::{CameraView, View};
use crate::render_scene::RenderScene;
use crate::scene::assets::RenderAssets;
use crate::scene::variation::RenderVariation;
use crate::shadow::map::{MapFootprint, ShadowMap, UnresolvedSamples};
use crate::shadow::planar::{Blocks, Reading};
use crate::simd::{BatchColumn, CHUNK, nearest_integer};

/// Where a pixel covers less than this many texels of the shadow map, four pixels share an estimate of the key light:
/// the softest edges that the map can show are three times as wide.
const COARSE_TEXELS: f32 = 0.75;
/// Pixels beyond a tile up to which the light on the table is read: a tile on one plane ends a pixel beyond its last one,
/// and rounding.
const EDGE_PX: f32 = 1.5;
/// The same along a row, where the nodes of a tile may lie a tile beyond it.
const NODES_PX: f32 = TILE as f32 + EDGE_PX;
/// Pixels of one surface whose depths differ by less than this share lie on one piece of it.
const SAME_DEPTH: f32 = 0.02;
/// Estimate of a pixel whose share of the key light is read from a level top.
const ON_TOP: f32 = -2.0;

mod blur;
mod changes;
mod shadow_mask;
mod surfaces;
mod tiled_buffer;
mod tiles;
mod upsample;

use crate::shadow::pcss::UNKNOWN;
use blur::Windows;
use changes::{Changes, Estimates};
use tiled_buffer::TiledBuffer;
use upsample::{HALF, UpsampleWindow, upsample_planar_tile, upsample_tile};

/// What the centres of an [`LightBuffer`]'s pixels see, while its other fields are written.
macro_rules! centers {
    ($of:expr) => {
        PixelCenters { width: $of.width, ids: &$of.ids, depth: &$of.depth, columns: $of.columns, only: &$of.only }
    };
}

/// Arriving light per pixel, kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct LightBuffer {
    width: usize,
    height: usize,
    half_width: usize,
    half_height: usize,
    columns: usize,
    rows: usize,
    /// Depth of what is opaque, 0 where there is nothing.
    pub depth: Vec<f32>,
    /// Visibility ids, and the part in them; 0 where there is nothing.
    pub ids: Vec<u32>,
    pub surface: Vec<u16>,
    /// As estimated, and as blurred.
    raw_shadow_mask: TiledBuffer,
    pub shadow_mask: TiledBuffer,
    /// At constant rows and columns: as estimated, and as blurred.
    raw_half_ao: TiledBuffer,
    half_ao: TiledBuffer,
    pub ambient: TiledBuffer,
    tiles: Vec<TileSummary>,
    /// By tile: column and row of tiles.
    places: Vec<[u16; 2]>,
    /// By tile: the one triangle that all its samples show, as a visibility id, or [`MIXED`]; and whether those next to it
    /// show it, too.
    only: Vec<u32>,
    only_around: Vec<bool>,
    /// By tile: whether it and those next to it show one surface at about one depth.
    planar_around: Vec<bool>,
    ranges: Ranges,
    /// Where nothing can be darkened by what is near on the picture, in this one and in the one before.
    is_unoccluded: Vec<bool>,
    was_unoccluded: Vec<bool>,
    /// Where no fixed thing but the table is near.
    is_far_from_statics: Vec<bool>,
    boundaries: MarkCount,
    changes: MarkCount,
    shadow_changes: MarkCount,
    changed: Changes,
    windows: Box<Windows>,
    window: Box<UpsampleWindow>,
    work: Box<Work>,
}

/// Memory of the estimates.
#[derive(Debug, Default)]
struct Work {
    pixels: Pixels,
    points: Points,
    taps: SsaoTaps,
    unresolved: UnresolvedSamples,
    reading: Reading,
    /// Pixels that show level tops.
    tops: MaterialBins,
    /// Tiles whose pixels share estimates of the key light, and the pixels that do, in bits; all of a level tile.
    coarse: Vec<(usize, u64)>,
    /// Tiles whose shares of the key light and of the ambient light follow from estimates.
    doubtful: Vec<usize>,
    dark: Vec<usize>,
    /// Tiles of which four estimates of the ambient light share one.
    shared: Vec<usize>,
    /// Pixels of tiles that only what is not in the picture may darken.
    open: MaterialBins,
    /// Estimates of the picture before.
    before: Vec<(usize, Estimates)>,
}

/// What a tile shows.
#[derive(Clone, Debug)]
struct TileSummary {
    /// The one surface that is seen, or [`SEVERAL`].
    surface: u16,
    /// Reach of its taps on the image, pixels.
    reach: u16,
    /// Where it lies on the shadow map.
    footprint: MapFootprint,
    /// What its pixels read of the level top that all of them show.
    top: Option<Blocks>,
    /// Whether only some of its pixels may show one.
    has_top: bool,
    /// Whether any shows a fixed thing other than the table.
    has_fixed: bool,
    /// Whether its pixels are much smaller than the shadow map's texels.
    is_coarse: bool,
    /// Whether all its pixels show one surface at about one depth, and the smallest reversed_z of what is there.
    is_planar: bool,
    low: f32,
}

/// By tile, smallest and largest shares.
#[derive(Debug, Default)]
struct Ranges {
    /// Of the key light as estimated.
    key: Vec<[f32; 2]>,
    /// Of the ambient light, and over the tiles next to it too.
    ambient: Vec<[f32; 2]>,
    ambient_around: Vec<[f32; 2]>,
}

const SEVERAL: u16 = u16::MAX;
const NO_RANGE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl LightBuffer {
    /// Starts over at a size; every tile must be seen and estimated then.
    pub fn reset(&mut self, width: usize, height: usize) {
        // May have been passed on.
        self.depth.resize(width * height, 0.0);
        if (self.width, self.height) == (width, height) {
            return;
        }
        (self.width, self.height) = (width, height);
        (self.half_width, self.half_height) = (width.div_ceil(2), height.div_ceil(2));
        (self.columns, self.rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let tiles = self.columns * self.rows;
        for field in [&mut self.raw_shadow_mask, &mut self.shadow_mask, &mut self.ambient] {
            field.reset([width, height], tiles, UNKNOWN);
        }
        for field in [&mut self.raw_half_ao, &mut self.half_ao] {
            field.reset([self.half_width, self.half_height], tiles, UNKNOWN);
        }
        self.ids.clear();
        self.ids.resize(width * height, 0);
        self.surface.clear();
        self.surface.resize(width * height, 0);
        let tile = TileSummary {
            surface: 0,
            reach: 0,
            footprint: MapFootprint::default(),
            top: None,
            has_top: false,
            has_fixed: false,
            is_coarse: false,
            is_planar: false,
            low: 0.0,
        };
        self.tiles.clear();
        self.tiles.resize(tiles, tile);
        let place = |tile: usize| [(tile % self.columns) as u16, (tile / self.columns) as u16];
        self.places.clear();
        self.places.extend((0..tiles).map(place));
        self.only.clear();
        self.only.resize(tiles, MIXED);
        for list in [&mut self.only_around, &mut self.planar_around] {
            list.clear();
            list.resize(tiles, false);
        }
        for list in [&mut self.ranges.key, &mut self.ranges.ambient, &mut self.ranges.ambient_around] {
            list.clear();
            list.resize(tiles, NO_RANGE);
        }
    }

    /// What the pixels' centres see.
    pub fn centers(&self) -> PixelCenters<'_> {
        centers!(self)
    }

    /// The one surface that a tile shows, 0 for nothing; `None` for several.
    pub fn surface_of(&self, tile: usize) -> Option<u16> {
        Some(self.tiles[tile].surface).filter(|&surface| surface != SEVERAL)
    }

    /// Whether a tile shows nothing anywhere.
    pub fn may_be_empty(&self, tile: usize) -> bool {
        matches!(self.tiles[tile].surface, 0 | SEVERAL)
    }

    /// The tiles whose estimates may have changed: those that show something else, those whose taps reach one unless they
    /// are plain as before, and those on which the shadows may have changed since a version of the shadow map.
    pub fn mark_stale(&mut self, changed: &[bool], shadow: &ShadowMap, version: u64, stale: &mut Vec<bool>) {
        self.changes.count(changed.iter().copied(), self.columns, self.rows);
        let (marks, columns) = shadow.changed_after(version);
        self.shadow_changes.count(marks, columns, columns);
        stale.clear();
        stale.extend(self.tiles.iter().enumerate().map(|(tile, summary)| {
            let is_near = || {
                let [from, to] = self.around(tile, summary.reach);
                let stays_unoccluded = self.is_unoccluded[tile] && self.was_unoccluded.get(tile) == Some(&true);
                !stays_unoccluded && self.changes.any(from, to)
            };
            if changed[tile] || is_near() {
                return true;
            }
            if let (Some(blocks), Some(top)) = (summary.top, shadow.planar_receivers().of(summary.surface)) {
                return top.changed_after(version, blocks);
            }
            let [mut shadow_from, mut shadow_to] = summary.footprint.reach();
            if summary.has_top {
                // The cells of a top reach further than the taps of a pixel.
                shadow_from = shadow_from.map(|tile| tile - 1);
                shadow_to = shadow_to.map(|tile| tile + 1);
            }
            self.shadow_changes.any(shadow_from, shadow_to)
        }));
    }

    /// Finds the tiles where nothing can be darkened by what is near on the picture; on the table, which has a light of its
    /// own, only fixed things do.
    pub fn find_unoccluded(&mut self, assets: &RenderAssets, variation: &RenderVariation, table: u16) {
        let is_on = variation.occlusion_radius_m > 0.0;
        let Self { columns, rows, .. } = *self;
        std::mem::swap(&mut self.is_unoccluded, &mut self.was_unoccluded);
        let (mut is_unoccluded, mut is_far_from_statics) =
            (std::mem::take(&mut self.is_unoccluded), std::mem::take(&mut self.is_far_from_statics));
        self.boundaries.count(self.tiles.iter().map(|tile| tile.has_fixed), columns, rows);
        is_far_from_statics.clear();
        is_far_from_statics.extend(self.tiles.iter().enumerate().map(|(tile, summary)| {
            let [from, to] = self.around(tile, summary.reach);
            !self.boundaries.any(from, to)
        }));
        let (tiles, places) = (&self.tiles, &self.places);
        let is_boundary = |(tile, own): (usize, &TileSummary)| {
            let ([column, row], own) = (places[tile].map(usize::from), own.surface);
            own == SEVERAL
                || (column + 1 < columns && tiles[tile + 1].surface != own)
                || (row + 1 < rows && tiles[tile + columns].surface != own)
        };
        self.boundaries.count(tiles.iter().enumerate().map(is_boundary), columns, rows);
        is_unoccluded.clear();
        is_unoccluded.extend(self.tiles.iter().enumerate().map(|(tile, summary)| {
            let part = assets.parts.get((summary.surface as usize).wrapping_sub(1));
            let [from, to] = self.around(tile, summary.reach);
            // Only one convex part is seen all around.
            let is_alone = || part.is_none_or(|part| part.convex) && !self.boundaries.any(from, to);
            !is_on || is_far_from_statics[tile] && summary.surface == table && table > 0 || is_alone()
        }));
        (self.is_unoccluded, self.is_far_from_statics) = (is_unoccluded, is_far_from_statics);
    }

    /// Marks the tiles that may show the table where its ambient light changed after a version.
    pub fn mark_table(&self, irradiance_grid: &IrradianceGrid, version: u64, camera: &CameraView, marks: &mut [bool]) {
        for (tile, mark) in marks.iter_mut().enumerate().filter(|(_, mark)| !**mark) {
            let summary = &self.tiles[tile];
            if self.only[tile] != MIXED && summary.surface != irradiance_grid.surface() {
                continue;
            }
            let is_whole = self.only[tile] != MIXED && summary.top.is_some();
            let [columns, rows] =
                self.pixels_of(tile).map(|range| [range.start, range.end - 1].map(|pixel| pixel as f32));
            let [left, right] = [columns[0] - NODES_PX, columns[1] + NODES_PX];
            let [top, bottom] = [rows[0] - EDGE_PX, rows[1] + EDGE_PX];
            let corners = [[left, top], [right, top], [left, bottom], [right, bottom]].map(Vec2::from_array);
            *mark = !is_whole || irradiance_grid.changed_between(version, camera, corners);
        }
    }

    /// Estimates both shares of the pixels of stale tiles among some.
    pub fn estimate(&mut self, scene: &RenderScene<'_>, view: &View, tiles: &[usize], bins: &mut MaterialBins) {
        let (assets, shadow, variation) = (scene.assets, scene.shadow, scene.variation);
        let table = scene.irradiance_grid.surface();
        let mut work = std::mem::take(&mut self.work);
        self.keep_estimates(tiles, &mut work.before);
        self.find_key(shadow, &view.camera, tiles, bins, assets.parts.len(), &mut work);
        let Work { pixels, points, taps, unresolved, reading, tops, coarse, dark, shared, open, .. } = &mut *work;
        let centers = centers!(self);
        bins.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.camera);
            shadow.classify(points, &mut self.raw_shadow_mask, unresolved);
        });
        if shadow.is_on() {
            shadow.resolve(unresolved, &mut self.raw_shadow_mask);
        }
        coarse.iter().for_each(|&(tile, shared)| self.share_key(tile, shared));
        let centers = centers!(self);
        for (part, tiles, places) in tops.parts() {
            if let Some(top) = shadow.planar_receivers().of(part as u16 + 1) {
                top.light([tiles, places], centers, &view.camera, reading, &mut self.shadow_mask);
            }
        }
        open.clear(assets.parts.len());
        let bodies = scene.proxies.count().then_some(&mut *open);
        self.find_ambient(tiles, bins, assets.parts.len(), [dark, shared], table, bodies);
        let is_table = |part: usize| part + 1 == usize::from(table);
        let centers = centers!(self);
        bins.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.camera);
            let (size, top) = ([self.width, self.height], scene.irradiance_grid.top().filter(|_| !is_table(part)));
            occlude(points, &self.depth, size, &view.camera, top, variation, taps);
            if !is_table(part) {
                scene.proxies.darken(points, assets.parts[part].body, &mut taps.share);
            }
            put_half(points, &taps.share, &mut self.raw_half_ao, self.half_width);
        });
        open.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.camera);
            taps.share = [1.0; CHUNK];
            scene.proxies.darken(points, assets.parts[part].body, &mut taps.share);
            put_half(points, &taps.share, &mut self.raw_half_ao, self.half_width);
        });
        work.shared.iter().for_each(|&tile| self.share_ambient(tile));
        for &tile in &work.doubtful {
            let [columns, rows] = self.pixels_of(tile);
            let summary = &self.tiles[tile];
            let step = if summary.is_coarse && summary.is_planar { 2 } else { 1 };
            self.ranges.key[tile] = range_of::<TILE>(&self.raw_shadow_mask, self.width, columns, rows.step_by(step));
        }
        for &tile in &work.dark {
            let [columns, rows] = self.pixels_of(tile);
            let (columns, rows) = (columns.start / 2..columns.end.div_ceil(2), rows.start / 2..rows.end.div_ceil(2));
            self.ranges.ambient[tile] = range_of::<HALF>(&self.raw_half_ao, self.half_width, columns, rows.step_by(1));
        }
        self.compare_estimates(&work.before);
        self.work = work;
    }

    /// Writes the ambient light of tiles where nothing can be darkened, and lists every other row and column of the
    /// others; the former are listed elsewhere if anything that is not in the picture may darken them.
    fn find_ambient(
        &mut self,
        tiles: &[usize],
        bins: &mut MaterialBins,
        parts: usize,
        [dark, shared]: [&mut Vec<usize>; 2],
        table: u16,
        mut open: Option<&mut MaterialBins>,
    ) {
        bins.clear(parts);
        dark.clear();
        shared.clear();
        let has_bodies = open.is_some();
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            let (surface, is_unoccluded) = (self.tiles[tile].surface, self.is_unoccluded[tile]);
            let is_far_from_statics = self.is_far_from_statics[tile];
            // For the hand's camera bodies tell what the picture does of things near by, except of fixed ones.
            let list = match &mut open {
                Some(open) if is_unoccluded || is_far_from_statics => &mut **open,
                _ => &mut *bins,
            };
            if has_bodies
                && (is_unoccluded || is_far_from_statics)
                && surface > 0
                && surface != SEVERAL
                && surface != table
            {
                // Only bodies darken it, and slowly from place to place.
                self.raw_half_ao.set_varying(tile);
                list.push_every::<4>(surface, &columns, &rows);
                dark.push(tile);
                shared.push(tile);
                continue;
            }
            if surface != SEVERAL {
                let is_lit = surface > 0 && is_unoccluded;
                let half = [&columns, &rows].map(|range| range.start / 2..range.end.div_ceil(2));
                self.raw_half_ao.fill(tile, half, if is_lit { 1.0 } else { UNKNOWN });
                if surface == 0 || is_lit {
                    self.ranges.ambient[tile] = if is_lit { [1.0; 2] } else { NO_RANGE };
                } else {
                    self.raw_half_ao.set_varying(tile);
                    list.push_every::<2>(surface, &columns, &rows);
                    dark.push(tile);
                }
                continue;
            }
            self.raw_half_ao.set_varying(tile);
            dark.push(tile);
            for row in rows.step_by(2) {
                let first = row / 2 * self.half_width;
                for column in columns.clone().step_by(2) {
                    let surface = self.surface[row * self.width + column];
                    let is_lit = surface > 0 && (is_unoccluded || surface == table && is_far_from_statics);
                    self.raw_half_ao[first + column / 2] = if is_lit { 1.0 } else { UNKNOWN };
                    if !is_lit {
                        list.push(surface, packed(column, row));
                    }
                }
            }
        }
    }

    /// Gives the estimates of a tile, two by two, the first of them.
    fn share_ambient(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile).map(|range| range.start / 2..range.end.div_ceil(2));
        for row in rows {
            let given: [f32; HALF] = line_of(&self.raw_half_ao[(row & !1) * self.half_width..][columns.clone()], 0.0);
            let shared: [f32; HALF] = std::array::from_fn(|step| given[step & !1]);
            put(&mut self.raw_half_ao[row * self.half_width..][columns.clone()], &shared);
        }
    }

    /// The ambient light at every pixel of tiles, each from the four coarse pixels around it that show the same surface,
    /// among some where any of these may have changed; those next to them must be blurred.
    pub fn upsample(&mut self, tiles: Range<usize>) {
        let mut window = std::mem::take(&mut self.window);
        for tile in marked_around(&self.changed.blurred, self.columns, tiles) {
            let (is_lit_anew, ambient) = (self.changed.light[tile], |own: &Self| own.square(&own.ambient, tile));
            self.changed.light[tile] = self.alters(is_lit_anew, ambient, |own| own.upsample_tile(tile, &mut window));
        }
        self.window = window;
    }

    fn upsample_tile(&mut self, tile: usize, window: &mut UpsampleWindow) {
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.ranges.ambient_around[tile];
        if low >= high {
            // One value all around; where nothing was estimated, nothing is darkened.
            self.ambient.fill(tile, [columns, rows], if low == high { low } else { 1.0 });
            return;
        }
        self.ambient.set_varying(tile);
        let refined = if self.planar_around[tile] {
            upsample_planar_tile(&self.half_ao[rows.start / 2 * self.half_width + columns.start / 2..], self.half_width)
        } else {
            self.fill_window(columns.start, rows.start, window);
            upsample_tile(window)
        };
        for (row, line) in rows.zip(&refined) {
            put(&mut self.ambient[row * self.width..][columns.clone()], line);
        }
    }
}

/// Writes values of points at constant rows and columns.
fn put_half(points: &Points, share: &BatchColumn, half: &mut [f32], width: usize) {
    for i in 0..points.count {
        let (column, row) = (nearest_integer(points.column[i]), nearest_integer(points.row[i]));
        half[row as usize / 2 * width + column as usize / 2] = share[i];
    }
}

/// Smallest and largest value of some rows of a rectangle of at most so many columns, without those that are unknown.
#[multiversion(targets("x86_64+avx2+fma"))]
fn range_of<const SIDE: usize>(
    values: &[f32],
    width: usize,
    columns: Range<usize>,
    rows: StepBy<Range<usize>>,
) -> [f32; 2] {
    // One pair of extremes per column: columns are independent, so this runs in vectors.
    let (mut low, mut high) = ([f32::INFINITY; SIDE], [f32::NEG_INFINITY; SIDE]);
    for row in rows {
        let line: [f32; SIDE] = line_of(&values[row * width..][columns.clone()], UNKNOWN);
        for column in 0..SIDE {
            let value = line[column];
            low[column] = if (value >= 0.0) & (value < low[column]) { value } else { low[column] };
            high[column] = if (value >= 0.0) & (value > high[column]) { value } else { high[column] };
        }
    }
    [low.into_iter().fold(f32::INFINITY, f32::min), high.into_iter().fold(f32::NEG_INFINITY, f32::max)]
}

/// Writes the first values of a tile's row; all of them without a call.
#[inline(always)]
fn put<T: Copy, const SIDE: usize>(out: &mut [T], values: &[T; SIDE]) {
    match out.first_chunk_mut::<SIDE>() {
        Some(whole) => *whole = *values,
        // Two copies of a slice would become one call with a length.
        None => out.iter_mut().zip(values).for_each(|(out, value)| *out = *value),
    }
}

/// Reads a tile's row, whose values end where the picture does.
#[inline(always)]
fn line_of<T: Copy, const SIDE: usize>(values: &[T], beyond: T) -> [T; SIDE] {
    if let Some(whole) = values.first_chunk() {
        return *whole;
    }
    let mut line = [beyond; SIDE];
    line.iter_mut().zip(values).for_each(|(line, value)| *line = *value);
    line
}

impl LightBuffer {
    /// What the ambient light of a tile follows from.
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

//! Per pixel of the opaque surfaces: share of the key light and of the ambient light that arrives.
//!
//! Few taps whose pattern repeats every 4×4 pixels, then a mean over such a block without crossing from one surface
//! to another. Ambient light varies slowly: it is estimated at every other row and column.
//! Ambient occlusion after McGuire et al., "Scalable Ambient Obscurance", 2012.
//!
//! A tile depends on tiles within a known reach only, so that a frame can be continued where nothing changed.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec2, Vec3A};
use multiversion::multiversion;

use crate::assets::RenderAssets;
use crate::layers::{MarkCount, TILE};
use crate::points::{CHUNK, Points};
use crate::raster::{Target, nearest_integer, within};
use crate::shadow::{Doubts, ShadowMap, turn_of};
use crate::variation::RenderVariation;
use crate::view::View;

/// Taps of the ambient occlusion.
const TAPS: usize = 8;
/// Largest radius of the ambient occlusion on the image, pixels.
const MAX_REACH: f32 = 64.0;
/// Tiles beyond the reach of the taps on which a blurred pixel depends.
const BLUR_TILES: isize = 1;
/// Share of a pixel that shows nothing.
const UNKNOWN: f32 = -1.0;
/// Pixels around a tile that its blur reads.
const MARGIN: usize = 2;
/// Rows and columns of a tile with its surroundings.
const WINDOW: usize = TILE + 2 * MARGIN;
/// The same of the coarse grid of the ambient light.
const HALF: usize = TILE / 2;
const HALF_WINDOW: usize = HALF + 2 * MARGIN;

/// Arriving light per pixel, kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Arrival {
    width: usize,
    height: usize,
    half_width: usize,
    half_height: usize,
    columns: usize,
    rows: usize,
    /// Depth of what is opaque, 0 where there is nothing.
    pub depth: Vec<f32>,
    /// Part of the visibility id, 0 where there is nothing.
    pub surface: Vec<u16>,
    /// As estimated, and as blurred.
    raw_key: Vec<f32>,
    pub key: Vec<f32>,
    /// At even rows and columns: as estimated, and as blurred.
    raw_half: Vec<f32>,
    half: Vec<f32>,
    pub ambient: Vec<f32>,
    tiles: Vec<TileSummary>,
    seams: MarkCount,
    changes: MarkCount,
    shadow_changes: MarkCount,
    doubts: Doubts,
}

/// What a tile shows.
#[derive(Clone, Debug)]
struct TileSummary {
    /// The one surface that is seen, or [`SEVERAL`].
    surface: u16,
    /// Reach of its taps on the image, pixels.
    reach: isize,
    /// Tiles of the shadow map on which it depends.
    shadow_tiles: [[isize; 2]; 2],
    /// Smallest and largest share of the key light as estimated.
    key: [f32; 2],
    /// The same of the ambient light.
    ambient: [f32; 2],
}

const SEVERAL: u16 = u16::MAX;
const NO_RANGE: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

impl Arrival {
    /// Starts over at a size.
    pub fn reset(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        (self.half_width, self.half_height) = (width.div_ceil(2), height.div_ceil(2));
        (self.columns, self.rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let fresh = |list: &mut Vec<f32>, count: usize| {
            list.clear();
            list.resize(count, UNKNOWN);
        };
        for list in [&mut self.depth, &mut self.raw_key, &mut self.key, &mut self.ambient] {
            fresh(list, width * height);
        }
        for list in [&mut self.raw_half, &mut self.half] {
            fresh(list, self.half_width * self.half_height);
        }
        self.surface.clear();
        self.surface.resize(width * height, 0);
        let tile = TileSummary { surface: 0, reach: 0, shadow_tiles: [[0; 2]; 2], key: NO_RANGE, ambient: NO_RANGE };
        self.tiles.clear();
        self.tiles.resize(self.columns * self.rows, tile);
    }

    /// Pixels of a tile: columns and rows.
    pub fn pixels_of(&self, tile: usize) -> [std::ops::Range<usize>; 2] {
        let (column, row) = (tile % self.columns * TILE, tile / self.columns * TILE);
        [column..(column + TILE).min(self.width), row..(row + TILE).min(self.height)]
    }

    /// Where a pixel comes when tiles are gone through one after the other.
    pub fn order_of(&self, pixel: usize) -> usize {
        let (column, row) = (pixel % self.width, pixel / self.width);
        ((row / TILE * self.columns + column / TILE) * TILE + row % TILE) * TILE + column % TILE
    }

    /// Takes over what is seen in the tiles that changed.
    pub fn see(
        &mut self,
        opaque: &Target,
        changed: &[bool],
        view: &View,
        shadow: &ShadowMap,
        variation: &RenderVariation,
    ) {
        let scale = opaque.scale;
        for tile in (0..self.tiles.len()).filter(|&tile| changed[tile]) {
            let [columns, rows] = self.pixels_of(tile);
            let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
            let (mut first, mut is_mixed) = (None, false);
            for row in rows.clone() {
                let samples = row * scale * opaque.width + columns.start * scale;
                for (step, pixel) in (row * self.width + columns.start..row * self.width + columns.end).enumerate() {
                    let sample = samples + step * scale;
                    let nearness = opaque.nearness[sample];
                    let surface = (opaque.ids[sample] >> crate::assets::TRIANGLE_BITS) as u16;
                    self.depth[pixel] = if nearness > 0.0 { 1.0 / nearness } else { 0.0 };
                    self.surface[pixel] = surface;
                    is_mixed |= *first.get_or_insert(surface) != surface;
                    low = if nearness > 0.0 && nearness < low { nearness } else { low };
                    high = if nearness > high { nearness } else { high };
                }
            }
            let reach = (variation.occlusion_radius_m * view.lens.focal.x * high).clamp(3.0, MAX_REACH);
            let corners = [low, high].into_iter().filter(|_| high > 0.0).flat_map(|nearness| {
                let depth = 1.0 / nearness;
                [columns.start, columns.end].into_iter().flat_map({
                    let rows = rows.clone();
                    move |x| [rows.start, rows.end].map(|y| (x, y, depth))
                })
            });
            let lens = &view.lens;
            let points = corners.map(|(x, y, depth)| {
                let ray = (Vec2::new(x as f32, y as f32) - lens.center) / lens.focal;
                lens.turn * (Vec3A::from(ray.extend(1.0)) * depth) + lens.eye
            });
            self.tiles[tile] = TileSummary {
                surface: if is_mixed { SEVERAL } else { first.unwrap_or(0) },
                reach: reach as isize + 2,
                shadow_tiles: if shadow.is_on() && high > 0.0 { shadow.tiles_of(points) } else { [[0; 2], [-1; 2]] },
                key: NO_RANGE,
                ambient: NO_RANGE,
            };
        }
    }

    /// The tiles whose estimates may have changed: those that show something else, those whose taps reach one, and
    /// those on which the shadows may have changed since a version of the shadow map.
    pub fn mark_stale(&mut self, changed: &[bool], shadow: &ShadowMap, version: u64, stale: &mut Vec<bool>) {
        self.changes.count(changed.iter().copied(), self.columns, self.rows);
        let (marks, columns) = shadow.changed_after(version);
        self.shadow_changes.count(marks, columns, columns);
        stale.clear();
        stale.extend(self.tiles.iter().enumerate().map(|(tile, summary)| {
            let [from, to] = self.around(tile, summary.reach);
            let [shadow_from, shadow_to] = summary.shadow_tiles;
            self.changes.any(from, to) || self.shadow_changes.any(shadow_from, shadow_to)
        }));
    }

    /// First and last column and row of the tiles within so many pixels of a tile.
    fn around(&self, tile: usize, pixels: isize) -> [[isize; 2]; 2] {
        let (column, row) = ((tile % self.columns) as isize, (tile / self.columns) as isize);
        let tiles = (pixels + TILE as isize - 1) / TILE as isize;
        [[column - tiles, row - tiles], [column + tiles, row + tiles]]
    }

    /// Marks the tiles next to marked ones too.
    pub fn widen(&mut self, marks: &mut [bool]) {
        self.changes.count(marks.iter().copied(), self.columns, self.rows);
        for (tile, mark) in marks.iter_mut().enumerate() {
            let [from, to] = self.around(tile, BLUR_TILES);
            *mark = self.changes.any(from, to);
        }
    }

    /// Estimates both shares of pixels, listed by part.
    #[expect(clippy::too_many_arguments, reason = "one stage of a pipeline: what it reads, and what it writes")]
    pub fn estimate(
        &mut self,
        assets: &RenderAssets,
        view: &View,
        opaque: &Target,
        shadow: &ShadowMap,
        variation: &RenderVariation,
        stale: &[bool],
        bins: &[Vec<u32>],
    ) {
        let is_seam = |tile: usize| {
            let own = self.tiles[tile].surface;
            let (column, row) = (tile % self.columns, tile / self.columns);
            own == SEVERAL
                || (column + 1 < self.columns && self.tiles[tile + 1].surface != own)
                || (row + 1 < self.rows && self.tiles[tile + self.columns].surface != own)
        };
        self.seams.count((0..self.tiles.len()).map(is_seam), self.columns, self.rows);
        // Nothing can be darkened where only one convex part is seen all around.
        let is_plain: Vec<bool> = (0..self.tiles.len())
            .map(|tile| {
                let [from, to] = self.around(tile, self.tiles[tile].reach);
                let part = assets.parts.get((self.tiles[tile].surface as usize).wrapping_sub(1));
                part.is_none_or(|part| part.convex) && !self.seams.any(from, to)
            })
            .collect();
        for tile in (0..self.tiles.len()).filter(|&tile| stale[tile]) {
            let [columns, rows] = self.pixels_of(tile);
            for row in rows {
                self.raw_key[row * self.width..][columns.clone()].fill(UNKNOWN);
                if row % 2 == 0 {
                    self.raw_half[row / 2 * self.half_width..][columns.start / 2..columns.end.div_ceil(2)]
                        .fill(UNKNOWN);
                }
            }
        }
        let mut points = Points::default();
        let mut list = Vec::new();
        for (pixels, (part, placed)) in bins.iter().zip(assets.parts.iter().zip(&view.parts)) {
            for chunk in pixels.chunks(CHUNK) {
                if shadow.is_on() {
                    points.fill(chunk, part, placed, &view.lens, opaque, &self.depth);
                    shadow.judge(&points, &mut self.raw_key, &mut self.doubts);
                } else {
                    chunk.iter().for_each(|&pixel| self.raw_key[pixel as usize] = 1.0);
                }
            }
            list.clear();
            for &pixel in pixels {
                let (column, row) = (pixel as usize % self.width, pixel as usize / self.width);
                if column % 2 == 0 && row % 2 == 0 {
                    let coarse = row / 2 * self.half_width + column / 2;
                    if variation.occlusion_radius_m <= 0.0 || is_plain[row / TILE * self.columns + column / TILE] {
                        self.raw_half[coarse] = 1.0;
                    } else {
                        list.push(pixel);
                    }
                }
            }
            for chunk in list.chunks(CHUNK) {
                points.fill(chunk, part, placed, &view.lens, opaque, &self.depth);
                self.occlude(&points, view.lens.focal.x, variation);
            }
        }
        shadow.settle(&mut self.doubts, &mut self.raw_key);
    }

    fn occlude(&mut self, points: &Points, focal: f32, variation: &RenderVariation) {
        let radius = variation.occlusion_radius_m;
        let mut taps = Taps::new(points, focal, radius, self.width);
        for &offset in spiral() {
            place_taps(&mut taps, offset, [self.width, self.height]);
            for i in 0..points.count {
                taps.depth[i] = self.depth[taps.index[i] as usize];
            }
            add_taps(&mut taps, points, focal, radius);
        }
        let scale = 2.5 * variation.occlusion_strength / (radius.powi(5) * TAPS as f32);
        for i in 0..points.count {
            let pixel = points.pixel[i] as usize;
            let coarse = pixel / self.width / 2 * self.half_width + pixel % self.width / 2;
            self.raw_half[coarse] = (1.0 - taps.darkening[i] * scale).max(0.15);
        }
    }

    /// Blurs and refines the tiles that are marked; the estimates of those next to them must be up to date.
    pub fn smooth(&mut self, stale: &[bool], marked: &[bool]) {
        for tile in (0..self.tiles.len()).filter(|&tile| stale[tile]) {
            let [columns, rows] = self.pixels_of(tile);
            let (mut key, mut ambient) = (NO_RANGE, NO_RANGE);
            let widen = |range: &mut [f32; 2], value: f32| {
                if value >= 0.0 {
                    *range = [range[0].min(value), range[1].max(value)];
                }
            };
            for row in rows {
                self.raw_key[row * self.width..][columns.clone()].iter().for_each(|&value| widen(&mut key, value));
                if row % 2 == 0 {
                    let range = columns.start / 2..columns.end.div_ceil(2);
                    let values = &self.raw_half[row / 2 * self.half_width..][range];
                    values.iter().for_each(|&value| widen(&mut ambient, value));
                }
            }
            (self.tiles[tile].key, self.tiles[tile].ambient) = (key, ambient);
        }
        for tile in (0..self.tiles.len()).filter(|&tile| marked[tile]) {
            self.blur_key(tile);
            self.blur_half(tile);
        }
        for tile in (0..self.tiles.len()).filter(|&tile| marked[tile]) {
            self.refine(tile);
        }
    }

    /// Extremes over a tile and its neighbours.
    fn range_around(&self, tile: usize, pick: impl Fn(&TileSummary) -> [f32; 2]) -> [f32; 2] {
        let (column, row) = (tile % self.columns, tile / self.columns);
        let mut range = NO_RANGE;
        for row in row.saturating_sub(1)..(row + 2).min(self.rows) {
            for column in column.saturating_sub(1)..(column + 2).min(self.columns) {
                let [low, high] = pick(&self.tiles[row * self.columns + column]);
                range = [range[0].min(low), range[1].max(high)];
            }
        }
        range
    }

    fn blur_key(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.range_around(tile, |tile| tile.key);
        if low >= high {
            for row in rows {
                let range = row * self.width + columns.start..row * self.width + columns.end;
                self.key[range.clone()].copy_from_slice(&self.raw_key[range]);
            }
            return;
        }
        let mut window = Window::<WINDOW>::default();
        window.load(self, &self.raw_key, self.width, [columns.start, rows.start], 1);
        let blurred = blur_tile(&window);
        for (row, line) in rows.zip(&blurred) {
            let out = &mut self.key[row * self.width..][columns.clone()];
            out.copy_from_slice(&line[..out.len()]);
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

    /// The ambient light at every pixel of a tile from the four coarse pixels around it that show the same surface.
    fn refine(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.range_around(tile, |tile| tile.ambient);
        if low >= high {
            // One value all around; where nothing was estimated, nothing is darkened.
            let value = if low == high { low } else { 1.0 };
            rows.for_each(|row| self.ambient[row * self.width..][columns.clone()].fill(value));
            return;
        }
        for row in rows {
            for column in columns.clone() {
                let pixel = row * self.width + column;
                let (surface, depth) = (self.surface[pixel], self.depth[pixel]);
                let (mut sum, mut total) = (0.0, 0.0);
                let (left, top) = (column / 2, row / 2);
                let (right, bottom) =
                    ((left + column % 2).min(self.half_width - 1), (top + row % 2).min(self.half_height - 1));
                for (x, y) in [(left, top), (right, top), (left, bottom), (right, bottom)] {
                    let fine = 2 * y * self.width + 2 * x;
                    let value = self.half[y * self.half_width + x];
                    let is_same = (self.surface[fine] == surface) & ((self.depth[fine] - depth).abs() < 0.02 * depth);
                    // A thin thing between the coarse pixels takes what is known around it.
                    let weight = if value < 0.0 {
                        0.0
                    } else if is_same {
                        1.0
                    } else {
                        1e-4
                    };
                    sum += weight * value;
                    total += weight;
                }
                self.ambient[pixel] = if total > 0.0 { sum / total } else { 1.0 };
            }
        }
    }
}

/// A tile and its surroundings.
struct Window<const SIDE: usize> {
    surface: [[u16; SIDE]; SIDE],
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
        for row in 0..SIDE {
            let Some(y) = (y0 + row).checked_sub(MARGIN).filter(|&y| y < height) else { continue };
            for column in 0..SIDE {
                let Some(x) = (x0 + column).checked_sub(MARGIN).filter(|&x| x < width) else { continue };
                let fine = y * step * arrival.width + x * step;
                self.surface[row][column] = arrival.surface[fine];
                self.depth[row][column] = arrival.depth[fine];
                self.value[row][column] = values[y * width + x];
            }
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
                        & ((self.depth[row][column + tap] - depth).abs() < 0.02 * depth)
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
                        & ((self.depth[row + tap][column + MARGIN] - depth).abs() < 0.02 * depth)
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

/// Taps around a chunk of points.
struct Taps {
    column: [f32; CHUNK],
    row: [f32; CHUNK],
    cosine: [f32; CHUNK],
    sine: [f32; CHUNK],
    /// Whole pixels from the point to the tap.
    dx: [f32; CHUNK],
    dy: [f32; CHUNK],
    index: [u32; CHUNK],
    depth: [f32; CHUNK],
    darkening: [f32; CHUNK],
}

impl Taps {
    /// The turn and the length of the taps of each point go together.
    fn new(points: &Points, focal: f32, radius: f32, width: usize) -> Self {
        let zero = [0.0; CHUNK];
        let mut taps = Self {
            column: zero,
            row: zero,
            cosine: zero,
            sine: zero,
            dx: zero,
            dy: zero,
            index: [0; CHUNK],
            depth: zero,
            darkening: zero,
        };
        for i in 0..points.count {
            let pixel = points.pixel[i] as usize;
            let reach = within(radius * focal / points.place_in_camera[2][i], 3.0, MAX_REACH);
            // Of every other pixel, so that the pattern of turns repeats every 4×4 estimates.
            let (column, row) = (pixel % width, pixel / width);
            let (sine, cosine) = turn_of(TURN[row / 2 % 4][column / 2 % 4]);
            (taps.column[i], taps.row[i]) = (column as i32 as f32, row as i32 as f32);
            (taps.cosine[i], taps.sine[i]) = (cosine * reach, sine * reach);
        }
        taps
    }
}

/// Order of the turns within a block of estimates.
const TURN: [[u8; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn place_taps(taps: &mut Taps, offset: [f32; 2], [width, height]: [usize; 2]) {
    let (last_column, last_row, width) = ((width - 1) as i32 as f32, (height - 1) as i32 as f32, width as u32);
    for i in 0..CHUNK {
        let column = within(taps.column[i] + offset[0] * taps.cosine[i] - offset[1] * taps.sine[i], 0.0, last_column);
        let row = within(taps.row[i] + offset[0] * taps.sine[i] + offset[1] * taps.cosine[i], 0.0, last_row);
        let (column, row) = (nearest_integer(column), nearest_integer(row));
        taps.dx[i] = column as i32 as f32 - taps.column[i];
        taps.dy[i] = row as i32 as f32 - taps.row[i];
        taps.index[i] = row * width + column;
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn add_taps(taps: &mut Taps, points: &Points, focal: f32, radius: f32) {
    let inverse_focal = 1.0 / focal;
    let square_radius = radius * radius;
    for i in 0..CHUNK {
        let (x, y, z) = (points.place_in_camera[0][i], points.place_in_camera[1][i], points.place_in_camera[2][i]);
        let depth = taps.depth[i];
        let bias = 0.001 + 0.002 * z;
        // The tap's ray is the pixel's ray moved by whole pixels; nothing (depth 0) lies outside the radius.
        let stretch = depth / z - 1.0;
        let step = depth * inverse_focal;
        let toward = [stretch * x + taps.dx[i] * step, stretch * y + taps.dy[i] * step, depth - z];
        let square = toward[0] * toward[0] + toward[1] * toward[1] + toward[2] * toward[2];
        let near = if square_radius > square { square_radius - square } else { 0.0 };
        let above = toward[0] * points.normal_in_camera[0][i]
            + toward[1] * points.normal_in_camera[1][i]
            + toward[2] * points.normal_in_camera[2][i]
            - bias;
        let above = if above > 0.0 { above } else { 0.0 };
        taps.darkening[i] += near * near * near * above / (square + 1e-5);
    }
}

/// A spiral on the unit disc.
fn spiral() -> &'static [[f32; 2]; TAPS] {
    static TABLE: std::sync::OnceLock<[[f32; 2]; TAPS]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|tap| {
            let share = (tap as f32 + 0.5) / TAPS as f32;
            (Vec2::from_angle(std::f32::consts::TAU * share * 3.0) * share).to_array()
        })
    })
}

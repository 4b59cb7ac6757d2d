//! Per pixel of the opaque surfaces: share of the key light and of the ambient light that arrives.
//!
//! Few taps whose pattern repeats every 4×4 pixels, then a mean over such a block without crossing from one surface
//! to another. Ambient light varies slowly: it is estimated at every other row and column.
//!
//! A tile depends on tiles within a known reach only, so that a frame can be continued where nothing changed.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec2, Vec3A};

use crate::assets::{RenderAssets, TRIANGLE_BITS};
use crate::lanes::{CHUNK, nearest_integer};
use crate::layers::{MarkCount, TILE};
use crate::occlusion::{MAX_REACH, Taps, occlude};
use crate::points::{Pixels, Points, packed};
use crate::raster::Target;
use crate::refine::{HALF, RefineWindow, UNKNOWN, refine_tile};
use crate::scene::Scene;
use crate::shadow::{Doubts, ShadowMap, Span};
use crate::variation::RenderVariation;
use crate::view::View;

/// Where a pixel covers less than this many texels of the shadow map, four pixels share an estimate of the key light:
/// the softest edges that the map can show are three times as wide.
const COARSE_TEXELS: f32 = 0.75;
/// Pixels of one surface whose depths differ by less than this share lie on one piece of it.
const LEVEL: f32 = 0.02;
/// Tiles beyond the reach of the taps on which a blurred pixel depends.
const BLUR_TILES: isize = 1;

mod blur;

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
    /// Where nothing can be darkened.
    is_plain: Vec<bool>,
    seams: MarkCount,
    changes: MarkCount,
    shadow_changes: MarkCount,
    work: Box<Work>,
}

/// Memory of the estimates.
#[derive(Debug, Default)]
struct Work {
    pixels: Pixels,
    points: Points,
    taps: Taps,
    doubts: Doubts,
    /// Tiles whose pixels share estimates of the key light.
    coarse: Vec<usize>,
}

/// Pixels by the part they show, [`packed`].
#[derive(Debug, Default)]
pub(crate) struct Bins {
    parts: Vec<Bin>,
}

/// Pixels of a part.
#[derive(Debug, Default)]
struct Bin {
    /// First pixels of tiles that show nothing else.
    tiles: Vec<u32>,
    /// The others.
    pixels: Vec<u32>,
}

/// What a tile shows.
#[derive(Clone, Debug)]
struct TileSummary {
    /// The one surface that is seen, or [`SEVERAL`].
    surface: u16,
    /// Reach of its taps on the image, pixels.
    reach: isize,
    /// Where it lies on the shadow map.
    span: Span,
    /// Whether its pixels are much smaller than the shadow map's texels.
    is_coarse: bool,
    /// Whether all its pixels show one surface at about one depth.
    is_level: bool,
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
        let tile = TileSummary {
            surface: 0,
            reach: 0,
            span: Span::default(),
            is_coarse: false,
            is_level: false,
            key: NO_RANGE,
            ambient: NO_RANGE,
        };
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
        assets: &RenderAssets,
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
            let first = opaque.ids[(rows.start * opaque.width + columns.start) * scale];
            let (mut differ, mut is_mixed) = (0, false);
            let first_surface = (first >> TRIANGLE_BITS) as u16;
            for row in rows.clone() {
                let samples = row * scale * opaque.width + columns.start * scale;
                for (step, pixel) in (row * self.width + columns.start..row * self.width + columns.end).enumerate() {
                    let sample = samples + step * scale;
                    let (nearness, id) = (opaque.nearness[sample], opaque.ids[sample]);
                    let surface = (id >> TRIANGLE_BITS) as u16;
                    self.depth[pixel] = if nearness > 0.0 { 1.0 / nearness } else { 0.0 };
                    self.surface[pixel] = surface;
                    is_mixed |= surface != first_surface;
                    differ |= id ^ first;
                    low = if nearness > 0.0 && nearness < low { nearness } else { low };
                    high = if nearness > high { nearness } else { high };
                }
            }
            let reach = (variation.occlusion_radius_m * view.lens.focal.x * high).clamp(3.0, MAX_REACH);
            let lens = &view.lens;
            let point = |x: usize, y: usize, depth: f32| {
                let ray = (Vec2::new(x as f32, y as f32) - lens.center) / lens.focal;
                lens.turn * (Vec3A::from(ray.extend(1.0)) * depth) + lens.eye
            };
            let span = if !shadow.is_on() || high == 0.0 {
                Span::default()
            } else if differ == 0
                && let Some(normal) = view.normal_of(assets, first)
            {
                let corners = [columns.start, columns.end - 1]
                    .into_iter()
                    .flat_map(|x| [rows.start, rows.end - 1].map(|y| point(x, y, self.depth[y * self.width + x])));
                shadow.span_of_plane(corners, normal)
            } else {
                let depths = [1.0 / low, 1.0 / high];
                let corners = [columns.start, columns.end].into_iter().flat_map(|x| {
                    [rows.start, rows.end].into_iter().flat_map(move |y| depths.map(|depth| point(x, y, depth)))
                });
                shadow.span_of(corners)
            };
            let surface = if is_mixed { SEVERAL } else { first_surface };
            let is_coarse = high > 0.0 && 1.0 < COARSE_TEXELS * shadow.texel_m() * lens.focal.x * low;
            let reach = reach as isize + 2;
            let is_level = surface != SEVERAL && high < (1.0 + LEVEL) * low;
            let (key, ambient) = (NO_RANGE, NO_RANGE);
            self.tiles[tile] = TileSummary { surface, reach, span, is_coarse, is_level, key, ambient };
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
            let [shadow_from, shadow_to] = summary.span.reach();
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

    /// Finds the tiles where nothing can be darkened.
    pub fn find_plain(&mut self, assets: &RenderAssets, variation: &RenderVariation) {
        let is_seam = |tile: usize| {
            let own = self.tiles[tile].surface;
            let (column, row) = (tile % self.columns, tile / self.columns);
            own == SEVERAL
                || (column + 1 < self.columns && self.tiles[tile + 1].surface != own)
                || (row + 1 < self.rows && self.tiles[tile + self.columns].surface != own)
        };
        self.seams.count((0..self.tiles.len()).map(is_seam), self.columns, self.rows);
        let mut is_plain = std::mem::take(&mut self.is_plain);
        is_plain.clear();
        is_plain.extend((0..self.tiles.len()).map(|tile| {
            let part = assets.parts.get((self.tiles[tile].surface as usize).wrapping_sub(1));
            let [from, to] = self.around(tile, self.tiles[tile].reach);
            // Only one convex part is seen all around.
            variation.occlusion_radius_m <= 0.0 || part.is_none_or(|part| part.convex) && !self.seams.any(from, to)
        }));
        self.is_plain = is_plain;
    }

    /// Estimates both shares of the pixels of stale tiles among some.
    pub fn estimate(&mut self, scene: &Scene<'_>, view: &View, opaque: &Target, tiles: &[usize], bins: &mut Bins) {
        let (assets, shadow, variation) = (scene.assets, scene.shadow, scene.variation);
        let mut work = std::mem::take(&mut self.work);
        let Work { pixels, points, taps, doubts, coarse } = &mut *work;
        self.find_key(shadow, tiles, bins, assets.parts.len(), coarse);
        bins.for_each(pixels, opaque, &self.depth, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.lens);
            shadow.judge(points, &mut self.raw_key, doubts);
        });
        if shadow.is_on() {
            shadow.settle(doubts, &mut self.raw_key);
        }
        coarse.drain(..).for_each(|tile| self.share_key(tile));
        self.find_ambient(tiles, bins, assets.parts.len());
        bins.for_each(pixels, opaque, &self.depth, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.lens);
            occlude(points, &self.depth, [self.width, self.height], view.lens.focal.x, variation, taps);
            for i in 0..points.count {
                let (column, row) = (nearest_integer(points.column[i]), nearest_integer(points.row[i]));
                self.raw_half[row as usize / 2 * self.half_width + column as usize / 2] = taps.share[i];
            }
        });
        self.work = work;
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            let (mut key, mut ambient) = (NO_RANGE, NO_RANGE);
            for row in rows {
                widen_range(&mut key, &self.raw_key[row * self.width..][columns.clone()]);
                if row % 2 == 0 {
                    let range = columns.start / 2..columns.end.div_ceil(2);
                    widen_range(&mut ambient, &self.raw_half[row / 2 * self.half_width..][range]);
                }
            }
            (self.tiles[tile].key, self.tiles[tile].ambient) = (key, ambient);
        }
    }

    /// Writes the share of the key light of tiles for which one is certain, and lists the pixels of the others; of
    /// coarse tiles, which are listed too, only those that do not share the estimate of another.
    fn find_key(
        &mut self,
        shadow: &ShadowMap,
        tiles: &[usize],
        bins: &mut Bins,
        parts: usize,
        coarse: &mut Vec<usize>,
    ) {
        bins.clear(parts);
        for &tile in tiles {
            let summary = &self.tiles[tile];
            let share = match summary.surface {
                0 => Some(UNKNOWN),
                _ if shadow.is_on() => shadow.certain_share(&summary.span),
                _ => Some(1.0),
            };
            let [columns, rows] = self.pixels_of(tile);
            if share.is_none() && summary.is_coarse && summary.is_level {
                for row in rows.clone().step_by(2) {
                    let even = columns.clone().step_by(2).map(|column| packed(column, row));
                    bins.parts[summary.surface as usize - 1].pixels.extend(even);
                }
                coarse.push(tile);
            } else if share.is_none() && summary.is_coarse {
                for row in rows.clone() {
                    for column in columns.clone() {
                        if self.giver_of(column, row).is_none() {
                            bins.push(self.surface[row * self.width + column], packed(column, row));
                        }
                    }
                }
                coarse.push(tile);
            } else if share.is_none() {
                bins.push_tile(self, tile);
            }
            rows.for_each(|row| self.raw_key[row * self.width..][columns.clone()].fill(share.unwrap_or(UNKNOWN)));
        }
    }

    /// The pixel at an even row and column whose estimate of the key light another pixel of a coarse tile shares: it must
    /// show the same surface.
    #[inline(always)]
    fn giver_of(&self, column: usize, row: usize) -> Option<usize> {
        let (pixel, giver) = (row * self.width + column, (row & !1) * self.width + (column & !1));
        let is_same = (self.surface[giver] == self.surface[pixel])
            & ((self.depth[giver] - self.depth[pixel]).abs() < LEVEL * self.depth[pixel]);
        (pixel != giver && is_same).then_some(giver)
    }

    fn share_key(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        if self.tiles[tile].is_level {
            for row in rows {
                let (giver, first) = ((row & !1) * self.width, row * self.width);
                for column in columns.clone() {
                    self.raw_key[first + column] = self.raw_key[giver + (column & !1)];
                }
            }
            return;
        }
        for row in rows {
            for column in columns.clone() {
                if let Some(giver) = self.giver_of(column, row) {
                    self.raw_key[row * self.width + column] = self.raw_key[giver];
                }
            }
        }
    }

    /// Writes the ambient light of tiles where nothing can be darkened, and lists every other row and column of the
    /// others.
    fn find_ambient(&mut self, tiles: &[usize], bins: &mut Bins, parts: usize) {
        bins.clear(parts);
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            for row in rows.step_by(2) {
                let first = row / 2 * self.half_width;
                for column in columns.clone().step_by(2) {
                    let surface = self.surface[row * self.width + column];
                    let is_lit = surface > 0 && self.is_plain[tile];
                    self.raw_half[first + column / 2] = if is_lit { 1.0 } else { UNKNOWN };
                    if !is_lit {
                        bins.push(surface, packed(column, row));
                    }
                }
            }
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

    /// The ambient light at every pixel of a tile from the four coarse pixels around it that show the same surface.
    /// Those next to it must be blurred.
    pub fn refine(&mut self, tile: usize) {
        let [columns, rows] = self.pixels_of(tile);
        let [low, high] = self.range_around(tile, |tile| tile.ambient);
        if low >= high {
            // One value all around; where nothing was estimated, nothing is darkened.
            let value = if low == high { low } else { 1.0 };
            rows.for_each(|row| self.ambient[row * self.width..][columns.clone()].fill(value));
            return;
        }
        let refined = refine_tile(&self.refine_window(columns.start, rows.start));
        for (row, line) in rows.zip(&refined) {
            let out = &mut self.ambient[row * self.width..][columns.clone()];
            out.copy_from_slice(&line[..out.len()]);
        }
    }
}

impl Bins {
    fn clear(&mut self, parts: usize) {
        self.parts.resize_with(parts, Bin::default);
        for bin in &mut self.parts {
            bin.tiles.clear();
            bin.pixels.clear();
        }
    }

    /// Adds a pixel that shows a surface; 0 is none.
    fn push(&mut self, surface: u16, place: u32) {
        if let Some(bin) = (surface as usize).checked_sub(1).and_then(|part| self.parts.get_mut(part)) {
            bin.pixels.push(place);
        }
    }

    /// Adds the pixels of a tile.
    fn push_tile(&mut self, arrival: &Arrival, tile: usize) {
        let [columns, rows] = arrival.pixels_of(tile);
        let surface = arrival.tiles[tile].surface;
        let is_whole = surface != SEVERAL && columns.len() * rows.len() == TILE * TILE;
        if surface > 0 && is_whole {
            self.parts[surface as usize - 1].tiles.push(packed(columns.start, rows.start));
        } else if surface > 0 {
            for row in rows {
                for column in columns.clone() {
                    self.push(arrival.surface[row * arrival.width + column], packed(column, row));
                }
            }
        }
    }

    /// Lists the pixels of some tiles.
    pub fn fill(&mut self, arrival: &Arrival, parts: usize, tiles: &[usize]) {
        self.clear(parts);
        tiles.iter().for_each(|&tile| self.push_tile(arrival, tile));
    }

    /// Calls with each part that is seen and some of its pixels, until all had their turn.
    pub fn for_each(&self, pixels: &mut Pixels, opaque: &Target, depth: &[f32], mut call: impl FnMut(usize, &Pixels)) {
        for (part, bin) in self.parts.iter().enumerate() {
            for &place in &bin.tiles {
                pixels.tile(place, opaque, depth);
                call(part, pixels);
            }
            for places in bin.pixels.chunks(CHUNK) {
                pixels.list(places, opaque, depth);
                call(part, pixels);
            }
        }
    }
}

/// Takes values into a range, without those that are unknown.
fn widen_range([low, high]: &mut [f32; 2], values: &[f32]) {
    for &value in values {
        *low = if (value >= 0.0) & (value < *low) { value } else { *low };
        *high = if (value >= 0.0) & (value > *high) { value } else { *high };
    }
}

impl Arrival {
    /// What the ambient light of a tile follows from.
    fn refine_window(&self, first_column: usize, first_row: usize) -> RefineWindow {
        let mut window = RefineWindow::default();
        for row in 0..TILE.min(self.height - first_row) {
            let fine = (first_row + row) * self.width + first_column;
            for column in 0..TILE.min(self.width - first_column) {
                window.surface[row][column] = u32::from(self.surface[fine + column]);
                window.depth[row][column] = self.depth[fine + column];
            }
        }
        for row in 0..=HALF {
            let y = (first_row / 2 + row).min(self.half_height - 1);
            let (mut surface, mut depth, mut value) = ([0; HALF + 1], [0.0; HALF + 1], [UNKNOWN; HALF + 1]);
            for column in 0..=HALF {
                let x = (first_column / 2 + column).min(self.half_width - 1);
                let fine = 2 * y * self.width + 2 * x;
                surface[column] = u32::from(self.surface[fine]);
                depth[column] = self.depth[fine];
                value[column] = self.half[y * self.half_width + x];
            }
            for column in 0..TILE {
                for (side, x) in [column / 2, column / 2 + column % 2].into_iter().enumerate() {
                    window.coarse_surface[row][side][column] = surface[x];
                    window.coarse_depth[row][side][column] = depth[x];
                    window.value[row][side][column] = value[x];
                }
            }
        }
        window
    }
}

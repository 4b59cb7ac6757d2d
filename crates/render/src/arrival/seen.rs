//! What the pixels' centres see, and what follows from it for each tile.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::ops::Range;

use glam::{Vec2, Vec3A};
use multiversion::multiversion;

use super::{Arrival, COARSE_TEXELS, LEVEL, NO_RANGE, SEVERAL, TileSummary, put};
use crate::assets::TRIANGLE_BITS;
use crate::layers::TILE;
use crate::occlusion::MAX_REACH;
use crate::raster::{Cover, Target};
use crate::scene::Scene;
use crate::shadow::Span;
use crate::view::View;

impl Arrival {
    /// Takes over what is seen in the tiles that changed.
    pub fn see(&mut self, scene: &Scene<'_>, opaque: &Target, changed: &[bool], view: &View) {
        let Scene { assets, shadow, variation, table_light, .. } = *scene;
        self.changed.begin(changed);
        for tile in (0..self.tiles.len()).filter(|&tile| changed[tile]) {
            let [columns, rows] = self.pixels_of(tile);
            let cover = opaque.cover(tile);
            let first = match cover {
                Some(cover) => cover.id,
                None => opaque.ids[(rows.start * opaque.stride + columns.start) * opaque.scale],
            };
            // What shows the same triangle as before everywhere has its ids.
            let has_ids = cover.is_some() && self.only[tile] == Some(first);
            let seen = Seen { depth: &mut self.depth, ids: &mut self.ids, surface: &mut self.surface, has_ids };
            let ([low, high], differ, differ_all) =
                see_tile(opaque, cover, columns.clone(), rows.clone(), first, self.width, seen);
            let (is_mixed, first_surface) = (differ >> TRIANGLE_BITS != 0, (first >> TRIANGLE_BITS) as u16);
            let reach = (variation.occlusion_radius_m * view.lens.focal.x * high).clamp(3.0, MAX_REACH);
            let lens = &view.lens;
            let point = |x: usize, y: usize, depth: f32| lens.point_at(Vec2::new(x as f32, y as f32), depth);
            // What the pixels at the corners see.
            let seen_at = |x: usize, y: usize| point(x, y, self.depth[y * self.width + x]);
            let (right, bottom) = (columns.end - 1, rows.end - 1);
            let corners = match is_mixed {
                true => [Vec3A::ZERO; 4],
                false => [(columns.start, rows.start), (columns.start, bottom), (right, rows.start), (right, bottom)]
                    .map(|(x, y)| seen_at(x, y)),
            };
            let surface = if is_mixed { SEVERAL } else { first_surface };
            let top = shadow.tops().of(surface).and_then(|top| {
                let is_whole = corners.iter().all(|place| top.holds(place.z));
                is_whole.then(|| top.blocks_of(corners.iter().map(|place| place.truncate())))
            });
            // The light on a level top is read from the top.
            let span = if top.is_some() || !shadow.is_on() || high == 0.0 {
                Span::default()
            } else if differ == 0
                && let Some(normal) = view.normal_of(assets, first)
            {
                shadow.span_of_plane(corners.into_iter(), normal)
            } else {
                let depths = [1.0 / low, 1.0 / high];
                let corners = [columns.start, columns.end].into_iter().flat_map(|x| {
                    [rows.start, rows.end].into_iter().flat_map(move |y| depths.map(|depth| point(x, y, depth)))
                });
                shadow.span_of(corners)
            };
            let is_top = |surface| shadow.tops().of(surface).is_some();
            let has_top = top.is_none() && self.shows(is_top, surface, columns.clone(), rows.clone());
            let has_fixed = self.shows(|surface| table_light.is_fixed(surface), surface, columns, rows);
            let is_coarse = high > 0.0 && 1.0 < COARSE_TEXELS * shadow.texel_m() * lens.focal.x * low;
            let reach = reach as isize + 2;
            let is_level = surface != SEVERAL && high < (1.0 + LEVEL) * low;
            self.only[tile] = (differ_all == 0).then_some(first);
            let (key, ambient, ambient_around) = (NO_RANGE, NO_RANGE, NO_RANGE);
            self.tiles[tile] = TileSummary {
                surface,
                reach,
                span,
                top,
                has_top,
                has_fixed,
                is_coarse,
                is_level,
                key,
                ambient,
                ambient_around,
            };
        }
    }
}

impl Arrival {
    /// Whether any pixel of a tile, which shows one surface or several, shows one of a kind.
    fn shows(
        &self,
        is_kind: impl Fn(u16) -> bool,
        surface: u16,
        columns: Range<usize>,
        mut rows: Range<usize>,
    ) -> bool {
        if surface != SEVERAL {
            return is_kind(surface);
        }
        rows.any(|row| self.surface[row * self.width..][columns.clone()].iter().any(|&surface| is_kind(surface)))
    }
}

/// What the centres of all pixels see, to be written.
struct Seen<'a> {
    depth: &'a mut [f32],
    ids: &'a mut [u32],
    surface: &'a mut [u16],
    /// Whether ids and surfaces are those already.
    has_ids: bool,
}

/// Adds to `differ` the bits in which the samples' ids of a row of pixels differ from a first one.
#[inline(always)]
fn differ_from(
    first: u32,
    opaque: &Target,
    columns: &Range<usize>,
    row: usize,
    mut differ: [u32; 2 * TILE],
) -> [u32; 2 * TILE] {
    let scale = opaque.scale;
    for row in row * scale..(row + 1) * scale {
        let samples = row * opaque.stride + columns.start * scale..row * opaque.stride + columns.end * scale;
        for ids in opaque.ids[samples].chunks(2 * TILE) {
            match ids.first_chunk::<{ 2 * TILE }>() {
                Some(ids) => (0..2 * TILE).for_each(|sample| differ[sample] |= ids[sample] ^ first),
                None => ids.iter().for_each(|id| differ[0] |= id ^ first),
            }
        }
    }
    differ
}

/// Takes over what the centres of a tile's pixels see; returns the smallest and largest nearness of what is there, and
/// the bits in which ids of centres, and of all samples, differ from a first one.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn see_tile(
    opaque: &Target,
    cover: Option<&Cover>,
    columns: Range<usize>,
    rows: Range<usize>,
    first: u32,
    width: usize,
    seen: Seen<'_>,
) -> ([f32; 2], u32, u32) {
    /// Samples of a tile's row up to the last centre with two per pixel along each axis.
    const SPAN: usize = 2 * TILE - 1;
    let scale = opaque.scale;
    let (mut low, mut high, mut differ) = ([f32::INFINITY; TILE], [0.0_f32; TILE], [0_u32; TILE]);
    let mut differ_all = [0_u32; 2 * TILE];
    let first_row = rows.start;
    for row in rows {
        let (mut near, mut ids) = ([0.0; TILE], [first; TILE]);
        if let Some(cover) = cover {
            near = cover.line::<TILE, 2>(2 * (row - first_row), 2 * columns.start);
        } else {
            differ_all = differ_from(first, opaque, &columns, row, differ_all);
            let at = row * scale * opaque.stride + columns.start * scale;
            let spans = (opaque.nearness[at..].first_chunk::<SPAN>(), opaque.ids[at..].first_chunk::<SPAN>());
            if let (Some(nearness), Some(span), TILE, 2) = (spans.0, spans.1, columns.len(), scale) {
                for column in 0..TILE {
                    (near[column], ids[column]) = (nearness[2 * column], span[2 * column]);
                }
            } else {
                for column in 0..columns.len() {
                    let sample = at + column * scale;
                    (near[column], ids[column]) = (opaque.nearness[sample], opaque.ids[sample]);
                }
            }
        }
        let (mut depth, mut surface) = ([0.0; TILE], [0; TILE]);
        for column in 0..TILE {
            let nearness = near[column];
            let is_there = nearness > 0.0;
            depth[column] = if is_there { 1.0 / nearness } else { 0.0 };
            surface[column] = (ids[column] >> TRIANGLE_BITS) as u16;
            differ[column] |= ids[column] ^ first;
            low[column] = if is_there & (nearness < low[column]) { nearness } else { low[column] };
            high[column] = if nearness > high[column] { nearness } else { high[column] };
        }
        let pixels = row * width + columns.start..row * width + columns.end;
        put(&mut seen.depth[pixels.clone()], &depth);
        if !seen.has_ids {
            put(&mut seen.ids[pixels.clone()], &ids);
            put(&mut seen.surface[pixels], &surface);
        }
    }
    let (low, high) = (low.into_iter().fold(f32::INFINITY, f32::min), high.into_iter().fold(0.0, f32::max));
    let any = |bits: &[u32]| bits.iter().fold(0, |all, one| all | one);
    ([low, high], any(&differ), any(&differ_all))
}

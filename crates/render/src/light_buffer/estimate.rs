//! Raw shadow mask and ambient occlusion of dirty tiles.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use std::ops::Range;

use multiversion::multiversion;

use super::buffer::{HALF, LightBuffer, NO_RANGE, SEVERAL, fill, line_of, put};
use crate::ambient::ssao::{SsaoTaps, occlude};
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::{PixelCenters, Pixels, Points, packed};
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::View;
use crate::render_scene::RenderScene;
use crate::shadow::map::UnresolvedSamples;
use crate::shadow::pcss::UNKNOWN;
use crate::shadow::planar::Reading;
use crate::simd::{BatchColumn, CHUNK, nearest_integer};

/// Scratch memory of the estimates.
#[derive(Debug, Default)]
pub(crate) struct Estimator {
    pixels: Pixels,
    points: Points,
    taps: SsaoTaps,
    unresolved: UnresolvedSamples,
    reading: Reading,
    pub(super) bins: MaterialBins,
    /// Pixels on planar receivers.
    pub(super) on_receivers: MaterialBins,
    /// Tiles with sampled shadows, and with sampled AO.
    pub(super) shadow_tiles: Vec<usize>,
    ao_tiles: Vec<usize>,
    /// Tiles whose AO samples are shared in blocks of 2×2.
    shared: Vec<usize>,
    /// Pixels occluded by proxies only.
    by_proxies: MaterialBins,
}

impl LightBuffer {
    /// Samples the shadow mask and AO of dirty tiles.
    pub fn estimate(&mut self, scene: &RenderScene<'_>, view: &View, tiles: &[usize], estimator: &mut Estimator) {
        let (assets, shadow, variation) = (scene.assets, scene.shadow, scene.variation);
        let support = scene.irradiance_grid.surface();
        self.find_shadows(shadow, &view.camera, tiles, assets.parts.len(), estimator);
        let Estimator { pixels, points, unresolved, reading, bins, on_receivers, .. } = estimator;
        let Self { width, columns, ids, depth, only, raw_shadow_mask, shadow_mask, .. } = self;
        let centers = PixelCenters { width: *width, ids, depth, columns: *columns, only };
        bins.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.camera);
            shadow.classify(points, raw_shadow_mask, unresolved);
        });
        if shadow.is_on() {
            shadow.resolve(unresolved, raw_shadow_mask);
        }
        for (part, tiles, places) in on_receivers.parts() {
            if let Some(receiver) = shadow.planar_receivers().of(part as u16 + 1) {
                receiver.light([tiles, places], centers, &view.camera, reading, shadow_mask);
            }
        }
        self.find_ambient(tiles, assets.parts.len(), support, scene.proxies.count(), estimator);
        let Estimator { pixels, points, taps, bins, by_proxies, .. } = estimator;
        let Self { width, height, half_width, columns, ids, depth, only, raw_half_ao, .. } = self;
        let centers = PixelCenters { width: *width, ids, depth, columns: *columns, only };
        let is_support = |part: usize| part + 1 == usize::from(support);
        bins.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.camera);
            let ground = scene.irradiance_grid.top().filter(|_| !is_support(part));
            occlude(points, depth, [*width, *height], &view.camera, ground, variation, taps);
            if !is_support(part) {
                scene.proxies.darken(points, assets.parts[part].body, &mut taps.share);
            }
            put_half(points, &taps.share, raw_half_ao, *half_width);
        });
        by_proxies.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], &view.camera);
            taps.share = [1.0; CHUNK];
            scene.proxies.darken(points, assets.parts[part].body, &mut taps.share);
            put_half(points, &taps.share, raw_half_ao, *half_width);
        });
        estimator.shared.iter().for_each(|&tile| self.share_ambient(tile));
        for &tile in &estimator.shadow_tiles {
            let [columns, rows] = self.pixels_of(tile);
            self.shadow_range[tile] = range_of::<TILE>(&self.raw_shadow_mask, self.width, columns, rows);
        }
        for &tile in &estimator.ao_tiles {
            let [columns, rows] = self.half_pixels_of(tile);
            self.ao_range[tile] = range_of::<HALF>(&self.raw_half_ao, self.half_width, columns, rows);
        }
    }

    /// Fills the AO of unoccluded tiles, and bins the AO samples of the others: every second row and column.
    fn find_ambient(
        &mut self,
        tiles: &[usize],
        parts: usize,
        support: u16,
        has_proxies: bool,
        estimator: &mut Estimator,
    ) {
        let Estimator { bins, by_proxies, ao_tiles, shared, .. } = estimator;
        bins.clear(parts);
        by_proxies.clear(parts);
        ao_tiles.clear();
        shared.clear();
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            let (surface, is_unoccluded) = (self.tiles[tile].surface, self.is_unoccluded[tile]);
            let is_far = self.is_far_from_statics[tile];
            // For a wrist camera proxies replace SSAO, except near fixtures.
            let by_proxies_only = has_proxies && (is_unoccluded || is_far);
            let list = if by_proxies_only { &mut *by_proxies } else { &mut *bins };
            if by_proxies_only && surface > 0 && surface != SEVERAL && surface != support {
                // Proxies darken it slowly from place to place.
                list.push_every::<4>(surface, &columns, &rows);
                ao_tiles.push(tile);
                shared.push(tile);
            } else if surface != SEVERAL {
                let is_lit = surface > 0 && is_unoccluded;
                let value = if is_lit { 1.0 } else { UNKNOWN };
                let half = self.half_pixels_of(tile);
                fill(&mut self.raw_half_ao, self.half_width, half, value);
                if surface == 0 || is_lit {
                    self.ao_range[tile] = if is_lit { [1.0; 2] } else { NO_RANGE };
                } else {
                    list.push_every::<2>(surface, &columns, &rows);
                    ao_tiles.push(tile);
                }
            } else {
                ao_tiles.push(tile);
                for row in rows.step_by(2) {
                    let first = row / 2 * self.half_width;
                    for column in columns.clone().step_by(2) {
                        let surface = self.surface[row * self.width + column];
                        let is_lit = surface > 0 && (is_unoccluded || surface == support && is_far);
                        self.raw_half_ao[first + column / 2] = if is_lit { 1.0 } else { UNKNOWN };
                        if !is_lit {
                            list.push(surface, packed(column, row));
                        }
                    }
                }
            }
        }
    }

    /// Copies the first AO sample of each block of 2×2 samples to the others.
    fn share_ambient(&mut self, tile: usize) {
        let [columns, rows] = self.half_pixels_of(tile);
        for row in rows {
            let given: [f32; HALF] = line_of(&self.raw_half_ao[(row & !1) * self.half_width..][columns.clone()], 0.0);
            let shared: [f32; HALF] = std::array::from_fn(|step| given[step & !1]);
            put(&mut self.raw_half_ao[row * self.half_width..][columns.clone()], &shared);
        }
    }
}

/// Writes AO samples of points at even rows and columns.
fn put_half(points: &Points, share: &BatchColumn, half: &mut [f32], width: usize) {
    for i in 0..points.count {
        let (column, row) = (nearest_integer(points.column[i]), nearest_integer(points.row[i]));
        half[row as usize / 2 * width + column as usize / 2] = share[i];
    }
}

/// Range of the known values in some rows of a rectangle of at most `SIDE` columns.
#[multiversion(targets("x86_64+avx2+fma"))]
fn range_of<const SIDE: usize>(values: &[f32], width: usize, columns: Range<usize>, rows: Range<usize>) -> [f32; 2] {
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

//! Estimation of the raw shadow mask and raw ambient occlusion of dirty tiles.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use std::ops::Range;

use multiversion::multiversion;

use super::buffer::{HALF, LightBuffer, SEVERAL, TileSummary, fill};
use crate::ambient::ssao::{SsaoTaps, occlude};
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::{PixelCenters, Pixels, Points, packed};
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::View;
use crate::raster::read_window;
use crate::render_scene::RenderScene;
use crate::shadow::map::UnresolvedSamples;
use crate::shadow::pcss::UNKNOWN;
use crate::simd::{BatchColumn, nearest_integer};

/// Scratch memory of the estimates.
#[derive(Debug, Default)]
pub(crate) struct Estimator {
    pixels: Pixels,
    points: Points,
    taps: SsaoTaps,
    unresolved: UnresolvedSamples,
    /// Pixels whose shadow is sampled, whose AO needs SSAO, and whose AO only needs the proxies.
    shadows: MaterialBins,
    ssao: MaterialBins,
    by_proxies: MaterialBins,
}

impl LightBuffer {
    /// Samples shadow mask and AO of dirty tiles, and sets `changed` of those in which a value changed.
    pub fn estimate(
        &mut self,
        scene: &RenderScene<'_>,
        view: &View,
        tiles: &[usize],
        estimator: &mut Estimator,
        changed: &mut [bool],
    ) {
        let before = tiles.iter().filter(|&&tile| !changed[tile]).map(|&tile| (tile, self.estimates_of(tile)));
        let before: Vec<_> = before.collect();
        self.sample(scene, view, tiles, estimator);
        for (tile, before) in before {
            changed[tile] = self.estimates_of(tile) != before;
        }
    }

    /// Raw shadow mask and AO of a tile, row by row.
    fn estimates_of(&self, tile: usize) -> ([[f32; TILE]; TILE], [[f32; HALF]; HALF]) {
        let (mut mask, mut ao) = ([[UNKNOWN; TILE]; TILE], [[UNKNOWN; HALF]; HALF]);
        let place = self.place_of(tile).map(|at| at as isize);
        read_window(&self.raw_shadow_mask, [self.width; 2], place.map(|at| at * TILE as isize), &mut mask);
        read_window(&self.raw_half_ao, [self.width / 2; 2], place.map(|at| at * HALF as isize), &mut ao);
        (mask, ao)
    }

    fn sample(&mut self, scene: &RenderScene<'_>, view: &View, tiles: &[usize], estimator: &mut Estimator) {
        let (assets, shadow, camera) = (scene.assets, scene.shadow, &view.camera);
        self.find_shadows(scene, tiles, estimator);
        self.find_ambient(scene, tiles, estimator);
        let Estimator { pixels, points, taps, unresolved, shadows, ssao, by_proxies, .. } = estimator;
        let Self { width, height, ids, depth, raw_shadow_mask, raw_half_ao, .. } = self;
        let (size, centers) = ([*width, *height], PixelCenters { width: *width, ids, depth });
        shadows.for_each(pixels, centers, |part, pixels| {
            points.fill(pixels, &assets.parts[part], &view.parts[part], camera);
            shadow.classify(points, raw_shadow_mask, unresolved);
        });
        if shadow.is_on() {
            shadow.resolve(unresolved, raw_shadow_mask);
        }
        for (bins, has_ssao) in [(ssao, true), (by_proxies, false)] {
            bins.for_each(pixels, centers, |part, pixels| {
                points.fill(pixels, &assets.parts[part], &view.parts[part], camera);
                match has_ssao {
                    true => occlude(points, depth, size, camera, view.parts[part].ground, scene.variation, taps),
                    false => taps.share.fill(1.0),
                }
                if scene.irradiance_grids.of(part as u16 + 1).is_none() {
                    scene.proxies.darken(points, assets.parts[part].body, &mut taps.share);
                }
                put_half(points, &taps.share, raw_half_ao, *width / 2);
            });
        }
        for &tile in tiles {
            let [columns, rows] = self.pixels_of(tile);
            self.shadow_range[tile] = range_of::<TILE>(&self.raw_shadow_mask, self.width, columns.start, rows);
            let [columns, rows] = self.half_pixels_of(tile);
            self.ao_range[tile] = range_of::<HALF>(&self.raw_half_ao, self.width / 2, columns.start, rows);
        }
    }

    /// Sets the shadow mask of fully lit tiles to 1, and bins the pixels of the others.
    fn find_shadows(&mut self, scene: &RenderScene<'_>, tiles: &[usize], estimator: &mut Estimator) {
        estimator.shadows.clear(scene.assets.parts.len());
        for &tile in tiles {
            let TileSummary { surface, footprint, .. } = &self.tiles[tile];
            let is_lit = *surface > 0 && (!scene.shadow.is_on() || scene.shadow.lights(footprint));
            if !is_lit {
                // On a single surface, every second pixel suffices for the bilateral filter.
                self.push_tile::<2>(tile, &mut estimator.shadows);
            }
            let (pixels, value) = (self.pixels_of(tile), if is_lit { 1.0 } else { UNKNOWN });
            fill(&mut self.raw_shadow_mask, self.width, pixels, value);
        }
    }

    /// Sets the AO of unoccluded tiles to 1, and bins the AO samples (every second row and column) of the others.
    fn find_ambient(&mut self, scene: &RenderScene<'_>, tiles: &[usize], estimator: &mut Estimator) {
        let Estimator { ssao, by_proxies, .. } = estimator;
        let (parts, has_proxies) = (scene.assets.parts.len(), scene.proxies.count());
        ssao.clear(parts);
        by_proxies.clear(parts);
        for &tile in tiles {
            let (own, is_unoccluded, is_far) =
                (self.tiles[tile].surface, self.is_unoccluded[tile], self.is_far_from_statics[tile]);
            // For a wrist camera proxies replace SSAO, except near fixtures.
            let bins = if has_proxies && (is_unoccluded || is_far) { &mut *by_proxies } else { &mut *ssao };
            let is_lit = |surface: u16| {
                let has_grid = scene.irradiance_grids.of(surface).is_some();
                surface > 0 && (has_grid && is_far || is_unoccluded && (has_grid || !has_proxies))
            };
            if own == 0 || own != SEVERAL && is_lit(own) {
                let value = if own == 0 { UNKNOWN } else { 1.0 };
                let pixels = self.half_pixels_of(tile);
                fill(&mut self.raw_half_ao, self.width / 2, pixels, value);
                continue;
            }
            let [columns, rows] = self.pixels_of(tile);
            for row in rows.step_by(2) {
                for column in columns.clone().step_by(2) {
                    let surface = self.surface[row * self.width + column];
                    let is_lit = own == SEVERAL && is_lit(surface);
                    self.raw_half_ao[row / 2 * (self.width / 2) + column / 2] = if is_lit { 1.0 } else { UNKNOWN };
                    if !is_lit {
                        bins.extend(surface, [packed(column, row)]);
                    }
                }
            }
        }
    }
}

/// Writes the AO of points, which lie at even rows and columns, to the half-resolution buffer `half`.
fn put_half(points: &Points, share: &BatchColumn, half: &mut [f32], width: usize) {
    for i in 0..points.count {
        let (column, row) = (nearest_integer(points.column[i]), nearest_integer(points.row[i]));
        half[row as usize / 2 * width + column as usize / 2] = share[i];
    }
}

/// Lowest and highest value in some rows of `SIDE` columns, without unknown values.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn range_of<const SIDE: usize>(values: &[f32], width: usize, column: usize, rows: Range<usize>) -> [f32; 2] {
    // One pair of extremes per column: columns are independent, so that the loop is vectorised.
    let (mut low, mut high) = ([f32::INFINITY; SIDE], [f32::NEG_INFINITY; SIDE]);
    for row in rows {
        let line = &values[row * width + column..][..SIDE];
        for column in 0..SIDE {
            let value = line[column];
            low[column] = if (value >= 0.0) & (value < low[column]) { value } else { low[column] };
            high[column] = if (value >= 0.0) & (value > high[column]) { value } else { high[column] };
        }
    }
    [low.into_iter().fold(f32::INFINITY, f32::min), high.into_iter().fold(f32::NEG_INFINITY, f32::max)]
}

//! Which pixels' share of the key light is certain, which is read from level tops, and which is estimated.

use super::{LightBuffer, NO_RANGE, ON_TOP, SAME_DEPTH, SEVERAL, Work, line_of, put};
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::packed;
use crate::gbuffer::static_layer::{TILE, each_place};
use crate::gbuffer::view::CameraView;
use crate::shadow::map::ShadowMap;
use crate::shadow::pcss::UNKNOWN;
use crate::shadow::planar::PlanarReceivers;

impl LightBuffer {
    /// Writes the share of the key light of tiles for which one is certain, and lists the pixels of the others; of
    /// coarse tiles, which are listed too, only those that do not share the estimate of another.
    pub(super) fn find_key(
        &mut self,
        shadow: &ShadowMap,
        camera: &CameraView,
        tiles: &[usize],
        bins: &mut MaterialBins,
        parts: usize,
        Work { tops, coarse, doubtful, .. }: &mut Work,
    ) {
        bins.clear(parts);
        tops.clear(parts);
        coarse.clear();
        doubtful.clear();
        for &tile in tiles {
            let summary = &self.tiles[tile];
            let [columns, rows] = self.pixels_of(tile);
            if let (Some(blocks), Some(top)) = (summary.top, shadow.planar_receivers().of(summary.surface)) {
                let certain = top.certain_share(blocks);
                self.raw_shadow_mask.fill(tile, [columns.clone(), rows.clone()], ON_TOP);
                self.ranges.key[tile] = NO_RANGE;
                match certain {
                    Some(share) => self.shadow_mask.fill(tile, [columns, rows], share),
                    None => {
                        self.shadow_mask.set_varying(tile);
                        self.push_tile(tile, tops);
                    }
                }
                continue;
            }
            let share = match summary.surface {
                0 => Some(UNKNOWN),
                _ if shadow.is_on() => shadow.certain_share(&summary.footprint),
                _ => Some(1.0),
            };
            // Where all pixels of one surface are estimated, all are written.
            let is_estimated = share.is_none() && summary.surface != SEVERAL && !summary.has_top;
            if !is_estimated || summary.is_coarse && !summary.is_planar {
                self.raw_shadow_mask.fill(tile, [columns.clone(), rows.clone()], share.unwrap_or(UNKNOWN));
            }
            if share.is_none() || summary.has_top {
                self.raw_shadow_mask.set_varying(tile);
            }
            if summary.has_top {
                self.shadow_mask.set_varying(tile);
                self.find_tops(shadow.planar_receivers(), camera, tile, tops);
            }
            let summary = &self.tiles[tile];
            if share.is_none() && summary.is_coarse && summary.is_planar {
                bins.push_every::<2>(summary.surface, &columns, &rows);
                coarse.push((tile, u64::MAX));
            } else if share.is_none() && summary.is_coarse {
                let [estimated, shared] = self.shared_in(tile);
                for place in each_place(estimated & !shared) {
                    let [column, row] = [columns.start + place % TILE, rows.start + place / TILE];
                    bins.push(self.surface[row * self.width + column], packed(column, row));
                }
                coarse.push((tile, shared));
            } else if share.is_none() && summary.has_top {
                for row in rows {
                    for pixel in row * self.width + columns.start..row * self.width + columns.end {
                        if self.raw_shadow_mask[pixel] > ON_TOP {
                            bins.push(self.surface[pixel], packed(pixel - row * self.width, row));
                        }
                    }
                }
            } else if share.is_none() {
                self.push_tile(tile, bins);
            }
            match share {
                Some(share) => self.ranges.key[tile] = if share >= 0.0 { [share; 2] } else { NO_RANGE },
                None => doubtful.push(tile),
            }
        }
    }

    /// Lists the pixels of a tile that show level tops.
    fn find_tops(&mut self, known: &PlanarReceivers, camera: &CameraView, tile: usize, tops: &mut MaterialBins) {
        let [columns, rows] = self.pixels_of(tile);
        for row in rows {
            let first = row * self.width + columns.start;
            let pixels = first..first + columns.len();
            let surfaces: [u16; TILE] = line_of(&self.surface[pixels.clone()], 0);
            let depths: [f32; TILE] = line_of(&self.depth[pixels], 0.0);
            let heights = camera.heights_at([columns.start, row], &depths);
            for (step, (&surface, &height)) in surfaces.iter().zip(&heights).enumerate() {
                if known.of(surface).is_some_and(|top| top.holds(height)) {
                    self.raw_shadow_mask[first + step] = ON_TOP;
                    tops.push(surface, packed(columns.start + step, row));
                }
            }
        }
    }

    /// Pixels of a coarse tile, in bits, row by row: those whose share of the key light is estimated, and those of them that
    /// share the estimate of the one at an constant row and column beside them, which shows the same surface.
    fn shared_in(&self, tile: usize) -> [u64; 2] {
        let [columns, rows] = self.pixels_of(tile);
        // What lies beyond the picture is not estimated.
        let line = |row: usize| {
            let pixels = row * self.width + columns.start..row * self.width + columns.end;
            let surfaces: [u16; TILE] = line_of(&self.surface[pixels.clone()], 0);
            let depths: [f32; TILE] = line_of(&self.depth[pixels.clone()], 0.0);
            let keys: [f32; TILE] = line_of(&self.raw_shadow_mask[pixels], ON_TOP);
            (surfaces, depths, keys)
        };
        let (mut estimated, mut shared) = (0, 0);
        for row in rows.clone() {
            let (givers, giver_depths, giver_keys) = line(row & !1);
            let (surfaces, depths, keys) = line(row);
            for i in 0..TILE {
                let giver = i & !1;
                let is_estimated = keys[i] > ON_TOP;
                let is_shared = (givers[giver] == surfaces[i])
                    & ((giver_depths[giver] - depths[i]).abs() < SAME_DEPTH * depths[i])
                    & (giver_keys[giver] > ON_TOP)
                    & is_estimated
                    & (row % 2 + i % 2 > 0);
                let place = (row - rows.start) * TILE + i;
                estimated |= u64::from(is_estimated) << place;
                shared |= u64::from(is_shared) << place;
            }
        }
        [estimated, shared]
    }

    /// Gives the pixels of a coarse tile that share an estimate that of another.
    pub(super) fn share_key(&mut self, tile: usize, shared: u64) {
        let [columns, rows] = self.pixels_of(tile);
        if self.tiles[tile].is_planar {
            for row in rows {
                let given: [f32; TILE] =
                    line_of(&self.raw_shadow_mask[(row & !1) * self.width..][columns.clone()], 0.0);
                let shared: [f32; TILE] = std::array::from_fn(|step| given[step & !1]);
                put(&mut self.raw_shadow_mask[row * self.width..][columns.clone()], &shared);
            }
            return;
        }
        for place in each_place(shared) {
            let [column, row] = [columns.start + place % TILE, rows.start + place / TILE];
            self.raw_shadow_mask[row * self.width + column] =
                self.raw_shadow_mask[(row & !1) * self.width + (column & !1)];
        }
    }
}

//! Raw shadow mask: constant tiles, pixels on planar receivers, and pixels to be sampled by PCSS.

use super::buffer::{LightBuffer, NO_RANGE, ON_RECEIVER, SEVERAL, fill, line_of};
use super::estimate::Estimator;
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::points::packed;
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::CameraView;
use crate::shadow::map::ShadowMap;
use crate::shadow::pcss::UNKNOWN;
use crate::shadow::planar::PlanarReceivers;

impl LightBuffer {
    /// Fills the shadow mask of constant tiles, and bins the pixels of the others.
    pub(super) fn find_shadows(
        &mut self,
        shadow: &ShadowMap,
        camera: &CameraView,
        tiles: &[usize],
        parts: usize,
        Estimator { bins, on_receivers, shadow_tiles, .. }: &mut Estimator,
    ) {
        bins.clear(parts);
        on_receivers.clear(parts);
        shadow_tiles.clear();
        for &tile in tiles {
            let (surface, has_receiver) = (self.tiles[tile].surface, self.tiles[tile].has_receiver);
            let [columns, rows] = self.pixels_of(tile);
            let pixels = || [columns.clone(), rows.clone()];
            let receivers = shadow.planar_receivers();
            if let (Some(blocks), Some(receiver)) = (self.tiles[tile].receiver, receivers.of(surface)) {
                fill(&mut self.raw_shadow_mask, self.width, pixels(), ON_RECEIVER);
                self.shadow_range[tile] = NO_RANGE;
                match receiver.certain_share(blocks) {
                    Some(share) => fill(&mut self.shadow_mask, self.width, pixels(), share),
                    None => self.push_tile(tile, on_receivers),
                }
                continue;
            }
            if surface == 0 || !shadow.is_on() {
                let share = if surface == 0 { UNKNOWN } else { 1.0 };
                fill(&mut self.raw_shadow_mask, self.width, pixels(), share);
                self.shadow_range[tile] = if surface == 0 { NO_RANGE } else { [1.0; 2] };
                continue;
            }
            shadow_tiles.push(tile);
            if surface == SEVERAL || has_receiver {
                fill(&mut self.raw_shadow_mask, self.width, pixels(), UNKNOWN);
            }
            if !has_receiver {
                self.push_tile(tile, bins);
                continue;
            }
            self.find_on_receivers(receivers, camera, tile, on_receivers);
            for row in rows {
                for column in columns.clone() {
                    let pixel = row * self.width + column;
                    if self.raw_shadow_mask[pixel] > ON_RECEIVER {
                        bins.push(self.surface[pixel], packed(column, row));
                    }
                }
            }
        }
    }

    /// Bins the pixels of a tile that lie on planar receivers.
    fn find_on_receivers(
        &mut self,
        receivers: &PlanarReceivers,
        camera: &CameraView,
        tile: usize,
        bins: &mut MaterialBins,
    ) {
        let [columns, rows] = self.pixels_of(tile);
        for row in rows {
            let first = row * self.width + columns.start;
            let pixels = first..first + columns.len();
            let surfaces: [u16; TILE] = line_of(&self.surface[pixels.clone()], 0);
            let depths: [f32; TILE] = line_of(&self.depth[pixels], 0.0);
            let heights = camera.heights_at([columns.start, row], &depths);
            for (step, (&surface, &height)) in surfaces.iter().zip(&heights).enumerate() {
                if receivers.of(surface).is_some_and(|receiver| receiver.holds(height)) {
                    self.raw_shadow_mask[first + step] = ON_RECEIVER;
                    bins.push(surface, packed(columns.start + step, row));
                }
            }
        }
    }
}

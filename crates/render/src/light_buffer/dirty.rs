//! Dirty tiles: where shadow mask, ambient occlusion or shading may differ from the last frame.

use super::buffer::{LightBuffer, MIXED, SEVERAL, TileSummary};
use crate::ambient::irradiance_grid::IrradianceGrids;
use crate::gbuffer::static_layer::MarkCount;
use crate::scene::assets::RenderAssets;
use crate::scene::variation::RenderVariation;
use crate::shadow::map::ShadowMap;

impl LightBuffer {
    /// Marks the tiles whose raw shadow mask or AO may have changed: those with a tile of `changed` geometry within the
    /// reach of their SSAO, and those whose part of the shadow map changed after its version `version`.
    pub fn mark_dirty(&mut self, changed: &[bool], shadow: &ShadowMap, version: u64, dirty: &mut Vec<bool>) {
        self.marks.count(changed.iter().copied(), self.columns, self.rows);
        let (marks, columns) = shadow.changed_after(version);
        let mut shadow_changes = MarkCount::default();
        shadow_changes.count(marks, columns, columns);
        dirty.clear();
        dirty.extend(self.tiles.iter().enumerate().map(|(tile, summary)| {
            let [from, to] = self.around(tile, summary.reach);
            let [shadow_from, shadow_to] = summary.footprint.reach();
            changed[tile] || self.marks.any(from, to) || shadow_changes.any(shadow_from, shadow_to)
        }));
    }

    /// Marks tiles that need no SSAO: all tiles if it is switched off. Otherwise tiles that show a surface with an
    /// irradiance grid and no other fixture within reach, and tiles with a single convex part within reach.
    pub fn find_unoccluded(&mut self, assets: &RenderAssets, variation: &RenderVariation, grids: &IrradianceGrids) {
        let is_on = variation.occlusion_radius_m > 0.0;
        let (columns, rows) = (self.columns, self.rows);
        self.is_far_from_statics.clear();
        self.is_far_from_statics.resize(self.tiles.len(), false);
        // The last pass, with 0 for no support surface, finds tiles that have no fixture within reach.
        for support in grids.surfaces().chain([0]) {
            let is_other = |tile: &TileSummary| tile.fixture != 0 && tile.fixture != support;
            self.marks.count(self.tiles.iter().map(is_other), columns, rows);
            for (tile, summary) in self.tiles.iter().enumerate() {
                let [from, to] = self.around(tile, summary.reach);
                self.is_far_from_statics[tile] |= !self.marks.any(from, to);
            }
        }
        let tiles = &self.tiles;
        let is_boundary = |(tile, own): (usize, &TileSummary)| {
            let ([column, row], own) = ([tile % columns, tile / columns], own.surface);
            own == SEVERAL
                || (column + 1 < columns && tiles[tile + 1].surface != own)
                || (row + 1 < rows && tiles[tile + columns].surface != own)
        };
        self.marks.count(tiles.iter().enumerate().map(is_boundary), columns, rows);
        let is_unoccluded = |(tile, summary): (usize, &TileSummary)| {
            let part = assets.parts.get((summary.surface as usize).wrapping_sub(1));
            let [from, to] = self.around(tile, summary.reach);
            // True if no surface but one, of a convex part or of the background, lies within reach.
            let is_alone = || part.is_none_or(|part| part.convex) && !self.marks.any(from, to);
            !is_on || self.is_far_from_statics[tile] && grids.of(summary.surface).is_some() || is_alone()
        };
        self.is_unoccluded = self.tiles.iter().enumerate().map(is_unoccluded).collect();
    }

    /// Marks the tiles that may show a support surface.
    pub fn mark_supports(&self, grids: &IrradianceGrids, marks: &mut [bool]) {
        for (mark, tile) in marks.iter_mut().zip(&self.tiles) {
            *mark |= tile.only == MIXED || grids.of(tile.surface).is_some();
        }
    }
}

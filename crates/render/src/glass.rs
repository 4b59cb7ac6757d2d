//! What is transparent, drawn apart from what is opaque.

use std::ops::Range;

use crate::assets::RenderAssets;
use crate::layers::TILE;
use crate::raster::Target;
use crate::view::View;

/// The sides of transparent things that a picture shows, and where.
#[derive(Debug, Default)]
pub(crate) struct Glass {
    /// The farthest sides that face away, with their nearness turned, and the nearest that face the viewer.
    pub layers: [Target; 2],
    /// Rows of samples that may hold anything.
    rows: Range<usize>,
    /// Tiles that transparent things may reach.
    reached: Vec<bool>,
}

impl Glass {
    /// Draws all that is transparent, with `scale`² samples per pixel.
    pub fn draw(&mut self, assets: &RenderAssets, view: &View, scale: usize) {
        let (width, height) = (view.lens.width, view.lens.height);
        for layer in &mut self.layers {
            if (layer.width, layer.height, layer.scale) == (width * scale, height * scale, scale) {
                layer.clear_rows(self.rows.clone());
            } else {
                layer.reset::<true>(width, height, scale);
            }
        }
        let columns = width.div_ceil(TILE);
        self.rows = height * scale..0;
        self.reached.clear();
        self.reached.resize(columns * height.div_ceil(TILE), false);
        for (_, motion) in assets.parts.iter().zip(&view.motions).filter(|(part, _)| part.is_transparent()) {
            for row in motion.now.tile_rows() {
                self.reached[row * columns..][motion.now.tile_columns()].fill(true);
            }
            if !motion.now.is_empty() {
                let rows = motion.now.rows.start * scale..motion.now.rows.end * scale;
                self.rows = self.rows.start.min(rows.start)..self.rows.end.max(rows.end);
            }
        }
        self.rows.start = self.rows.start.min(self.rows.end);
        let [far, near] = &mut self.layers;
        view.draw_far_sides(assets, far);
        view.draw_transparent(assets, [true, false], near);
    }

    /// Rows of pixels that may show anything transparent.
    pub fn rows_of_pixels(&self) -> Range<usize> {
        let scale = self.layers[0].scale.max(1);
        self.rows.start / scale..self.rows.end.div_ceil(scale)
    }

    /// Whether anything transparent may cover samples of a tile or next to it.
    pub fn reaches(&self, tile: usize) -> bool {
        self.reached[tile]
    }
}

//! Visibility buffers of transparent parts.

use std::ops::Range;

use crate::gbuffer::static_layer::{Rectangle, TILE};
use crate::gbuffer::view::View;
use crate::raster::VisibilityBuffer;
use crate::scene::assets::RenderAssets;

/// Nearest and farthest transparent interfaces per sample.
#[derive(Debug, Default)]
pub(crate) struct TransparentBuffers {
    /// Farthest back faces (stored with complemented reversed z), then nearest front faces.
    pub layers: [VisibilityBuffer; 2],
    /// Bounds of the visible transparent parts (px).
    areas: Vec<Rectangle>,
    /// By tile: true if a transparent part may cover samples of the tile or next to it; empty before the first frame.
    reached: Vec<bool>,
}

impl TransparentBuffers {
    /// Rasterises all transparent parts with `scale` × `scale` samples per pixel.
    pub fn draw(&mut self, assets: &RenderAssets, view: &View, scale: usize) {
        let (width, height) = (view.camera.width, view.camera.height);
        for layer in &mut self.layers {
            if (layer.width, layer.height) != (width * scale, height * scale) {
                layer.reset::<true>(width, height, scale);
            }
            // Only the areas of the last frame hold samples; all other samples are empty already.
            for area in &self.areas {
                layer.clear_rectangle(
                    area.columns.start * scale..area.columns.end * scale,
                    area.rows.start * scale..area.rows.end * scale,
                );
            }
        }
        let transparent = assets.parts.iter().zip(&view.motions).filter(|(part, _)| part.is_transparent());
        self.areas.clear();
        self.areas.extend(transparent.map(|(_, motion)| motion.now.clone()).filter(|area| !area.is_empty()));
        let [far, near] = &mut self.layers;
        view.draw_far_sides(assets, far);
        view.draw_transparent(assets, [true, false], near);
        let columns = width / TILE;
        self.reached.clear();
        self.reached.resize(columns * height / TILE, false);
        for area in &self.areas {
            for row in area.tile_rows() {
                self.reached[row * columns..][area.tile_columns()].fill(true);
            }
        }
    }

    /// Bounds of the visible transparent parts, clipped at the far ends of a rectangle that begins at pixel (0, 0).
    pub fn areas_within(&self, image: &Rectangle) -> Vec<Rectangle> {
        let cut = |range: &Range<usize>, end: usize| range.start.min(end)..range.end.min(end);
        let areas = self.areas.iter();
        let cut = areas.map(|Rectangle { columns, rows }| [cut(columns, image.columns.end), cut(rows, image.rows.end)]);
        cut.map(|[columns, rows]| Rectangle { columns, rows }).collect()
    }

    /// True if a transparent part may cover samples of a tile or next to it.
    pub fn reaches(&self, tile: usize) -> bool {
        self.reached.get(tile) == Some(&true)
    }
}

//! What is transparent, drawn apart from what is opaque.

use crate::gbuffer::static_layer::{Rectangle, TILE, clear, marked_around};
use crate::gbuffer::view::View;
use crate::raster::VisibilityBuffer;
use crate::scene::assets::RenderAssets;

/// The sides of transparent things that a picture shows, and where.
#[derive(Debug, Default)]
pub(crate) struct TransparentBuffers {
    /// The farthest sides that face away, with their reversed_z turned, and the nearest that face the viewer.
    pub layers: [VisibilityBuffer; 2],
    /// The pixels that each transparent part may cover.
    pub areas: Vec<Rectangle>,
    /// By tile: whether a transparent side covers samples of it or beside its first row and column, and whether one may be seen
    /// through that is bent to look at it. Empty before the first drawing.
    reached: Vec<bool>,
    seen_through: Vec<bool>,
}

impl TransparentBuffers {
    /// Draws all that is transparent, with `scale`² samples per pixel.
    pub fn draw(&mut self, assets: &RenderAssets, view: &View, scale: usize) {
        let (width, height) = (view.camera.width, view.camera.height);
        let transparent = assets.parts.iter().zip(&view.motions).filter(|(part, _)| part.is_transparent());
        self.areas.clear();
        self.areas.extend(transparent.map(|(_, motion)| motion.now.clone()).filter(|area| !area.is_empty()));
        self.layers.iter_mut().for_each(|layer| clear::<true>(layer, [width, height], scale));
        let [far, near] = &mut self.layers;
        view.draw_far_sides(assets, far);
        view.draw_transparent(assets, [true, false], near);
        self.mark(width.div_ceil(TILE), height.div_ceil(TILE));
    }

    /// Marks the tiles that show what was drawn.
    fn mark(&mut self, columns: usize, rows: usize) {
        self.reached.clear();
        self.reached.resize(columns * rows, false);
        for area in &self.areas {
            for row in area.tile_rows() {
                for tile in area.tile_columns().map(|column| row * columns + column) {
                    self.reached[tile] |= self.layers.iter().any(|layer| layer.may_show(tile));
                }
            }
        }
        self.seen_through.clear();
        self.seen_through.resize(columns * rows, false);
        for tile in marked_around(&self.reached, columns, 0..columns * rows) {
            self.seen_through[tile] = true;
        }
    }

    /// Whether anything transparent may cover samples of a tile or beside its first row and column.
    pub fn reaches(&self, tile: usize) -> bool {
        self.reached.get(tile) == Some(&true)
    }

    /// Whether a tile may be seen through something transparent.
    pub fn shows(&self, tile: usize) -> bool {
        self.seen_through.get(tile) == Some(&true)
    }
}

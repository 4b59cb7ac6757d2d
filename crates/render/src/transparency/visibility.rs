//! Visibility buffers of transparent parts.

use crate::gbuffer::static_layer::{TILE, clear};
use crate::gbuffer::view::View;
use crate::raster::VisibilityBuffer;
use crate::scene::assets::RenderAssets;

/// Nearest and farthest transparent interfaces per sample.
#[derive(Debug, Default)]
pub(crate) struct TransparentBuffers {
    /// Farthest back faces, with complemented reversed z, and nearest front faces.
    pub layers: [VisibilityBuffer; 2],
    /// By tile: true if a transparent interface covers samples of it or beside its first row and column; empty before the
    /// first frame.
    reached: Vec<bool>,
}

impl TransparentBuffers {
    /// Rasterises all transparent parts.
    pub fn draw(&mut self, assets: &RenderAssets, view: &View) {
        let (width, height) = (view.camera.width, view.camera.height);
        self.layers.iter_mut().for_each(|layer| clear::<true>(layer, [width, height]));
        let [far, near] = &mut self.layers;
        view.draw_far_sides(assets, far);
        view.draw_transparent(assets, [true, false], near);
        let columns = width.div_ceil(TILE);
        self.reached.clear();
        self.reached.resize(columns * height.div_ceil(TILE), false);
        let transparent = assets.parts.iter().zip(&view.motions).filter(|(part, _)| part.is_transparent());
        for area in transparent.map(|(_, motion)| &motion.now) {
            for row in area.tile_rows() {
                for tile in area.tile_columns().map(|column| row * columns + column) {
                    self.reached[tile] |= self.layers.iter().any(|layer| layer.may_show(tile));
                }
            }
        }
    }

    /// True if a transparent interface may cover samples of a tile or beside its first row and column.
    pub fn reaches(&self, tile: usize) -> bool {
        self.reached.get(tile) == Some(&true)
    }
}

//! The resolve pass of a frame: edge pixels and transparent layers.

use glam::{Vec2, Vec3A};

use super::coverage::{Coverage, find_coverage};
use super::edges::{EdgePixels, UnmatchedSample};
use super::surface_ids::{NormalCodes, TileSurfaceIds};
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::{View, complement_z, surface_of};
use crate::light_buffer::LightBuffer;
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::scene::assets::RenderAssets;
use crate::scene::texture::srgb8_from_linear;
use crate::shading::{ShadedPart, Shading, ShadingPoint};
use crate::simd::CHUNK;
use crate::transparency::composite::{Opaque, TransparencyLayers};
use crate::transparency::interface::LayerSample;
use crate::transparency::visibility::TransparentBuffers;

/// Resolve pass over the dirty tiles of a frame; its allocations are reused by the next frame.
#[derive(Debug, Default)]
pub(crate) struct Resolver {
    edges: EdgePixels,
    layers: TransparencyLayers,
    ids: TileSurfaceIds,
    codes: NormalCodes,
}

impl Resolver {
    /// Discards the last frame's results and loads the normal codes of the meshes in this view.
    pub fn begin(&mut self, assets: &RenderAssets, view: &View) {
        self.edges.clear();
        self.layers.clear();
        let placed = assets.parts.iter().zip(&view.parts);
        self.codes.fill(placed.map(|(part, placed)| &*placed.mesh(part).directions));
    }

    /// Finds the edge pixels and the pixels behind transparent layers in `tiles`.
    pub fn find(
        &mut self,
        opaque: &VisibilityBuffer,
        transparent: Option<&TransparentBuffers>,
        light_buffer: &LightBuffer,
        tiles: &[usize],
        colors: &[Vec3A],
    ) {
        for &tile in tiles {
            let place = light_buffer.pixels_of(tile).map(|range| range.start);
            let first_edge = self.edges.pixels.len();
            if !light_buffer.shows_one(tile) && self.ids.load(opaque, place, &self.codes) {
                self.edges.blend_tile(opaque, &self.ids, light_buffer, tile, colors);
            }
            if let Some(transparent) = transparent.filter(|transparent| transparent.reaches(tile)) {
                self.find_transparent(opaque, &transparent.layers, light_buffer, tile, first_edge);
            }
        }
    }

    /// Shades unmatched samples and transparent layers, and writes the bytes of all found pixels.
    pub fn finish(
        &mut self,
        scene: &RenderScene<'_>,
        view: &View,
        light_buffer: &LightBuffer,
        colors: &[Vec3A],
        rgb: &mut [u8],
    ) {
        self.shade_unmatched(scene, view);
        for &(pixel, color) in &self.edges.pixels {
            rgb[pixel as usize * 3..][..3].copy_from_slice(&srgb8_from_linear(color));
        }
        let opaque = Opaque { scene, view, light_buffer, colors, edge_pixels: &self.edges.pixels };
        self.layers.show(&opaque, rgb);
    }

    fn shade_unmatched(&mut self, scene: &RenderScene<'_>, view: &View) {
        let (camera, EdgePixels { pixels, unmatched, .. }) = (&view.camera, &mut self.edges);
        for UnmatchedSample { point, edge_pixel, share, .. } in unmatched.iter().filter(|sample| sample.point.id == 0) {
            pixels[*edge_pixel as usize].1 += scene.background(camera, Vec2::new(point.x, point.y)) * *share;
        }
        unmatched.retain(|sample| sample.point.id != 0);
        let surface = |sample: &UnmatchedSample| surface_of(sample.point.id);
        unmatched.sort_by_key(surface);
        let mut shading = Shading::default();
        for same in unmatched.chunk_by(|a, b| surface(a) == surface(b)) {
            let part = ShadedPart::new(scene, view, surface(&same[0]) as usize - 1);
            for samples in same.chunks(CHUNK) {
                shading.clear();
                samples.iter().for_each(|sample| shading.push(sample.point));
                shading.shade(&part);
                for (index, sample) in samples.iter().enumerate() {
                    pixels[sample.edge_pixel as usize].1 += shading.color_of(index) * sample.share;
                }
            }
        }
    }

    /// Lists the transparent layers in front of a tile's pixels; `first_edge` is the index of the tile's first edge
    /// pixel.
    fn find_transparent(
        &mut self,
        opaque: &VisibilityBuffer,
        layers: &[VisibilityBuffer; 2],
        light_buffer: &LightBuffer,
        tile: usize,
        first_edge: usize,
    ) {
        let [columns, rows] = light_buffer.pixels_of(tile);
        let coverage = find_coverage(layers, opaque, [columns.start, rows.start]);
        let width = opaque.width / 2;
        let mut edges = (first_edge as u32..).zip(&self.edges.pixels[first_edge..]).peekable();
        for (y, row) in rows.enumerate() {
            for (x, column) in columns.clone().enumerate() {
                let coverage = coverage.each_ref().map(|coverage| coverage[y * TILE + x]);
                // Without a near interface, the far one lies inside a support surface, or its object crosses the near
                // plane.
                if coverage[1].share == 0.0 {
                    continue;
                }
                let pixel = (row * width + column) as u32;
                // Edge pixels of a tile are in the same order as its pixels.
                while edges.next_if(|(_, (other, _))| *other < pixel).is_some() {}
                let edge = edges.next_if(|(_, (other, _))| *other == pixel).map(|(index, _)| index);
                let sample = |index: usize| {
                    let (layer, Coverage { share, sample: [dx, dy] }) = (&layers[index], coverage[index]);
                    if share == 0.0 {
                        return None;
                    }
                    let at = |place: usize, step: i8, size: usize| {
                        (2 * place as isize + isize::from(step)).clamp(0, size as isize - 1) as usize
                    };
                    let (column, row) = (at(column, dx, layer.width), at(row, dy, layer.height));
                    let (id, reversed_z) = layer.sample(column, row);
                    let point = ShadingPoint {
                        id,
                        x: column as f32 / 2.0,
                        y: row as f32 / 2.0,
                        depth: 1.0 / if index == 0 { complement_z(reversed_z) } else { reversed_z },
                        shadow: light_buffer.shadow_mask[pixel as usize].max(0.0),
                        ambient: 1.0,
                    };
                    Some(LayerSample { point, coverage: share })
                };
                self.layers.add(pixel, edge, [sample(0), sample(1)]);
            }
        }
    }
}

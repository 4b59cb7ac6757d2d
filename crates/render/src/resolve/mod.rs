//! Smooth edges, and what is transparent.
//!
//! A surface is shaded once per pixel, at the pixel's centre. Where the samples around a centre show other surfaces, a
//! sample takes the colour of the neighbouring pixel whose centre shows its surface (Chajdas, McGuire and Luebke,
//! "Subpixel Reconstruction Antialiasing", 2011); only what no centre near by shows is shaded by itself.
//! Samples count by a tent two pixels wide.

use glam::{Vec2, Vec3A};

use crate::gbuffer::static_layer::{TILE, each_place};
use crate::gbuffer::view::{View, complement_z, surface_of};
use crate::light_buffer::LightBuffer;
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::scene::assets::RenderAssets;
use crate::scene::texture::srgb8_from_linear;
use crate::shading::{ShadedPart, Shading, ShadingPoint};
use crate::transparency::composite::{LayerSample, Opaque, TransparencyLayers};
use crate::transparency::visibility::TransparentBuffers;
use coverage::{Share, find_shares};
use surface_ids::{Directions, SampleWindow, TileSurfaceIds};

mod blend;
mod coverage;
mod surface_ids;

/// What is found on the edges of a picture; memory kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Edges {
    /// Pixels with several surfaces, and the sum of their known colours.
    edge_pixels: Vec<(u32, Vec3A)>,
    /// Surfaces that are shaded by themselves.
    unmatched: Vec<UnmatchedSample>,
    layers: TransparencyLayers,
    order: Vec<u32>,
    /// By tile: the pixels, in bits, row by row, whose bytes are not those of their colour alone.
    rewritten: Vec<u64>,
    keys: TileSurfaceIds,
    directions: Directions,
}

/// A sample, or several of one surface, to be shaded.
#[derive(Debug)]
struct UnmatchedSample {
    spot: ShadingPoint,
    /// Equal for samples of one smooth piece of surface.
    key: u32,
    /// Index of the edge_pixels pixel.
    edge_pixels: u32,
    /// Its share of the pixel.
    share: f32,
}

impl Edges {
    /// Looks at all parts as they are seen; to be called before [`Edges::find`].
    pub fn begin(&mut self, assets: &RenderAssets, view: &View, tiles: usize) {
        self.rewritten.resize(tiles, 0);
        self.edge_pixels.clear();
        self.unmatched.clear();
        self.layers.clear();
        let placed = assets.parts.iter().zip(&view.parts);
        self.directions.fill(placed.map(|(part, placed)| &*placed.mesh(part).directions));
    }

    /// Finds the pixels of tiles that show several surfaces or something transparent; tiles are given in their order.
    pub fn find(
        &mut self,
        opaque: &mut VisibilityBuffer,
        mut glass: Option<&mut TransparentBuffers>,
        light_buffer: &LightBuffer,
        tiles: &[usize],
        colors: &[Vec3A],
    ) {
        let n = opaque.scale as isize;
        for &tile in tiles {
            let glass = glass.as_deref_mut().filter(|glass| glass.reaches(tile));
            if !light_buffer.is_at_border(tile) || glass.is_none() && light_buffer.shows_one(tile) {
                continue;
            }
            opaque.expand_around(tile);
            if let Some(glass) = glass {
                glass.layers.iter_mut().for_each(|layer| layer.expand_around(tile));
            }
        }
        let opaque = &*opaque;
        let (mut keys, directions) = (std::mem::take(&mut self.keys), std::mem::take(&mut self.directions));
        let around = SampleWindow { opaque, directions: &directions, light_buffer, n };
        for &tile in tiles {
            let [columns, rows] = light_buffer.pixels_of(tile);
            let first_mixed = self.edge_pixels.len();
            let is_mixed = n > 1 && !light_buffer.shows_one(tile) && keys.load(&around, tile);
            let mut rewritten = if is_mixed { self.mix_tile(&around, &keys, [&columns, &rows], colors) } else { 0 };
            if let Some(glass) = glass.as_deref().filter(|glass| glass.reaches(tile)) {
                rewritten |= self.find_panes(&around, &glass.layers, tile, first_mixed);
            }
            self.rewritten[tile] = rewritten;
        }
        (self.keys, self.directions) = (keys, directions);
    }

    /// The places within a tile of the pixels whose bytes were not those of their colour alone when it was last looked at.
    pub fn rewritten(&self, tile: usize) -> impl Iterator<Item = usize> {
        each_place(self.rewritten[tile])
    }

    /// Shades what no pixel's centre shows and rewrites the bytes of all pixels that were found.
    pub fn finish(
        &mut self,
        scene: &RenderScene<'_>,
        view: &View,
        light_buffer: &LightBuffer,
        colors: &[Vec3A],
        rgb: &mut [u8],
    ) {
        self.shade_extras(scene, view);
        for &(pixel, color) in &self.edge_pixels {
            rgb[pixel as usize * 3..][..3].copy_from_slice(&srgb8_from_linear(color));
        }
        let opaque = Opaque { scene, view, light_buffer, colors, edge_pixels: &self.edge_pixels };
        self.layers.show(&opaque, rgb);
    }

    fn shade_extras(&mut self, scene: &RenderScene<'_>, view: &View) {
        let camera = &view.camera;
        for UnmatchedSample { spot, edge_pixels, share, .. } in
            self.unmatched.iter().filter(|sample| sample.spot.id == 0)
        {
            let ray = camera.point_at(Vec2::new(spot.x, spot.y), 1.0) - camera.viewpoint;
            self.edge_pixels[*edge_pixels as usize].1 += scene.backdrop.color(camera.viewpoint, ray) * *share;
        }
        self.unmatched.retain(|sample| sample.spot.id != 0);
        let unmatched = &self.unmatched;
        by_surface(unmatched.iter().map(|sample| surface_of(sample.spot.id)), &mut self.order);
        let mut shading = Shading::default();
        let surface = |sample: &u32| surface_of(unmatched[*sample as usize].spot.id);
        for same in self.order.chunk_by(|a, b| surface(a) == surface(b)) {
            let appearance = ShadedPart::new(scene, view, surface(&same[0]) as usize - 1);
            for chunk in same.chunks(crate::simd::CHUNK) {
                shading.clear();
                for &sample in chunk {
                    shading.push(unmatched[sample as usize].spot);
                }
                shading.shade(&appearance);
                for (spot, &sample) in chunk.iter().enumerate() {
                    let UnmatchedSample { edge_pixels, share, .. } = unmatched[sample as usize];
                    self.edge_pixels[edge_pixels as usize].1 += shading.color_of(spot) * share;
                }
            }
        }
    }

    /// Lists the sides of transparent surfaces before the pixels of a tile, whose edge_pixels pixels are those from an index on;
    /// returns the places of the pixels with such sides, in bits.
    fn find_panes(
        &mut self,
        around: &SampleWindow<'_>,
        layers: &[VisibilityBuffer; 2],
        tile: usize,
        first_mixed: usize,
    ) -> u64 {
        let n = around.n;
        let [columns, rows] = around.light_buffer.pixels_of(tile);
        let shares = find_shares(layers, around, tile);
        let width = around.opaque.width / around.opaque.scale;
        let mut edge_pixels = (first_mixed as u32..).zip(&self.edge_pixels[first_mixed..]).peekable();
        let mut found = 0;
        for (y, row) in rows.enumerate() {
            for (x, column) in columns.clone().enumerate() {
                let shares = shares.each_ref().map(|shares| shares[y * TILE + x]);
                // A far side alone lies in what its thing stands on, or its thing begins before the near plane.
                if shares[1].coverage == 0.0 {
                    continue;
                }
                let pixel = (row * width + column) as u32;
                // In a tile both lists go through the pixels in the same order.
                while edge_pixels.next_if(|(_, (other, _))| *other < pixel).is_some() {}
                let edge_pixels = edge_pixels.next_if(|(_, (other, _))| *other == pixel).map(|(index, _)| index);
                let pane = |index: usize| {
                    let (layer, Share { coverage, step: [dx, dy] }) = (&layers[index], shares[index]);
                    if coverage == 0.0 {
                        return None;
                    }
                    let (column, row) =
                        around.cut(column as isize * n + isize::from(dx), row as isize * n + isize::from(dy));
                    let (id, stored) = layer.sample(column as usize, row as usize);
                    let spot = ShadingPoint {
                        id,
                        x: column as f32 / n as f32,
                        y: row as f32 / n as f32,
                        depth: 1.0 / if index == 0 { complement_z(stored) } else { stored },
                        shadow: around.light_buffer.shadow_mask[pixel as usize].max(0.0),
                        ambient: 1.0,
                    };
                    Some(LayerSample { spot, coverage })
                };
                self.layers.add(pixel, edge_pixels, [pane(0), pane(1)]);
                found |= 1 << (y * TILE + x);
            }
        }
        found
    }
}

/// Sorts the indices of surfaces by their numbers and keeps the order of equal ones; a counting sort, since many points
/// lie on few surfaces.
fn by_surface(surfaces: impl Iterator<Item = u32> + Clone, order: &mut Vec<u32>) {
    let mut ends = vec![0; surfaces.clone().max().map_or(0, |last| last as usize + 2)];
    surfaces.clone().for_each(|surface| ends[surface as usize + 1] += 1);
    for surface in 1..ends.len() {
        ends[surface] += ends[surface - 1];
    }
    order.clear();
    order.resize(ends.last().map_or(0, |count| *count as usize), 0);
    for (index, surface) in (0..).zip(surfaces) {
        let place = &mut ends[surface as usize];
        order[*place as usize] = index;
        *place += 1;
    }
}

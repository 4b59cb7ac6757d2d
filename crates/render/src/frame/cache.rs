//! One camera's colour picture, kept from frame to frame: only what may have changed is drawn again.

use glam::{Vec2, Vec3A};

use crate::ambient::proxies::AoProxies;
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::static_layer::{LayeredBuffer, TILE, marked_around};
use crate::gbuffer::view::{CameraView, View, surface_of};
use crate::job::{Channels, FrameBuffers, FrameState};
use crate::light_buffer::LightBuffer;
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::resolve::Edges;
use crate::scene::assets::RenderAssets;
use crate::scene::texture::srgb8_from_linear;
use crate::shading::{ShadedPart, Shading};
use crate::simd::CHUNK;
use crate::transparency::visibility::TransparentBuffers;

/// Pixels of a strip of tiles that is drawn at a time: what all stages hold of it fits the second cache.
const STRIP_PIXELS: usize = 16_384;

/// A picture and all that it was made from.
#[derive(Debug, Default)]
pub(crate) struct FrameCache {
    pub view: View,
    opaque: LayeredBuffer,
    glass: TransparentBuffers,
    light_buffer: LightBuffer,
    shadow_version: u64,
    proxies: AoProxies,
    table_version: u64,
    /// Linear display colours at pixel centres, without what is transparent; only where edges or glass may read them.
    colors: Vec<Vec3A>,
    rgb: Vec<u8>,
    changed: Vec<bool>,
    stale: Vec<bool>,
    shaded: Vec<bool>,
    finished: Vec<bool>,
    /// Whose `colors` are stored.
    colored: Vec<bool>,
    bins: MaterialBins,
    edges: Edges,
    shading: Box<Shading>,
    /// What the pixels' centres see, transparent things included.
    seen: VisibilityBuffer,
    /// Pixels whose surface was shaded at the last drawing.
    pub shaded_pixels: usize,
    /// Whether the camera was elsewhere before the last drawing, and before the one before, too: such a picture will not be
    /// continued, so its pixels are passed on rather than copied.
    is_moved: bool,
    swaps_buffers: bool,
}

impl FrameCache {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.colors.len()
    }

    /// Draws a frame; with a camera and a size that it knows, only what may have changed.
    pub fn draw(&mut self, scene: &RenderScene<'_>, frame: &FrameState, camera: CameraView, scale: usize) {
        let assets = scene.assets;
        let (width, height) = (camera.width, camera.height);
        let had_glass = self.view.has_transparent;
        let rests = self.view.place(assets, frame, camera);
        let follows = rests && self.opaque.target.scale == scale && !self.swaps_buffers;
        self.swaps_buffers = !rests && self.is_moved;
        self.is_moved = !rests;
        let view = &self.view;
        let draw = |part: usize, target: &mut VisibilityBuffer| view.draw_opaque(assets, part, target);
        if follows {
            self.opaque.follow::<true>(&view.motions, draw);
        } else {
            self.opaque.redraw::<true>([width, height], scale, assets.parts.len(), draw);
            self.light_buffer.reset(width, height);
            self.colors.resize(width * height, Vec3A::ZERO);
            self.rgb.resize(width * height * 3, 0);
        }
        self.changed.clone_from(&self.opaque.changed);
        let moved = |part: usize| assets.parts[part].is_transparent() && view.motions[part].moved;
        let glass_moved = !follows || (0..assets.parts.len()).any(moved);
        if (view.has_transparent || had_glass) && glass_moved {
            self.glass.draw(assets, view, scale);
        }
        let opaque = &self.opaque.target;
        self.light_buffer.see(scene, opaque, &self.changed, view);
        self.light_buffer.find_unoccluded(assets, scene.variation, scene.irradiance_grid.surface());
        if follows {
            self.light_buffer.mark_stale(&self.changed, scene.shadow, self.shadow_version, &mut self.stale);
        } else {
            self.stale.clone_from(&self.changed);
        }
        self.shaded.clone_from(&self.changed);
        if scene.proxies.differ(&self.proxies) {
            self.stale.fill(true);
            self.shaded.fill(true);
        }
        self.proxies.clone_from(scene.proxies);
        self.shadow_version = scene.shadow.version();
        if scene.irradiance_grid.version() != self.table_version {
            self.light_buffer.mark_table(
                scene.irradiance_grid,
                self.table_version,
                &self.view.camera,
                &mut self.shaded,
            );
        }
        self.table_version = scene.irradiance_grid.version();
        self.finished.clear();
        self.finished.resize(self.changed.len(), false);
        self.colored.resize(self.changed.len(), false);
        if glass_moved {
            self.mark_glass(assets);
        }
        self.draw_strips(scene);
    }

    /// Goes through the image strip by strip, so that what one stage writes is near when the next one reads it; each
    /// stage is so far behind the one before that the strips beside its own are ready.
    fn draw_strips(&mut self, scene: &RenderScene<'_>) {
        let tiles_in_strip =
            self.opaque.tile_columns * (STRIP_PIXELS / (TILE * TILE) / self.opaque.tile_columns).max(1);
        let strips = self.stale.len().div_ceil(tiles_in_strip);
        self.shaded_pixels = 0;
        self.edges.begin(scene.assets, &self.view, self.stale.len());
        let count = self.stale.len();
        let strip = |index: usize| index * tiles_in_strip..((index + 1) * tiles_in_strip).min(count);
        let strip_before =
            |step: usize, behind: usize| step.checked_sub(behind).filter(|&index| index < strips).map(strip);
        for step in 0..strips + 3 {
            if let Some(strip) = strip_before(step, 0) {
                let tiles: Vec<usize> = strip.filter(|&tile| self.stale[tile]).collect();
                self.light_buffer.estimate(scene, &self.view, &tiles, &mut self.bins);
            }
            if let Some(strip) = strip_before(step, 1) {
                self.light_buffer.blur(strip);
            }
            if let Some(strip) = strip_before(step, 2) {
                self.light_buffer.upsample(strip.clone());
                let tiles: Vec<usize> = strip.filter(|&tile| self.is_shaded(tile)).collect();
                self.shade(scene, &tiles);
            }
            if let Some(strip) = strip_before(step, 3) {
                for tile in marked_around(&self.shaded, self.opaque.tile_columns, strip.clone()) {
                    self.finished[tile] = true;
                }
                let tiles: Vec<usize> = strip.filter(|&tile| self.finished[tile]).collect();
                self.encode(&tiles);
                let glass = self.view.has_transparent.then_some(&mut self.glass);
                self.edges.find(&mut self.opaque.target, glass, &self.light_buffer, &tiles, &self.colors);
            }
        }
        self.edges.finish(scene, &self.view, &self.light_buffer, &self.colors, &mut self.rgb);
    }

    /// Whether a tile must be shaded: its light is new, or edges may read colours that were not kept.
    fn is_shaded(&mut self, tile: usize) -> bool {
        self.shaded[tile] |= self.light_buffer.is_lit_anew(tile)
            || !self.colored[tile] && is_read(&self.light_buffer, &self.glass, tile);
        self.shaded[tile]
    }

    /// Shades the surfaces at the centres of the pixels of tiles, and writes their bytes.
    fn shade(&mut self, scene: &RenderScene<'_>, tiles: &[usize]) {
        let camera = &self.view.camera;
        let plain = scene.backdrop.plain().map(|color| (color, srgb8_from_linear(color)));
        tiles.iter().for_each(|&tile| self.colored[tile] = true);
        for &tile in tiles.iter().filter(|&&tile| self.light_buffer.may_be_empty(tile)) {
            let [columns, rows] = self.light_buffer.pixels_of(tile);
            for row in rows {
                for pixel in row * camera.width + columns.start..row * camera.width + columns.end {
                    if self.light_buffer.surface[pixel] == 0 {
                        let (color, bytes) = plain.unwrap_or_else(|| {
                            let place = Vec2::new((pixel % camera.width) as f32, row as f32);
                            let color =
                                scene.backdrop.color(camera.viewpoint, camera.point_at(place, 1.0) - camera.viewpoint);
                            (color, srgb8_from_linear(color))
                        });
                        self.colors[pixel] = color;
                        self.rgb[pixel * 3..][..3].copy_from_slice(&bytes);
                    }
                }
            }
        }
        self.light_buffer.fill_bins(scene.assets.parts.len(), tiles, &mut self.bins);
        let (light_buffer, glass, colors, rgb) = (&self.light_buffer, &self.glass, &mut self.colors, &mut self.rgb);
        let shading = &mut *self.shading;
        let centers = light_buffer.centers();
        for (part, tiles, places) in self.bins.parts() {
            let appearance = ShadedPart::new(scene, &self.view, part);
            self.shaded_pixels += tiles.len() * TILE * TILE + places.len();
            let of_one_triangle = tiles.chunk_by(|&a, &b| centers.show_one(a, b));
            for mut tiles in of_one_triangle {
                while !tiles.is_empty() {
                    let (ready, others) = tiles.split_at(shading.light_nodes(tiles, &appearance, light_buffer));
                    for (index, &place) in ready.iter().enumerate() {
                        let tile = shading.shade_tile(index, place, &appearance, light_buffer);
                        let is_read = is_read(light_buffer, glass, tile);
                        self.colored[tile] &= is_read;
                        shading.write(if is_read { colors } else { &mut [] }, rgb);
                    }
                    tiles = others;
                }
            }
            for places in places.chunks(CHUNK) {
                shading.list(places, light_buffer);
                shading.shade(&appearance);
                shading.write(colors, rgb);
            }
        }
    }

    /// Marks the tiles where transparent things moved as unfinished.
    fn mark_glass(&mut self, assets: &RenderAssets) {
        for (part, motion) in assets.parts.iter().zip(&self.view.motions) {
            if part.is_transparent() && motion.moved {
                for rectangle in [&motion.before, &motion.now] {
                    for row in rectangle.tile_rows() {
                        self.finished[row * self.opaque.tile_columns..][rectangle.tile_columns()].fill(true);
                    }
                }
            }
        }
    }

    /// Writes the bytes of the colours of tiles that were not shaded, whose edges are to be drawn again; most have them.
    fn encode(&mut self, tiles: &[usize]) {
        for &tile in tiles.iter().filter(|&&tile| !self.shaded[tile]) {
            let [columns, rows] = self.light_buffer.pixels_of(tile);
            for place in self.edges.rewritten(tile) {
                let pixel = (rows.start + place / TILE) * self.view.camera.width + columns.start + place % TILE;
                self.rgb[pixel * 3..][..3].copy_from_slice(&srgb8_from_linear(self.colors[pixel]));
            }
        }
    }

    /// Hands out the channels that are asked for.
    pub fn write(&mut self, assets: &RenderAssets, channels: Channels, out: &mut FrameBuffers) {
        copy_or_swap(&mut self.rgb, &mut out.rgb, self.swaps_buffers);
        if channels.normal || channels.parts {
            self.see(assets);
            write_geometry(assets, &self.view, &self.seen, channels, out);
            return;
        }
        out.normal.clear();
        out.parts.clear();
        match channels.depth {
            true => copy_or_swap(&mut self.light_buffer.depth, &mut out.depth_m, self.swaps_buffers),
            false => out.depth_m.clear(),
        }
        match channels.instance {
            true => self.write_instances(assets, &mut out.instance),
            false => out.instance.clear(),
        }
        if self.view.has_transparent && (channels.depth || channels.instance) {
            self.write_glass(assets, channels, out);
        }
    }

    /// Writes the instances at the centres of pixels, without what is transparent.
    fn write_instances(&self, assets: &RenderAssets, out: &mut Vec<u16>) {
        let (camera, instances) = (&self.view.camera, instances_of(assets));
        out.resize(camera.width * camera.height, 0);
        for tile in 0..self.changed.len() {
            let [columns, rows] = self.light_buffer.pixels_of(tile);
            let one = self.light_buffer.surface_of(tile).map(|surface| instances[surface as usize]);
            for row in rows {
                let pixels = row * camera.width + columns.start..row * camera.width + columns.end;
                let (out, surfaces) = (&mut out[pixels.clone()], &self.light_buffer.surface[pixels]);
                match (one, out.first_chunk_mut::<TILE>()) {
                    (Some(one), Some(out)) => *out = [one; TILE],
                    (Some(one), None) => out.fill(one),
                    (None, _) => {
                        out.iter_mut().zip(surfaces).for_each(|(out, &surface)| *out = instances[surface as usize]);
                    }
                }
            }
        }
    }

    /// Writes what the centres of pixels see of what is transparent.
    fn write_glass(&mut self, assets: &RenderAssets, channels: Channels, out: &mut FrameBuffers) {
        self.fit_seen();
        let (seen, width, instances) = (&mut self.seen, self.view.camera.width, instances_of(assets));
        let (stride, opaque) = (seen.stride, &self.opaque.target);
        let rows = || self.glass.areas.iter().flat_map(|area| area.rows.clone().map(|row| (row, area.columns.clone())));
        for (row, columns) in rows() {
            seen.reversed_z[row * stride..][columns.clone()].fill(0.0);
            seen.ids[row * stride..][columns].fill(0);
        }
        self.view.draw_transparent(assets, [true, true], seen);
        for (row, columns) in rows() {
            for column in columns {
                let (reversed_z, id) = (seen.reversed_z[row * stride + column], seen.ids[row * stride + column]);
                if reversed_z == 0.0 {
                    continue;
                }
                let (other, behind) = opaque.sample(column * opaque.scale, row * opaque.scale);
                if reversed_z < behind || reversed_z == behind && other < id {
                    continue;
                }
                let pixel = row * width + column;
                if channels.depth {
                    out.depth_m[pixel] = depth_of(&reversed_z);
                }
                if channels.instance {
                    out.instance[pixel] = instances[surface_of(id) as usize];
                }
            }
        }
    }

    /// Gives what the centres of pixels see the picture's size; what it holds is to be written over.
    fn fit_seen(&mut self) {
        let CameraView { width, height, .. } = self.view.camera;
        if (self.seen.width, self.seen.height) != (width, height) {
            self.seen.reset::<true>(width, height, 1);
        }
    }

    /// What the centres of pixels see, transparent things included.
    fn see(&mut self, assets: &RenderAssets) {
        self.fit_seen();
        let (camera, opaque, scale) = (&self.view.camera, &self.opaque.target, self.opaque.target.scale);
        for row in 0..camera.height {
            for column in 0..camera.width {
                let sample = row * self.seen.stride + column;
                (self.seen.ids[sample], self.seen.reversed_z[sample]) = opaque.sample(column * scale, row * scale);
            }
        }
        self.view.draw_transparent(assets, [true, true], &mut self.seen);
    }
}

/// Copies values, or exchanges the lists.
fn copy_or_swap<T: Clone>(values: &mut Vec<T>, out: &mut Vec<T>, swaps_buffers: bool) {
    match swaps_buffers {
        true => std::mem::swap(values, out),
        false => out.clone_from(values),
    }
}

/// Whether edges or what is transparent may read the colours of a tile.
fn is_read(light_buffer: &LightBuffer, glass: &TransparentBuffers, tile: usize) -> bool {
    !light_buffer.shows_one(tile) || glass.shows(tile)
}

/// The instance of each surface; nothing comes first.
fn instances_of(assets: &RenderAssets) -> Vec<u16> {
    std::iter::once(0).chain(assets.parts.iter().map(|part| part.instance)).collect()
}

fn depth_of(reversed_z: &f32) -> f32 {
    if *reversed_z > 0.0 { 1.0 / reversed_z } else { 0.0 }
}

/// Depth, ids and normals of a target with one sample per pixel.
pub(crate) fn write_geometry(
    assets: &RenderAssets,
    view: &View,
    seen: &VisibilityBuffer,
    channels: Channels,
    out: &mut FrameBuffers,
) {
    let instances = instances_of(assets);
    out.depth_m.clear();
    out.instance.clear();
    out.normal.clear();
    out.parts.clear();
    for (reversed_z, ids) in seen.rows() {
        if channels.depth {
            out.depth_m.extend(reversed_z.iter().map(depth_of));
        }
        if channels.instance {
            out.instance.extend(ids.iter().map(|&id| instances[surface_of(id) as usize]));
        }
        if channels.parts {
            out.parts.extend(ids.iter().map(|&id| surface_of(id) as u16));
        }
    }
    if channels.normal {
        crate::frame::normals::write(assets, view, seen, &mut out.normal);
    }
}

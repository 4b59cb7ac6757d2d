//! Per-camera frame cache: the passes of a frame in order, repeated only for dirty tiles.

use glam::{Vec2, Vec3A};

use crate::ambient::proxy_set::Proxies;
use crate::gbuffer::material_bins::MaterialBins;
use crate::gbuffer::static_layer::{LayeredBuffer, Rectangle, TILE};
use crate::gbuffer::view::{CameraView, View, surface_of};
use crate::job::{Channels, FrameBuffers, FrameState};
use crate::light_buffer::{Estimator, LightBuffer, UpsampleWindow, Windows};
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::resolve::Resolver;
use crate::scene::assets::RenderAssets;
use crate::scene::texture::srgb8_from_linear;
use crate::shading::{ShadedPart, Shading};
use crate::simd::CHUNK;
use crate::transparency::visibility::TransparentBuffers;

/// Number of pixels in a strip of tiles that a pass processes at a time: its data fit the second-level cache.
const STRIP_PIXELS: usize = 8_192;
/// Samples per pixel along each axis.
const SCALE: usize = 2;

/// Last frame of a camera with all intermediate buffers, so that the next frame can reuse them.
#[derive(Debug, Default)]
pub(crate) struct FrameCache {
    view: View,
    opaque: LayeredBuffer,
    transparent: TransparentBuffers,
    light_buffer: LightBuffer,
    /// State for which the last frame was rendered; differences tell what changed.
    shadow_version: u64,
    grid_version: u64,
    proxies: Proxies,
    /// Linear display colours of the opaque surfaces at the pixel centres.
    colors: Vec<Vec3A>,
    rgb: Vec<u8>,
    dirty: DirtyTiles,
    bins: MaterialBins,
    estimator: Box<Estimator>,
    windows: Box<Windows>,
    upsample_window: Box<UpsampleWindow>,
    resolver: Resolver,
    shading: Box<Shading>,
    /// Visibility at the pixel centres with transparent parts included; valid where those may be visible.
    centers: VisibilityBuffer,
    /// Number of pixels shaded in the last frame.
    pub shaded_pixels: usize,
}

/// Tiles that each pass must repeat. Passes read neighbours of a tile, so marks spread by one tile from pass to pass.
#[derive(Debug, Default)]
struct DirtyTiles {
    /// Estimation of the raw shadow mask and AO.
    estimated: Vec<bool>,
    /// Tiles whose surfaces, raw shadow mask or AO differ from the last frame.
    changed: Vec<bool>,
    /// Bilateral filtering of shadow mask and ambient occlusion.
    blurred: Vec<bool>,
    /// AO upsampling and shading.
    shaded: Vec<bool>,
    /// Anti-aliasing and transparency.
    resolved: Vec<bool>,
}

impl FrameCache {
    /// Number of pixels of the cached frame, which is padded to whole tiles.
    pub fn pixels(&self) -> usize {
        self.colors.len()
    }

    /// Renders a frame of whole tiles; if the camera is that of the last frame, only its dirty tiles.
    pub fn draw(&mut self, scene: &RenderScene<'_>, frame: &FrameState, camera: CameraView) {
        let assets = scene.assets;
        let (width, height) = (camera.width, camera.height);
        let had_transparent = self.view.has_transparent;
        let continues = self.view.place(assets, frame, camera);
        let view = &self.view;
        let draw = |part: usize, target: &mut VisibilityBuffer| view.draw_opaque(assets, part, target);
        if continues {
            self.opaque.follow::<true>(&view.motions, draw);
        } else {
            self.opaque.redraw::<true>([width, height], SCALE, assets.parts.len(), draw);
            self.light_buffer.reset(width, height);
            self.colors.resize(width * height, Vec3A::ZERO);
            self.rgb.resize(width * height * 3, 0);
        }
        let moved = |part: usize| assets.parts[part].is_transparent() && view.motions[part].moved;
        let transparent_moved = !continues || (0..assets.parts.len()).any(moved);
        if (view.has_transparent || had_transparent) && transparent_moved {
            self.transparent.draw(assets, view, SCALE);
        }
        self.light_buffer.read_surfaces(scene, &self.opaque.target, &self.opaque.changed, view);
        self.light_buffer.find_unoccluded(assets, scene.variation, scene.irradiance_grids);
        self.find_dirty(scene);
        self.run_passes(scene);
    }

    /// Finds the dirty tiles of each pass, except those that a pass adds because of its predecessor's.
    fn find_dirty(&mut self, scene: &RenderScene<'_>) {
        let DirtyTiles { estimated, changed, blurred, shaded, resolved } = &mut self.dirty;
        changed.clone_from(&self.opaque.changed);
        self.light_buffer.mark_dirty(changed, scene.shadow, self.shadow_version, estimated);
        if scene.proxies.differ(&self.proxies) {
            estimated.fill(true);
            changed.fill(true);
        }
        for marks in [blurred, &mut *shaded, &mut *resolved] {
            *marks = vec![false; changed.len()];
        }
        let grids = scene.irradiance_grids;
        if grids.version() != self.grid_version {
            self.light_buffer.mark_supports(grids, shaded);
        }
        for (part, motion) in scene.assets.parts.iter().zip(&self.view.motions) {
            if part.is_transparent() && motion.moved {
                for rectangle in [&motion.before, &motion.now] {
                    for row in rectangle.tile_rows() {
                        resolved[row * self.opaque.tile_columns..][rectangle.tile_columns()].fill(true);
                    }
                }
            }
        }
        self.proxies.clone_from(scene.proxies);
        (self.shadow_version, self.grid_version) = (scene.shadow.version(), grids.version());
    }

    /// Runs the passes strip by strip, so that the output of a pass is still in the processor's cache for the next
    /// pass. Each pass is one strip behind its predecessor, whose neighbouring strips are then complete.
    fn run_passes(&mut self, scene: &RenderScene<'_>) {
        let (columns, count) = (self.opaque.tile_columns, self.opaque.changed.len());
        let tiles_in_strip = columns * (STRIP_PIXELS / (TILE * TILE) / columns).max(1);
        let strips = count.div_ceil(tiles_in_strip);
        self.shaded_pixels = 0;
        self.resolver.begin(scene.assets, &self.view);
        let strip_of = |step: usize, behind: usize| {
            let strip = step.checked_sub(behind).filter(|&strip| strip < strips)?;
            Some(strip * tiles_in_strip..((strip + 1) * tiles_in_strip).min(count))
        };
        for step in 0..strips + 3 {
            if let Some(strip) = strip_of(step, 0) {
                let DirtyTiles { estimated, changed, .. } = &mut self.dirty;
                let tiles: Vec<usize> = strip.filter(|&tile| estimated[tile]).collect();
                self.light_buffer.estimate(scene, &self.view, &tiles, &mut self.estimator, changed);
            }
            if let Some(strip) = strip_of(step, 1) {
                let tiles = self.light_buffer.spread(&self.dirty.changed, strip, &mut self.dirty.blurred);
                self.light_buffer.blur(&tiles, &mut self.windows);
            }
            if let Some(strip) = strip_of(step, 2) {
                let tiles = self.light_buffer.spread(&self.dirty.blurred, strip, &mut self.dirty.shaded);
                self.light_buffer.upsample(&tiles, &mut self.upsample_window);
                self.shade(scene, &tiles);
            }
            if let Some(strip) = strip_of(step, 3) {
                let tiles = self.light_buffer.spread(&self.dirty.shaded, strip, &mut self.dirty.resolved);
                self.restore(&tiles);
                let transparent = self.view.has_transparent.then_some(&self.transparent);
                self.resolver.find(&self.opaque.target, transparent, &self.light_buffer, &tiles, &self.colors);
            }
        }
        self.resolver.finish(scene, &self.view, &self.light_buffer, &self.colors, &mut self.rgb);
    }

    /// Shades the pixel centres of tiles, background included.
    fn shade(&mut self, scene: &RenderScene<'_>, tiles: &[usize]) {
        let camera = &self.view.camera;
        let plain = scene.backdrop.plain().filter(|_| scene.look.is_none());
        let constant = plain.map(|color| (color, srgb8_from_linear(color)));
        for &tile in tiles.iter().filter(|&&tile| self.light_buffer.may_be_empty(tile)) {
            let [columns, rows] = self.light_buffer.pixels_of(tile);
            for row in rows {
                for column in columns.clone() {
                    let pixel = row * camera.width + column;
                    if self.light_buffer.surface[pixel] != 0 {
                        continue;
                    }
                    let (color, bytes) = constant.unwrap_or_else(|| {
                        let color = scene.background(camera, Vec2::new(column as f32, row as f32));
                        (color, srgb8_from_linear(color))
                    });
                    self.colors[pixel] = color;
                    self.rgb[pixel * 3..][..3].copy_from_slice(&bytes);
                }
            }
        }
        self.light_buffer.fill_bins(scene.assets.parts.len(), tiles, &mut self.bins);
        let (light_buffer, shading) = (&self.light_buffer, &mut *self.shading);
        for (part, places) in self.bins.parts() {
            let shaded_part = ShadedPart::new(scene, &self.view, part);
            self.shaded_pixels += places.len();
            for places in places.chunks(CHUNK) {
                shading.load_pixels(places, light_buffer);
                shading.shade(&shaded_part);
                shading.write(&mut self.colors, &mut self.rgb);
            }
        }
    }

    /// Restores the centre colours that the resolve pass overwrote, in those of the tiles that were not shaded again.
    fn restore(&mut self, tiles: &[usize]) {
        for &tile in tiles.iter().filter(|&&tile| !self.dirty.shaded[tile]) {
            let [columns, rows] = self.light_buffer.pixels_of(tile);
            for row in rows {
                for pixel in columns.clone().map(|column| row * self.view.camera.width + column) {
                    self.rgb[pixel * 3..][..3].copy_from_slice(&srgb8_from_linear(self.colors[pixel]));
                }
            }
        }
    }

    /// Writes the requested channels, cropped to `size` (width, height; pixels): the frame is padded to whole tiles.
    pub fn write(&mut self, assets: &RenderAssets, channels: Channels, size: [usize; 2], out: &mut FrameBuffers) {
        out.rgb.clear();
        for row in self.rgb.chunks_exact(3 * self.view.camera.width).take(size[1]) {
            out.rgb.extend_from_slice(&row[..3 * size[0]]);
        }
        let ([width, height], stride) = (size, self.view.camera.width);
        let (whole, is_whole) = (Rectangle { columns: 0..width, rows: 0..height }, channels.normal || channels.parts);
        let areas = if is_whole { vec![whole] } else { self.transparent.areas_within(&whole) };
        // Visibility at the pixel centres including transparent parts is computed only where it may differ from the
        // opaque buffer.
        let (opaque, centers) = (&self.opaque.target, &mut self.centers);
        if (centers.width, centers.height) != (width, height) {
            centers.reset::<true>(width, height, 1);
        }
        for (row, column) in areas.iter().flat_map(Rectangle::pixels) {
            let sample = row * centers.stride + column;
            (centers.ids[sample], centers.reversed_z[sample]) = opaque.sample(column * SCALE, row * SCALE);
        }
        self.view.draw_transparent(assets, [true, true], centers);
        if is_whole {
            write_geometry(assets, &self.view, centers, channels, out);
            return;
        }
        let instances = instances_of(assets);
        let LightBuffer { depth, surface, .. } = &self.light_buffer;
        out.clear_geometry();
        for row in (0..height).map(|row| row * stride..row * stride + width) {
            if channels.depth {
                out.depth_m.extend_from_slice(&depth[row.clone()]);
            }
            if channels.instance {
                out.instance.extend(surface[row].iter().map(|&surface| instances[usize::from(surface)]));
            }
        }
        for (row, column) in areas.iter().flat_map(Rectangle::pixels) {
            let (pixel, sample) = (row * width + column, row * centers.stride + column);
            if channels.depth {
                out.depth_m[pixel] = depth_of(&centers.reversed_z[sample]);
            }
            if channels.instance {
                out.instance[pixel] = instances[surface_of(centers.ids[sample]) as usize];
            }
        }
    }
}

/// Instance id of each surface number; 0 is the background.
fn instances_of(assets: &RenderAssets) -> Vec<u16> {
    std::iter::once(0).chain(assets.parts.iter().map(|part| part.instance)).collect()
}

/// Depth (m) from reversed z; 0 for the background.
fn depth_of(reversed_z: &f32) -> f32 {
    if *reversed_z > 0.0 { 1.0 / reversed_z } else { 0.0 }
}

/// Writes depth, ids and normals of a visibility buffer with one sample per pixel.
pub(crate) fn write_geometry(
    assets: &RenderAssets,
    view: &View,
    seen: &VisibilityBuffer,
    channels: Channels,
    out: &mut FrameBuffers,
) {
    let instances = instances_of(assets);
    out.clear_geometry();
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
        super::normals::write(assets, view, seen.rows(), &mut out.normal);
    }
}

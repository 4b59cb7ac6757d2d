//! One camera's colour picture, kept from frame to frame: only what may have changed is drawn again.

use glam::{Vec2, Vec3A};

use crate::arrival::{Arrival, Bins};
use crate::assets::RenderAssets;
use crate::edges::Edges;
use crate::glass::Glass;
use crate::job::{Channels, FrameBuffers, FrameState};
use crate::lanes::CHUNK;
use crate::layers::{Layers, TILE, marked_around};
use crate::occluders::Occluders;
use crate::raster::Target;
use crate::scene::Scene;
use crate::shade::{Appearance, Shading};
use crate::texture::srgb8_from_linear;
use crate::view::{Lens, View, surface_of};

/// Pixels of a strip of tiles that is drawn at a time: what all stages hold of it fits the second cache.
const STRIP_PIXELS: usize = 16_384;

/// A picture and all that it was made from.
#[derive(Debug, Default)]
pub(crate) struct Canvas {
    pub view: View,
    opaque: Layers,
    glass: Glass,
    arrival: Arrival,
    shadow_version: u64,
    occluders: Occluders,
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
    bins: Bins,
    edges: Edges,
    shading: Box<Shading>,
    /// What the pixels' centres see, transparent things included.
    seen: Target,
    /// Pixels whose surface was shaded at the last drawing.
    pub shaded_pixels: usize,
    /// Whether the camera was elsewhere before the last drawing, and before the one before, too: such a picture will not be
    /// continued, so its pixels are passed on rather than copied.
    is_moved: bool,
    is_passed_on: bool,
}

impl Canvas {
    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.colors.len()
    }

    /// Draws a frame; with a lens and a size that it knows, only what may have changed.
    pub fn draw(&mut self, scene: &Scene<'_>, frame: &FrameState, lens: Lens, scale: usize) {
        let assets = scene.assets;
        let (width, height) = (lens.width, lens.height);
        let had_glass = self.view.has_transparent;
        let rests = self.view.place(assets, frame, lens);
        let follows = rests && self.opaque.target.scale == scale && !self.is_passed_on;
        self.is_passed_on = !rests && self.is_moved;
        self.is_moved = !rests;
        let view = &self.view;
        let draw = |part: usize, target: &mut Target| view.draw_opaque(assets, part, target);
        if follows {
            self.opaque.follow::<true>(&view.motions, draw);
        } else {
            self.opaque.redraw::<true>([width, height], scale, assets.parts.len(), draw);
            self.arrival.reset(width, height);
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
        self.arrival.see(scene, opaque, &self.changed, view);
        self.arrival.find_plain(assets, scene.variation, scene.table_light.surface());
        if follows {
            self.arrival.mark_stale(&self.changed, scene.shadow, self.shadow_version, &mut self.stale);
        } else {
            self.stale.clone_from(&self.changed);
        }
        self.shaded.clone_from(&self.changed);
        if scene.occluders.differ(&self.occluders) {
            self.stale.fill(true);
            self.shaded.fill(true);
        }
        self.occluders.clone_from(scene.occluders);
        self.shadow_version = scene.shadow.version();
        if scene.table_light.version() != self.table_version {
            self.arrival.mark_table(scene.table_light, self.table_version, &self.view.lens, &mut self.shaded);
        }
        self.table_version = scene.table_light.version();
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
    fn draw_strips(&mut self, scene: &Scene<'_>) {
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
                self.arrival.estimate(scene, &self.view, &tiles, &mut self.bins);
            }
            if let Some(strip) = strip_before(step, 1) {
                self.arrival.blur(strip);
            }
            if let Some(strip) = strip_before(step, 2) {
                self.arrival.refine(strip.clone());
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
                self.edges.find(&mut self.opaque.target, glass, &self.arrival, &tiles, &self.colors);
            }
        }
        self.edges.finish(scene, &self.view, &self.arrival, &self.colors, &mut self.rgb);
    }

    /// Whether a tile must be shaded: its light is new, or edges may read colours that were not kept.
    fn is_shaded(&mut self, tile: usize) -> bool {
        self.shaded[tile] |=
            self.arrival.is_lit_anew(tile) || !self.colored[tile] && is_read(&self.arrival, &self.glass, tile);
        self.shaded[tile]
    }

    /// Shades the surfaces at the centres of the pixels of tiles, and writes their bytes.
    fn shade(&mut self, scene: &Scene<'_>, tiles: &[usize]) {
        let lens = &self.view.lens;
        let plain = scene.backdrop.plain().map(|color| (color, srgb8_from_linear(color)));
        tiles.iter().for_each(|&tile| self.colored[tile] = true);
        for &tile in tiles.iter().filter(|&&tile| self.arrival.may_be_empty(tile)) {
            let [columns, rows] = self.arrival.pixels_of(tile);
            for row in rows {
                for pixel in row * lens.width + columns.start..row * lens.width + columns.end {
                    if self.arrival.surface[pixel] == 0 {
                        let (color, bytes) = plain.unwrap_or_else(|| {
                            let place = Vec2::new((pixel % lens.width) as f32, row as f32);
                            let color = scene.backdrop.color(lens.eye, lens.point_at(place, 1.0) - lens.eye);
                            (color, srgb8_from_linear(color))
                        });
                        self.colors[pixel] = color;
                        self.rgb[pixel * 3..][..3].copy_from_slice(&bytes);
                    }
                }
            }
        }
        self.bins.fill(&self.arrival, scene.assets.parts.len(), tiles);
        let (arrival, glass, colors, rgb) = (&self.arrival, &self.glass, &mut self.colors, &mut self.rgb);
        let shading = &mut *self.shading;
        let centers = arrival.centers();
        for (part, tiles, places) in self.bins.parts() {
            let appearance = Appearance::new(scene, &self.view, part);
            self.shaded_pixels += tiles.len() * TILE * TILE + places.len();
            let of_one_triangle = tiles.chunk_by(|&a, &b| centers.show_one(a, b));
            for mut tiles in of_one_triangle {
                while !tiles.is_empty() {
                    let (ready, others) = tiles.split_at(shading.light_nodes(tiles, &appearance, arrival));
                    for (index, &place) in ready.iter().enumerate() {
                        let tile = shading.shade_tile(index, place, &appearance, arrival);
                        let is_read = is_read(arrival, glass, tile);
                        self.colored[tile] &= is_read;
                        shading.write(if is_read { colors } else { &mut [] }, rgb);
                    }
                    tiles = others;
                }
            }
            for places in places.chunks(CHUNK) {
                shading.list(places, arrival);
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
            let [columns, rows] = self.arrival.pixels_of(tile);
            for place in self.edges.rewritten(tile) {
                let pixel = (rows.start + place / TILE) * self.view.lens.width + columns.start + place % TILE;
                self.rgb[pixel * 3..][..3].copy_from_slice(&srgb8_from_linear(self.colors[pixel]));
            }
        }
    }

    /// Hands out the channels that are asked for.
    pub fn write(&mut self, assets: &RenderAssets, channels: Channels, out: &mut FrameBuffers) {
        hand_out(&mut self.rgb, &mut out.rgb, self.is_passed_on);
        if channels.normal || channels.parts {
            self.see(assets);
            write_geometry(assets, &self.view, &self.seen, channels, out);
            return;
        }
        out.normal.clear();
        out.parts.clear();
        match channels.depth {
            true => hand_out(&mut self.arrival.depth, &mut out.depth_m, self.is_passed_on),
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
        let (lens, instances) = (&self.view.lens, instances_of(assets));
        out.resize(lens.width * lens.height, 0);
        for tile in 0..self.changed.len() {
            let [columns, rows] = self.arrival.pixels_of(tile);
            let one = self.arrival.surface_of(tile).map(|surface| instances[surface as usize]);
            for row in rows {
                let pixels = row * lens.width + columns.start..row * lens.width + columns.end;
                let (out, surfaces) = (&mut out[pixels.clone()], &self.arrival.surface[pixels]);
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
        let (seen, width, instances) = (&mut self.seen, self.view.lens.width, instances_of(assets));
        let (stride, opaque) = (seen.stride, &self.opaque.target);
        let rows = || self.glass.areas.iter().flat_map(|area| area.rows.clone().map(|row| (row, area.columns.clone())));
        for (row, columns) in rows() {
            seen.nearness[row * stride..][columns.clone()].fill(0.0);
            seen.ids[row * stride..][columns].fill(0);
        }
        self.view.draw_transparent(assets, [true, true], seen);
        for (row, columns) in rows() {
            for column in columns {
                let (nearness, id) = (seen.nearness[row * stride + column], seen.ids[row * stride + column]);
                if nearness == 0.0 {
                    continue;
                }
                let (other, behind) = opaque.sample(column * opaque.scale, row * opaque.scale);
                if nearness < behind || nearness == behind && other < id {
                    continue;
                }
                let pixel = row * width + column;
                if channels.depth {
                    out.depth_m[pixel] = depth_of(&nearness);
                }
                if channels.instance {
                    out.instance[pixel] = instances[surface_of(id) as usize];
                }
            }
        }
    }

    /// Gives what the centres of pixels see the picture's size; what it holds is to be written over.
    fn fit_seen(&mut self) {
        let Lens { width, height, .. } = self.view.lens;
        if (self.seen.width, self.seen.height) != (width, height) {
            self.seen.reset::<true>(width, height, 1);
        }
    }

    /// What the centres of pixels see, transparent things included.
    fn see(&mut self, assets: &RenderAssets) {
        self.fit_seen();
        let (lens, opaque, scale) = (&self.view.lens, &self.opaque.target, self.opaque.target.scale);
        for row in 0..lens.height {
            for column in 0..lens.width {
                let sample = row * self.seen.stride + column;
                (self.seen.ids[sample], self.seen.nearness[sample]) = opaque.sample(column * scale, row * scale);
            }
        }
        self.view.draw_transparent(assets, [true, true], &mut self.seen);
    }
}

/// Copies values, or exchanges the lists.
fn hand_out<T: Clone>(values: &mut Vec<T>, out: &mut Vec<T>, is_passed_on: bool) {
    match is_passed_on {
        true => std::mem::swap(values, out),
        false => out.clone_from(values),
    }
}

/// Whether edges or what is transparent may read the colours of a tile.
fn is_read(arrival: &Arrival, glass: &Glass, tile: usize) -> bool {
    !arrival.shows_one(tile) || glass.shows(tile)
}

/// The instance of each surface; nothing comes first.
fn instances_of(assets: &RenderAssets) -> Vec<u16> {
    std::iter::once(0).chain(assets.parts.iter().map(|part| part.instance)).collect()
}

fn depth_of(nearness: &f32) -> f32 {
    if *nearness > 0.0 { 1.0 / nearness } else { 0.0 }
}

/// Depth, ids and normals of a target with one sample per pixel.
pub(crate) fn write_geometry(
    assets: &RenderAssets,
    view: &View,
    seen: &Target,
    channels: Channels,
    out: &mut FrameBuffers,
) {
    let instances = instances_of(assets);
    out.depth_m.clear();
    out.instance.clear();
    out.normal.clear();
    out.parts.clear();
    for (nearness, ids) in seen.rows() {
        if channels.depth {
            out.depth_m.extend(nearness.iter().map(depth_of));
        }
        if channels.instance {
            out.instance.extend(ids.iter().map(|&id| instances[surface_of(id) as usize]));
        }
        if channels.parts {
            out.parts.extend(ids.iter().map(|&id| surface_of(id) as u16));
        }
    }
    if channels.normal {
        crate::normals::write(assets, view, seen, &mut out.normal);
    }
}

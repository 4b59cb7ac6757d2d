//! One camera's colour picture, kept from frame to frame: only what may have changed is drawn again.

use glam::Vec3A;

use crate::arrival::Arrival;
use crate::assets::RenderAssets;
use crate::edges::Edges;
use crate::job::{Channels, FrameBuffers, FrameState};
use crate::layers::Layers;
use crate::points::CHUNK;
use crate::raster::Target;
use crate::scene::Scene;
use crate::shade::{Shading, Spot};
use crate::texture::{linear_from_srgb8, srgb8_from_linear};
use crate::view::{Lens, View, part_and_triangle, surface_of};

/// A picture and all that it was made from.
#[derive(Debug, Default)]
pub(crate) struct Canvas {
    pub view: View,
    opaque: Layers,
    /// Sides of transparent things that face away and that face the viewer; empty without any.
    glass: [Target; 2],
    arrival: Arrival,
    shadow_version: u64,
    /// Linear display colours at pixel centres, without what is transparent.
    colors: Vec<Vec3A>,
    rgb: Vec<u8>,
    changed: Vec<bool>,
    stale: Vec<bool>,
    shaded: Vec<bool>,
    finished: Vec<bool>,
    bins: Vec<Vec<u32>>,
    edges: Edges,
    /// What the pixels' centres see, transparent things included.
    seen: Target,
    /// Pixels whose surface was shaded at the last drawing.
    pub shaded_pixels: usize,
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
        let follows = self.view.place(assets, frame, lens) && self.opaque.target.scale == scale;
        let view = &self.view;
        let draw = |part: usize, target: &mut Target| view.draw_opaque(assets, part, target);
        if follows {
            self.opaque.follow::<true>(&view.motions, draw);
        } else {
            self.opaque.redraw::<true>([width, height], scale, assets.parts.len(), draw);
            self.arrival.reset(width, height);
            self.colors.clear();
            self.colors.resize(width * height, Vec3A::ZERO);
            self.rgb.clear();
            self.rgb.resize(width * height * 3, 0);
        }
        self.changed.clone_from(&self.opaque.changed);
        let moved = |part: usize| assets.parts[part].is_transparent() && view.motions[part].moved;
        let glass_moved = !follows || (0..assets.parts.len()).any(moved);
        if (view.has_transparent || had_glass) && glass_moved {
            for (target, sides) in self.glass.iter_mut().zip([[false, true], [true, false]]) {
                target.reset::<true>(width, height, scale);
                view.draw_transparent(assets, sides, target);
            }
        }
        let opaque = &self.opaque.target;
        self.arrival.see(opaque, &self.changed, view, scene.shadow, scene.variation);
        if follows {
            self.arrival.mark_stale(&self.changed, scene.shadow, self.shadow_version, &mut self.stale);
        } else {
            self.stale.clone_from(&self.changed);
        }
        self.shadow_version = scene.shadow.version();
        fill_bins(&self.arrival, &self.stale, width, &mut self.bins, assets.parts.len());
        self.arrival.estimate(assets, view, opaque, scene.shadow, scene.variation, &self.stale, &self.bins);
        self.shaded.clone_from(&self.stale);
        self.arrival.widen(&mut self.shaded);
        self.arrival.smooth(&self.stale, &self.shaded);
        fill_bins(&self.arrival, &self.shaded, width, &mut self.bins, assets.parts.len());
        self.shade(scene);
        self.finished.clone_from(&self.shaded);
        self.arrival.widen(&mut self.finished);
        self.finish(scene, glass_moved);
    }

    /// Shades the surfaces at the centres of the pixels in the bins.
    fn shade(&mut self, scene: &Scene<'_>) {
        let background = linear_from_srgb8(scene.variation.background);
        for tile in (0..self.shaded.len()).filter(|&tile| self.shaded[tile]) {
            let [columns, rows] = self.arrival.pixels_of(tile);
            for row in rows {
                for pixel in row * self.view.lens.width + columns.start..row * self.view.lens.width + columns.end {
                    if self.arrival.surface[pixel] == 0 {
                        self.colors[pixel] = background;
                    }
                }
            }
        }
        let (lens, target) = (&self.view.lens, &self.opaque.target);
        let mut shading = Shading::default();
        self.shaded_pixels = 0;
        for (part, pixels) in self.bins.iter().enumerate() {
            self.shaded_pixels += pixels.len();
            for chunk in pixels.chunks(CHUNK) {
                shading.clear();
                for &pixel in chunk {
                    let (column, row) = (pixel as usize % lens.width, pixel as usize / lens.width);
                    let sample = row * target.scale * target.width + column * target.scale;
                    let pixel = pixel as usize;
                    shading.push(Spot {
                        id: target.ids[sample],
                        x: column as i32 as f32,
                        y: row as i32 as f32,
                        depth: self.arrival.depth[pixel],
                        key: self.arrival.key[pixel],
                        ambient: self.arrival.ambient[pixel],
                    });
                }
                shading.shade(&scene.assets.parts[part], &self.view.parts[part], lens, scene.lighting);
                for (spot, &pixel) in chunk.iter().enumerate() {
                    self.colors[pixel as usize] = shading.color_of(spot);
                }
            }
        }
    }

    /// Smooths edges, lays what is transparent over them, and encodes.
    fn finish(&mut self, scene: &Scene<'_>, glass_moved: bool) {
        if glass_moved {
            for (part, motion) in scene.assets.parts.iter().zip(&self.view.motions) {
                if part.is_transparent() && motion.moved {
                    for rectangle in [&motion.before, &motion.now].into_iter().filter(|rectangle| !rectangle.is_empty())
                    {
                        let (tiles, step) = (self.opaque.tile_columns, crate::layers::TILE);
                        for row in rectangle.rows.start / step..rectangle.rows.end.div_ceil(step) {
                            let columns = rectangle.columns.start / step..rectangle.columns.end.div_ceil(step);
                            self.finished[row * tiles..][columns].fill(true);
                        }
                    }
                }
            }
        }
        let width = self.view.lens.width;
        for tile in (0..self.finished.len()).filter(|&tile| self.finished[tile]) {
            let [columns, rows] = self.arrival.pixels_of(tile);
            for row in rows {
                let pixels = row * width + columns.start..row * width + columns.end;
                let bytes = self.rgb[pixels.start * 3..pixels.end * 3].chunks_exact_mut(3);
                for (bytes, &color) in bytes.zip(&self.colors[pixels]) {
                    bytes.copy_from_slice(&srgb8_from_linear(color));
                }
            }
        }
        let glass = self.view.has_transparent.then_some(&self.glass);
        self.edges.finish(
            scene,
            &self.view,
            &self.opaque.target,
            glass,
            &self.arrival,
            &self.finished,
            &self.colors,
            &mut self.rgb,
        );
    }

    /// Copies the channels that are asked for.
    pub fn write(&mut self, assets: &RenderAssets, channels: Channels, out: &mut FrameBuffers) {
        out.rgb.clone_from(&self.rgb);
        let wants_geometry = channels.depth || channels.instance || channels.normal;
        let sees_glass = self.view.has_transparent && wants_geometry;
        if sees_glass || channels.normal {
            self.see(assets);
        }
        if channels.depth {
            if sees_glass {
                out.depth_m.extend(self.seen.nearness.iter().map(depth_of));
            } else {
                out.depth_m.clone_from(&self.arrival.depth);
            }
        }
        if channels.instance {
            let mut instances = vec![0; assets.parts.len() + 1];
            instances.iter_mut().skip(1).zip(&assets.parts).for_each(|(instance, part)| *instance = part.instance);
            if sees_glass {
                out.instance.extend(self.seen.ids.iter().map(|&id| instances[surface_of(id) as usize]));
            } else {
                out.instance.extend(self.arrival.surface.iter().map(|&surface| instances[surface as usize]));
            }
        }
        if channels.normal {
            crate::normals::write(assets, &self.view, &self.seen, &mut out.normal);
        }
    }

    /// What the pixels' centres see, transparent things included.
    fn see(&mut self, assets: &RenderAssets) {
        let (lens, opaque) = (&self.view.lens, &self.opaque.target);
        let scale = opaque.scale;
        self.seen.reset::<true>(lens.width, lens.height, 1);
        let glass = self.glass.iter().filter(|_| self.view.has_transparent);
        let (mut glass_from, mut glass_to) = (lens.height, 0);
        for (part, motion) in assets.parts.iter().zip(&self.view.motions) {
            if part.is_transparent() && !motion.now.is_empty() {
                glass_from = glass_from.min(motion.now.rows.start);
                glass_to = glass_to.max(motion.now.rows.end);
            }
        }
        let layers = std::iter::once((opaque, 0..lens.height)).chain(glass.map(|layer| (layer, glass_from..glass_to)));
        for (layer, rows) in layers {
            for row in rows {
                let samples = row * scale * layer.width..(row * scale + 1) * layer.width;
                let values = layer.nearness[samples.clone()].iter().step_by(scale);
                let ids = layer.ids[samples].iter().step_by(scale);
                let pixels = row * lens.width..(row + 1) * lens.width;
                let seen = self.seen.nearness[pixels.clone()].iter_mut().zip(&mut self.seen.ids[pixels]);
                for ((nearest, nearest_id), (&value, &id)) in seen.zip(values.zip(ids)) {
                    let closer = (value > *nearest) | ((value == *nearest) & (value > 0.0) & (id < *nearest_id));
                    *nearest = if closer { value } else { *nearest };
                    *nearest_id = if closer { id } else { *nearest_id };
                }
            }
        }
    }
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
    if channels.depth {
        out.depth_m.extend(seen.nearness.iter().map(depth_of));
    }
    if channels.instance {
        let instance = |&id: &u32| part_and_triangle(id).map_or(0, |(part, _)| assets.parts[part].instance);
        out.instance.extend(seen.ids.iter().map(instance));
    }
    if channels.normal {
        crate::normals::write(assets, view, seen, &mut out.normal);
    }
}

/// Lists the pixels of marked tiles by the part they show.
fn fill_bins(arrival: &Arrival, marked: &[bool], width: usize, bins: &mut Vec<Vec<u32>>, parts: usize) {
    bins.resize_with(parts, Vec::new);
    bins.iter_mut().for_each(Vec::clear);
    for tile in (0..marked.len()).filter(|&tile| marked[tile]) {
        let [columns, rows] = arrival.pixels_of(tile);
        for row in rows {
            let mut pixel = row * width + columns.start;
            let end = row * width + columns.end;
            while pixel < end {
                let surface = arrival.surface[pixel];
                let run = arrival.surface[pixel..end].iter().take_while(|&&other| other == surface).count();
                if let Some(bin) = (surface as usize).checked_sub(1).and_then(|part| bins.get_mut(part)) {
                    bin.extend(pixel as u32..(pixel + run) as u32);
                }
                pixel += run;
            }
        }
    }
}

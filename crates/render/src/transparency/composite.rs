//! Compositing of transparent layers: two interfaces per pixel, the nearest and the farthest.

use glam::Vec3A;
use multiversion::multiversion;

use super::interface::{Covered, Interface, LayerSample};
use super::refraction::{RefractedRays, refract};
use crate::gbuffer::view::{View, surface_of};
use crate::light_buffer::LightBuffer;
use crate::render_scene::RenderScene;
use crate::scene::assets::Part;
use crate::scene::texture::{find_codes, srgb_table};
use crate::shading::Shading;
use crate::simd::{BatchColumn, CHUNK, Column, lerp, within};

/// Number of glass interfaces that tint the light near a contact: 4 for the two walls of a cup; also suits solid feet.
const LIT_THROUGH: f32 = 4.0;
/// Distance behind a transparent object (m) from which light on a surface is not tinted. Chosen by hand.
const LIT_THROUGH_M: f32 = 0.02;

/// Transparent pixels of a frame, grouped by their surfaces; allocations are reused by the next frame.
#[derive(Debug, Default)]
pub(crate) struct TransparencyLayers {
    groups: Vec<Group>,
    /// Index of the last pixel's group, which is tried first, since most pixels have the surfaces of their neighbour.
    last: usize,
    work: Box<Work>,
}

/// Pixels with the same transparent surfaces.
#[derive(Debug)]
struct Group {
    /// Far and near surface number; the far one is 0 if there is only one interface.
    surfaces: [u32; 2],
    pixels: Vec<Covered>,
}

/// Result of the opaque pass, over which transparent layers are composited, and what is needed to shade the layers.
pub(crate) struct Opaque<'a> {
    pub scene: &'a RenderScene<'a>,
    pub view: &'a View,
    pub light_buffer: &'a LightBuffer,
    /// Linear display colours of the pixel centres; then those of edge pixels, with their pixel indices.
    pub colors: &'a [Vec3A],
    pub edge_pixels: &'a [(u32, Vec3A)],
}

/// Scratch memory for a batch of pixels.
#[derive(Debug, Default)]
struct Work {
    shading: Shading,
    /// Far interfaces, then near ones.
    sides: [Interface; 2],
    rays: RefractedRays,
}

impl TransparencyLayers {
    /// Removes the pixels of the last frame.
    pub fn clear(&mut self) {
        self.groups.retain(|group| !group.pixels.is_empty());
        self.groups.iter_mut().for_each(|group| group.pixels.clear());
        self.last = 0;
    }

    /// Adds a pixel with one or two layers; `edge_pixel` is its index among the edge pixels, if it is one.
    pub fn add(&mut self, pixel: u32, edge_pixel: Option<u32>, [one, other]: [Option<LayerSample>; 2]) {
        let mut layers = [one.or(other).unwrap_or_default(), other.or(one).unwrap_or_default()];
        if layers[0].point.depth < layers[1].point.depth {
            layers.swap(0, 1);
        }
        let [far, near] = layers.map(|layer| surface_of(layer.point.id));
        let surfaces = [if one.is_some() && other.is_some() { far } else { 0 }, near];
        let is_same = |group: &Group| group.surfaces == surfaces;
        if !self.groups.get(self.last).is_some_and(is_same) {
            self.last = self.groups.iter().position(is_same).unwrap_or_else(|| {
                self.groups.push(Group { surfaces, pixels: Vec::new() });
                self.groups.len() - 1
            });
        }
        self.groups[self.last].pixels.push(Covered { pixel, edge_pixel, layers });
    }

    /// Composites the layers of all pixels and writes the resulting bytes.
    pub fn show(&mut self, opaque: &Opaque<'_>, rgb: &mut [u8]) {
        let (mut seen, mut codes) = ([BatchColumn::default(); 3], [Column::default(); 3]);
        for Group { surfaces, pixels } in &self.groups {
            // A single layer counts as the near one.
            let first = usize::from(surfaces[0] == 0);
            let crossings = crossings(&opaque.scene.assets.parts, *surfaces);
            let lit_through = lit_through(opaque.scene, surfaces[0]);
            for pixels in pixels.chunks(CHUNK) {
                self.work.shade(opaque, *surfaces, pixels);
                self.work.look_behind(opaque, *surfaces, pixels, &mut seen);
                let Work { sides, rays, .. } = &*self.work;
                see_through(&sides[first..], &crossings[first..], lit_through, rays, &mut seen);
                find_codes(&seen, &mut codes);
                for (i, covered) in pixels.iter().enumerate() {
                    let bytes = [0, 1, 2].map(|channel| srgb_table()[codes[channel][i] as usize & 4095]);
                    rgb[covered.pixel as usize * 3..][..3].copy_from_slice(&bytes);
                }
            }
        }
    }
}

impl Work {
    /// Shades the interfaces of a batch; if its surface is a solid object, also refracts the view rays.
    fn shade(&mut self, opaque: &Opaque<'_>, surfaces: [u32; 2], pixels: &[Covered]) {
        let Opaque { scene, view, light_buffer, .. } = opaque;
        for (index, surface) in surfaces.into_iter().enumerate().filter(|(_, surface)| *surface > 0) {
            self.sides[index].shade(pixels, index, surface, &mut self.shading, scene, view);
        }
        let [far, near] = surfaces;
        for (gap, (covered, depth)) in self.rays.gap.iter_mut().zip(pixels.iter().zip(self.sides[0].depth.iter())) {
            let behind = light_buffer.depth[covered.pixel as usize];
            *gap = if far > 0 && behind > 0.0 { (behind - depth).max(0.0) } else { f32::INFINITY };
        }
        self.rays.are_bent = far == near && self.sides[1].is_solid;
        if self.rays.are_bent {
            let index_of_refraction = scene.materials[near as usize - 1].index_of_refraction();
            refract(&self.sides, index_of_refraction, &view.camera, scene.lighting, scene.look, &mut self.rays);
        }
    }

    /// Finds the opaque colour behind each pixel of a batch, along refracted rays if there are any.
    fn look_behind(
        &mut self,
        opaque: &Opaque<'_>,
        [_, near]: [u32; 2],
        pixels: &[Covered],
        seen: &mut [BatchColumn; 3],
    ) {
        let Opaque { scene, light_buffer, colors, edge_pixels, .. } = opaque;
        let body_of = |surface: u32| surface.checked_sub(1).and_then(|part| scene.assets.parts[part as usize].body);
        let own_body = body_of(near);
        for (i, covered) in pixels.iter().enumerate() {
            let pixel = covered.pixel as usize;
            let aside = self.rays.pixel[i] as usize;
            // The straight view ray is used if the refracted ray hits something nearer than the object, and for a label
            // on the far interface, which must not shift.
            let is_aside = self.rays.are_bent && {
                let (depth, body) = (light_buffer.depth[aside], body_of(u32::from(light_buffer.surface[pixel])));
                (depth <= 0.0 || depth > self.sides[1].depth[i]) && (body.is_none() || body != own_body)
            };
            let straight = || covered.edge_pixel.map_or(colors[pixel], |index| edge_pixels[index as usize].1);
            let behind = if is_aside { colors[aside] } else { straight() };
            self.rays.share[i] = if is_aside { self.rays.share[i] } else { 0.0 };
            (seen[0][i], seen[1][i], seen[2][i]) = behind.into();
        }
    }
}

/// Number of times that the stored far and near interfaces are composited. A pixel stores only two interfaces; hidden
/// ones between them are taken to equal these.
fn crossings(parts: &[Part], [far, near]: [u32; 2]) -> [usize; 2] {
    let near = &parts[near as usize - 1];
    let Some(far) = far.checked_sub(1).map(|part| &parts[part as usize]) else {
        // The content of a cup hides the cup's far interfaces.
        return [1, if near.faces_out && !near.mesh.closed { 2 } else { 1 }];
    };
    if std::ptr::eq(far, near) {
        return if near.mesh.closed { [1, 1] } else { [2, 2] };
    }
    // A wall next to a cavity has two interfaces, and so has the opposite wall.
    let of = |part: &Part| if part.faces_out && !part.mesh.closed { 4 } else { 2 };
    if near.body.is_none() || far.body != near.body {
        [of(far), of(near)]
    } else if near.faces_out {
        [2, if near.mesh.closed { 1 } else { 4 }]
    } else {
        // A view from above into a cup crosses its inner, then its outer surface.
        [1, 1]
    }
}

/// Tint of light on opaque surfaces in contact with the far object; white without a far object.
fn lit_through(scene: &RenderScene<'_>, far: u32) -> [f32; 3] {
    let Some(part) = far.checked_sub(1).map(|part| part as usize) else { return [1.0; 3] };
    let material = &scene.materials[part];
    let is_shell = !scene.assets.parts[part].mesh.closed;
    material.tint(material.mean_color(), 1.0, is_shell).powf(LIT_THROUGH).to_array()
}

/// Composites the interfaces, far ones first, over the opaque colours.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn see_through(
    sides: &[Interface],
    crossings: &[usize],
    lit_through: [f32; 3],
    rays: &RefractedRays,
    colors: &mut [BatchColumn; 3],
) {
    let mut near_by = BatchColumn::default();
    for (near_by, gap) in near_by.iter_mut().zip(rays.gap.iter()) {
        *near_by = within(1.0 - gap / LIT_THROUGH_M, 0.0, 1.0);
    }
    for (channel, (seen, around)) in colors.iter_mut().zip(&rays.around).enumerate() {
        for i in 0..CHUNK {
            let lit = seen[i] * lerp(1.0, lit_through[channel], near_by[i]);
            seen[i] = lerp(lit, around[i], rays.share[i]);
        }
        for (index, side) in sides.iter().enumerate() {
            let (color, passes) = (&side.color[channel], &side.passes[channel]);
            for i in 0..CHUNK {
                let mut passed = seen[i];
                for crossing in 0..crossings[index] {
                    // Where the bottom of a cup touches its support, it neither reflects nor absorbs.
                    let touches = if index + crossing == 0 && !side.is_solid { near_by[i] } else { 0.0 };
                    passed = lerp(color[i] + passed * passes[i], passed, touches);
                }
                seen[i] += (passed - seen[i]) * side.coverage[i];
            }
        }
    }
}

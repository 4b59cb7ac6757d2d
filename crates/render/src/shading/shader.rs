//! Shading of batches of points, and output of their colours.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::Vec3A;

use super::part::ShadedPart;
use super::points::{ShadingPoints, find_footprints, interpolate, interpolate_one, locate};
use super::reflect::reflect;
use super::terms::ShadingTerms;
use crate::gbuffer::points::TRIANGLE;
use crate::light_buffer::LightBuffer;
use crate::matched::look::Photographed;
use crate::scene::texture::{Samples, find_codes, srgb_table};
use crate::simd::{BatchColumn, CHUNK, Column, REGISTER};

/// Point in the image to be shaded.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ShadingPoint {
    /// Visibility id of the triangle at the point.
    pub id: u32,
    /// Image position (px); integers at pixel centres.
    pub x: f32,
    pub y: f32,
    pub depth: f32,
    /// Unoccluded share of the key light (shadow mask), 0-1.
    pub shadow: f32,
    /// Unoccluded share of the ambient light (ambient occlusion), 0-1.
    pub ambient: f32,
}

/// Shader of batches of points, each batch of one part; keeps its buffers from batch to batch.
#[derive(Debug, Default)]
pub(crate) struct Shading {
    points: ShadingPoints,
    samples: Samples,
    reflected: ShadingTerms,
    /// Indices of the colours in [`srgb_table`].
    codes: [Column<u32>; 3],
}

impl Shading {
    /// Empties the batch.
    pub fn clear(&mut self) {
        let pixels = &mut self.points.pixels;
        (pixels.count, pixels.is_flat) = (0, true);
    }

    /// Adds a point to the batch.
    pub fn push(&mut self, point: ShadingPoint) {
        let ShadingPoints { pixels, shadow, ambient, .. } = &mut self.points;
        let i = pixels.count;
        (pixels.column[i], pixels.row[i], pixels.depth[i]) = (point.x, point.y, point.depth);
        (shadow[i], ambient[i]) = (point.shadow, point.ambient);
        pixels.triangle[i] = point.id & TRIANGLE;
        pixels.is_flat &= pixels.triangle[i] == pixels.triangle[0];
        pixels.count += 1;
    }

    /// Replaces the batch by the centres of packed pixels, with their light from the light buffer.
    pub fn load_pixels(&mut self, places: &[u32], light_buffer: &LightBuffer) {
        let ShadingPoints { pixels, shadow, ambient, .. } = &mut self.points;
        pixels.load(places, light_buffer.centers());
        for (i, &pixel) in pixels.pixel.iter().enumerate().take(pixels.count) {
            (shadow[i], ambient[i]) = (light_buffer.shadow_mask[pixel as usize], light_buffer.ambient[pixel as usize]);
        }
        clamp_unknown(shadow);
    }

    /// Writes linear display colours and sRGB bytes of a batch of pixel centres into images.
    pub fn write(&mut self, colors: &mut [Vec3A], rgb: &mut [u8]) {
        find_codes(&self.reflected.color, &mut self.codes);
        let pixels = &self.points.pixels;
        let table = srgb_table();
        let code = |channel: usize, point: usize| table[self.codes[channel][point] as usize & 4095];
        for (point, &pixel) in pixels.pixel.iter().enumerate().take(pixels.count) {
            colors[pixel as usize] = self.color_of(point);
            let bytes: [u8; 3] = std::array::from_fn(|channel| code(channel, point));
            rgb[pixel as usize * 3..][..3].copy_from_slice(&bytes);
        }
    }

    /// Linear display colour of point number `point`, after [`Shading::shade`].
    #[inline(always)]
    pub fn color_of(&self, point: usize) -> Vec3A {
        self.reflected.color_at(point)
    }

    /// Linear display colours of all points, after [`Shading::shade`].
    pub fn colors(&self) -> &[BatchColumn; 3] {
        &self.reflected.color
    }

    /// Unit normals in the world on the side of the viewer, and their cosines to the direction to the viewer.
    pub fn normals(&self) -> (&[BatchColumn; 3], &BatchColumn) {
        (&self.reflected.normal, &self.reflected.facing)
    }

    /// Linear base colours of all points.
    pub fn bases(&self) -> &[BatchColumn; 3] {
        &self.points.base
    }

    /// Shades the points of the batch, all of which lie on `part`.
    pub fn shade(&mut self, part: &ShadedPart<'_>) {
        let Self { points, samples, reflected, .. } = self;
        let &ShadedPart { faces, viewpoint, material, placed, camera, .. } = part;
        match points.pixels.count <= REGISTER {
            true => locate::<REGISTER>(points, placed, camera),
            false => locate::<CHUNK>(points, placed, camera),
        }
        match points.pixels.is_flat {
            true => interpolate_one::<CHUNK>(points, &faces[points.pixels.triangle[0] as usize], viewpoint),
            false => interpolate(points, faces, viewpoint, material.texture.is_some()),
        }
        if let Some(texture) = &material.texture {
            find_footprints::<CHUNK>(points, placed, camera, texture.texels());
        }
        points.paint(material, samples);
        let Some(look) = part.look else { return reflect(points, part, reflected) };
        let count = points.pixels.count;
        points.photographed = BatchColumn::default();
        let mut as_seen = [None; CHUNK];
        if part.is_fixture {
            // Fixtures stand in the world: the frame of the body is that of the world.
            for i in 0..count {
                let at = |axes: &[BatchColumn; 3]| Vec3A::new(axes[0][i], axes[1][i], axes[2][i]);
                let (place, normal) = (at(&points.place), at(&points.normal).normalize_or_zero());
                match look.surface(place, normal, part.light.lighting) {
                    Some(Photographed::Base(base)) => {
                        (0..3).for_each(|channel| points.base[channel][i] = base[channel]);
                        points.photographed[i] = 1.0;
                    }
                    Some(Photographed::AsSeen(radiance)) => as_seen[i] = Some(radiance),
                    None => {}
                }
            }
        }
        reflect(points, part, reflected);
        for i in 0..count {
            let color = look.display(as_seen[i].unwrap_or_else(|| reflected.color_at(i)));
            (0..3).for_each(|channel| reflected.color[channel][i] = color[channel]);
        }
    }
}

/// Replaces unknown values of the shadow mask, which are negative, by 0.
#[inline(always)]
fn clamp_unknown(shadow: &mut BatchColumn) {
    for shadow in shadow.iter_mut() {
        *shadow = if *shadow > 0.0 { *shadow } else { 0.0 };
    }
}

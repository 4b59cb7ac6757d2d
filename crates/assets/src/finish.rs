//! Surface finishes of recipes: material and painted texture.

use std::sync::Arc;

use genmanip_core::{Material, Seed};
use serde::Deserialize;

use crate::color::Color;
use crate::paint::{Canvas, Paint};

/// Material and texture of a surface.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finish {
    /// Base colour of the surface.
    pub color: Color,
    /// Perceptual roughness, from 0 for a mirror to 1.
    #[serde(default = "default_roughness")]
    pub rough: f32,
    /// True for bare metal.
    #[serde(default)]
    pub metal: bool,
    /// Opacity, 0-1: 1 is opaque, less is a thin translucent wall.
    #[serde(default = "one")]
    pub opacity: f32,
    /// Index of refraction of the surface.
    #[serde(default = "default_ior")]
    pub ior: f32,
    /// Layers painted over the base colour, in order; without layers there is no texture.
    #[serde(default)]
    pub paint: Vec<Paint>,
    /// Width of the painted area divided by its height, needed to make discs round.
    #[serde(default = "one")]
    pub aspect: f32,
    /// Width and height of the texture (texels).
    #[serde(default = "default_pixels")]
    pub pixels: [u32; 2],
}

/// Metallic parameter of worn metal; a perfect mirror would be invisible in an empty room.
const HOUSEHOLD_METAL: f32 = 0.7;

impl Finish {
    /// True if the finish has a texture.
    pub fn is_painted(&self) -> bool {
        !self.paint.is_empty()
    }

    /// Material with its texture painted; `seed` drives the random patterns.
    pub fn material(&self, seed: Seed) -> Material {
        let texture = self.is_painted().then(|| {
            let mut canvas = Canvas::new(self.pixels, self.aspect, self.color);
            for (index, paint) in self.paint.iter().enumerate() {
                canvas.apply(paint, seed.fork_index(index as u64));
            }
            Arc::new(canvas.into_texture())
        });
        Material {
            base_color: if texture.is_some() { [1.0; 3] } else { self.color.0 },
            roughness: self.rough,
            metallic: if self.metal { HOUSEHOLD_METAL } else { 0.0 },
            opacity: self.opacity,
            ior: self.ior,
            thin_walled: self.opacity < 1.0,
            texture,
        }
    }
}

fn default_roughness() -> f32 {
    0.5
}

fn default_ior() -> f32 {
    1.5
}

fn one() -> f32 {
    1.0
}

fn default_pixels() -> [u32; 2] {
    [128, 128]
}

//! Procedural, seamlessly tiling textures of two colours, so that no third-party images are needed.

use std::f32::consts::TAU;
use std::sync::{Arc, Weak};

use genmanip_core::{Material, Texture};
use glam::Vec3;

use crate::simd::smooth_step;

/// Appearance of a support surface, floor or wall: two 8-bit sRGB colours and a pattern.
pub(crate) struct Patterned {
    pub name: &'static str,
    pub pattern: Pattern,
    light: [u8; 3],
    dark: [u8; 3],
    roughness: f32,
    metallic: f32,
}

/// Procedural patterns. Counts and `bands` are repetitions along one side of the texture, except that `threads` counts
/// single threads and `across` cells of noise; a row of bricks has `rows` / 3 of them. The second colour is `dark`; a
/// larger `share` (0-1) gives it more of the area, though not exactly that share.
#[derive(Clone, Copy)]
pub(crate) enum Pattern {
    /// Long wood fibres along v, in wide soft bands.
    Grain { bands: f32 },
    /// Boards of different grain side by side.
    Boards { count: u32 },
    /// Thin veins of the second colour in soft clouds.
    Veins { share: f32 },
    /// Small grains of the second colour.
    Flecks { across: u32, share: f32 },
    /// Woven threads, over and under each other.
    Weave { threads: u32 },
    /// Crossed stripes, as on a tablecloth.
    Checks { count: u32 },
    /// Squares with joints of the second colour.
    Tiles { count: u32 },
    /// Fine scratches along u.
    Brushed,
    /// Soft clouds and pores.
    Concrete,
    /// Mottled blend of both colours; plain if they are similar.
    Plain,
    /// Rows of bricks, every other one shifted.
    Bricks { rows: u32 },
    /// Upright stripes, as on a wallpaper.
    Stripes { count: u32 },
    /// Soft dots in shifted rows, as on a wallpaper.
    Dots { count: u32 },
    /// Vertical folds of a curtain.
    Folds { count: u32 },
}

use Pattern::{
    Boards, Bricks, Brushed, Checks, Concrete, Dots, Flecks, Folds, Grain, Plain, Stripes, Tiles, Veins, Weave,
};

/// Defines a type of materials that are identified by their names in files.
macro_rules! named_materials {
    ($(#[$attribute:meta])* $name:ident, $what:literal, $list:ident, $size:ident) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        #[serde(try_from = "String", into = "String")]
        pub struct $name(u8);

        impl $name {
            /// All materials of this type, the default first.
            pub fn all() -> impl ExactSizeIterator<Item = Self> {
                (0..$list.len() as u8).map(Self)
            }

            /// Name in files.
            pub fn name(self) -> &'static str {
                $list[usize::from(self.0)].name
            }

            /// Material with this name; its texture is cached while it is in use.
            pub(crate) fn material(self) -> genmanip_core::Material {
                type Known = std::sync::Weak<genmanip_core::Texture>;
                static MADE: std::sync::Mutex<[Known; $list.len()]> =
                    std::sync::Mutex::new([const { Known::new() }; $list.len()]);
                let index = usize::from(self.0);
                $list[index].material(&mut MADE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)[index], $size)
            }
        }

        impl TryFrom<String> for $name {
            type Error = String;

            fn try_from(name: String) -> Result<Self, String> {
                let known = || $list.map(|material| material.name).join(", ");
                let found = Self::all().find(|material| material.name() == name);
                found.ok_or_else(|| format!("unknown {} `{name}`: expected one of {}", $what, known()))
            }
        }

        impl From<$name> for String {
            fn from(material: $name) -> Self {
                material.name().into()
            }
        }
    };
}

pub(crate) use named_materials;

pub(crate) const fn patterned(
    name: &'static str,
    pattern: Pattern,
    light: [u8; 3],
    dark: [u8; 3],
    roughness: f32,
    metallic: f32,
) -> Patterned {
    Patterned { name, pattern, light, dark, roughness, metallic }
}

impl Patterned {
    /// Material with the pattern as its texture of `size` × `size` texels, which is generated unless `made` still
    /// refers to it.
    pub fn material(&self, made: &mut Weak<Texture>, size: u32) -> Material {
        let texture = made.upgrade().unwrap_or_else(|| Arc::new(self.texture(size)));
        *made = Arc::downgrade(&texture);
        Material { texture: Some(texture), metallic: self.metallic, ..Material::plain([1.0; 3], self.roughness) }
    }

    fn texture(&self, size: u32) -> Texture {
        let color = |[r, g, b]: [u8; 3]| Vec3::new(f32::from(r), f32::from(g), f32::from(b));
        let (light, dark) = (color(self.light), color(self.dark));
        let mut rgb = Vec::with_capacity((size * size * 3) as usize);
        for y in 0..size {
            for x in 0..size {
                let mix = self.pattern.mix(x as f32 / size as f32, y as f32 / size as f32);
                rgb.extend(light.lerp(dark, mix.clamp(0.0, 1.0)).to_array().map(|value| value as u8));
            }
        }
        Texture { width: size, height: size, rgb }
    }
}

impl Pattern {
    /// Weight of the second colour at texture coordinates `u` and `v` (each 0-1). It is not clamped: the terms of some
    /// patterns add up to as much as 1.5.
    pub fn mix(self, u: f32, v: f32) -> f32 {
        match self {
            Grain { bands } => grain(u, v, bands),
            Boards { count } => {
                let across = u * count as f32;
                let board = across as u32;
                // The grain of each board is shifted by its own offset, so that boards look like different pieces of
                // wood.
                let own = hash(board.wrapping_mul(7919) + count);
                let joint = smooth_edge((across.fract() - 0.5).abs(), 0.5 - 0.0035 * count as f32, 0.5);
                let end = smooth_edge(((v + own).fract() - 0.5).abs(), 0.4985, 0.5);
                grain((u + own).fract(), (v + 0.37 * own).fract(), 9.0) * 0.75 + own * 0.3 + joint.max(end) * 0.5
            }
            Veins { share } => {
                let bend = tiling_noise(u, v, 3, 3) * 0.5 + tiling_noise(u, v, 9, 9) * 0.2;
                let vein = |u: f32, v: f32, count: f32| {
                    let wave = ((u + v + bend) * TAU * count).sin().abs();
                    1.0 - smooth_edge(wave, 0.0, share)
                };
                let clouds = tiling_noise(u, v, 5, 4) * 0.6 + tiling_noise(u, v, 24, 24) * 0.4;
                0.25 * clouds + 0.6 * vein(u, v, 2.0) * clouds + 0.3 * vein(v, 2.0 * u, 1.0)
            }
            Flecks { across, share } => {
                let grain = tiling_noise(u, v, across, across) * 0.7 + tiling_noise(u, v, across * 2, across * 2) * 0.3;
                smooth_edge(grain, 0.62 - 0.4 * share, 0.78 - 0.4 * share) * 0.85 + tiling_noise(u, v, 6, 6) * 0.15
            }
            Weave { threads } => {
                let count = threads as f32;
                let (x, y) = ((u * count * TAU / 2.0).sin(), (v * count * TAU / 2.0).sin());
                let fibre = tiling_noise(u, v, threads, 40) * 0.5 + tiling_noise(u, v, 40, threads) * 0.5;
                0.25 + 0.25 * x * y + 0.5 * fibre
            }
            Checks { count } => {
                let is_dark = |t: f32| f32::from(u8::from((t * count as f32).fract() < 0.5));
                (is_dark(u) + is_dark(v)) * 0.45 + tiling_noise(u, v, 512, 512) * 0.1
            }
            Tiles { count } => {
                let (x, y) = (u * count as f32, v * count as f32);
                let joint = |t: f32| smooth_edge((t.fract() - 0.5).abs(), 0.478, 0.488);
                let own = hash(x as u32 * 131 + y as u32 * 7919 + count);
                joint(x).max(joint(y)) + 0.10 * own + 0.06 * tiling_noise(u, v, 30, 30)
            }
            Brushed => tiling_noise(u, v, 4, 512) * 0.6 + tiling_noise(u, v, 16, 900) * 0.4,
            Concrete => {
                let clouds = tiling_noise(u, v, 4, 4) * 0.5 + tiling_noise(u, v, 13, 13) * 0.3;
                let pores = smooth_edge(tiling_noise(u, v, 180, 180), 0.86, 0.95);
                clouds + tiling_noise(u, v, 120, 120) * 0.2 + pores * 0.5
            }
            Bricks { rows } => {
                let row = (v * rows as f32) as u32;
                let (x, y) = ((u * (rows / 3) as f32 + 0.5 * (row % 2) as f32).fract(), (v * rows as f32).fract());
                let number = (u * (rows / 3) as f32 + 0.5 * (row % 2) as f32) as u32 % (rows / 3);
                let joint = smooth_edge((x - 0.5).abs(), 0.478, 0.49).max(smooth_edge((y - 0.5).abs(), 0.435, 0.47));
                let own = hash(number * 131 + row * 7919);
                joint + (1.0 - joint) * (0.35 * own + 0.2 * tiling_noise(u, v, 120, 120))
            }
            Stripes { count } => {
                let place = ((u * count as f32).fract() - 0.5).abs();
                smooth_edge(place, 0.24, 0.26) + 0.08 * tiling_noise(u, v, 256, 256)
            }
            Dots { count } => {
                let row = (v * count as f32) as u32;
                let x = (u * count as f32 + 0.5 * (row % 2) as f32).fract() - 0.5;
                let y = (v * count as f32).fract() - 0.5;
                1.0 - smooth_edge(x.hypot(y), 0.2, 0.24) + 0.08 * tiling_noise(u, v, 256, 256)
            }
            Folds { count } => {
                let bend = tiling_noise(u, v, 9, 2) * 0.06;
                let fold = ((u + bend) * TAU * count as f32).sin() * 0.5 + 0.5;
                0.8 * fold + 0.2 * tiling_noise(u, v, 300, 300)
            }
            Plain => tiling_noise(u, v, 200, 200) * 0.6 + tiling_noise(u, v, 7, 7) * 0.4,
        }
    }
}

/// Wood grain of low contrast, so that objects stand out: long fibres along v, wide soft bands.
fn grain(u: f32, v: f32, bands: f32) -> f32 {
    let bend = tiling_noise(u, v, 4, 3) * 0.10 + tiling_noise(u, v, 10, 4) * 0.03;
    let band = ((u + bend) * TAU * bands).sin() * 0.5 + 0.5;
    let fibre = tiling_noise(u, v, 400, 12) * 0.6 + tiling_noise(u, v, 160, 5) * 0.4;
    let patch = tiling_noise(u, v, 3, 2);
    0.18 + 0.22 * band + 0.34 * fibre + 0.16 * patch
}

/// Smooth step from 0 at `below` to 1 at `above`.
fn smooth_edge(value: f32, below: f32, above: f32) -> f32 {
    smooth_step((value - below) / (above - below))
}

/// Value noise in 0-1 on a tiling grid of `columns` × `rows` cells.
fn tiling_noise(u: f32, v: f32, columns: u32, rows: u32) -> f32 {
    let (x, y) = (u * columns as f32, v * rows as f32);
    let (x0, y0) = (x as u32, y as u32);
    let (fx, fy) = (smooth_step(x - x0 as f32), smooth_step(y - y0 as f32));
    let value =
        |column: u32, row: u32| hash((column % columns) + (row % rows) * columns + columns * 7919 + rows * 104_729);
    let upper = value(x0, y0) + (value(x0 + 1, y0) - value(x0, y0)) * fx;
    let lower = value(x0, y0 + 1) + (value(x0 + 1, y0 + 1) - value(x0, y0 + 1)) * fx;
    upper + (lower - upper) * fy
}

/// Hash of an integer, mapped to 0-1.
fn hash(cell: u32) -> f32 {
    let mut hash = cell.wrapping_mul(0x9E37_79B1);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x85EB_CA77);
    hash = (hash ^ (hash >> 13)).wrapping_mul(0xC2B2_AE3D);
    (hash >> 8) as f32 / 16_777_216.0
}

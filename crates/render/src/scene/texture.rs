//! Mip-mapped textures with bilinear lookup.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use genmanip_core::Texture;
use glam::{Vec2, Vec3A};
use multiversion::multiversion;

use crate::simd::{BatchColumn, CHUNK, Column, floor, lerp, nearest_integer, polynomial, whole_registers, within};

/// Texture with its mip levels, which are created on first use.
#[derive(Debug)]
pub struct MipTexture {
    texture: Arc<Texture>,
    levels: OnceLock<Pyramid>,
}

/// Mip levels of a texture; their texels are stored one level after the other.
#[derive(Debug)]
struct Pyramid {
    levels: Vec<Level>,
    /// 8-bit sRGB, small enough for the processor's cache; the fourth byte is padding.
    texels: Vec<[u8; 4]>,
}

/// Mip level with a border of one texel, copied from the opposite side since textures repeat.
#[derive(Clone, Copy, Debug)]
struct Level {
    width: f32,
    height: f32,
    /// Texels per row including the border, and index of the level's first texel in [`Pyramid::texels`].
    stride: u32,
    first: u32,
}

/// Texture lookups of a batch of points.
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    /// Mip level, 0 for full detail.
    octave: Column<u32>,
    levels: Levels,
    /// Texture coordinates first, then bilinear weights.
    x: BatchColumn,
    y: BatchColumn,
    index: Column<u32>,
    /// Upper and lower pair of texels; within a pair, the left one first.
    texels: [Column<[u32; 2]>; 2],
}

/// [`Level`]s of a batch as structure of arrays.
#[derive(Clone, Debug, Default)]
struct Levels {
    width: BatchColumn,
    height: BatchColumn,
    stride: Column<u32>,
    first: Column<u32>,
}

impl MipTexture {
    /// Texture with mip levels, cached in the process while in use; `None` for an empty or incomplete texture.
    pub fn shared(texture: &Arc<Texture>) -> Option<Arc<Self>> {
        static KNOWN: Mutex<BTreeMap<usize, Arc<MipTexture>>> = Mutex::new(BTreeMap::new());
        let (width, height) = (texture.width as usize, texture.height as usize);
        let is_whole = width > 0 && height > 0 && texture.rgb.len() == width * height * 3;
        // The map is consistent even if a thread panicked while it held the lock.
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        // Drops textures that only this cache still holds.
        known.retain(|_, made| Arc::strong_count(&made.texture) > 1 || Arc::strong_count(made) > 1);
        let new = || Arc::new(Self { texture: Arc::clone(texture), levels: OnceLock::new() });
        is_whole.then(|| Arc::clone(known.entry(Arc::as_ptr(texture) as usize).or_insert_with(new)))
    }

    /// Number of texels of the full-detail image, that is per unit square of texture coordinates.
    pub fn texels(&self) -> f32 {
        (self.texture.width as usize * self.texture.height as usize) as f32
    }

    /// Mean linear colour of 32×32 samples.
    pub fn mean(&self) -> Vec3A {
        const SIDE: usize = 32;
        let place = |index: usize| Vec2::new((index % SIDE) as f32 + 0.5, (index / SIDE) as f32 + 0.5) / SIDE as f32;
        (0..SIDE * SIDE).fold(Vec3A::ZERO, |sum, index| sum + self.at(place(index))) / (SIDE * SIDE) as f32
    }

    /// Linear colour at texture coordinates, in full detail.
    pub fn at(&self, uv: Vec2) -> Vec3A {
        let (width, height) = (self.texture.width as usize, self.texture.height as usize);
        let place = (uv - uv.floor()) * Vec2::new(width as f32, height as f32) - 0.5;
        let (corner, share) = (place.floor(), place - place.floor());
        let texel = |dx: i64, dy: i64| {
            let column = (corner.x as i64 + dx).rem_euclid(width as i64) as usize;
            let row = (corner.y as i64 + dy).rem_euclid(height as i64) as usize;
            let rgb = &self.texture.rgb[(row * width + column) * 3..][..3];
            linear_from_srgb8([rgb[0], rgb[1], rgb[2]])
        };
        let upper = texel(0, 0).lerp(texel(1, 0), share.x);
        upper.lerp(texel(0, 1).lerp(texel(1, 1), share.x), share.y)
    }

    /// Samples the linear colours, multiplied by a tint, at `count` points.
    pub(crate) fn sample(
        &self,
        count: usize,
        place: [&BatchColumn; 2],
        texels_per_pixel: &BatchColumn,
        tint: [f32; 3],
        samples: &mut Samples,
        out: &mut [BatchColumn; 3],
    ) {
        let pyramid = self.levels.get_or_init(|| Pyramid::new(&self.texture));
        find_octaves(count, texels_per_pixel, &mut samples.octave);
        for i in 0..count.min(CHUNK) {
            let Level { width, height, stride, first } = *pyramid.at(samples.octave[i]);
            let levels = &mut samples.levels;
            (levels.width[i], levels.height[i], levels.stride[i], levels.first[i]) = (width, height, stride, first);
        }
        find_texels(count, place, samples);
        samples.read(count, &pyramid.texels);
        mix_texels(count, tint, samples, out);
    }
}

impl Samples {
    /// Reads the four texels around each point.
    fn read(&mut self, count: usize, texels: &[[u8; 4]]) {
        for i in 0..count.min(CHUNK) {
            let (index, stride) = (self.index[i] as usize, self.levels.stride[i] as usize);
            if let ([a, b, ..], [c, d, ..]) = (&texels[index..], &texels[index + stride..]) {
                self.texels[0][i] = [u32::from_le_bytes(*a), u32::from_le_bytes(*b)];
                self.texels[1][i] = [u32::from_le_bytes(*c), u32::from_le_bytes(*d)];
            }
        }
    }

    /// Sets the index of the first of the four texels around point `i`, and its bilinear weights.
    #[inline(always)]
    fn find(&mut self, i: usize, [u, v]: [f32; 2], level: Level) {
        let column = (u - floor(u)).mul_add(level.width, 0.5);
        let row = (v - floor(v)).mul_add(level.height, 0.5);
        // Also clamps coordinates that are not finite; the border makes neighbours of the last texel valid.
        let (left, top) = (within(floor(column), 0.0, level.width), within(floor(row), 0.0, level.height));
        self.x[i] = column - left;
        self.y[i] = row - top;
        self.index[i] = nearest_integer(top) * level.stride + nearest_integer(left) + level.first;
    }
}

/// Mip levels of a batch, with about one texel per pixel.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn find_octaves(count: usize, texels_per_pixel: &BatchColumn, octaves: &mut Column<u32>) {
    for i in 0..whole_registers(count) {
        octaves[i] = octave(texels_per_pixel[i]);
    }
}

/// Mip level of one point.
#[inline(always)]
fn octave(texels_per_pixel: f32) -> u32 {
    // The exponent of a float is its rounded-down binary logarithm. A level half a step higher would blur, one half a
    // step lower would alias.
    let texels = if texels_per_pixel > 1.0 { texels_per_pixel } else { 1.0 };
    ((texels * 1.19).to_bits() >> 23) - 127
}

/// First of the four texels around each point.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn find_texels(count: usize, [u, v]: [&BatchColumn; 2], samples: &mut Samples) {
    for i in 0..whole_registers(count) {
        let Levels { width, height, stride, first } = &samples.levels;
        let level = Level { width: width[i], height: height[i], stride: stride[i], first: first[i] };
        samples.find(i, [u[i], v[i]], level);
    }
}

/// Bilinear interpolation in sRGB, close enough to linear light, then conversion and tint.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn mix_texels(count: usize, tint: [f32; 3], samples: &Samples, out: &mut [BatchColumn; 3]) {
    for channel in 0..3 {
        for i in 0..whole_registers(count) {
            let code = |row: usize, side: usize| (samples.texels[row][i][side] >> (8 * channel) & 0xff) as i32 as f32;
            let mixed = |row: usize| lerp(code(row, 0), code(row, 1), samples.x[i]);
            let light = linear_of(lerp(mixed(0), mixed(1), samples.y[i]) * (1.0 / 255.0));
            out[channel][i] = light * tint[channel];
        }
    }
}

/// Linear value of an sRGB value in 0-1, with a relative error of 0.4 %: `t²` times a polynomial fit of `t` to the
/// power 0.4.
#[inline(always)]
fn linear_of(value: f32) -> f32 {
    let t = value.mul_add(1.0 / 1.055, 0.055 / 1.055);
    let power = polynomial([-1.213_869, 3.181_99, -3.232_639, 2.037_177, 0.223_733], t);
    if value > 0.040_45 { t * t * power } else { value * (1.0 / 12.92) }
}

impl Pyramid {
    fn new(texture: &Texture) -> Self {
        let mut size = [texture.width as usize, texture.height as usize];
        let mut texels: Vec<[u8; 3]> = texture.rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
        let mut pyramid = Self { levels: Vec::new(), texels: Vec::new() };
        pyramid.push(size, &texels);
        while size != [1, 1] {
            (size, texels) = halved(size, &texels);
            pyramid.push(size, &texels);
        }
        pyramid
    }

    /// Mip level `octave`, or the smallest level if there are fewer.
    fn at(&self, octave: u32) -> &Level {
        &self.levels[(octave as usize).min(self.levels.len() - 1)]
    }

    fn push(&mut self, [width, height]: [usize; 2], texels: &[[u8; 3]]) {
        let (stride, first) = (width as u32 + 2, self.texels.len() as u32);
        self.levels.push(Level { width: width as u32 as f32, height: height as u32 as f32, stride, first });
        for row in 0..height + 2 {
            let line = &texels[(row + height - 1) % height * width..][..width];
            let bordered = line.last().into_iter().chain(line).chain(line.first());
            self.texels.extend(bordered.map(|&[r, g, b]| [r, g, b, 0]));
        }
    }
}

fn halved([width, height]: [usize; 2], texels: &[[u8; 3]]) -> ([usize; 2], Vec<[u8; 3]>) {
    let half = [(width / 2).max(1), (height / 2).max(1)];
    let mut smaller = Vec::with_capacity(half[0] * half[1]);
    for y in 0..half[1] {
        for x in 0..half[0] {
            let at = |dx: usize, dy: usize| {
                let (column, row) = ((2 * x + dx).min(width - 1), (2 * y + dy).min(height - 1));
                linear_from_srgb8(texels[row * width + column])
            };
            smaller.push(srgb8_from_linear((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) * 0.25));
        }
    }
    (half, smaller)
}

/// Linear colour of 8-bit sRGB.
#[inline]
pub fn linear_from_srgb8(rgb: [u8; 3]) -> Vec3A {
    let table = linear_table();
    Vec3A::from_array(rgb.map(|code| table[code as usize]))
}

/// 8-bit sRGB of a linear colour, clamped.
#[inline]
pub fn srgb8_from_linear(linear: Vec3A) -> [u8; 3] {
    let table = srgb_table();
    let code = |value: f32| table[nearest_integer(within(value, 0.0, 1.0) * 4095.0) as usize & 4095];
    [code(linear.x), code(linear.y), code(linear.z)]
}

/// Indices of linear colours in [`srgb_table`].
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(crate) fn find_codes(colors: &[BatchColumn; 3], codes: &mut [Column<u32>; 3]) {
    for channel in 0..3 {
        for i in 0..CHUNK {
            codes[channel][i] = nearest_integer(within(colors[channel][i], 0.0, 1.0) * 4095.0);
        }
    }
}

/// Linear colour of sRGB in 0-1.
pub fn linear_from_srgb(rgb: [f32; 3]) -> Vec3A {
    Vec3A::from_array(rgb.map(|value| {
        let value = value.clamp(0.0, 1.0);
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    }))
}

/// sRGB value, 0-1, of a linear value.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Linear values of 8-bit sRGB codes.
fn linear_table() -> &'static [f32; 256] {
    static TABLE: OnceLock<[f32; 256]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|code| linear_from_srgb([code as f32 / 255.0; 3]).x))
}

/// 8-bit sRGB codes of linear values in steps of 1/4095.
pub(crate) fn srgb_table() -> &'static [u8; 4096] {
    static TABLE: OnceLock<[u8; 4096]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|index| {
            let linear = index as f32 / 4095.0;
            (srgb_from_linear(linear) * 255.0 + 0.5) as u8
        })
    })
}

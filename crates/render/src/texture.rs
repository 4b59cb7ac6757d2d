//! Pictures on surfaces: a pyramid of halved sizes, read bilinearly at the level that fits a pixel.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use genmanip_core::Texture;
use glam::{Vec2, Vec3A};

use crate::raster::{nearest_integer, within};

/// A texture and its smaller copies, linear colour; they are made when the first pixel asks for them.
#[derive(Debug)]
pub(crate) struct MipTexture {
    texture: Arc<Texture>,
    levels: OnceLock<Vec<Level>>,
}

#[derive(Debug)]
struct Level {
    width: usize,
    height: usize,
    /// 8-bit sRGB as it came, small enough to stay in the cache; the fourth byte is for alignment.
    texels: Vec<[u8; 4]>,
}

impl MipTexture {
    /// The pyramid of a texture, one per process while the texture lives; `None` when it has no pixels or their number does not match its size.
    pub fn shared(texture: &Arc<Texture>) -> Option<Arc<Self>> {
        static KNOWN: Mutex<BTreeMap<usize, Arc<MipTexture>>> = Mutex::new(BTreeMap::new());
        let (width, height) = (texture.width as usize, texture.height as usize);
        let is_whole = width > 0 && height > 0 && texture.rgb.len() == width * height * 3;
        // A thread that panicked while it held the lock left a whole map behind.
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        // Dropped when nobody else holds the texture or its pyramid.
        known.retain(|_, made| Arc::strong_count(&made.texture) > 1 || Arc::strong_count(made) > 1);
        let new = || Arc::new(Self { texture: Arc::clone(texture), levels: OnceLock::new() });
        is_whole.then(|| Arc::clone(known.entry(Arc::as_ptr(texture) as usize).or_insert_with(new)))
    }

    /// Number of texels per unit square of texture coordinates.
    pub fn texels(&self) -> f32 {
        (self.texture.width as usize * self.texture.height as usize) as f32
    }

    /// Linear colour at a texture coordinate, where a pixel covers about `texels_per_pixel` texels along one side.
    #[inline]
    pub fn sample(&self, uv: Vec2, texels_per_pixel: f32) -> Vec3A {
        // Exponent of the float = floor of the logarithm; half a level more would blur, half less would shimmer.
        let octave = ((texels_per_pixel.max(1.0) * 1.19).to_bits() >> 23) as usize - 127;
        let levels = self.levels.get_or_init(|| pyramid(&self.texture));
        levels[octave.min(levels.len() - 1)].sample(uv)
    }
}

fn pyramid(texture: &Texture) -> Vec<Level> {
    let texels = texture.rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2], 0]).collect();
    let mut levels = vec![Level { width: texture.width as usize, height: texture.height as usize, texels }];
    while let Some(smaller) = levels.last().and_then(Level::halved) {
        levels.push(smaller);
    }
    levels
}

impl Level {
    /// Mixes the four nearest texels in sRGB, which is close enough to mixing light and needs one conversion.
    ///
    /// In whole numbers, all three channels in one: 21 bits each, weights in 4096ths.
    #[inline]
    fn sample(&self, uv: Vec2) -> Vec3A {
        let (left, right, fx) = neighbours(uv.x, self.width);
        let (top, bottom, fy) = neighbours(uv.y, self.height);
        let (top, bottom) = (top * self.width, bottom * self.width);
        let texel = |index: usize| {
            let code = u64::from(u32::from_le_bytes(self.texels[index]));
            (code & 0xff) | ((code & 0xff00) << 13) | ((code & 0xff_0000) << 26)
        };
        let lower_right = fx * fy;
        let (upper_right, lower_left) = (fx * STEPS - lower_right, fy * STEPS - lower_right);
        let upper_left = STEPS * STEPS - fx * STEPS - lower_left;
        let mixed = texel(top + left) * upper_left
            + texel(top + right) * upper_right
            + texel(bottom + left) * lower_left
            + texel(bottom + right) * lower_right;
        let table = linear_table();
        let linear = |shift: u32| table[(((mixed >> shift) + 512) >> 10) as usize & 1023];
        Vec3A::new(linear(0), linear(21), linear(42))
    }

    fn halved(&self) -> Option<Self> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let at = |dx: usize, dy: usize| {
                    let column = (2 * x + dx).min(self.width - 1);
                    let row = (2 * y + dy).min(self.height - 1);
                    let [r, g, b, _] = self.texels[row * self.width + column];
                    linear_from_srgb8([r, g, b])
                };
                let [r, g, b] = srgb8_from_linear((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) * 0.25);
                texels.push([r, g, b, 0]);
            }
        }
        Some(Self { width, height, texels })
    }
}

/// Steps between two texels.
const STEPS: u64 = 64;

/// The two texels beside a texture coordinate that repeats, and how many steps it lies towards the second.
#[inline(always)]
fn neighbours(coordinate: f32, count: usize) -> (usize, usize, u64) {
    let count = count as i32;
    let steps = (coordinate - floor(coordinate)) * (count * STEPS as i32) as f32;
    let place = nearest_integer(steps) as i32 - STEPS as i32 / 2;
    let first = (place >> STEPS.trailing_zeros()).min(count - 1);
    let second = if first + 1 >= count { 0 } else { first + 1 };
    let first = if first < 0 { count - 1 } else { first };
    (first as usize, second as usize, (place & (STEPS as i32 - 1)) as u64)
}

/// Without a call to the mathematics library; for numbers below 2²².
#[inline(always)]
fn floor(value: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let nearest = (value + SHIFT) - SHIFT;
    if nearest > value { nearest - 1.0 } else { nearest }
}

/// Linear light of an 8-bit sRGB colour.
#[inline]
pub(crate) fn linear_from_srgb8(rgb: [u8; 3]) -> Vec3A {
    let table = linear_table();
    Vec3A::from_array(rgb.map(|code| table[code as usize * 4]))
}

/// 8-bit sRGB of linear light; clips.
#[inline]
pub(crate) fn srgb8_from_linear(linear: Vec3A) -> [u8; 3] {
    let table = srgb_table();
    let code = |value: f32| table[nearest_integer(within(value, 0.0, 1.0) * 4095.0) as usize & 4095];
    [code(linear.x), code(linear.y), code(linear.z)]
}

/// Linear light of an sRGB colour, 0-1.
pub(crate) fn linear_from_srgb(rgb: [f32; 3]) -> Vec3A {
    Vec3A::from_array(rgb.map(|value| {
        let value = value.clamp(0.0, 1.0);
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    }))
}

/// Linear light of quarters of 8-bit codes.
fn linear_table() -> &'static [f32; 1024] {
    static TABLE: OnceLock<[f32; 1024]> = OnceLock::new();
    TABLE.get_or_init(|| std::array::from_fn(|quarter| linear_from_srgb([quarter as f32 / 1020.0; 3]).x))
}

fn srgb_table() -> &'static [u8; 4096] {
    static TABLE: OnceLock<[u8; 4096]> = OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|index| {
            let linear = index as f32 / 4095.0;
            let srgb = if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
            (srgb * 255.0 + 0.5) as u8
        })
    })
}

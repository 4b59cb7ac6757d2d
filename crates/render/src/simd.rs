//! Batches of points as structures of arrays, in loops that compile to wide SIMD registers and give the same bits on
//! all processors.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::ops::{Deref, DerefMut};

/// Number of points per batch: several of the widest registers; all components fit the first-level cache.
pub(crate) const CHUNK: usize = 64;

/// Number of 32-bit lanes in the widest registers.
pub(crate) const REGISTER: usize = 16;

/// Number of points rounded up to a multiple of the register width.
#[inline(always)]
pub(crate) fn whole_registers(count: usize) -> usize {
    count.next_multiple_of(REGISTER).min(CHUNK)
}

/// Component of a batch of points: one value per point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Column<T>([T; CHUNK]);

pub(crate) type BatchColumn = Column<f32>;

impl<T: Copy> Column<T> {
    /// Component with the same value for all points.
    #[inline(always)]
    pub fn of(value: T) -> Self {
        Self([value; CHUNK])
    }
}

impl<T: Copy + Default> Default for Column<T> {
    fn default() -> Self {
        Self::of(T::default())
    }
}

impl<T> Deref for Column<T> {
    type Target = [T; CHUNK];

    #[inline(always)]
    fn deref(&self) -> &[T; CHUNK] {
        &self.0
    }
}

impl<T> DerefMut for Column<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T; CHUNK] {
        &mut self.0
    }
}

/// Dot product with fused multiply-adds, which round once and give the same bits on all processors.
#[inline(always)]
pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// Component `axis` of the product of a vector and a matrix, which is given by its columns.
#[inline(always)]
pub(crate) fn turned(columns: &[[f32; 3]; 3], axis: usize, vector: [f32; 3]) -> f32 {
    dot([columns[0][axis], columns[1][axis], columns[2][axis]], vector)
}

/// Value of a polynomial given by its coefficients, highest power first (Horner's scheme).
#[inline(always)]
pub(crate) fn polynomial<const N: usize>(coefficients: [f32; N], x: f32) -> f32 {
    let mut sum = coefficients[0];
    // A loop, since closures of iterators would not be compiled for wide registers.
    for index in 1..N {
        sum = sum.mul_add(x, coefficients[index]);
    }
    sum
}

/// Linear interpolation.
#[inline(always)]
pub(crate) fn lerp(from: f32, to: f32, share: f32) -> f32 {
    (to - from).mul_add(share, from)
}

/// Nearest integer of a number from 0 to 2²², without the special cases of a conversion.
#[inline(always)]
pub(crate) fn nearest_integer(value: f32) -> u32 {
    const SHIFT: f32 = 8_388_608.0;
    (value + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits())
}

/// Value clamped to a range, without the NaN handling of `f32::min` and `max`: one instruction per side.
#[inline(always)]
pub(crate) fn within(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

/// Smooth step (3t² - 2t³) of a parameter clamped to 0-1.
#[inline(always)]
pub(crate) fn smooth_step(share: f32) -> f32 {
    let t = within(share, 0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Floor of a number below 2²², without a call to the mathematics library.
#[inline(always)]
pub(crate) fn floor(value: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let nearest = (value + SHIFT) - SHIFT;
    if nearest > value { nearest - 1.0 } else { nearest }
}

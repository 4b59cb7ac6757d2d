//! What loops over many points at once share: one component of all points beside each other, compiled for the widest
//! registers of the machine, with the same bits on all.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

/// Points at a time: several of the widest registers, and all components of a chunk fit the first cache.
pub(crate) const CHUNK: usize = 64;

/// Lanes of the widest registers.
pub(crate) const REGISTER: usize = 16;

/// So many points of a chunk, rounded up to the widest registers.
#[inline(always)]
pub(crate) fn whole_registers(count: usize) -> usize {
    count.next_multiple_of(REGISTER).min(CHUNK)
}

/// One component of the points of a chunk.
pub(crate) type BatchColumn = [f32; CHUNK];

pub(crate) const ZERO: BatchColumn = [0.0; CHUNK];

/// Scalar product. The sums of products here are fused, rounded once: so they have the same bits on all processors, and are
/// one instruction where there is one.
#[inline(always)]
pub(crate) fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// A component of a vector turned by a matrix, which is given by its columns.
#[inline(always)]
pub(crate) fn turned(columns: &[[f32; 3]; 3], axis: usize, vector: [f32; 3]) -> f32 {
    dot([columns[0][axis], columns[1][axis], columns[2][axis]], vector)
}

/// A polynomial, given by its coefficients from the highest power on (Horner's scheme).
#[inline(always)]
pub(crate) fn polynomial<const N: usize>(coefficients: [f32; N], x: f32) -> f32 {
    let mut sum = coefficients[0];
    // Not by an iterator: what its closure calls is not compiled for wide registers.
    for index in 1..N {
        sum = sum.mul_add(x, coefficients[index]);
    }
    sum
}

/// So far on the way from one number to another.
#[inline(always)]
pub(crate) fn lerp(from: f32, to: f32, share: f32) -> f32 {
    (to - from).mul_add(share, from)
}

/// Nearest integer of a number from 0 to 2²², without the care that a conversion takes for others.
#[inline(always)]
pub(crate) fn nearest_integer(value: f32) -> u32 {
    const SHIFT: f32 = 8_388_608.0;
    (value + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits())
}

/// A number moved into an interval; one instruction per side, unlike `f32::min` and `max`, which care for NaN.
#[inline(always)]
pub(crate) fn within(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

/// A smooth step from 0 to 1 of a share of the way between its ends.
#[inline(always)]
pub(crate) fn smooth_step(share: f32) -> f32 {
    let t = within(share, 0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Largest integer that is not above a number of less than 2²², without a call to the mathematics library.
#[inline(always)]
pub(crate) fn floor(value: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let nearest = (value + SHIFT) - SHIFT;
    if nearest > value { nearest - 1.0 } else { nearest }
}

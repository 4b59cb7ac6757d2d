//! What loops over many points at once share: one component of all points beside each other, compiled for the widest
//! registers of the machine, with the same bits on all.

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
pub(crate) type Lane = [f32; CHUNK];

pub(crate) const ZERO: Lane = [0.0; CHUNK];

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

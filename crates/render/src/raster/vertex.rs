//! Projected vertices, and arithmetic of triangle edges.

use crate::simd::within;

/// Vertex projected into the image, in samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// Column; samples are at integers.
    pub x: f32,
    /// Row; samples are at integers.
    pub y: f32,
    /// Reversed depth: positive, increases towards the viewer, linear in the image, e.g. 1 / depth.
    pub reversed_z: f32,
}

/// Componentwise minimum and maximum of vertices.
#[inline(always)]
pub(crate) fn extremes(corners: impl Iterator<Item = Corner>) -> (Corner, Corner) {
    let joined = |a: Corner, b: Corner, join: fn(f32, f32) -> f32| Corner {
        x: join(a.x, b.x),
        y: join(a.y, b.y),
        reversed_z: join(a.reversed_z, b.reversed_z),
    };
    let all = |value: f32| Corner { x: value, y: value, reversed_z: value };
    corners.fold((all(f32::MAX), all(f32::MIN)), |(low, high), corner| {
        (joined(low, corner, |a, b| if a < b { a } else { b }), joined(high, corner, |a, b| if a > b { a } else { b }))
    })
}

/// Twice the signed area of a triangle on the image, negative for counter-clockwise (front) faces.
#[inline(always)]
pub(super) fn area_of(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
}

/// Smallest integer at or above a coordinate, clamped to `0..=limit`.
///
/// Adding 2²³ to a float rounds it to an integer, without a call to the mathematics library.
#[inline(always)]
pub(super) fn first_sample(coordinate: f32, limit: usize) -> u32 {
    const SHIFT: f32 = 8_388_608.0;
    let inside = within(coordinate, 0.0, limit as i32 as f32);
    let shifted = inside + SHIFT;
    let below = u32::from(shifted - SHIFT < inside);
    shifted.to_bits().wrapping_sub(SHIFT.to_bits()).wrapping_add(below)
}

/// Smallest and largest of three numbers.
#[inline(always)]
pub(super) fn range_of_three(a: f32, b: f32, c: f32) -> (f32, f32) {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    (if c < low { c } else { low }, if c > high { c } else { high })
}

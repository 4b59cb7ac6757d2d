//! Spans of triangles: samples beside each other.

use std::array;

use crate::simd::within;

/// Samples that are drawn at once: few rows have more.
const SAMPLES: usize = 8;

/// Reversed z of a triangle as a linear function of the place.
#[derive(Clone, Debug, Default)]
pub(super) struct DepthGradient {
    /// At the origin of the image, in double precision: corners may lie far outside it.
    pub constant: f64,
    pub dx: f32,
    pub dy: f32,
    /// Bounds over the corners: rounding on a sliver must not leave them.
    pub low: f32,
    pub high: f32,
}

/// A row of a triangle.
pub(super) struct Span {
    /// Samples.
    pub first: usize,
    pub count: usize,
    /// Samples from where the reversed_z is `value` to the first one.
    pub offset: f32,
    pub value: f32,
}

impl Span {
    /// Draws it; without ids, on a map of shadows.
    #[inline(always)]
    pub fn draw<const IDS: bool>(&self, gradient: &DepthGradient, id: u32, reversed_z: &mut [f32], ids: &mut [u32]) {
        let &Self { first, count, .. } = self;
        // Without ids it is faster to draw nothing than to mispredict a branch.
        if IDS && count == 0 {
            return;
        }
        let whole = count.saturating_sub(1) / SAMPLES * SAMPLES;
        if whole > 0 {
            let reversed_z = reversed_z[first..first + whole].as_chunks_mut::<SAMPLES>().0.iter_mut();
            if IDS {
                let ids = ids[first..first + whole].as_chunks_mut::<SAMPLES>().0.iter_mut();
                for (chunk, (reversed_z, ids)) in reversed_z.zip(ids).enumerate() {
                    show(reversed_z, ids, &self.values(gradient, chunk * SAMPLES), id);
                }
            } else {
                for (chunk, reversed_z) in reversed_z.enumerate() {
                    cast(reversed_z, &self.values(gradient, chunk * SAMPLES));
                }
            }
        }
        // What lies beyond the row is read and written as it was.
        let values = self.values(gradient, whole);
        if let Some(reversed_z) = reversed_z[first + whole..].first_chunk_mut::<SAMPLES>() {
            if IDS {
                if let Some(ids) = ids[first + whole..].first_chunk_mut::<SAMPLES>() {
                    show(reversed_z, ids, &values, id);
                }
            } else {
                cast(reversed_z, &values);
            }
            return;
        }
        for column in whole..count {
            let (at, value) = (first + column, [values[column - whole]]);
            if IDS {
                show(array::from_mut(&mut reversed_z[at]), array::from_mut(&mut ids[at]), &value, id);
            } else {
                cast(array::from_mut(&mut reversed_z[at]), &value);
            }
        }
    }

    /// Reversed z of samples from one on, 0 beyond the row.
    #[inline(always)]
    fn values(&self, gradient: &DepthGradient, from: usize) -> [f32; SAMPLES] {
        // Integers in single precision: exact. From 1, since the compiler treats 0 apart.
        const STEPS: [f32; SAMPLES] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let (left, offset) = ((self.count - from) as i32 as f32, self.offset + (from as i32 - 1) as f32);
        let mut values = [0.0; SAMPLES];
        for i in 0..SAMPLES {
            let value = within((STEPS[i] + offset).mul_add(gradient.dx, self.value), gradient.low, gradient.high);
            values[i] = if STEPS[i] <= left { value } else { 0.0 };
        }
        values
    }
}

/// Draws samples of a triangle.
#[inline(always)]
fn show<const N: usize>(reversed_z: &mut [f32; N], ids: &mut [u32; N], values: &[f32; N], id: u32) {
    let (nearest, nearest_ids) = (*reversed_z, *ids);
    for i in 0..N {
        // Positive numbers are in the order of their bits.
        reversed_z[i] = f32::from_bits(values[i].to_bits().max(nearest[i].to_bits()));
        // Written so, the compiler does not make it a masked store, at which some processors are slow.
        let own = if values[i] >= nearest[i] { id } else { u32::MAX };
        let other = if values[i] > nearest[i] { u32::MAX } else { nearest_ids[i] };
        ids[i] = own.min(other);
    }
}

/// Draws samples of a triangle on a map of shadows, which keeps its last bit for what is transparent.
#[inline(always)]
fn cast<const N: usize>(reversed_z: &mut [f32; N], values: &[f32; N]) {
    let nearest = *reversed_z;
    for i in 0..N {
        // Positive numbers are in the order of their bits, and negative ones are less.
        let (value, other) = ((values[i].to_bits() & !1) as i32, nearest[i].to_bits() as i32);
        reversed_z[i] = f32::from_bits(value.max(other) as u32);
    }
}

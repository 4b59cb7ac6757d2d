//! Spans of triangles: runs of samples in a row.

use std::array;

use crate::simd::within;

/// Number of samples drawn at once; few spans are longer.
const SAMPLES: usize = 8;

/// Reversed z of a triangle as a linear function of the sample position.
#[derive(Clone, Debug, Default)]
pub(super) struct DepthGradient {
    /// Value at sample (0, 0), in double precision, since vertices may lie far outside the image.
    pub constant: f64,
    /// Change per sample along a row, and from row to row.
    pub dx: f32,
    pub dy: f32,
    /// Range over the vertices, to which values are clamped, since rounding on slivers would exceed it.
    pub low: f32,
    pub high: f32,
}

/// Span of a triangle in one row.
pub(super) struct Span {
    /// Index of the first sample in the buffer, and number of samples.
    pub first: usize,
    pub count: usize,
    /// Distance (samples) from the sample at which reversed z is `value` to the first sample.
    pub offset: f32,
    pub value: f32,
}

impl Span {
    /// Draws the span with depth test; without `IDS`, into a shadow map.
    #[inline(always)]
    pub fn draw<const IDS: bool>(&self, gradient: &DepthGradient, id: u32, reversed_z: &mut [f32], ids: &mut [u32]) {
        let &Self { first, count, .. } = self;
        // In a shadow map, drawing nothing is faster than a mispredicted branch.
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
        // Samples beyond the span keep their values: reversed z 0 never wins the depth test.
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

    /// Reversed z of [`SAMPLES`] samples from index `from` of the span on, 0 beyond its end.
    #[inline(always)]
    fn values(&self, gradient: &DepthGradient, from: usize) -> [f32; SAMPLES] {
        // Exact integers, starting at 1 since the compiler treats 0 specially.
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

/// Depth test and update of samples; on equal depth the smaller id wins.
#[inline(always)]
fn show<const N: usize>(reversed_z: &mut [f32; N], ids: &mut [u32; N], values: &[f32; N], id: u32) {
    let (nearest, nearest_ids) = (*reversed_z, *ids);
    for i in 0..N {
        // Positive floats have the same order as their bits.
        reversed_z[i] = f32::from_bits(values[i].to_bits().max(nearest[i].to_bits()));
        // Avoids a masked store, which is slow on some processors.
        let own = if values[i] >= nearest[i] { id } else { u32::MAX };
        let other = if values[i] > nearest[i] { u32::MAX } else { nearest_ids[i] };
        ids[i] = own.min(other);
    }
}

/// Depth test and update of shadow-map texels, whose lowest bit marks transparent casters.
#[inline(always)]
fn cast<const N: usize>(reversed_z: &mut [f32; N], values: &[f32; N]) {
    let nearest = *reversed_z;
    for i in 0..N {
        // Positive floats have the same order as their bits, and negative ones are smaller as signed integers.
        let (value, other) = ((values[i].to_bits() & !1) as i32, nearest[i].to_bits() as i32);
        reversed_z[i] = f32::from_bits(value.max(other) as u32);
    }
}

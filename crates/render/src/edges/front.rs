//! Which samples show something transparent before what is opaque.

use std::sync::OnceLock;

use multiversion::multiversion;

use super::keys::Around;
use crate::layers::TILE;
use crate::raster::Target;
use crate::view::far_nearness;

/// By how much a transparent side must be nearer than what is opaque, as a share: glass stands on the table.
const APART: f32 = 1e-4;
/// Most samples per pixel along an axis.
const MOST: usize = 4;
/// Most rows of samples between the centres of the pixels beside a tile.
const ROWS: usize = (TILE + 1) * MOST - 1;

/// The samples of a tile and of those around it between the centres of the pixels next to it, a bit each.
#[derive(Debug)]
pub(super) struct Front {
    /// Samples per pixel along an axis.
    n: isize,
    rows: [u64; ROWS],
}

/// What is in front of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Share {
    /// Of the pixel.
    pub coverage: f32,
    /// From the pixel's centre to the sample that counts most, samples.
    pub step: [isize; 2],
}

impl Front {
    /// Of a tile that begins at a pixel. The nearness of a layer of far sides is turned.
    pub fn of(layer: &Target, is_far: bool, around: &Around<'_>, [column, row]: [usize; 2]) -> Self {
        let n = around.n;
        let mut own = Self { n, rows: [0; ROWS] };
        let side = (TILE as isize + 1) * n - 1;
        let first = [column as isize * n - (n - 1), row as isize * n - (n - 1)];
        let (left, right) = (around.cut(first[0], 0).0, around.cut(first[0] + side - 1, 0).0);
        let (before, after) = ((left - first[0]) as u32, (first[0] + side - 1 - right) as u32);
        let count = (right + 1 - left) as usize;
        let (top, bottom) = (around.cut(0, first[1]).1, around.cut(0, first[1] + side - 1).1);
        let (above, height) = ((top - first[1]) as usize, (bottom + 1 - top) as usize);
        let first = |target: &Target| top as usize * target.stride + left as usize;
        let opaque = around.opaque;
        let lines =
            [(&layer.nearness[first(layer)..], layer.stride), (&opaque.nearness[first(opaque)..], opaque.stride)];
        let rows = &mut own.rows[..side as usize];
        compare(lines, is_far, count, &mut rows[above..above + height]);
        // Samples beyond the image's border are those next to it.
        for bits in &mut rows[above..above + height] {
            let spread = |bit: u64, count: u32| if bit != 0 { (1 << count) - 1 } else { 0 };
            let (inside, last) = (*bits, *bits >> (count - 1) & 1);
            *bits = spread(inside & 1, before) | inside << before | spread(last, after) << (before + count as u32);
        }
        let (first, last) = (rows[above], rows[above + height - 1]);
        rows[..above].fill(first);
        rows[above + height..].fill(last);
        own
    }

    /// What is in front of a pixel of the tile.
    #[inline(always)]
    pub fn share(&self, [x, y]: [usize; 2]) -> Option<Share> {
        let n = self.n as usize;
        if n == 2 {
            let line = |step: usize| (self.rows[2 * y + step] >> (2 * x) & 7) as usize;
            return shares_of_two()[line(0) | line(1) << 3 | line(2) << 6];
        }
        let center = [(x + 1) * n - 1, (y + 1) * n - 1].map(|sample| sample as isize);
        weigh(self.n, |[dx, dy]| self.rows[(center[1] + dy) as usize] >> (center[0] + dx) & 1 == 1)
    }
}

/// In which samples of some rows, so many wide, a layer is before what is opaque, in bits; both begin with the first sample,
/// and have so many from one row to the next.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn compare([layer, opaque]: [(&[f32], usize); 2], is_far: bool, width: usize, rows: &mut [u64]) {
    /// Samples of a tile with two per pixel along each axis.
    const USUAL: usize = 2 * TILE + 1;
    for (row, bits) in rows.iter_mut().enumerate() {
        let (layer, opaque) = (&layer.0[row * layer.1..][..width], &opaque.0[row * opaque.1..][..width]);
        *bits = match (layer.first_chunk::<USUAL>(), opaque.first_chunk::<USUAL>(), width) {
            (Some(layer), Some(opaque), USUAL) => compare_line(layer, opaque, is_far),
            _ => compare_line(layer, opaque, is_far),
        };
    }
}

#[inline(always)]
fn compare_line(layer: &[f32], opaque: &[f32], is_far: bool) -> u64 {
    let mut bits = 0;
    for (column, (&stored, &opaque)) in layer.iter().zip(opaque).enumerate() {
        let nearness = if is_far && stored > 0.0 { far_nearness(stored) } else { stored };
        bits |= u64::from(nearness > opaque * (1.0 + APART)) << column;
    }
    bits
}

/// The share of a pixel of `n`² samples that the samples around its centre have which are in front, by a tent.
fn weigh(n: isize, is_front: impl Fn([isize; 2]) -> bool) -> Option<Share> {
    let (mut share, mut most) = (None, 0.0);
    for dy in 1 - n..n {
        for dx in 1 - n..n {
            if is_front([dx, dy]) {
                let weight = ((n - dx.abs()) * (n - dy.abs())) as f32 / (n * n * n * n) as f32;
                let Share { coverage, step } = share.unwrap_or(Share { coverage: 0.0, step: [dx, dy] });
                let step = if weight > most { [dx, dy] } else { step };
                (share, most) = (Some(Share { coverage: coverage + weight, step }), weight.max(most));
            }
        }
    }
    share
}

/// [`weigh`] for two samples per pixel along each axis, by the bits of the nine samples, row by row.
fn shares_of_two() -> &'static [Option<Share>; 512] {
    static TABLE: OnceLock<Box<[Option<Share>; 512]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        Box::new(std::array::from_fn(|bits| weigh(2, |[dx, dy]| bits >> ((dy + 1) * 3 + dx + 1) & 1 == 1)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arrival::Arrival;
    use crate::edges::keys::Directions;

    /// A tile at once gives what one sample after the other gives, at the border of the picture too.
    #[test]
    fn tiles_count_the_samples_in_front() {
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        for n in [1, 2, 4] {
            let mut layers: [Target; 2] = Default::default();
            for (target, share) in layers.iter_mut().zip([0.4, 0.9]) {
                target.reset::<true>(20, 12, n);
                target.nearness.iter_mut().for_each(|value| *value = if draw() < share { 0.5 + draw() } else { 0.0 });
            }
            let [layer, opaque] = &layers;
            let (directions, arrival) = (Directions::default(), Arrival::default());
            let around = Around { opaque, directions: &directions, arrival: &arrival, n: n as isize };
            for (is_far, [x, y]) in (0..2).flat_map(|far| (0..20 * 12).map(move |i| (far == 1, [i % 20, i / 20]))) {
                let is_front = |[dx, dy]: [isize; 2]| {
                    let (column, row) = around.cut((x * n) as isize + dx, (y * n) as isize + dy);
                    let sample = row as usize * layer.stride + column as usize;
                    let stored = layer.nearness[sample];
                    let nearness = if is_far && stored > 0.0 { far_nearness(stored) } else { stored };
                    nearness > opaque.nearness[sample] * (1.0 + APART)
                };
                let front = Front::of(layer, is_far, &around, [x, y].map(|place| place / TILE * TILE));
                let share = front.share([x % TILE, y % TILE]);
                assert_eq!(share, weigh(n as isize, is_front), "pixel ({x}, {y}) with {n}² samples");
            }
        }
    }
}

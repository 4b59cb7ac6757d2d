//! Coverage of pixels by transparent layers in front of the opaque surfaces.

use std::sync::OnceLock;

use multiversion::multiversion;

use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::complement_z;
use crate::raster::{VisibilityBuffer, read_window};

/// Samples along a side of the window that covers a tile: two per pixel, and one before the tile for the tent filter.
const SIDE: usize = 2 * TILE + 1;
/// Relative distance by which a transparent front face must be closer than the opaque surface, so that glass standing
/// on a table does not flicker. Chosen by hand.
const APART: f32 = 1e-4;
/// Relative distance by which a transparent back face may lie behind the opaque surface: the bottom of standing glass
/// may sink in a little. Chosen by hand.
const SUNK: f32 = 4e-3;

/// Reversed z of the samples of a tile and one row and column before it.
type TileDepths = [[f32; SIDE]; SIDE];

/// Coverage of a pixel by a layer of transparent interfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Coverage {
    /// Weight of the covered samples in the tent filter, 0-1.
    pub share: f32,
    /// Offset from the pixel centre to the covered sample with the largest weight (samples).
    pub sample: [i8; 2],
}

/// Coverage of the pixels of a tile, row by row.
pub(super) type TileCoverage = [Coverage; TILE * TILE];

/// Coverage by the layers of far and near interfaces in the tile whose first pixel is at `place` (column, row); far
/// interfaces are stored with complemented reversed z.
pub(super) fn find_coverage(
    layers: &[VisibilityBuffer; 2],
    opaque: &VisibilityBuffer,
    place: [usize; 2],
) -> [TileCoverage; 2] {
    let first = place.map(|at| 2 * at as isize - 1);
    let load = |buffer: &VisibilityBuffer| {
        let mut depths = [[0.0; SIDE]; SIDE];
        read_window(&buffer.reversed_z, [buffer.width, buffer.stride], first, &mut depths);
        depths
    };
    let opaque = load(opaque);
    let [far, near] = layers.each_ref().map(load);
    [cover::<true>(&far, &opaque), cover::<false>(&near, &opaque)]
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn cover<const IS_FAR: bool>(layer: &TileDepths, opaque: &TileDepths) -> TileCoverage {
    let mut coverage = [Coverage::default(); TILE * TILE];
    let mut in_front = [0_u32; SIDE * SIDE];
    let mut count = 0;
    for (front, (&layer, &opaque)) in in_front.iter_mut().zip(layer.as_flattened().iter().zip(opaque.as_flattened())) {
        *front = u32::from(is_in_front(layer, opaque, IS_FAR));
        count += *front;
    }
    let table = coverage_table();
    if count == (SIDE * SIDE) as u32 {
        coverage = [table[511]; TILE * TILE];
    } else if count > 0 {
        for (place, coverage) in coverage.iter_mut().enumerate() {
            // Bit mask of the nine samples around the pixel centre, row by row.
            let first = place / TILE * 2 * SIDE + place % TILE * 2;
            let row = |row: usize| {
                let first = first + row * SIDE;
                in_front[first] | in_front[first + 1] << 1 | in_front[first + 2] << 2
            };
            let code = row(0) | row(1) << 3 | row(2) << 6;
            *coverage = table[code as usize & 511];
        }
    }
    coverage
}

/// True if a layer's sample is in front of the opaque surface.
#[inline(always)]
fn is_in_front(layer: f32, opaque: f32, is_far: bool) -> bool {
    if is_far { (layer > 0.0) & (complement_z(layer) > opaque * (1.0 - SUNK)) } else { layer > opaque * (1.0 + APART) }
}

/// Coverage for each of the 512 bit masks of the nine samples around a pixel centre, row by row.
fn coverage_table() -> &'static [Coverage; 512] {
    static TABLE: OnceLock<Box<[Coverage; 512]>> = OnceLock::new();
    let coverage = |bits: usize| {
        let (mut coverage, mut most) = (Coverage::default(), 0.0);
        for sample in (0..9).filter(|sample| bits >> sample & 1 == 1) {
            let (dx, dy) = (sample % 3 - 1, sample / 3 - 1);
            let weight = ((2 - i32::abs(dx)) * (2 - i32::abs(dy))) as f32 / 16.0;
            coverage.share += weight;
            if weight > most {
                (coverage.sample, most) = ([dx as i8, dy as i8], weight);
            }
        }
        coverage
    };
    TABLE.get_or_init(|| Box::new(std::array::from_fn(coverage)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coverage of tiles, also at the image border, against a sum over samples.
    #[test]
    fn tiles_sum_the_samples_in_front() {
        const SIZE: [usize; 2] = [44, 28];
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let mut buffers: [VisibilityBuffer; 3] = Default::default();
        for (buffer, share) in buffers.iter_mut().zip([0.4, 0.4, 0.9]) {
            buffer.reset::<true>(SIZE[0], SIZE[1], 2);
            buffer.reversed_z.iter_mut().for_each(|value| *value = if draw() < share { 0.5 + draw() } else { 0.0 });
        }
        let [far, near, opaque] = buffers;
        let layers = [far, near];
        for [column, row] in [[0, 0], [8, 8], [40, 24], [40, 0]] {
            let coverage = find_coverage(&layers, &opaque, [column, row]);
            for (x, y) in
                (column..SIZE[0].min(column + TILE)).flat_map(|x| (row..SIZE[1].min(row + TILE)).map(move |y| (x, y)))
            {
                for (index, layer) in layers.iter().enumerate() {
                    let mut share = 0.0;
                    for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                        let at = |place: usize, step: isize, size: usize| {
                            (2 * place as isize + step).clamp(0, 2 * size as isize - 1) as usize
                        };
                        let sample = at(y, dy, SIZE[1]) * layer.stride + at(x, dx, SIZE[0]);
                        let (depth, behind) = (layer.reversed_z[sample], opaque.reversed_z[sample]);
                        let weight = ((2 - dx.abs()) * (2 - dy.abs())) as f32 / 16.0;
                        share += if is_in_front(depth, behind, index == 0) { weight } else { 0.0 };
                    }
                    let got = coverage[index][y % TILE * TILE + x % TILE].share;
                    assert!((got - share).abs() < 1e-6, "pixel ({x}, {y}): {got} instead of {share}");
                }
            }
        }
    }
}

//! Which samples show something transparent before what is opaque.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use std::sync::OnceLock;

use multiversion::multiversion;

use super::surface_ids::SampleWindow;
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::complement_z;
use crate::raster::{TileDepths, VisibilityBuffer};

/// By how much a transparent side must be nearer than what is opaque, as a share: glass stands on the table.
const APART: f32 = 1e-4;
/// By how much a far side may be behind it, as a share: the bottom of what stands on the table, or rests a little in it.
const RESTS: f32 = 4e-3;

/// What is in front of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Share {
    /// Of the pixel; 0 where nothing is in front.
    pub coverage: f32,
    /// From the pixel's centre to the sample that counts most, samples.
    pub step: [i8; 2],
}

/// What is in front of the pixels of a tile, row by row.
pub(super) type Shares = [Share; TILE * TILE];

/// What layers show before the pixels of a tile; the reversed_z of the first one, of far sides, is turned. At the picture's
/// border the tile must be settled.
pub(super) fn find_shares(layers: &[VisibilityBuffer; 2], around: &SampleWindow<'_>, tile: usize) -> [Shares; 2] {
    let mut shares = [[Share::default(); TILE * TILE]; 2];
    if around.n != 2 || around.light_buffer.is_at_border(tile) {
        let place = around.light_buffer.pixels_of(tile).map(|range| range.start as isize);
        for (index, (layer, shares)) in layers.iter().zip(&mut shares).enumerate() {
            share_samples(layer, index == 0, around, place, shares);
        }
        return shares;
    }
    let (mut opaque, mut reversed_z) = Default::default();
    around.opaque.read_tile(tile, &mut opaque);
    for (index, (layer, shares)) in layers.iter().zip(&mut shares).enumerate() {
        if layer.may_show(tile) {
            layer.read_tile(tile, &mut reversed_z);
            match index {
                0 => compare_tile::<true>(&reversed_z, &opaque, shares),
                _ => compare_tile::<false>(&reversed_z, &opaque, shares),
            }
        }
    }
    shares
}

/// [`find_shares`] of a layer for any number of samples and at the border, for the tile that begins at a pixel.
fn share_samples(
    layer: &VisibilityBuffer,
    is_far: bool,
    around: &SampleWindow<'_>,
    [column, row]: [isize; 2],
    shares: &mut Shares,
) {
    let n = around.n;
    for (place, share) in shares.iter_mut().enumerate() {
        let (x, y) = (column + (place % TILE) as isize, row + (place / TILE) as isize);
        *share = weigh(n, |[dx, dy]| {
            let (column, row) = around.cut(x * n + dx, y * n + dy);
            let reversed_z =
                |target: &VisibilityBuffer| target.reversed_z[row as usize * target.stride + column as usize];
            is_front(reversed_z(layer), reversed_z(around.opaque), is_far)
        });
    }
}

/// [`find_shares`] of a layer, from what it shows and what is opaque.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn compare_tile<const IS_FAR: bool>(layer: &TileDepths, opaque: &TileDepths, shares: &mut Shares) {
    const SIDE: usize = 2 * TILE + 1;
    let mut front = [0_u32; SIDE * SIDE];
    let mut count = 0;
    for (front, (&layer, &opaque)) in front.iter_mut().zip(layer.as_flattened().iter().zip(opaque.as_flattened())) {
        *front = u32::from(is_front(layer, opaque, IS_FAR));
        count += *front;
    }
    let table = shares_of_two();
    if count == (SIDE * SIDE) as u32 {
        *shares = [table[511]; TILE * TILE];
    } else if count > 0 {
        for (place, share) in shares.iter_mut().enumerate() {
            // In which of the nine samples around its centre, in bits, row by row.
            let first = place / TILE * 2 * SIDE + place % TILE * 2;
            let row = |row: usize| {
                let first = first + row * SIDE;
                front[first] | front[first + 1] << 1 | front[first + 2] << 2
            };
            let code = row(0) | row(1) << 3 | row(2) << 6;
            *share = table[code as usize & 511];
        }
    }
}

/// Whether a sample of a layer is before what is opaque.
#[inline(always)]
fn is_front(stored: f32, opaque: f32, is_far: bool) -> bool {
    if is_far {
        (stored > 0.0) & (complement_z(stored) > opaque * (1.0 - RESTS))
    } else {
        stored > opaque * (1.0 + APART)
    }
}

/// The share of a pixel of `n`² samples that the samples around its centre have which are in front, by a tent.
fn weigh(n: isize, is_front: impl Fn([isize; 2]) -> bool) -> Share {
    let (mut share, mut most) = (Share::default(), 0.0);
    for dy in 1 - n..n {
        for dx in 1 - n..n {
            if is_front([dx, dy]) {
                let weight = ((n - dx.abs()) * (n - dy.abs())) as f32 / (n * n * n * n) as f32;
                let step = if weight > most { [dx as i8, dy as i8] } else { share.step };
                (share, most) = (Share { coverage: share.coverage + weight, step }, weight.max(most));
            }
        }
    }
    share
}

/// [`weigh`] for two samples per pixel along each axis, by the bits of the nine samples, row by row.
fn shares_of_two() -> &'static [Share; 512] {
    static TABLE: OnceLock<Box<[Share; 512]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        Box::new(std::array::from_fn(|bits| weigh(2, |[dx, dy]| bits >> ((dy + 1) * 3 + dx + 1) & 1 == 1)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light_buffer::LightBuffer;
    use crate::raster::Corner;
    use crate::resolve::surface_ids::Directions;

    /// A tile at once gives what one sample after the other gives, at the border of the picture too.
    #[test]
    fn tiles_count_the_samples_in_front() {
        const SIZE: [usize; 2] = [44, 28];
        let mut state = 1_u32;
        let mut draw = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let (directions, mut light_buffer) = (Directions::default(), LightBuffer::default());
        light_buffer.reset(SIZE[0], SIZE[1]);
        for n in [1, 2, 4] {
            let mut targets: [VisibilityBuffer; 3] = Default::default();
            for (target, share) in targets.iter_mut().zip([0.4, 0.4, 0.9]) {
                target.reset::<true>(SIZE[0], SIZE[1], n);
                target.reversed_z.iter_mut().for_each(|value| *value = if draw() < share { 0.5 + draw() } else { 0.0 });
            }
            let [far, near, opaque] = targets;
            let layers = [far, near];
            let around =
                SampleWindow { opaque: &opaque, directions: &directions, light_buffer: &light_buffer, n: n as isize };
            for tile in 0..SIZE[0].div_ceil(TILE) * SIZE[1].div_ceil(TILE) {
                let shares = find_shares(&layers, &around, tile);
                let [columns, rows] = light_buffer.pixels_of(tile);
                for (x, y) in columns.clone().flat_map(|x| rows.clone().map(move |y| (x, y))) {
                    for (index, layer) in layers.iter().enumerate() {
                        let is_front = |[dx, dy]: [isize; 2]| {
                            let (column, row) = around.cut((x * n) as isize + dx, (y * n) as isize + dy);
                            let sample = row as usize * layer.stride + column as usize;
                            let stored = layer.reversed_z[sample];
                            let opaque = opaque.reversed_z[sample];
                            match index {
                                0 => stored > 0.0 && complement_z(stored) > opaque * (1.0 - RESTS),
                                _ => stored > opaque * (1.0 + APART),
                            }
                        };
                        let share = shares[index][y % TILE * TILE + x % TILE];
                        assert_eq!(share, weigh(n as isize, is_front), "pixel ({x}, {y}) with {n}² samples");
                    }
                }
            }
        }
    }

    /// Tiles that triangles cover give what their samples give once they are stored.
    #[test]
    fn covered_tiles_count_as_their_samples() {
        const SIZE: [usize; 2] = [64, 48];
        let mut state = 1_u32;
        let mut draw = |low: f32, high: f32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            low + (high - low) * (state >> 8) as f32 / 16_777_216.0
        };
        let (directions, mut light_buffer) = (Directions::default(), LightBuffer::default());
        light_buffer.reset(SIZE[0], SIZE[1]);
        for round in 0..20 {
            let mut targets: [VisibilityBuffer; 3] = Default::default();
            for (index, target) in targets.iter_mut().enumerate() {
                target.reset_covered(SIZE[0], SIZE[1]);
                for id in 1..4 {
                    let reversed_z = draw(0.5, 1.0);
                    let reversed_z = if index == 0 { complement_z(reversed_z) } else { reversed_z };
                    let corners = [(); 3].map(|()| Corner { x: draw(-60.0, 190.0), y: draw(-60.0, 160.0), reversed_z });
                    target.draw::<true>(corners, id << 20);
                }
            }
            let stored = targets.clone().map(|mut target| {
                target.expand_all();
                target
            });
            let shares_of = |[far, near, opaque]: [VisibilityBuffer; 3], tile: usize| {
                let around =
                    SampleWindow { opaque: &opaque, directions: &directions, light_buffer: &light_buffer, n: 2 };
                find_shares(&[far, near], &around, tile)
            };
            for tile in (0..SIZE[0] * SIZE[1] / TILE / TILE).filter(|&tile| !light_buffer.is_at_border(tile)) {
                let [covered, single] = [&targets, &stored].map(|targets| shares_of(targets.clone(), tile));
                assert!(covered == single, "tile {tile} of round {round}");
            }
        }
    }
}

//! Which tiles' light is not what it was at the picture before, to the bit: only those are shaded again.

use std::ops::Range;

use super::upsample::HALF;
use super::{LightBuffer, line_of};
use crate::gbuffer::static_layer::TILE;

/// By tile, what changed since the picture before.
#[derive(Debug, Default)]
pub(super) struct Changes {
    /// What is seen, or an estimate.
    pub estimates: Vec<bool>,
    /// The same, or the ambient light as blurred.
    pub blurred: Vec<bool>,
    /// What is seen, or the light that arrives.
    pub light: Vec<bool>,
}

/// Estimates of a tile, in bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimates {
    raw_shadow_mask: Square<TILE>,
    raw_half_ao: Square<HALF>,
    ranges: [[u32; 2]; 2],
    /// Read from a level top, it is not blurred.
    key: Square<TILE>,
}

/// Values of a tile, in bits; those beyond the picture are 0.
pub(super) type Square<const SIDE: usize> = [[u32; SIDE]; SIDE];

impl Changes {
    /// Begins with the tiles that show something else.
    pub fn begin(&mut self, seen: &[bool]) {
        for list in [&mut self.estimates, &mut self.blurred, &mut self.light] {
            list.clear();
            list.extend_from_slice(seen);
        }
    }
}

impl LightBuffer {
    /// Whether the light that arrives in a tile, or what it shows, is not what it was.
    pub fn is_lit_anew(&self, tile: usize) -> bool {
        self.changed.light[tile]
    }

    /// Keeps the estimates of the tiles that show what they showed before.
    pub(super) fn keep_estimates(&self, tiles: &[usize], kept: &mut Vec<(usize, Estimates)>) {
        kept.clear();
        let same = tiles.iter().copied().filter(|&tile| !self.changed.light[tile]);
        kept.extend(same.map(|tile| (tile, self.estimates_of(tile))));
    }

    /// Marks the tiles whose estimates are not those that were kept.
    pub(super) fn compare_estimates(&mut self, kept: &[(usize, Estimates)]) {
        for (tile, before) in kept {
            let now = self.estimates_of(*tile);
            self.changed.estimates[*tile] |= now != *before;
            self.changed.light[*tile] |= now.key != before.key;
        }
    }

    fn estimates_of(&self, tile: usize) -> Estimates {
        Estimates {
            raw_shadow_mask: self.square(&self.raw_shadow_mask, tile),
            raw_half_ao: self.half_square(&self.raw_half_ao, tile),
            ranges: [self.ranges.key[tile], self.ranges.ambient[tile]].map(|range| range.map(f32::to_bits)),
            key: self.square(&self.shadow_mask, tile),
        }
    }

    /// Whether writing changes what is read, to the bit; where that is known already, nothing is read.
    pub(super) fn alters<T: PartialEq>(
        &mut self,
        is_known: bool,
        read: impl Fn(&Self) -> T,
        write: impl FnOnce(&mut Self),
    ) -> bool {
        let before = (!is_known).then(|| read(self));
        write(self);
        before.is_none_or(|before| before != read(self))
    }

    /// Values of a tile's pixels.
    pub(super) fn square(&self, values: &[f32], tile: usize) -> Square<TILE> {
        square(values, self.width, self.pixels_of(tile))
    }

    /// Values at a tile's constant rows and columns.
    pub(super) fn half_square(&self, values: &[f32], tile: usize) -> Square<HALF> {
        square(values, self.half_width, self.pixels_of(tile).map(|range| range.start / 2..range.end.div_ceil(2)))
    }
}

fn square<const SIDE: usize>(values: &[f32], width: usize, [columns, rows]: [Range<usize>; 2]) -> Square<SIDE> {
    let mut out = [[0; SIDE]; SIDE];
    for (row, out) in rows.zip(&mut out) {
        *out = line_of(&values[row * width..][columns.clone()], 0.0).map(f32::to_bits);
    }
    out
}

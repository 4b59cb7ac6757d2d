//! Surface ids of samples: equal for samples on one smooth piece of one surface.

use multiversion::multiversion;

use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::surface_of;
use crate::raster::{VisibilityBuffer, read_window};
use crate::scene::assets::TRIANGLE_BITS;

/// Offsets (samples) of the eight samples around a pixel centre, and their weights in the tent filter.
pub(super) const AROUND: [([isize; 2], f32); 8] = [
    ([-1, -1], 0.0625),
    ([0, -1], 0.125),
    ([1, -1], 0.0625),
    ([-1, 0], 0.125),
    ([1, 0], 0.125),
    ([-1, 1], 0.0625),
    ([0, 1], 0.125),
    ([1, 1], 0.0625),
];

/// Number of samples along a side of a tile that is extended to the centres of the neighbouring pixels.
pub(super) const SIDE: usize = 2 * (TILE + 1) + 1;

/// Normal codes of all triangles, part by part; see `Mesh::directions`.
#[derive(Debug, Default)]
pub(super) struct NormalCodes {
    /// By surface number: offset from a visibility id to the index of its triangle's code (wrapping). Number 0 is the
    /// background.
    offsets: Vec<u32>,
    codes: Vec<u8>,
}

impl NormalCodes {
    /// Replaces the codes by those of `parts`, in the order of part numbers.
    pub fn fill<'a>(&mut self, parts: impl Iterator<Item = &'a [u8]>) {
        self.offsets.clear();
        self.codes.clear();
        self.offsets.push(0);
        self.codes.push(0);
        for (part, codes) in parts.enumerate() {
            self.offsets.push((self.codes.len() as u32).wrapping_sub((part as u32 + 1) << TRIANGLE_BITS));
            self.codes.extend_from_slice(codes);
        }
    }
}

/// Surface ids of the samples of a tile, up to the centres of the neighbouring pixels.
#[derive(Debug)]
pub(super) struct TileSurfaceIds(pub [[u32; SIDE]; SIDE]);

impl Default for TileSurfaceIds {
    fn default() -> Self {
        Self([[0; SIDE]; SIDE])
    }
}

impl TileSurfaceIds {
    /// Loads the surface ids of the tile whose first pixel is `place`; returns false if all samples have the same id.
    pub fn load(&mut self, buffer: &VisibilityBuffer, place: [usize; 2], codes: &NormalCodes) -> bool {
        let first = place.map(|at| 2 * at as isize - 2);
        read_window(&buffer.ids, [buffer.width, buffer.stride], first, &mut self.0);
        load(&mut self.0, &codes.offsets, &codes.codes)
    }
}

/// Replaces visibility ids by surface ids; returns false if all are equal, in which case `ids` may be unchanged.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn load(ids: &mut [[u32; SIDE]; SIDE], offsets: &[u32], codes: &[u8]) -> bool {
    let first = ids[0][0];
    if ids.as_flattened().iter().fold(0, |differ, &id| differ | (id ^ first)) == 0 {
        return false;
    }
    for id in ids.as_flattened_mut() {
        let surface = surface_of(*id);
        *id = surface << 8 | u32::from(codes[offsets[surface as usize].wrapping_add(*id) as usize]);
    }
    let first = ids[0][0];
    ids.as_flattened().iter().fold(0, |differ, &id| differ | (id ^ first)) != 0
}

/// Matches of the eight samples around each pixel centre of a tile, as bit masks in the order of [`AROUND`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Matches([u32; TILE * TILE]);

impl Default for Matches {
    fn default() -> Self {
        Self([0; TILE * TILE])
    }
}

/// Position of the bits of samples that match the nearest neighbouring pixel instead of their own.
const NEIGHBOUR: u32 = 8;
/// Position of the total weight, in sixteenths, of the samples that match their own pixel.
const OWN_SHARE: u32 = 16;

impl Matches {
    /// Bit mask of the samples whose surface is neither the pixel centre's nor their nearest neighbour's.
    #[inline(always)]
    pub fn unmatched(&self, place: usize) -> u32 {
        !(self.0[place] | self.0[place] >> NEIGHBOUR) & 0xff
    }

    /// Total weight of the centre and of the samples that match it, 0-1.
    #[inline(always)]
    pub fn own_share(&self, place: usize) -> f32 {
        // The centre itself has the weight 4/16.
        ((self.0[place] >> OWN_SHARE) + 4) as f32 * 0.0625
    }

    /// Weight of each sample that matches the nearest neighbouring pixel, 0 for the other samples.
    #[inline(always)]
    pub fn neighbour_shares(&self, place: usize) -> [f32; AROUND.len()] {
        std::array::from_fn(|sample| {
            // Multiplied rather than selected, since a branch would be unpredictable.
            let matches = self.0[place] >> (NEIGHBOUR + sample as u32) & 1;
            matches as i32 as f32 * AROUND[sample].1
        })
    }
}

/// Matches the samples of a tile; returns a bit mask (row by row) of the edge pixels, whose samples show several
/// surfaces.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
pub(super) fn match_samples(ids: &TileSurfaceIds, matches: &mut Matches) -> u64 {
    /// Row length of the arrays for even and odd sample columns, padded to whole SIMD registers.
    const COLUMNS: usize = 16;
    let (mut even, mut odd) = ([[0; COLUMNS]; SIDE], [[0; COLUMNS]; SIDE]);
    for (row, line) in ids.0.iter().enumerate() {
        for column in 0..=TILE {
            (even[row][column], odd[row][column]) = (line[2 * column], line[2 * column + 1]);
        }
        even[row][TILE + 1] = line[SIDE - 1];
    }
    let mut edge_pixels = 0;
    for y in 0..TILE {
        let mut bits = [0_u32; TILE];
        for (index, &([dx, dy], share)) in AROUND.iter().enumerate() {
            let own_bits = 1 << index | ((share * 16.0) as u32) << OWN_SHARE;
            let neighbour_bits = 1 << (NEIGHBOUR + index as u32);
            let row = |reach: isize| (2 * y as isize + 2 + reach * dy) as usize;
            let line = if dx == 0 { &even[row(1)][1..] } else { &odd[row(1)][usize::from(dx > 0)..] };
            let (own, sample, neighbour) = (&even[row(0)][1..], line, &even[row(2)][(1 + dx) as usize..]);
            let (own, sample, neighbour) = (&own[..TILE], &sample[..TILE], &neighbour[..TILE]);
            for x in 0..TILE {
                let matched = if sample[x] == neighbour[x] { neighbour_bits } else { 0 };
                bits[x] += if sample[x] == own[x] { own_bits } else { matched };
            }
        }
        matches.0[y * TILE..][..TILE].copy_from_slice(&bits);
        for (x, bits) in bits.into_iter().enumerate() {
            edge_pixels |= u64::from(bits & 0xff != 0xff) << (y * TILE + x);
        }
    }
    edge_pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found edge pixels, compared with a search of the samples around each centre.
    #[test]
    fn edge_pixels_show_several_surfaces() {
        let mut state = 1_u32;
        for share in [0, 1, 20, 255] {
            let mut draw = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                u32::from(state >> 24 < share)
            };
            let ids = TileSurfaceIds([(); SIDE].map(|()| [(); SIDE].map(|()| draw())));
            let is_edge = |place: usize| {
                let (x, y) = (2 * (place % TILE) + 2, 2 * (place / TILE) + 2);
                ids.0[y - 1..=y + 1].iter().any(|line| line[x - 1..=x + 1].iter().any(|&id| id != ids.0[y][x]))
            };
            let expected = (0..TILE * TILE).fold(0, |bits, place| bits | u64::from(is_edge(place)) << place);
            assert_eq!(match_samples(&ids, &mut Matches::default()), expected, "share {share}");
        }
    }
}

//! Which samples show one smooth piece of a surface.

use multiversion::multiversion;

use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::surface_of;
use crate::light_buffer::LightBuffer;
use crate::raster::VisibilityBuffer;
use crate::scene::assets::TRIANGLE_BITS;

/// The samples around a pixel's centre with two per pixel along each axis, and their share of the pixel.
pub(super) const BESIDE: [([isize; 2], f32); 8] = [
    ([-1, -1], 0.0625),
    ([0, -1], 0.125),
    ([1, -1], 0.0625),
    ([-1, 0], 0.125),
    ([1, 0], 0.125),
    ([-1, 1], 0.0625),
    ([0, 1], 0.125),
    ([1, 1], 0.0625),
];

/// Samples along the side of a tile with its surroundings, with two per pixel along each axis.
pub(super) const SIDE: usize = 2 * (TILE + 1) + 1;

/// The samples around pixels.
pub(super) struct SampleWindow<'a> {
    pub opaque: &'a VisibilityBuffer,
    pub directions: &'a Directions,
    pub light_buffer: &'a LightBuffer,
    /// Samples per pixel along an axis.
    pub n: isize,
}

impl SampleWindow<'_> {
    /// The nearest sample within the image.
    #[inline(always)]
    pub fn cut(&self, column: isize, row: isize) -> (isize, isize) {
        (column.clamp(0, self.opaque.width as isize - 1), row.clamp(0, self.opaque.height as isize - 1))
    }
}

/// Directions of all triangles, part by part.
#[derive(Debug, Default)]
pub(super) struct Directions {
    /// By part plus one: what to add to a visibility id for the place of its triangle; nothing comes first.
    first: Vec<u32>,
    codes: Vec<u8>,
}

impl Directions {
    /// Takes over the directions of the triangles of all parts.
    pub fn fill<'a>(&mut self, parts: impl Iterator<Item = &'a [u8]>) {
        self.first.clear();
        self.codes.clear();
        self.first.push(0);
        self.codes.push(0);
        for (part, codes) in parts.enumerate() {
            self.first.push((self.codes.len() as u32).wrapping_sub((part as u32 + 1) << TRIANGLE_BITS));
            self.codes.extend_from_slice(codes);
        }
    }

    /// Equal for samples of one smooth piece of surface.
    #[inline(always)]
    fn key(&self, id: u32) -> u32 {
        key(&self.first, &self.codes, id)
    }
}

/// [`Directions::key`] with its lists in registers.
#[inline(always)]
fn key(first: &[u32], codes: &[u8], id: u32) -> u32 {
    let surface = surface_of(id);
    surface << 8 | u32::from(codes[first[surface as usize].wrapping_add(id) as usize])
}

/// Keys of the samples of a tile, and of those around it up to the centres of the pixels next to it.
#[derive(Debug, Default)]
pub(super) struct TileSurfaceIds {
    /// Samples per pixel along an axis.
    n: usize,
    side: usize,
    pub keys: Vec<u32>,
}

impl TileSurfaceIds {
    /// Reads a tile, which must be settled at the picture's border; says whether its samples differ at all.
    pub fn load(&mut self, around: &SampleWindow<'_>, tile: usize) -> bool {
        let [column, row] = around.light_buffer.pixels_of(tile).map(|range| range.start);
        let n = around.n;
        (self.n, self.side) = (n as usize, (TILE + 1) * n as usize + 1);
        self.keys.resize(self.side * self.side, 0);
        let (first_column, first_row) = ((column as isize - 1) * n, (row as isize - 1) * n);
        let (from, top) = around.cut(first_column, first_row);
        let last = [first_column, first_row].map(|first| first + self.side as isize - 1);
        let (to, bottom) = around.cut(last[0], last[1]);
        let ids = &around.opaque.ids;
        if let (2, true, Some(keys)) = (n, !around.light_buffer.is_at_border(tile), self.keys.first_chunk_mut()) {
            let ids = &ids[top as usize * around.opaque.stride + from as usize..];
            let covers = around.opaque.covers_around(tile);
            return match covers == [None; 9] {
                true => load_of_two(ids, around.opaque.stride, around.directions, keys),
                false => load_covers(ids, around.opaque.stride, &covers, around.directions, keys),
            };
        }
        let line = |row: isize| &ids[row as usize * around.opaque.stride..][from as usize..=to as usize];
        let first = line(top)[0];
        if (top..=bottom).all(|row| line(row).iter().fold(0, |differ, &id| differ | (id ^ first)) == 0) {
            return false;
        }
        let first_key = around.directions.key(first);
        let mut differ = 0;
        // Samples beyond the image's border are those next to it.
        let before = (from - first_column) as usize;
        for (step, out) in self.keys.chunks_exact_mut(self.side).enumerate() {
            let (_, row) = around.cut(0, first_row + step as isize);
            let line = line(row);
            for (out, &id) in out[before..].iter_mut().zip(line) {
                *out = around.directions.key(id);
            }
            let (left, right) = (out[before], out[before + line.len() - 1]);
            out[..before].fill(left);
            out[before + line.len()..].fill(right);
            differ |= out.iter().fold(0, |differ, key| differ | (key ^ first_key));
        }
        differ != 0
    }

    /// Index of the key at the centre of a pixel of the tile.
    #[inline(always)]
    pub fn center(&self, [x, y]: [usize; 2]) -> usize {
        (y + 1) * self.n * self.side + (x + 1) * self.n
    }

    /// Index of the key so many samples beside another.
    #[inline(always)]
    pub fn beside(&self, index: usize, dx: isize, dy: isize) -> usize {
        (index as isize + dy * self.side as isize + dx) as usize
    }

    /// Keys from two rows above and two columns to the left of a pixel's centre on, with two samples per pixel along
    /// each axis.
    #[inline(always)]
    pub fn window(&self, [x, y]: [usize; 2]) -> &[u32; 4 * SIDE + 5] {
        const WINDOW: usize = 4 * SIDE + 5;
        self.keys[2 * y * SIDE + 2 * x..].first_chunk::<WINDOW>().expect("a tile's keys reach two samples beyond it")
    }

    /// The pixels of the tile around whose centres the samples show several surfaces, in bits, row by row; with two
    /// samples per pixel along each axis, what these samples show, too.
    pub fn compare(&self, matches: &mut Matches) -> u64 {
        if let (2, Some(keys)) = (self.n, self.keys.first_chunk()) {
            return compare_of_two(keys, matches);
        }
        (0..TILE * TILE).fold(0, |bits, place| bits | u64::from(self.differ([place % TILE, place / TILE])) << place)
    }

    /// Whether the samples around the centre of a pixel of the tile show several surfaces.
    #[inline(always)]
    fn differ(&self, place: [usize; 2]) -> bool {
        let center = self.center(place);
        let reach = self.n - 1;
        let (first, own) = (center - reach * self.side - reach, self.keys[center]);
        let line = |step: usize| &self.keys[first + step * self.side..][..2 * reach + 1];
        (0..=2 * reach).any(|step| line(step).iter().fold(false, |differ, &key| differ | (key != own)))
    }
}

/// [`TileSurfaceIds::load`] within the image, for two samples per pixel along each axis, from the first id on.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn load_of_two(ids: &[u32], stride: usize, directions: &Directions, keys: &mut [u32; SIDE * SIDE]) -> bool {
    let first = ids[0];
    let line = |row: usize| ids[row * stride..].first_chunk::<SIDE>().expect("the tile lies within the image");
    if (0..SIDE).all(|row| line(row).iter().fold(0, |differ, &id| differ | (id ^ first)) == 0) {
        return false;
    }
    let (begins, codes) = (&*directions.first, &*directions.codes);
    // Triangles are so small on the image that guessing when the next one comes does not pay.
    for (row, out) in keys.chunks_exact_mut(SIDE).enumerate() {
        for (out, &id) in out.iter_mut().zip(line(row)) {
            *out = key(begins, codes, id);
        }
    }
    let first = keys[0];
    keys.iter().fold(0, |differ, key| differ | (key ^ first)) != 0
}

/// [`load_of_two`] where something covers the tile or some of those next to it, given row by row.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn load_covers(
    ids: &[u32],
    stride: usize,
    covers: &[Option<u32>; 9],
    directions: &Directions,
    keys: &mut [u32; SIDE * SIDE],
) -> bool {
    /// Rows of the tiles above, of the tile and of those below.
    const BANDS: [[usize; 2]; 3] = [[0, 2], [2, SIDE - 1], [SIDE - 1, SIDE]];
    let (begins, codes) = (&*directions.first, &*directions.codes);
    for (covers, [top, bottom]) in covers.as_chunks::<3>().0.iter().zip(BANDS) {
        let covered = covers.map(|cover| cover.map(|id| key(begins, codes, id)));
        for row in top..bottom {
            let line = ids[row * stride..].first_chunk::<SIDE>().expect("the tile lies within the image");
            let out = keys[row * SIDE..].first_chunk_mut::<SIDE>().expect("a row of the tile's");
            read_line::<0, 2>(line, covered[0], out, begins, codes);
            read_line::<2, { SIDE - 1 }>(line, covered[1], out, begins, codes);
            read_line::<{ SIDE - 1 }, SIDE>(line, covered[2], out, begins, codes);
        }
    }
    let first = keys[0];
    keys.iter().fold(0, |differ, key| differ | (key ^ first)) != 0
}

/// Keys of part of a row of samples: that of what covers it, or those of the ids.
#[inline(always)]
fn read_line<const FROM: usize, const TO: usize>(
    ids: &[u32; SIDE],
    covered: Option<u32>,
    out: &mut [u32; SIDE],
    begins: &[u32],
    codes: &[u8],
) {
    match covered {
        Some(key) => out[FROM..TO].fill(key),
        None => {
            for (out, &id) in out[FROM..TO].iter_mut().zip(&ids[FROM..TO]) {
                *out = key(begins, codes, id);
            }
        }
    }
}

/// What the samples beside the centres of a tile's pixels show, in bits in the order of [`BESIDE`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Matches([u32; TILE * TILE]);

impl Default for Matches {
    fn default() -> Self {
        Self([0; TILE * TILE])
    }
}

/// First bit of the samples that show something else, namely what the pixel shows that they lean to.
const LEANS: u32 = 8;
/// First bit of the sixteenths of the pixel that the samples have that show what its centre shows.
const OWN_SHARE: u32 = 16;

impl Matches {
    /// The samples that show neither what the pixel's centre shows nor what the one shows that they lean to.
    #[inline(always)]
    pub fn left(&self, place: usize) -> u32 {
        !(self.0[place] | self.0[place] >> LEANS) & 0xff
    }

    /// The share of the pixel that shows what its centre shows.
    #[inline(always)]
    pub fn own_share(&self, place: usize) -> f32 {
        // The centre itself has a quarter.
        ((self.0[place] >> OWN_SHARE) + 4) as f32 * 0.0625
    }

    /// The shares of the samples that lean to what they show, 0 for the others.
    #[inline(always)]
    pub fn neighbour_shares(&self, place: usize) -> [f32; BESIDE.len()] {
        std::array::from_fn(|sample| {
            // As a number: whether a sample leans cannot be guessed, and a choice would become a branch.
            let leans = self.0[place] >> (LEANS + sample as u32) & 1;
            leans as i32 as f32 * BESIDE[sample].1
        })
    }
}

/// [`TileSurfaceIds::compare`] for two samples per pixel along each axis.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn compare_of_two(keys: &[u32; SIDE * SIDE], matches: &mut Matches) -> u64 {
    /// Even and odd columns apart, padded to whole registers.
    const COLUMNS: usize = 16;
    let (mut even, mut odd) = ([[0; COLUMNS]; SIDE], [[0; COLUMNS]; SIDE]);
    for (row, line) in keys.as_chunks::<SIDE>().0.iter().enumerate() {
        for column in 0..=TILE {
            (even[row][column], odd[row][column]) = (line[2 * column], line[2 * column + 1]);
        }
        even[row][TILE + 1] = line[SIDE - 1];
    }
    let mut edge_pixels = 0;
    for y in 0..TILE {
        let mut bits = [0_u32; TILE];
        for (index, &([dx, dy], share)) in BESIDE.iter().enumerate() {
            let (own_bits, lean_bits) =
                (1 << index | ((share * 16.0) as u32) << OWN_SHARE, 1 << (LEANS + index as u32));
            let row = |reach: isize| (2 * y as isize + 2 + reach * dy) as usize;
            let line = if dx == 0 { &even[row(1)][1..] } else { &odd[row(1)][usize::from(dx > 0)..] };
            let (own, beside, next) = (&even[row(0)][1..], line, &even[row(2)][(1 + dx) as usize..]);
            let (own, beside, next) = (&own[..TILE], &beside[..TILE], &next[..TILE]);
            for x in 0..TILE {
                let lean = if beside[x] == next[x] { lean_bits } else { 0 };
                bits[x] += if beside[x] == own[x] { own_bits } else { lean };
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

    /// All pixels of a tile at once give what one after the other gives.
    #[test]
    fn mixed_pixels_are_found_at_once() {
        let mut state = 1_u32;
        for share in [0, 1, 20, 255] {
            let mut draw = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                u32::from(state >> 24 < share)
            };
            let keys = TileSurfaceIds { n: 2, side: SIDE, keys: (0..SIDE * SIDE).map(|_| draw()).collect() };
            let single = |place: usize| u64::from(keys.differ([place % TILE, place / TILE])) << place;
            let all = (0..TILE * TILE).fold(0, |bits, place| bits | single(place));
            assert_eq!(keys.compare(&mut Matches::default()), all, "share {share}");
        }
    }
}

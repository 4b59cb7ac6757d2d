//! Colours of pixels that show several surfaces.

use std::ops::Range;

use glam::Vec3A;
use multiversion::multiversion;

use super::surface_ids::{BESIDE, Matches, SIDE, SampleWindow, TileSurfaceIds};
use super::{Edges, UnmatchedSample};
use crate::gbuffer::static_layer::{TILE, each_place};
use crate::shading::ShadingPoint;

/// Pixels next to one, in the order in which they are asked for a colour.
const NEXT: [[isize; 2]; 8] = [[-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];

/// By sample, those that come before all others: the two beside the one that a corner leans to, in bits of [`NEXT`].
const FIRST: [u32; BESIDE.len()] = [0b0101, 0, 0b0110, 0, 0, 0b1001, 0, 0b1010];

/// Sums of colours of a tile's pixels.
type Sums = [Vec3A; TILE * TILE];

impl Edges {
    /// Sums the colours of the samples of a tile's edge_pixels pixels as far as they are known; returns the places of these
    /// pixels, in bits.
    pub(super) fn mix_tile(
        &mut self,
        around: &SampleWindow<'_>,
        keys: &TileSurfaceIds,
        [columns, rows]: [&Range<usize>; 2],
        colors: &[Vec3A],
    ) -> u64 {
        let (width, height) = (around.opaque.width / around.opaque.scale, around.opaque.height / around.opaque.scale);
        let mut matches = Matches::default();
        let found = keys.compare(&mut matches) & places(columns, rows, 0..width, 0..height);
        let mut sums = [Vec3A::ZERO; TILE * TILE];
        let mut inner = 0;
        if around.n == 2 {
            inner = found & places(columns, rows, 1..width - 1, 1..height - 1);
            sum_neighbours(&matches, inner, colors, rows.start * width + columns.start, width, &mut sums);
        }
        for place in each_place(found) {
            let [x, y] = [columns.start + place % TILE, rows.start + place / TILE];
            let pixel = y * width + x;
            let color = if inner >> place & 1 == 1 {
                let mut sum = sums[place];
                let left = matches.left(place);
                if left != 0 {
                    sum = self.add_remaining(around, keys, [x, y], left, sum, colors);
                }
                sum + colors[pixel] * matches.own_share(place)
            } else {
                self.mix(around, keys, [x, y], pixel, colors)
            };
            self.edge_pixels.push((pixel as u32, color));
        }
        found
    }

    /// Adds to a pixel's sum the samples that are left: with the colour of any pixel next to it that shows the same, or
    /// they are listed to be shaded.
    #[inline(always)]
    fn add_remaining(
        &mut self,
        around: &SampleWindow<'_>,
        keys: &TileSurfaceIds,
        [x, y]: [usize; 2],
        mut left: u32,
        mut sum: Vec3A,
        colors: &[Vec3A],
    ) -> Vec3A {
        let width = (around.opaque.width / 2) as isize;
        let window = keys.window([x % TILE, y % TILE]);
        let at = |[dx, dy]: [isize; 2]| window[((2 + dy) * SIDE as isize + 2 + dx) as usize];
        let next = NEXT.map(|[sx, sy]| at([2 * sx, 2 * sy]));
        while left != 0 {
            let sample = left.trailing_zeros() as usize;
            left &= left - 1;
            let ([dx, dy], share) = BESIDE[sample];
            let key = at([dx, dy]);
            let same = (0..NEXT.len()).fold(0, |same, index| same | u32::from(next[index] == key) << index);
            if same == 0 {
                let (column, row) = around.cut(x as isize * 2 + dx, y as isize * 2 + dy);
                self.add_unmatched(around, (column, row), y * width as usize + x, key, share);
                continue;
            }
            let first = same & FIRST[sample];
            let [sx, sy] = NEXT[if first != 0 { first } else { same }.trailing_zeros() as usize];
            sum += colors[((y as isize + sy) * width + x as isize + sx) as usize] * share;
        }
        sum
    }

    /// Sums the colours of a pixel's samples as far as they are known, for any number of samples and at the border.
    fn mix(
        &mut self,
        around: &SampleWindow<'_>,
        keys: &TileSurfaceIds,
        [x, y]: [usize; 2],
        pixel: usize,
        colors: &[Vec3A],
    ) -> Vec3A {
        let n = around.n;
        let center = keys.center([x % TILE, y % TILE]);
        let own = keys.keys[center];
        let place = [x as isize, y as isize];
        let (mut sum, mut own_weight) = (Vec3A::ZERO, 0.0);
        for dy in 1 - n..n {
            for dx in 1 - n..n {
                let weight = ((n - dx.abs()) * (n - dy.abs())) as f32 / (n * n * n * n) as f32;
                if keys.keys[keys.beside(center, dx, dy)] == own {
                    own_weight += weight;
                } else {
                    sum += self.sample(around, keys, place, [dx, dy], weight, pixel, colors);
                }
            }
        }
        sum + colors[pixel] * own_weight
    }

    /// What a sample beside a pixel's centre adds to it: the colour of a pixel near by that shows the same, or nothing
    /// and the sample is listed to be shaded.
    #[expect(clippy::too_many_arguments, reason = "the body of a loop")]
    fn sample(
        &mut self,
        around: &SampleWindow<'_>,
        keys: &TileSurfaceIds,
        [x, y]: [isize; 2],
        [dx, dy]: [isize; 2],
        weight: f32,
        pixel: usize,
        colors: &[Vec3A],
    ) -> Vec3A {
        let n = around.n;
        let (width, height) = (around.opaque.width as isize / n, around.opaque.height as isize / n);
        let center = keys.center([x as usize % TILE, y as usize % TILE]);
        let key = keys.keys[keys.beside(center, dx, dy)];
        let (sx, sy) = (dx.signum(), dy.signum());
        let shows = |[sx, sy]: [isize; 2]| {
            let (x, y) = (x + sx, y + sy);
            let inside = x >= 0 && y >= 0 && x < width && y < height;
            (inside && keys.keys[keys.beside(center, sx * n, sy * n)] == key).then(|| (y * width + x) as usize)
        };
        // The pixel that the sample leans to first, then the others.
        let neighbour = shows([sx, sy])
            .or_else(|| shows([sx, 0]).or_else(|| shows([0, sy])).or_else(|| NEXT.into_iter().find_map(shows)));
        if let Some(neighbour) = neighbour {
            return colors[neighbour] * weight;
        }
        self.add_unmatched(around, around.cut(x * n + dx, y * n + dy), pixel, key, weight);
        Vec3A::ZERO
    }

    /// Lists a sample of a surface that no centre near by shows; several of one surface are shaded together.
    #[cold]
    fn add_unmatched(
        &mut self,
        around: &SampleWindow<'_>,
        (column, row): (isize, isize),
        pixel: usize,
        key: u32,
        weight: f32,
    ) {
        let edge_pixels = self.edge_pixels.len() as u32;
        let mut same = self.unmatched.iter_mut().rev().take_while(|sample| sample.edge_pixels == edge_pixels);
        if let Some(sample) = same.find(|sample| sample.key == key) {
            sample.share += weight;
            return;
        }
        let (id, reversed_z) = around.opaque.sample(column as usize, row as usize);
        let spot = ShadingPoint {
            id,
            x: column as f32 / around.n as f32,
            y: row as f32 / around.n as f32,
            depth: 1.0 / reversed_z,
            shadow: around.light_buffer.shadow_mask[pixel].max(0.0),
            ambient: around.light_buffer.ambient[pixel].max(0.0),
        };
        self.unmatched.push(UnmatchedSample { spot, key, edge_pixels, share: weight });
    }
}

/// The places within a tile, in bits, row by row, that lie in some columns and rows of the picture.
fn places(columns: &Range<usize>, rows: &Range<usize>, of_columns: Range<usize>, of_rows: Range<usize>) -> u64 {
    let line = (columns.start.max(of_columns.start)..columns.end.min(of_columns.end))
        .fold(0_u64, |bits, column| bits | 1 << (column - columns.start));
    (rows.start.max(of_rows.start)..rows.end.min(of_rows.end))
        .fold(0, |bits, row| bits | line << ((row - rows.start) * TILE))
}

/// Sums the colours of the samples that show what the pixel shows that they lean to, for some pixels of a tile that do
/// not lie at the border.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn sum_neighbours(matches: &Matches, edge_pixels: u64, colors: &[Vec3A], first: usize, width: usize, sums: &mut Sums) {
    for place in each_place(edge_pixels) {
        let shares = matches.neighbour_shares(place);
        let pixel = first + place / TILE * width + place % TILE;
        let row = |first: usize| &colors[first..][..3];
        let rows = [row(pixel - width - 1), row(pixel - 1), row(pixel + width - 1)];
        let mut sum = Vec3A::ZERO;
        for (&([dx, dy], _), share) in BESIDE.iter().zip(shares) {
            sum += rows[(dy + 1) as usize][(dx + 1) as usize] * share;
        }
        sums[place] = sum;
    }
}

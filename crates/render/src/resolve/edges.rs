//! Colours of edge pixels, whose samples show several surfaces.

use glam::Vec3A;
use multiversion::multiversion;

use super::surface_ids::{AROUND, Matches, TileSurfaceIds, match_samples};
use crate::gbuffer::static_layer::{TILE, each_place};
use crate::light_buffer::LightBuffer;
use crate::raster::VisibilityBuffer;
use crate::shading::ShadingPoint;

/// Offsets (px) of the neighbouring pixels, in the order in which they are searched for a sample's surface.
const NEIGHBOURS: [[isize; 2]; 8] = [[-1, 0], [1, 0], [0, -1], [0, 1], [-1, -1], [1, -1], [-1, 1], [1, 1]];

/// By sample of [`AROUND`], bit mask of the [`NEIGHBOURS`] that are searched first: for a diagonal sample the two
/// pixels adjacent to it, e.g. left and upper for [-1, -1].
const PREFERRED: [u32; AROUND.len()] = [0b0101, 0, 0b0110, 0, 0, 0b1001, 0, 0b1010];

/// Colours of a tile and of a one-pixel border around it; beyond the image its border colours are repeated.
pub(super) type ColorWindow = [[Vec3A; TILE + 2]; TILE + 2];

/// Edge pixels of a frame and the samples that must be shaded for them.
#[derive(Debug, Default)]
pub(super) struct EdgePixels {
    /// Pixel index and weighted sum of the colours found so far, of each edge pixel.
    pub pixels: Vec<(u32, Vec3A)>,
    pub unmatched: Vec<UnmatchedSample>,
    matches: Matches,
}

/// Samples of a surface in an edge pixel that neither the pixel's centre nor a neighbouring centre shows.
#[derive(Debug)]
pub(super) struct UnmatchedSample {
    pub point: ShadingPoint,
    surface_id: u32,
    /// Index into the list of edge pixels, not of the image.
    pub edge_pixel: u32,
    /// Total weight of the samples in the tent filter.
    pub share: f32,
}

impl EdgePixels {
    /// Removes all edge pixels and samples of the last frame.
    pub fn clear(&mut self) {
        self.pixels.clear();
        self.unmatched.clear();
    }

    /// Finds the edge pixels of a tile, sums the colours of their matched samples, and lists their unmatched samples.
    pub fn blend_tile(
        &mut self,
        opaque: &VisibilityBuffer,
        ids: &TileSurfaceIds,
        light_buffer: &LightBuffer,
        tile: usize,
        colors: &[Vec3A],
    ) {
        let [columns, rows] = light_buffer.pixels_of(tile);
        let width = opaque.width / 2;
        let found = match_samples(ids, &mut self.matches);
        if found == 0 {
            return;
        }
        let window = color_window(colors, [width, opaque.height / 2], [columns.start, rows.start]);
        let mut sums = [Vec3A::ZERO; TILE * TILE];
        sum_neighbours(&self.matches, found, &window, &mut sums);
        for place in each_place(found) {
            let [x, y] = [place % TILE, place / TILE];
            let pixel = (rows.start + y) * width + columns.start + x;
            let mut sum = sums[place];
            let mut unmatched = self.matches.unmatched(place);
            while unmatched != 0 {
                let sample = unmatched.trailing_zeros() as usize;
                unmatched &= unmatched - 1;
                let ([dx, dy], share) = AROUND[sample];
                // Array `ids` begins two samples before the tile.
                let id_at = |dx: isize, dy: isize| {
                    ids.0[(2 * y as isize + 2 + dy) as usize][(2 * x as isize + 2 + dx) as usize]
                };
                let id = id_at(dx, dy);
                let is_same = |&[dx, dy]: &[isize; 2]| u32::from(id_at(2 * dx, 2 * dy) == id);
                let same = NEIGHBOURS.iter().rev().fold(0, |same, neighbour| same << 1 | is_same(neighbour));
                if same == 0 {
                    let sample = [(columns.start + x) as isize * 2 + dx, (rows.start + y) as isize * 2 + dy];
                    self.add_unmatched(opaque, light_buffer, sample, pixel, id, share);
                    continue;
                }
                let preferred = same & PREFERRED[sample];
                let [dx, dy] = NEIGHBOURS[if preferred != 0 { preferred } else { same }.trailing_zeros() as usize];
                sum += window[(y as isize + 1 + dy) as usize][(x as isize + 1 + dx) as usize] * share;
            }
            let color = sum + window[y + 1][x + 1] * self.matches.own_share(place);
            self.pixels.push((pixel as u32, color));
        }
    }

    /// Adds an unmatched sample to be shaded; samples of one surface in a pixel are shaded once.
    #[cold]
    fn add_unmatched(
        &mut self,
        opaque: &VisibilityBuffer,
        light_buffer: &LightBuffer,
        [column, row]: [isize; 2],
        pixel: usize,
        surface_id: u32,
        share: f32,
    ) {
        let edge_pixel = self.pixels.len() as u32;
        let mut same_pixel = self.unmatched.iter_mut().rev().take_while(|sample| sample.edge_pixel == edge_pixel);
        if let Some(sample) = same_pixel.find(|sample| sample.surface_id == surface_id) {
            sample.share += share;
            return;
        }
        let column = column.clamp(0, opaque.width as isize - 1) as usize;
        let row = row.clamp(0, opaque.height as isize - 1) as usize;
        let (id, reversed_z) = opaque.sample(column, row);
        let point = ShadingPoint {
            id,
            x: column as f32 / 2.0,
            y: row as f32 / 2.0,
            depth: 1.0 / reversed_z,
            shadow: light_buffer.shadow_mask[pixel].max(0.0),
            ambient: light_buffer.ambient[pixel].max(0.0),
        };
        self.unmatched.push(UnmatchedSample { point, surface_id, edge_pixel, share });
    }
}

/// Colours of the tile whose first pixel is (`column`, `row`) and of a one-pixel border, repeated at the image's edge.
/// `colors` is the whole image, row by row.
fn color_window(colors: &[Vec3A], [width, height]: [usize; 2], [column, row]: [usize; 2]) -> ColorWindow {
    let at = |first: usize, step: usize, size: usize| (first + step).saturating_sub(1).min(size - 1);
    std::array::from_fn(|y| {
        let line = &colors[at(row, y, height) * width..][..width];
        match line.get(column.wrapping_sub(1)..).and_then(|line| line.first_chunk()) {
            Some(whole) => *whole,
            None => std::array::from_fn(|x| line[at(column, x, width)]),
        }
    })
}

/// Sums, for each edge pixel, the weighted colours of the samples that match their nearest neighbouring pixel.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn sum_neighbours(matches: &Matches, edge_pixels: u64, colors: &ColorWindow, sums: &mut [Vec3A; TILE * TILE]) {
    for place in each_place(edge_pixels) {
        let shares = matches.neighbour_shares(place);
        let (x, y) = (place % TILE, place / TILE);
        let rows = [&colors[y][x..][..3], &colors[y + 1][x..][..3], &colors[y + 2][x..][..3]];
        let mut sum = Vec3A::ZERO;
        for (&([dx, dy], _), share) in AROUND.iter().zip(shares) {
            sum += rows[(dy + 1) as usize][(dx + 1) as usize] * share;
        }
        sums[place] = sum;
    }
}

//! Visibility buffer: nearest triangle and reversed z per sample.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use crate::simd::within;

use super::triangle_setup::{BLOCK, Corners, TriangleSetup};
use super::vertex::{Corner, area_of, range_of_three};

/// Number of a triangle's rows whose spans are computed at once. Measured: 8 are slower in small images.
const ROWS: usize = 4;

/// Sides of triangles to be drawn: front faces, back faces.
pub(crate) type Sides = [bool; 2];

/// Rasterises the triangles of a mesh that show a requested side.
#[inline(always)]
pub(crate) fn draw_mesh<const IDS: bool>(
    triangles: &[[u32; 3]],
    corners: &[Corner],
    sides: Sides,
    first_id: u32,
    target: &mut VisibilityBuffer,
) {
    let mut block = Block::default();
    for (triangle, id) in triangles.iter().zip(first_id..) {
        block.push::<IDS>(id, triangle.map(|corner| &corners[corner as usize]), sides, target);
    }
    block.draw::<IDS>(sides, target);
}

/// Batch of up to [`BLOCK`] triangles that are rasterised together.
#[derive(Default)]
pub(crate) struct Block {
    count: usize,
    ids: [u32; BLOCK],
    /// Vertices in pixels, not yet scaled to samples.
    corners: Corners,
}

impl Block {
    /// Adds a triangle; if the batch is then full, rasterises and empties it.
    #[inline(always)]
    pub fn push<const IDS: bool>(
        &mut self,
        id: u32,
        corners: [&Corner; 3],
        sides: Sides,
        target: &mut VisibilityBuffer,
    ) {
        let at = self.count & (BLOCK - 1);
        self.ids[at] = id;
        self.corners.put(at, corners);
        self.count += 1;
        if self.count == BLOCK {
            self.draw::<IDS>(sides, target);
        }
    }

    /// Rasterises and empties the batch.
    #[inline(always)]
    pub fn draw<const IDS: bool>(&mut self, sides: Sides, target: &mut VisibilityBuffer) {
        let mut visible = self.visible(sides, target);
        let setup = self.corners.setup(target.scale as i32 as f32, target.height);
        while visible != 0 {
            let i = visible.trailing_zeros() as usize & (BLOCK - 1);
            visible &= visible - 1;
            target.scan::<IDS>(&setup, i, self.ids[i]);
        }
        self.count = 0;
    }

    /// Bit mask of the triangles that show a requested side and may cover a sample.
    #[inline(always)]
    fn visible(&self, sides: Sides, target: &VisibilityBuffer) -> u32 {
        let scale = target.scale as i32 as f32;
        let (columns, rows) = (target.width as i32 as f32, target.height as i32 as f32);
        let (front, back) = (u32::from(sides[0]), u32::from(sides[1]));
        let mut seen = [0_u32; BLOCK];
        let [ax, bx, cx] = &self.corners.x;
        let [ay, by, cy] = &self.corners.y;
        for i in 0..BLOCK {
            let area = area_of([ax[i], ay[i]], [bx[i], by[i]], [cx[i], cy[i]]);
            let (left, right) = range_of_three(ax[i], bx[i], cx[i]);
            let (top, bottom) = range_of_three(ay[i], by[i], cy[i]);
            let covers_column = ceiling(left * scale, columns) < ceiling(right * scale, columns);
            let covers_row = ceiling(top * scale, rows) < ceiling(bottom * scale, rows);
            let side = if area < 0.0 { front } else { back };
            seen[i] = side & u32::from(covers_column & covers_row & (area != 0.0));
        }
        let bits = (0..BLOCK).fold(0, |bits, i| bits | seen[i] << i);
        bits & ((1_u32 << self.count) - 1)
    }
}

/// Value clamped to `0..=limit` and rounded up to an integer.
#[inline(always)]
fn ceiling(value: f32, limit: f32) -> f32 {
    const SHIFT: f32 = 8_388_608.0;
    let inside = within(value, 0.0, limit);
    let nearest = (inside + SHIFT) - SHIFT;
    if nearest < inside { nearest + 1.0 } else { nearest }
}

/// Nearest surface at each sample.
#[derive(Clone, Debug, Default)]
pub(crate) struct VisibilityBuffer {
    /// Number of samples per row.
    pub width: usize,
    /// Distance between the starts of rows in the buffers (samples), at least `width`.
    pub stride: usize,
    /// Number of rows of samples.
    pub height: usize,
    /// Samples per pixel along each axis, a power of two; the first sample of a pixel is at its centre.
    pub scale: usize,
    /// Reversed z, 0 for the background.
    pub reversed_z: Vec<f32>,
    /// Visibility ids, 0 for the background; empty for a shadow map.
    pub ids: Vec<u32>,
}

impl VisibilityBuffer {
    /// Reversed z and ids of each row.
    pub fn rows(&self) -> impl Iterator<Item = (&[f32], &[u32])> {
        let row = |row: usize| row * self.stride..row * self.stride + self.width;
        (0..self.height).map(move |index| (&self.reversed_z[row(index)], &self.ids[row(index)]))
    }

    /// Resizes the buffer to a size in pixels, and fills it with background.
    pub fn reset<const IDS: bool>(&mut self, width: usize, height: usize, scale: usize) {
        (self.width, self.height, self.scale) = (width * scale, height * scale, scale);
        self.stride = stride_of(self.width);
        let samples = self.stride * self.height;
        self.reversed_z.clear();
        self.reversed_z.resize(samples, 0.0);
        self.ids.clear();
        if IDS {
            self.ids.resize(samples, 0);
        }
    }

    /// Fills a rectangle of samples, ends excluded, with background.
    pub fn clear_rectangle(&mut self, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) {
        for row in rows {
            let range = row * self.stride + columns.start..row * self.stride + columns.end;
            self.reversed_z[range.clone()].fill(0.0);
            self.ids[range].fill(0);
        }
    }

    /// Visibility id and reversed z of a sample.
    pub fn sample(&self, column: usize, row: usize) -> (u32, f32) {
        let sample = row * self.stride + column;
        (self.ids[sample], self.reversed_z[sample])
    }

    /// Copies a rectangle of samples, ends excluded, from a buffer of the same size.
    pub fn copy_rectangle(&mut self, other: &Self, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) {
        for row in rows {
            let range = row * self.stride + columns.start..row * self.stride + columns.end;
            self.reversed_z[range.clone()].copy_from_slice(&other.reversed_z[range.clone()]);
            if !self.ids.is_empty() {
                self.ids[range.clone()].copy_from_slice(&other.ids[range]);
            }
        }
    }

    /// True if a rectangle of samples, ends excluded, differs from that of a buffer of the same size.
    pub fn differs(&self, other: &Self, columns: std::ops::Range<usize>, mut rows: std::ops::Range<usize>) -> bool {
        rows.any(|row| {
            let range = row * self.stride + columns.start..row * self.stride + columns.end;
            // Ids distinguish triangles of equal depth.
            self.reversed_z[range.clone()] != other.reversed_z[range.clone()]
                || (!self.ids.is_empty() && self.ids[range.clone()] != other.ids[range])
        })
    }

    /// Draws triangle `i` of a setup.
    #[inline(always)]
    fn scan<const IDS: bool>(&mut self, setup: &TriangleSetup, i: usize, id: u32) {
        let triangle = setup.triangle(i);
        let (width, stride, scale) = (self.width, self.stride, self.scale as u32);
        let [mut first, _, end] = triangle.rows;
        let (reversed_z, ids) = (&mut self.reversed_z[..], &mut self.ids[..]);
        while first < end {
            let rows = triangle.spans_from::<ROWS>(first, width, scale);
            let mut at = first as usize * stride;
            for i in 0..ROWS.min((end - first) as usize) {
                rows.row(i, at).draw::<IDS>(&triangle.gradient, id, reversed_z, ids);
                at += stride;
            }
            first += ROWS as u32;
        }
    }
}

/// Reads a square window that begins at a column and row of an image; beyond the image the border values are repeated.
#[inline(always)]
pub(crate) fn read_window<T: Copy, const SIDE: usize>(
    values: &[T],
    [width, stride]: [usize; 2],
    [column, row]: [isize; 2],
    out: &mut [[T; SIDE]; SIDE],
) {
    let clamp = |at: isize, size: usize| at.clamp(0, size as isize - 1) as usize;
    for (step, out) in out.iter_mut().enumerate() {
        let line = &values[clamp(row + step as isize, values.len() / stride) * stride..][..width];
        let whole = usize::try_from(column).ok().and_then(|column| line.get(column..)?.first_chunk());
        *out = match whole {
            Some(whole) => *whole,
            None => std::array::from_fn(|step| line[clamp(column + step as isize, width)]),
        };
    }
}

/// Distance between the starts of rows of `width` samples (samples), which avoids cache conflicts between rows.
fn stride_of(width: usize) -> usize {
    /// Number of samples (4 bytes) after which lines of a first-level cache with 64 sets and lines of 64 bytes fall
    /// into the same set.
    const SAME_SET: usize = 1024;
    /// Padding of a row: the samples of two cache lines.
    const APART: usize = 32;
    if width > 0 && width.is_multiple_of(SAME_SET) { width + APART } else { width }
}

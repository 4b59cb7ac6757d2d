//! Triangle setup in batches: edges, depth gradients and spans.

use super::span::{DepthGradient, Span};
use super::vertex::{Corner, area_of, first_sample, range_of_three};

/// Number of triangles in a batch.
pub(super) const BLOCK: usize = 16;

/// Vertices of a batch of triangles as structure of arrays: x and y (px), reversed z (1/depth).
#[derive(Default)]
pub(super) struct Corners {
    pub x: [[f32; BLOCK]; 3],
    pub y: [[f32; BLOCK]; 3],
    pub reversed_z: [[f32; BLOCK]; 3],
}

/// Edges of a batch of triangles, and their reversed z as linear functions of the sample position.
pub(super) struct TriangleSetup {
    /// Upper end (x, y) of the long edge and of the upper short edge, then of the lower short edge.
    pub top: [[f32; BLOCK]; 2],
    pub middle: [[f32; BLOCK]; 2],
    /// Columns per row of the long, the upper short and the lower short edge.
    pub slopes: [[f32; BLOCK]; 3],
    /// All bits set if the long edge is on the left, else 0.
    pub long_is_left: [u32; BLOCK],
    /// First row, first row of the lower short edge, and end row.
    pub rows: [[u32; BLOCK]; 3],
    /// Reversed z at sample (0, 0), in double precision, since vertices may lie far outside the image.
    pub constant: [f64; BLOCK],
    pub dx: [f32; BLOCK],
    pub dy: [f32; BLOCK],
    /// Range over the vertices, to which values are clamped, since rounding on slivers would exceed it.
    pub low: [f32; BLOCK],
    pub high: [f32; BLOCK],
}

impl Corners {
    #[inline(always)]
    pub fn put(&mut self, at: usize, corners: [&Corner; 3]) {
        for (index, corner) in corners.into_iter().enumerate() {
            self.x[index][at] = corner.x;
            self.y[index][at] = corner.y;
            self.reversed_z[index][at] = corner.reversed_z;
        }
    }

    /// Triangle setup for `scale` samples per pixel and axis in a buffer of `height` rows of samples.
    #[inline(always)]
    pub fn setup(&self, scale: f32, height: usize) -> TriangleSetup {
        let (none, no_rows) = ([0.0; BLOCK], [0; BLOCK]);
        let mut out = TriangleSetup {
            top: [none; 2],
            middle: [none; 2],
            slopes: [none; 3],
            long_is_left: no_rows,
            rows: [no_rows; 3],
            constant: [0.0; BLOCK],
            dx: none,
            dy: none,
            low: none,
            high: none,
        };
        for i in 0..BLOCK {
            let corner = |index: usize| Corner {
                x: self.x[index][i] * scale,
                y: self.y[index][i] * scale,
                reversed_z: self.reversed_z[index][i],
            };
            let (a, b, c) = (corner(0), corner(1), corner(2));
            let area = area_of([a.x, a.y], [b.x, b.y], [c.x, c.y]);
            let (a, b, area) = sorted(a, b, area);
            let (a, c, area) = sorted(a, c, area);
            let (b, c, area) = sorted(b, c, area);
            let slope = |from: Corner, to: Corner| (to.x - from.x) / (to.y - from.y);
            (out.top[0][i], out.top[1][i]) = (a.x, a.y);
            (out.middle[0][i], out.middle[1][i]) = (b.x, b.y);
            (out.slopes[0][i], out.slopes[1][i], out.slopes[2][i]) = (slope(a, c), slope(a, b), slope(b, c));
            out.long_is_left[i] = if area > 0.0 { u32::MAX } else { 0 };
            let (first, end) = (first_sample(a.y, height), first_sample(c.y, height));
            out.rows[0][i] = first;
            out.rows[1][i] = first_sample(b.y, height);
            out.rows[2][i] = if area == 0.0 { first } else { end };
            let inverse = 1.0 / area;
            let (ab, ac) = (b.reversed_z - a.reversed_z, c.reversed_z - a.reversed_z);
            (out.low[i], out.high[i]) = range_of_three(a.reversed_z, b.reversed_z, c.reversed_z);
            let dx = (ab * (c.y - a.y) - ac * (b.y - a.y)) * inverse;
            let dy = (ac * (b.x - a.x) - ab * (c.x - a.x)) * inverse;
            let [x, y] = [a.x, a.y].map(f64::from);
            out.constant[i] = (-x).mul_add(f64::from(dx), (-y).mul_add(f64::from(dy), f64::from(a.reversed_z)));
            (out.dx[i], out.dy[i]) = (dx, dy);
        }
        out
    }
}

/// The two vertices, the upper one first, and the signed area for that order.
#[inline(always)]
fn sorted(a: Corner, b: Corner, area: f32) -> (Corner, Corner, f32) {
    let swap = b.y < a.y;
    let pick = |first: f32, second: f32| if swap { second } else { first };
    let upper = Corner { x: pick(a.x, b.x), y: pick(a.y, b.y), reversed_z: pick(a.reversed_z, b.reversed_z) };
    let lower = Corner { x: pick(b.x, a.x), y: pick(b.y, a.y), reversed_z: pick(b.reversed_z, a.reversed_z) };
    (upper, lower, pick(area, -area))
}

/// Setup of one triangle of a batch.
pub(super) struct Triangle {
    top: [f32; 2],
    middle: [f32; 2],
    slopes: [f32; 3],
    long_is_left: u32,
    /// First row, first row of the lower short edge, and end row, as in [`TriangleSetup`].
    pub rows: [u32; 3],
    pub gradient: DepthGradient,
}

impl TriangleSetup {
    /// Setup of triangle `i` of the batch.
    #[inline(always)]
    pub fn triangle(&self, i: usize) -> Triangle {
        Triangle {
            top: self.top.each_ref().map(|list| list[i]),
            middle: self.middle.each_ref().map(|list| list[i]),
            slopes: self.slopes.each_ref().map(|list| list[i]),
            long_is_left: self.long_is_left[i],
            rows: self.rows.each_ref().map(|list| list[i]),
            gradient: DepthGradient {
                constant: self.constant[i],
                dx: self.dx[i],
                dy: self.dy[i],
                low: self.low[i],
                high: self.high[i],
            },
        }
    }
}

/// Spans of one triangle in consecutive rows.
pub(super) struct Spans<const ROWS: usize> {
    /// Column of each row's first sample.
    pub starts: [u32; ROWS],
    counts: [u32; ROWS],
    /// Distance (samples) from the pixel-aligned sample at which reversed z is `values` to the first sample, by row.
    pub offsets: [f32; ROWS],
    pub values: [f32; ROWS],
}

impl Triangle {
    /// Spans in rows `first` and following of a buffer `width` samples wide; spans of rows beyond the triangle are
    /// invalid.
    #[inline(always)]
    pub fn spans_from<const ROWS: usize>(&self, first: u32, width: usize, scale: u32) -> Spans<ROWS> {
        let (dx, dy) = (f64::from(self.gradient.dx), f64::from(self.gradient.dy));
        let ([top_x, top_y], [middle_x, middle_y]) = (self.top, self.middle);
        let [long_slope, upper_slope, lower_slope] = self.slopes;
        let (none, zero) = ([0; ROWS], [0.0; ROWS]);
        let mut rows = Spans { starts: none, counts: none, offsets: zero, values: zero };
        for i in 0..ROWS {
            let row = first + i as u32;
            let y = row as i32 as f32;
            let long_x = (y - top_y).mul_add(long_slope, top_x);
            let upper_x = (y - top_y).mul_add(upper_slope, top_x);
            let lower_x = (y - middle_y).mul_add(lower_slope, middle_x);
            let short_x = if row < self.rows[1] { upper_x } else { lower_x };
            // Swap without a branch.
            let exchanged = (long_x.to_bits() ^ short_x.to_bits()) & self.long_is_left;
            let left = f32::from_bits(short_x.to_bits() ^ exchanged);
            let right = f32::from_bits(long_x.to_bits() ^ exchanged);
            let start = first_sample(left, width);
            rows.starts[i] = start;
            rows.counts[i] = first_sample(right, width).max(start) - start;
            // Reversed z is evaluated at a pixel-aligned sample, so that rounding is the same for any number of samples
            // per pixel.
            let pixel = (start + scale - 1) & !(scale - 1);
            rows.offsets[i] = (start as i32 - pixel as i32) as f32;
            let begin = f64::from(row as i32).mul_add(dy, self.gradient.constant);
            rows.values[i] = f64::from(pixel as i32).mul_add(dx, begin) as f32;
        }
        rows
    }
}

impl<const ROWS: usize> Spans<ROWS> {
    /// Span of row `i`, in a buffer in which that row begins at index `at`.
    #[inline(always)]
    pub fn row(&self, i: usize, at: usize) -> Span {
        Span {
            first: at + self.starts[i] as usize,
            count: self.counts[i] as usize,
            offset: self.offsets[i],
            value: self.values[i],
        }
    }
}

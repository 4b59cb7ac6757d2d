//! Scan conversion: which triangle is nearest at each sample.
//!
//! Two triangles that share an edge compute the same crossing of that edge with a row from the same two corners,
//! so that every sample between them belongs to exactly one of them: no cracks, no double hits, no fixed-point grid.
//!
//! Of equally near triangles the one with the smaller id is seen, so the order of drawing does not matter.
//! With a power of two of samples per pixel, the samples at pixel centres get the same bits as with one:
//! doubling is exact in floating point, and every step here is either scaled by it or not changed at all.

/// A corner on the image plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// Column; samples are at integers.
    pub x: f32,
    /// Row; samples are at integers.
    pub y: f32,
    /// Grows towards the viewer and is linear on the image plane, e.g. 1 / depth; positive.
    pub nearness: f32,
}

/// Nearest surface per sample.
#[derive(Clone, Debug, Default)]
pub(crate) struct Target {
    /// Samples per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples per pixel along each axis, a power of two; a pixel's centre is its first sample.
    pub scale: usize,
    /// 0 where there is nothing.
    pub nearness: Vec<f32>,
    /// 0 where there is nothing; empty for a target without ids.
    pub ids: Vec<u32>,
}

impl Target {
    /// Clears to nothing at a size in pixels.
    pub fn reset<const IDS: bool>(&mut self, width: usize, height: usize, scale: usize) {
        (self.width, self.height, self.scale) = (width * scale, height * scale, scale);
        let samples = self.width * self.height;
        self.nearness.clear();
        self.nearness.resize(samples, 0.0);
        self.ids.clear();
        if IDS {
            self.ids.resize(samples, 0);
        }
    }

    /// Takes a rectangle of samples, ends excluded, from a target of the same size.
    pub fn copy_rectangle(&mut self, other: &Self, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) {
        for row in rows {
            let range = row * self.width + columns.start..row * self.width + columns.end;
            self.nearness[range.clone()].copy_from_slice(&other.nearness[range.clone()]);
            if !self.ids.is_empty() {
                self.ids[range.clone()].copy_from_slice(&other.ids[range]);
            }
        }
    }

    /// Draws a triangle of either orientation; corners must be finite.
    ///
    /// `signed_area` is twice its area on the image plane, negative when it is counter-clockwise seen by the viewer.
    #[inline(always)]
    pub fn draw<const IDS: bool>(&mut self, corners: [Corner; 3], signed_area: f32, id: u32) {
        let [mut a, mut b, mut c] = corners;
        let mut area = signed_area;
        if b.y < a.y {
            std::mem::swap(&mut a, &mut b);
            area = -area;
        }
        if c.y < a.y {
            std::mem::swap(&mut a, &mut c);
            area = -area;
        }
        if c.y < b.y {
            std::mem::swap(&mut b, &mut c);
            area = -area;
        }
        let (first_row, end_row) = (first_sample(a.y, self.height), first_sample(c.y, self.height));
        if first_row >= end_row || area == 0.0 {
            return;
        }
        let (left, right) = extremes(a.x, b.x, c.x);
        if first_sample(left, self.width) >= first_sample(right, self.width) {
            return;
        }
        let middle_row = first_sample(b.y, self.height);
        // Most triangles are so small that they cover no sample.
        let mut gradient = None;
        let long_slope = (c.x - a.x) / (c.y - a.y);
        for (upper, lower, rows) in [(a, b, first_row..middle_row), (b, c, middle_row..end_row)] {
            let short_slope = (lower.x - upper.x) / (lower.y - upper.y);
            for row in rows {
                let y = row as i32 as f32;
                let long_x = a.x + (y - a.y) * long_slope;
                let short_x = upper.x + (y - upper.y) * short_slope;
                let (left, right) = if area > 0.0 { (long_x, short_x) } else { (short_x, long_x) };
                let (start, end) = (first_sample(left, self.width), first_sample(right, self.width));
                if start < end {
                    let gradient = gradient.get_or_insert_with(|| Gradient::new(a, b, c, area));
                    // Counted from the same pixel whatever the number of samples.
                    let pixel = (start + self.scale - 1) & !(self.scale - 1);
                    let nearness = gradient.at(f64::from(pixel as i32), f64::from(y));
                    let offset = start as i32 - pixel as i32;
                    self.fill::<IDS>(row * self.width + start, end - start, offset, nearness, gradient, id);
                }
            }
        }
    }

    /// One row of a triangle.
    #[inline(always)]
    fn fill<const IDS: bool>(
        &mut self,
        first: usize,
        count: usize,
        offset: i32,
        start: f32,
        gradient: &Gradient,
        id: u32,
    ) {
        let (dx, low, high) = (gradient.dx, gradient.low, gradient.high);
        let nearness = &mut self.nearness[first..first + count];
        if IDS {
            let ids = &mut self.ids[first..first + count];
            for (column, (nearest, nearest_id)) in nearness.iter_mut().zip(ids).enumerate() {
                let value = within(start + (column as i32 + offset) as f32 * dx, low, high);
                let closer = (value > *nearest) | ((value == *nearest) & (id < *nearest_id));
                *nearest = if closer { value } else { *nearest };
                *nearest_id = if closer { id } else { *nearest_id };
            }
        } else {
            for (column, nearest) in nearness.iter_mut().enumerate() {
                let value = within(start + (column as i32 + offset) as f32 * dx, low, high);
                *nearest = if value > *nearest { value } else { *nearest };
            }
        }
    }
}

/// Nearness over a triangle.
struct Gradient {
    origin: Corner,
    dx: f32,
    dy: f32,
    /// Bounds over the corners: rounding on a sliver must not leave them.
    low: f32,
    high: f32,
}

impl Gradient {
    #[inline(always)]
    fn new(a: Corner, b: Corner, c: Corner, area: f32) -> Self {
        let inverse = 1.0 / area;
        let (ab, ac) = (b.nearness - a.nearness, c.nearness - a.nearness);
        let (low, high) = extremes(a.nearness, b.nearness, c.nearness);
        Self {
            origin: a,
            dx: (ab * (c.y - a.y) - ac * (b.y - a.y)) * inverse,
            dy: (ac * (b.x - a.x) - ab * (c.x - a.x)) * inverse,
            low,
            high,
        }
    }

    /// In double precision: corners may lie far outside the image.
    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> f32 {
        let along_x = (x - f64::from(self.origin.x)) * f64::from(self.dx);
        let along_y = (y - f64::from(self.origin.y)) * f64::from(self.dy);
        (f64::from(self.origin.nearness) + along_x + along_y) as f32
    }
}

/// First sample at or beyond a coordinate, within `0..=limit`.
///
/// Adding 2²³ rounds to an integer without a call to the mathematics library.
#[inline(always)]
fn first_sample(coordinate: f32, limit: usize) -> usize {
    const SHIFT: f32 = 8_388_608.0;
    let inside = within(coordinate, 0.0, limit as i32 as f32);
    let shifted = inside + SHIFT;
    let below = u32::from(shifted - SHIFT < inside);
    ((shifted.to_bits().wrapping_sub(SHIFT.to_bits()).wrapping_add(below)) as usize).min(limit)
}

/// Nearest integer of a number from 0 to 2²², without the care that a conversion takes for others.
#[inline(always)]
pub(crate) fn nearest_integer(value: f32) -> u32 {
    const SHIFT: f32 = 8_388_608.0;
    (value + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits())
}

/// A number moved into an interval; one instruction per side, unlike `f32::min` and `max`, which care for NaN.
#[inline(always)]
pub(crate) fn within(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

/// Smallest and largest of three numbers.
#[inline(always)]
fn extremes(a: f32, b: f32, c: f32) -> (f32, f32) {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    (if c < low { c } else { low }, if c > high { c } else { high })
}

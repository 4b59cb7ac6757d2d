//! Scan conversion: which triangle is nearest at each sample.
//!
//! Two triangles that share an edge compute the same crossing of that edge with a row from the same two corners,
//! so that every sample between them belongs to exactly one of them: no cracks, no double hits, no fixed-point grid.

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
    /// 0 where there is nothing.
    pub nearness: Vec<f32>,
    /// 0 where there is nothing; empty for a target without ids.
    pub ids: Vec<u32>,
}

impl Target {
    /// Clears to nothing at a size.
    pub fn reset<const IDS: bool>(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.nearness.clear();
        self.nearness.resize(width * height, 0.0);
        self.ids.clear();
        if IDS {
            self.ids.resize(width * height, 0);
        }
    }

    /// Becomes a copy of another target, keeping its memory.
    pub fn copy_from(&mut self, other: &Self) {
        (self.width, self.height) = (other.width, other.height);
        self.nearness.clone_from(&other.nearness);
        self.ids.clone_from(&other.ids);
    }

    /// Draws a triangle of either orientation; corners must be finite.
    ///
    /// `signed_area` is twice its area on the image plane, negative when it is counter-clockwise seen by the viewer.
    #[inline]
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
                let y = row as f32;
                let long_x = a.x + (y - a.y) * long_slope;
                let short_x = upper.x + (y - upper.y) * short_slope;
                let (left, right) = if area > 0.0 { (long_x, short_x) } else { (short_x, long_x) };
                let (start, end) = (first_sample(left, self.width), first_sample(right, self.width));
                if start < end {
                    let gradient = gradient.get_or_insert_with(|| Gradient::new(a, b, c, area));
                    let nearness = gradient.at(start as f64, f64::from(y));
                    self.fill::<IDS>(row * self.width + start, end - start, nearness, gradient, id);
                }
            }
        }
    }

    /// One row of a triangle.
    #[inline]
    fn fill<const IDS: bool>(&mut self, first: usize, count: usize, start: f32, gradient: &Gradient, id: u32) {
        let nearness = &mut self.nearness[first..first + count];
        if IDS {
            let ids = &mut self.ids[first..first + count];
            for (column, (nearest, nearest_id)) in nearness.iter_mut().zip(ids).enumerate() {
                let value = within(start + column as i32 as f32 * gradient.dx, gradient.low, gradient.high);
                let closer = value > *nearest;
                *nearest = if closer { value } else { *nearest };
                *nearest_id = if closer { id } else { *nearest_id };
            }
        } else {
            for (column, nearest) in nearness.iter_mut().enumerate() {
                let value = within(start + column as i32 as f32 * gradient.dx, gradient.low, gradient.high);
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
    #[inline]
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
    #[inline]
    fn at(&self, x: f64, y: f64) -> f32 {
        let along_x = (x - f64::from(self.origin.x)) * f64::from(self.dx);
        let along_y = (y - f64::from(self.origin.y)) * f64::from(self.dy);
        (f64::from(self.origin.nearness) + along_x + along_y) as f32
    }
}

/// First sample at or beyond a coordinate, within `0..=limit`.
///
/// Adding 2²³ rounds to an integer without a call to the mathematics library.
/// An exact tie may round either way, but always the same way for the same coordinate, which is all an edge needs.
#[inline]
fn first_sample(coordinate: f32, limit: usize) -> usize {
    const SHIFT: f32 = 8_388_608.0;
    let inside = within(coordinate, 0.0, limit as i32 as f32);
    (((inside + 0.5 + SHIFT).to_bits() - SHIFT.to_bits()) as usize).min(limit)
}

/// A number moved into an interval; one instruction per side, unlike `f32::min` and `max`, which care for NaN.
#[inline]
pub(crate) fn within(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

/// Smallest and largest of three numbers.
#[inline]
fn extremes(a: f32, b: f32, c: f32) -> (f32, f32) {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    (if c < low { c } else { low }, if c > high { c } else { high })
}

//! Triangles made ready for drawing, many at a time.

use super::{Corner, area_of, extremes, first_sample};

/// Corners of triangles, component by component.
pub(super) struct Corners<const N: usize> {
    pub x: [[f32; N]; 3],
    pub y: [[f32; N]; 3],
    pub nearness: [[f32; N]; 3],
}

/// Sides of triangles, and their nearness as a linear function of the place.
pub(super) struct Outlines<const N: usize> {
    /// The upper end of the long side, and that of the lower short side.
    pub top: [[f32; N]; 2],
    pub middle: [[f32; N]; 2],
    /// Columns per row: of the long side, and of the upper and lower short one.
    pub slopes: [[f32; N]; 3],
    /// All bits where the long side is on the left, else none.
    pub long_is_left: [u32; N],
    /// First row, first row of the lower short side, and the row after the last.
    pub rows: [[u32; N]; 3],
    /// Nearness at the origin of the image, in double precision: corners may lie far outside it.
    pub constant: [f64; N],
    pub dx: [f32; N],
    pub dy: [f32; N],
    /// Bounds over the corners: rounding on a sliver must not leave them.
    pub low: [f32; N],
    pub high: [f32; N],
}

impl<const N: usize> Default for Corners<N> {
    fn default() -> Self {
        Self { x: [[0.0; N]; 3], y: [[0.0; N]; 3], nearness: [[0.0; N]; 3] }
    }
}

impl<const N: usize> Corners<N> {
    #[inline(always)]
    pub fn put(&mut self, at: usize, corners: [&Corner; 3]) {
        for (index, corner) in corners.into_iter().enumerate() {
            self.x[index][at] = corner.x;
            self.y[index][at] = corner.y;
            self.nearness[index][at] = corner.nearness;
        }
    }

    /// With so many samples per pixel, on an image of so many rows of samples.
    #[inline(always)]
    pub fn outlines(&self, scale: f32, height: usize) -> Outlines<N> {
        let (none, no_rows) = ([0.0; N], [0; N]);
        let mut out = Outlines {
            top: [none; 2],
            middle: [none; 2],
            slopes: [none; 3],
            long_is_left: no_rows,
            rows: [no_rows; 3],
            constant: [0.0; N],
            dx: none,
            dy: none,
            low: none,
            high: none,
        };
        for i in 0..N {
            let corner = |index: usize| Corner {
                x: self.x[index][i] * scale,
                y: self.y[index][i] * scale,
                nearness: self.nearness[index][i],
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
            let (ab, ac) = (b.nearness - a.nearness, c.nearness - a.nearness);
            (out.low[i], out.high[i]) = extremes(a.nearness, b.nearness, c.nearness);
            let dx = (ab * (c.y - a.y) - ac * (b.y - a.y)) * inverse;
            let dy = (ac * (b.x - a.x) - ab * (c.x - a.x)) * inverse;
            out.constant[i] = f64::from(a.nearness) - f64::from(a.x) * f64::from(dx) - f64::from(a.y) * f64::from(dy);
            (out.dx[i], out.dy[i]) = (dx, dy);
        }
        out
    }
}

/// Two corners, the upper one first, and the area, whose sign follows their order.
#[inline(always)]
fn sorted(a: Corner, b: Corner, area: f32) -> (Corner, Corner, f32) {
    let swap = b.y < a.y;
    let pick = |first: f32, second: f32| if swap { second } else { first };
    let upper = Corner { x: pick(a.x, b.x), y: pick(a.y, b.y), nearness: pick(a.nearness, b.nearness) };
    let lower = Corner { x: pick(b.x, a.x), y: pick(b.y, a.y), nearness: pick(b.nearness, a.nearness) };
    (upper, lower, pick(area, -area))
}

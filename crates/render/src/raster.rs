//! Scan conversion: which triangle is nearest at each sample.
//!
//! Two triangles that share an edge compute the same crossing of that edge with a row from the same two corners,
//! so that every sample between them belongs to exactly one of them: no cracks, no double hits, no fixed-point grid.
//!
//! Of equally near triangles the one with the smaller id is seen, so the order of drawing does not matter.
//! With a power of two of samples per pixel, the samples at pixel centres get the same bits as with one:
//! doubling is exact in floating point, and every step here is either scaled by it or not changed at all.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use crate::lanes::within;

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

/// Rows of a triangle whose ends are found at once.
const ROWS: usize = 8;
/// Samples of a row that are drawn one by one.
const SHORT: usize = 4;

impl Corner {
    /// With so many samples per pixel: a pixel's centre is its first sample.
    #[inline(always)]
    pub fn scaled(self, scale: f32) -> Self {
        Self { x: self.x * scale, y: self.y * scale, ..self }
    }

    /// Component by component.
    #[inline(always)]
    pub fn joined(&self, other: &Self, join: impl Fn(f32, f32) -> f32) -> Self {
        Self { x: join(self.x, other.x), y: join(self.y, other.y), nearness: join(self.nearness, other.nearness) }
    }
}

/// Triangles whose visibility is found at once.
pub(crate) const BLOCK: usize = 16;

/// Which sides of triangles to draw: those that face the viewer, and those that face away.
pub(crate) type Sides = [bool; 2];

/// Planes of a mesh's triangles, component by component: unit normals, zero for a triangle without area, and distances
/// from the origin; as many as whole blocks.
#[derive(Debug, Default)]
pub(crate) struct Planes {
    normal: [Vec<f32>; 3],
    distance: Vec<f32>,
}

/// From where a mesh is seen, in its frame.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Eye {
    At([f32; 3]),
    /// Far away in a direction of unit length.
    Towards([f32; 3]),
}

impl Planes {
    pub fn new(planes: impl ExactSizeIterator<Item = ([f32; 3], f32)>) -> Self {
        let count = planes.len().next_multiple_of(BLOCK);
        let mut own = Self { normal: std::array::from_fn(|_| vec![0.0; count]), distance: vec![0.0; count] };
        for (index, (normal, distance)) in planes.enumerate() {
            own.normal.iter_mut().zip(normal).for_each(|(list, value)| list[index] = value);
            own.distance[index] = distance;
        }
        own
    }

    /// Which triangles of a block may show their front, in bits.
    #[inline(always)]
    fn facing(&self, block: usize, eye: Eye) -> u32 {
        /// Distance of the eye behind a plane beyond which rounding cannot be the cause, metres: single precision at
        /// some metres; for a direction, the same in radians.
        const SURELY: f32 = 1e-5;
        let ([x, y, z], near) = match eye {
            Eye::At(place) => (place, 1.0),
            Eye::Towards(direction) => (direction, 0.0),
        };
        let range = block * BLOCK..(block + 1) * BLOCK;
        let [nx, ny, nz] = self.normal.each_ref().map(|list| &list[range.clone()]);
        let distance = &self.distance[range];
        let mut seen = [0_u32; BLOCK];
        for i in 0..BLOCK {
            let before = nx[i] * x + ny[i] * y + nz[i] * z - distance[i] * near;
            seen[i] = u32::from(before > -SURELY);
        }
        (0..BLOCK).fold(0, |bits, i| bits | seen[i] << i)
    }
}

/// Draws the triangles of a mesh that show a wanted side. Most are so small that they cover no sample, and half of them
/// face away: both are found for many at a time.
#[inline(always)]
pub(crate) fn draw_mesh<const IDS: bool>(
    triangles: &[[u32; 3]],
    corners: &[Corner],
    planes: &Planes,
    eye: Eye,
    sides: Sides,
    first_id: u32,
    target: &mut Target,
) {
    let mut block = Block::default();
    for (index, triangles_of_block) in triangles.chunks(BLOCK).enumerate() {
        let wanted = (1_u32 << triangles_of_block.len()) - 1;
        let mut facing = if sides[1] { wanted } else { planes.facing(index, eye) & wanted };
        while facing != 0 {
            let i = facing.trailing_zeros() as usize;
            facing &= facing - 1;
            block.put((index * BLOCK + i) as u32, triangles_of_block[i].map(|corner| &corners[corner as usize]));
            if block.count == BLOCK {
                block.draw::<IDS>(triangles, corners, sides, first_id, target);
            }
        }
    }
    block.draw::<IDS>(triangles, corners, sides, first_id, target);
}

/// Corners of triangles at one sample per pixel, component by component.
struct Block {
    count: usize,
    triangle: [u32; BLOCK],
    x: [[f32; BLOCK]; 3],
    y: [[f32; BLOCK]; 3],
}

impl Default for Block {
    fn default() -> Self {
        Self { count: 0, triangle: [0; BLOCK], x: [[0.0; BLOCK]; 3], y: [[0.0; BLOCK]; 3] }
    }
}

impl Block {
    #[inline(always)]
    fn put(&mut self, triangle: u32, corners: [&Corner; 3]) {
        let at = self.count & (BLOCK - 1);
        self.triangle[at] = triangle;
        for (index, corner) in corners.into_iter().enumerate() {
            self.x[index][at] = corner.x;
            self.y[index][at] = corner.y;
        }
        self.count += 1;
    }

    /// Draws its triangles and becomes empty.
    #[inline(always)]
    fn draw<const IDS: bool>(
        &mut self,
        triangles: &[[u32; 3]],
        corners: &[Corner],
        sides: Sides,
        first_id: u32,
        target: &mut Target,
    ) {
        let mut visible = self.visible(sides, target);
        let scale = target.scale as f32;
        while visible != 0 {
            let triangle = self.triangle[visible.trailing_zeros() as usize];
            visible &= visible - 1;
            let corners = triangles[triangle as usize].map(|corner| corners[corner as usize].scaled(scale));
            target.draw::<IDS>(corners, first_id + triangle);
        }
        self.count = 0;
    }

    /// Which triangles show a wanted side and may cover a sample, in bits.
    #[inline(always)]
    fn visible(&self, sides: Sides, target: &Target) -> u32 {
        let scale = target.scale as i32 as f32;
        let (columns, rows) = (target.width as i32 as f32, target.height as i32 as f32);
        let (front, back) = (u32::from(sides[0]), u32::from(sides[1]));
        let mut seen = [0_u32; BLOCK];
        let [ax, bx, cx] = &self.x;
        let [ay, by, cy] = &self.y;
        for i in 0..BLOCK {
            let area = area_of([ax[i], ay[i]], [bx[i], by[i]], [cx[i], cy[i]]);
            let (left, right) = extremes(ax[i], bx[i], cx[i]);
            let (top, bottom) = extremes(ay[i], by[i], cy[i]);
            let covers_column = ceiling(left * scale, columns) < ceiling(right * scale, columns);
            let covers_row = ceiling(top * scale, rows) < ceiling(bottom * scale, rows);
            let side = if area < 0.0 { front } else { back };
            seen[i] = side & u32::from(covers_column & covers_row & (area != 0.0));
        }
        let bits = (0..BLOCK).fold(0, |bits, i| bits | seen[i] << i);
        bits & ((1_u32 << self.count) - 1)
    }
}

/// Twice the area of a triangle on the image plane, negative when it is counter-clockwise seen by the viewer.
#[inline(always)]
pub(crate) fn area_of(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
}

/// Smallest integer that is not below a number moved into `0..=limit`.
#[inline(always)]
fn ceiling(value: f32, limit: f32) -> f32 {
    const SHIFT: f32 = 8_388_608.0;
    let inside = within(value, 0.0, limit);
    let nearest = (inside + SHIFT) - SHIFT;
    if nearest < inside { nearest + 1.0 } else { nearest }
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

    /// Clears rows of samples to nothing.
    pub fn clear_rows(&mut self, rows: std::ops::Range<usize>) {
        let samples = rows.start * self.width..rows.end * self.width;
        self.nearness[samples.clone()].fill(0.0);
        self.ids[samples].fill(0);
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

    /// Whether a rectangle of samples, ends excluded, is not that of a target of the same size, to the bit.
    pub fn differs(&self, other: &Self, columns: std::ops::Range<usize>, mut rows: std::ops::Range<usize>) -> bool {
        rows.any(|row| {
            let range = row * self.width + columns.start..row * self.width + columns.end;
            // Equal nearness of another triangle is told by the ids; nearness is positive, so equal is the same bits.
            self.nearness[range.clone()] != other.nearness[range.clone()]
                || (!self.ids.is_empty() && self.ids[range.clone()] != other.ids[range])
        })
    }

    /// Draws a triangle of either orientation; corners must be finite.
    #[inline(always)]
    pub fn draw<const IDS: bool>(&mut self, corners: [Corner; 3], id: u32) {
        let [mut a, mut b, mut c] = corners;
        let mut area = area_of([a.x, a.y], [b.x, b.y], [c.x, c.y]);
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
        let middle_row = first_sample(b.y, self.height);
        let slope = |from: Corner, to: Corner| (to.x - from.x) / (to.y - from.y);
        let (long_slope, upper_slope, lower_slope) = (slope(a, c), slope(a, b), slope(b, c));
        let gradient = Gradient::new(a, b, c, area);
        let scale = self.scale as u32;
        // Eight rows at a time: few triangles have more.
        for first in (first_row..end_row).step_by(ROWS) {
            let (mut starts, mut ends, mut nearness) = ([0; ROWS], [0; ROWS], [0.0; ROWS]);
            for i in 0..ROWS {
                let row = first + i as u32;
                let y = row as i32 as f32;
                let long_x = a.x + (y - a.y) * long_slope;
                let upper_x = a.x + (y - a.y) * upper_slope;
                let lower_x = b.x + (y - b.y) * lower_slope;
                let short_x = if row < middle_row { upper_x } else { lower_x };
                let (left, right) = if area > 0.0 { (long_x, short_x) } else { (short_x, long_x) };
                starts[i] = first_sample(left, self.width);
                ends[i] = first_sample(right, self.width);
                // Counted from the same pixel whatever the number of samples.
                let pixel = (starts[i] + scale - 1) & !(scale - 1);
                nearness[i] = gradient.at(f64::from(pixel as i32), f64::from(row as i32));
            }
            for i in 0..ROWS.min((end_row - first) as usize) {
                let (start, end) = (starts[i], ends[i]);
                if start < end {
                    let offset = start as i32 - ((start + scale - 1) & !(scale - 1)) as i32;
                    let at = (first as usize + i) * self.width + start as usize;
                    self.fill::<IDS>(at, (end - start) as usize, offset, nearness[i], &gradient, id);
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
            let mut draw = |column: usize| {
                let value = within(start + (column as i32 + offset) as f32 * dx, low, high);
                let (nearest, nearest_id) = (nearness[column], ids[column]);
                let closer = (value > nearest) | ((value == nearest) & (id < nearest_id));
                // Positive numbers are in the order of their bits. Where a choice is stored over what was read, the compiler
                // makes it a masked store, at which some processors are slow.
                nearness[column] = f32::from_bits(value.to_bits().max(nearest.to_bits()));
                ids[column] = nearest_id.wrapping_add(if closer { id.wrapping_sub(nearest_id) } else { 0 });
            };
            // Most rows are too short for wide registers.
            if count <= SHORT {
                (0..SHORT).take_while(|&column| column < count).for_each(draw);
            } else {
                (0..count).for_each(&mut draw);
            }
        } else {
            let mut draw = |column: usize| {
                // A map of shadows keeps its last bit for what is transparent.
                let value = within(start + (column as i32 + offset) as f32 * dx, low, high);
                let value = f32::from_bits(value.to_bits() & !1);
                nearness[column] = if value > nearness[column] { value } else { nearness[column] };
            };
            if count <= SHORT {
                (0..SHORT).take_while(|&column| column < count).for_each(draw);
            } else {
                (0..count).for_each(&mut draw);
            }
        }
    }
}

/// Nearness over a triangle.
struct Gradient {
    /// At the origin of the image, in double precision: corners may lie far outside it.
    constant: f64,
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
        let dx = (ab * (c.y - a.y) - ac * (b.y - a.y)) * inverse;
        let dy = (ac * (b.x - a.x) - ab * (c.x - a.x)) * inverse;
        let constant = f64::from(a.nearness) - f64::from(a.x) * f64::from(dx) - f64::from(a.y) * f64::from(dy);
        Self { constant, dx, dy, low, high }
    }

    #[inline(always)]
    fn at(&self, x: f64, y: f64) -> f32 {
        (self.constant + x * f64::from(self.dx) + y * f64::from(self.dy)) as f32
    }
}

/// First sample at or beyond a coordinate, within `0..=limit`.
///
/// Adding 2²³ rounds to an integer without a call to the mathematics library.
#[inline(always)]
fn first_sample(coordinate: f32, limit: usize) -> u32 {
    const SHIFT: f32 = 8_388_608.0;
    let inside = within(coordinate, 0.0, limit as i32 as f32);
    let shifted = inside + SHIFT;
    let below = u32::from(shifted - SHIFT < inside);
    shifted.to_bits().wrapping_sub(SHIFT.to_bits()).wrapping_add(below)
}

/// Smallest and largest of three numbers.
#[inline(always)]
fn extremes(a: f32, b: f32, c: f32) -> (f32, f32) {
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    (if c < low { c } else { low }, if c > high { c } else { high })
}

//! How far every place is at least, and at most, from a surface, on a grid: the fast path's answer for clouds and meshes.
//!
//! Each cell holds bounds for all its points, so that one look-up may prove a ball clear, or in contact.
//! Built row by row in three passes (after P. Felzenszwalb and D. Huttenlocher, *Distance Transforms of Sampled
//! Functions*, 2012), with a window instead of envelopes, since far cells need no number.

use glam::DVec3;

use super::lane_geometry::{Point, ROUNDING};
use super::lanes::{LANES, Lanes, Verdict};

/// Smallest cell, m.
const CELL_M: f64 = 0.0125;
/// Most cells; larger surfaces have larger cells.
const MAX_CELLS: f64 = 800_000.0;
/// Gaps of more cells than this are all alike; their squares fill a byte.
const WINDOW: usize = 16;

/// Lower bounds on the distance to a surface.
#[derive(Clone, Debug)]
pub(super) struct Field {
    low: [f32; 3],
    /// Cells along each axis.
    counts: [usize; 3],
    cell: f32,
    /// Everything within this distance of what was marked belongs to the surface.
    radius: f32,
    /// Per cell, x fastest: squared distance to the nearest marked cell, in cells.
    squared_gaps: Vec<u8>,
    /// Per cell: square of what no place in it is farther than from the surface, in cells; 255 where that is not known.
    squared_spans: Vec<u8>,
}

impl Field {
    /// A field over a box (`low` to `high`, world) with cells of at least `cell` metres; `mark` calls its argument
    /// with boxes that together hold the surface, none much larger than the cell it is given.
    pub(super) fn new(
        [low, high]: [DVec3; 2],
        radius: f64,
        cell: f64,
        mark: impl FnOnce(f64, &mut dyn FnMut(DVec3, DVec3)),
    ) -> Self {
        let cells = |cell: f64| ((high - low) / cell).floor() + DVec3::ONE;
        let mut cell = cell.max(CELL_M);
        while cells(cell).element_product() > MAX_CELLS {
            cell *= 1.1;
        }
        let counts = cells(cell).to_array().map(|count| count as usize);
        let [nx, ny, nz] = counts;
        let mut field = Self {
            low: low.as_vec3().to_array(),
            counts,
            cell: cell as f32,
            radius: radius as f32,
            squared_gaps: vec![u8::MAX; nx * ny * nz],
            squared_spans: vec![u8::MAX; nx * ny * nz],
        };
        mark(cell, &mut |from, to| {
            let index = |point: DVec3| {
                let cells = ((point - low) / cell).to_array();
                std::array::from_fn::<usize, 3, _>(|axis| (cells[axis].max(0.0) as usize).min(counts[axis] - 1))
            };
            let is_point = from == to;
            let (from, to) = (index(from), index(to));
            for z in from[2]..=to[2] {
                for y in from[1]..=to[1] {
                    let row = (z * ny + y) * nx;
                    field.squared_gaps[row + from[0]..=row + to[0]].fill(0);
                }
            }
            // What a box holds of a surface may miss some of its cells, but a point is in its one.
            if is_point {
                field.squared_spans[(from[2] * ny + from[1]) * nx + from[0]] = 0;
            }
        });
        field.span_neighbours();
        field.spread_along_rows();
        field.spread_across(nx, ny, nz, nx * ny);
        field.spread_across(nx * ny, nz, 1, 0);
        field
    }

    /// The lanes in which a ball of radius `reach` about `center` is not proven clear.
    #[inline(always)]
    pub(super) fn near(&self, center: &Point, reach: f32) -> u8 {
        let (cells, outside) = self.cells_at(center);
        self.not_clear(&cells, outside, reach)
    }

    /// Like `near`, and the lanes in which something within `touch` of the center certainly belongs to the surface.
    #[inline(always)]
    pub(super) fn compare(&self, center: &Point, reach: f32, touch: f32) -> Verdict {
        let (cells, outside) = self.cells_at(center);
        let undecided = self.not_clear(&cells, outside, reach);
        let touch = touch + self.radius - ROUNDING;
        if undecided == 0 || touch < self.cell {
            return Verdict { undecided, touching: 0 };
        }
        let spans = Lanes::from_array(cells.map(|cell| f32::from(self.squared_spans[cell])));
        let within = (spans * (self.cell * self.cell) - Lanes::all(touch * touch)).not_positive();
        let unknown = (Lanes::all(f32::from(u8::MAX)) - spans).not_positive();
        Verdict { undecided, touching: within & !unknown & outside.not_positive() }
    }

    #[inline(always)]
    fn not_clear(&self, cells: &[usize; LANES], outside: Lanes, reach: f32) -> u8 {
        let gaps = Lanes::from_array(cells.map(|cell| f32::from(self.squared_gaps[cell])));
        // All of the surface is inside of the grid, so its nearest point is at least as far as both legs say.
        let squared = outside + gaps * (self.cell * self.cell);
        let reach = reach + self.radius + ROUNDING;
        (squared - Lanes::all(reach * reach)).not_positive()
    }

    /// The cells nearest to points, and the squared distances of the points from the grid.
    #[inline(always)]
    fn cells_at(&self, point: &Point) -> ([usize; LANES], Lanes) {
        let per_cell = 1.0 / self.cell;
        let (mut outside, mut index) = (Lanes::all(0.0), Lanes::all(0.0));
        // Whole numbers of this size are exact.
        for axis in [2, 1, 0] {
            let count = self.counts[axis] as f32;
            let along = point[axis] - Lanes::all(self.low[axis]);
            let inside = along.clamp(0.0, self.cell * count);
            outside = outside + (along - inside) * (along - inside);
            index = index * count + (inside * per_cell).floor().min(count - 1.0);
        }
        (index.to_array().map(|index| index as usize), outside)
    }

    /// Fills the spans of cells with a point in them and of their neighbours: between the farthest corners of two cells so far apart.
    fn span_neighbours(&mut self) {
        let [nx, ny, nz] = self.counts;
        for (stride, line) in [(1, nx), (nx, nx * ny), (nx * ny, nx * ny * nz)] {
            let before = self.squared_spans.clone();
            for (spans, before) in self.squared_spans.chunks_exact_mut(line).zip(before.chunks_exact(line)) {
                spans.iter_mut().for_each(|span| *span = span.saturating_add(1));
                for (span, neighbour) in spans[stride..].iter_mut().zip(before) {
                    *span = (*span).min(neighbour.saturating_add(4));
                }
                for (span, neighbour) in spans.iter_mut().zip(&before[stride..]) {
                    *span = (*span).min(neighbour.saturating_add(4));
                }
            }
        }
    }

    fn spread_along_rows(&mut self) {
        let nx = self.counts[0];
        for row in self.squared_gaps.chunks_exact_mut(nx) {
            // First steps from the nearest marked cell before, then of the nearest on either side, squared.
            let mut steps = WINDOW as u8 + 1;
            for cell in row.iter_mut() {
                steps = if *cell == 0 { 0 } else { (steps + 1).min(WINDOW as u8 + 1) };
                *cell = steps;
            }
            for cell in row.iter_mut().rev() {
                steps = (*cell).min(steps + 1);
                *cell = squared_gap(steps.into());
            }
        }
    }

    /// One pass along an axis on which neighbours are `stride` bytes apart, `count` of them, in `blocks` blocks.
    fn spread_across(&mut self, stride: usize, count: usize, blocks: usize, block: usize) {
        let before = self.squared_gaps.clone();
        let filled: Vec<bool> =
            before.chunks_exact(stride).map(|row| row.iter().any(|&squared| squared < u8::MAX)).collect();
        for first in (0..blocks).map(|index| index * block) {
            for to in 0..count {
                let target = &mut self.squared_gaps[first + to * stride..][..stride];
                for from in to.saturating_sub(WINDOW)..(to + WINDOW + 1).min(count) {
                    let source = first + from * stride;
                    if from != to && filled[source / stride] {
                        let added = squared_gap(to.abs_diff(from));
                        for (target, source) in target.iter_mut().zip(&before[source..source + stride]) {
                            *target = (*target).min(source.saturating_add(added));
                        }
                    }
                }
            }
        }
    }
}

/// Cells between two cells that are so many steps apart, squared.
fn squared_gap(steps: usize) -> u8 {
    let gap = steps.saturating_sub(1).min(WINDOW);
    (gap * gap).min(usize::from(u8::MAX)) as u8
}

//! Distance field: grid of lower and upper bounds on the distance to a cloud or mesh, used by the fast path.
//!
//! Each cell holds bounds for all its points, so that one lookup may prove a sphere clear or in contact. Computed in
//! three separable passes (after P. Felzenszwalb and D. Huttenlocher, *Distance Transforms of Sampled Functions*,
//! 2012), with a window instead of envelopes, since far cells need no value.

use glam::DVec3;

use super::lane_geometry::{Point, ROUNDING};
use super::lanes::{LANES, Lanes, Verdict};

/// Minimum cell size (m). Chosen by hand.
const CELL_M: f64 = 0.0125;
/// Maximum number of cells, to bound memory; larger surfaces have larger cells.
const MAX_CELLS: f64 = 800_000.0;
/// Maximum gap (cells); its square fits into a byte.
const WINDOW: usize = 16;

/// Distance field: bounds on the distance to a surface per cell of a regular grid.
#[derive(Clone, Debug)]
pub(super) struct DistanceField {
    low: [f32; 3],
    /// Number of cells along x, y and z.
    counts: [usize; 3],
    cell: f32,
    /// Radius by which the facets of the surface are inflated (m), such as that of cloud points.
    radius: f32,
    /// Lower bound per cell, x fastest: squared distance to the nearest marked cell [cells²].
    squared_lower: Vec<u8>,
    /// Upper bound per cell: squared maximum distance of its points from the surface [cells²]; 255 if unknown.
    squared_upper: Vec<u8>,
}

impl DistanceField {
    /// Builds a field over a box (`low` to `high`, world frame) with cells of at least `cell` metres; `mark` calls its
    /// argument with boxes that together contain the surface, none much larger than a cell.
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
            squared_lower: vec![u8::MAX; nx * ny * nz],
            squared_upper: vec![u8::MAX; nx * ny * nz],
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
                    field.squared_lower[row + from[0]..=row + to[0]].fill(0);
                }
            }
            // A box may contain cells without surface, but a point marks exactly one cell.
            if is_point {
                field.squared_upper[(from[2] * ny + from[1]) * nx + from[0]] = 0;
            }
        });
        field.bound_neighbours();
        field.propagate_along_rows();
        field.propagate_across(nx, ny, nz, nx * ny);
        field.propagate_across(nx * ny, nz, 1, 0);
        field
    }

    /// Lanes in which a sphere of radius `reach` is not proven clear.
    #[inline(always)]
    pub(super) fn near(&self, center: &Point, reach: f32) -> u8 {
        let (cells, outside) = self.cells_at(center);
        self.not_clear(&cells, outside, reach)
    }

    /// Like `near`, and the lanes in which the surface is certainly within `touch` of the centre.
    #[inline(always)]
    pub(super) fn compare(&self, center: &Point, reach: f32, touch: f32) -> Verdict {
        let (cells, outside) = self.cells_at(center);
        let undecided = self.not_clear(&cells, outside, reach);
        let touch = touch + self.radius - ROUNDING;
        if undecided == 0 || touch < self.cell {
            return Verdict { undecided, touching: 0 };
        }
        let upper = Lanes::from_array(cells.map(|cell| f32::from(self.squared_upper[cell])));
        let within = (upper * (self.cell * self.cell) - Lanes::all(touch * touch)).not_positive();
        let unknown = (Lanes::all(f32::from(u8::MAX)) - upper).not_positive();
        Verdict { undecided, touching: within & !unknown & outside.not_positive() }
    }

    #[inline(always)]
    fn not_clear(&self, cells: &[usize; LANES], outside: Lanes, reach: f32) -> u8 {
        let lower = Lanes::from_array(cells.map(|cell| f32::from(self.squared_lower[cell])));
        // The whole surface is inside the grid, so the distance is at least the hypotenuse of both legs.
        let squared = outside + lower * (self.cell * self.cell);
        let reach = reach + self.radius + ROUNDING;
        (squared - Lanes::all(reach * reach)).not_positive()
    }

    /// Indices of the cells nearest to points, and the squared distances of the points from the grid's box (m²), 0
    /// inside.
    #[inline(always)]
    fn cells_at(&self, point: &Point) -> ([usize; LANES], Lanes) {
        let per_cell = 1.0 / self.cell;
        let (mut outside, mut index) = (Lanes::all(0.0), Lanes::all(0.0));
        // `f32` holds cell indices exactly: they are below 2²⁴.
        for axis in [2, 1, 0] {
            let count = self.counts[axis] as f32;
            let along = point[axis] - Lanes::all(self.low[axis]);
            let inside = along.clamp(0.0, self.cell * count);
            outside = outside + (along - inside) * (along - inside);
            index = index * count + (inside * per_cell).floor().min(count - 1.0);
        }
        (index.to_array().map(|index| index as usize), outside)
    }

    /// Fills the upper bounds of cells with a point and of their neighbours: the distance between the farthest corners
    /// of two cells.
    fn bound_neighbours(&mut self) {
        let [nx, ny, nz] = self.counts;
        for (stride, line) in [(1, nx), (nx, nx * ny), (nx * ny, nx * ny * nz)] {
            let before = self.squared_upper.clone();
            for (upper, before) in self.squared_upper.chunks_exact_mut(line).zip(before.chunks_exact(line)) {
                upper.iter_mut().for_each(|upper| *upper = upper.saturating_add(1));
                for (upper, neighbour) in upper[stride..].iter_mut().zip(before) {
                    *upper = (*upper).min(neighbour.saturating_add(4));
                }
                for (upper, neighbour) in upper.iter_mut().zip(&before[stride..]) {
                    *upper = (*upper).min(neighbour.saturating_add(4));
                }
            }
        }
    }

    fn propagate_along_rows(&mut self) {
        let nx = self.counts[0];
        for row in self.squared_lower.chunks_exact_mut(nx) {
            // First the distance (cells) to the nearest marked cell before in the row, then the squared gap to the
            // nearest on either side.
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

    /// One pass along an axis whose neighbouring cells are `stride` cells apart: `count` cells along it in each of
    /// `blocks` blocks of `block` cells.
    fn propagate_across(&mut self, stride: usize, count: usize, blocks: usize, block: usize) {
        let before = self.squared_lower.clone();
        let filled: Vec<bool> =
            before.chunks_exact(stride).map(|row| row.iter().any(|&squared| squared < u8::MAX)).collect();
        for first in (0..blocks).map(|index| index * block) {
            for to in 0..count {
                let target = &mut self.squared_lower[first + to * stride..][..stride];
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

/// Squared gap between two cells that are `steps` cells apart [cells²]: adjacent cells have none.
fn squared_gap(steps: usize) -> u8 {
    let gap = steps.saturating_sub(1).min(WINDOW);
    (gap * gap).min(usize::from(u8::MAX)) as u8
}

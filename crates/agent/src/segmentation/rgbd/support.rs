//! What things stand on: large level planes.

use glam::{Vec2, Vec3};

use super::surface::Surface;

/// Cosine of the largest tilt of a level surface, 25 degrees: normals from noisy depth are that far off.
const LEVEL_COSINE: f32 = 0.9;
/// Height of a bin in which level surfaces are counted, m.
const BIN_M: f32 = 0.005;
/// Heights that are looked at, m: the robot reaches nothing else.
const HEIGHTS_M: [f32; 2] = [-0.5, 1.2];
/// Least area of a surface that things stand on, m²: no tray or board of a table setting is that large.
const LEAST_AREA_M2: f32 = 0.15;
/// Edge of a cell that tells where a plane is, m.
const CELL_M: f32 = 0.05;
/// Cells along either axis, around the robot's base.
const CELLS: usize = 80;
/// How far beyond what is seen of it a plane still is, cells: things hide what they stand on.
const HIDDEN_CELLS: usize = 5;

/// A large level plane: z = height + slope · xy.
pub(super) struct Plane {
    height: f32,
    slope: Vec2,
    /// Where it is, as it is seen from above.
    cells: Vec<bool>,
}

impl Plane {
    /// Height of a point above it, m; `None` where the plane is not.
    pub fn height_of(&self, point: Vec3) -> Option<f32> {
        let is_over = cell_of(point).is_some_and(|cell| self.cells[cell]);
        is_over.then(|| point.z - self.height - self.slope.dot(point.truncate()))
    }
}

fn cell_of(point: Vec3) -> Option<usize> {
    let place = |value: f32| {
        let cell = (value / CELL_M).floor() + CELLS as f32 / 2.0;
        (cell >= 0.0 && cell < CELLS as f32).then_some(cell as usize)
    };
    Some(place(point.y)? * CELLS + place(point.x)?)
}

/// The planes of a surface, lowest first.
pub(super) fn planes(surface: &Surface) -> Vec<Plane> {
    let [lowest, highest] = HEIGHTS_M;
    let count = ((highest - lowest) / BIN_M) as usize;
    let mut areas = vec![0.0_f32; count];
    let level: Vec<usize> = (0..surface.points.len())
        .filter(|&index| {
            surface.normals[index].z > LEVEL_COSINE && (lowest..highest).contains(&surface.points[index].z)
        })
        .collect();
    for &index in &level {
        let point = surface.points[index];
        areas[((point.z - lowest) / BIN_M) as usize % count] += seen_area(surface, index);
    }
    // Three bins at a time: the plane may lie on the border of two, and noise widens it.
    let around = |bin: usize| areas[bin.saturating_sub(1)..(bin + 2).min(count)].iter().sum::<f32>();
    let sums: Vec<f32> = (0..count).map(around).collect();
    let mut planes: Vec<Plane> = Vec::new();
    let mut is_taken = vec![false; count];
    loop {
        let free = (0..count).filter(|bin| !is_taken[*bin]);
        let Some(best) = free.max_by(|one, other| sums[*one].total_cmp(&sums[*other])) else { break };
        if sums[best] < LEAST_AREA_M2 {
            break;
        }
        // Whatever lies within 3 cm belongs to this plane: noise, and things that lie flat.
        let near = (0.03 / BIN_M) as usize;
        is_taken[best.saturating_sub(near)..(best + near + 1).min(count)].fill(true);
        let height = lowest + (best as f32 + 0.5) * BIN_M;
        planes.push(fitted(surface, &level, height));
    }
    planes.sort_by(|one, other| one.height.total_cmp(&other.height));
    planes
}

/// Area that a pixel sees, m².
fn seen_area(surface: &Surface, index: usize) -> f32 {
    let view = (surface.eye - surface.points[index]).normalize_or_zero();
    let footprint = surface.footprint_m(surface.points[index]);
    footprint * footprint / surface.normals[index].dot(view).max(0.1)
}

/// The plane near a height that most points lie on.
fn fitted(surface: &Surface, level: &[usize], height: f32) -> Plane {
    let mut plane = Plane { height, slope: Vec2::ZERO, cells: vec![true; CELLS * CELLS] };
    // Half of the width of what counts, m: as the bins at first, then as the noise allows.
    for within in [0.01_f32, 0.006, 0.004] {
        let near = level.iter().copied().filter(|&index| {
            let point = surface.points[index];
            let within = within.max(2.0 * surface.depth_noise_m(point));
            plane.height_of(point).is_some_and(|height| height.abs() < within)
        });
        let points: Vec<Vec3> = near.map(|index| surface.points[index]).collect();
        if points.len() < 100 {
            break;
        }
        let mean = points.iter().sum::<Vec3>() / points.len() as f32;
        let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for point in &points {
            let Vec3 { x, y, z } = *point - mean;
            (xx, xy, yy, xz, yz) = (xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z);
        }
        let determinant = xx * yy - xy * xy;
        if determinant < 1e-6 * xx * yy {
            break;
        }
        plane.slope = Vec2::new(xz * yy - yz * xy, yz * xx - xz * xy) / determinant;
        plane.height = mean.z - plane.slope.dot(mean.truncate());
    }
    plane.cells = cells(surface, level, &plane);
    plane
}

/// Cells where the plane is seen, and those near them.
fn cells(surface: &Surface, level: &[usize], plane: &Plane) -> Vec<bool> {
    let mut counts = vec![0_u16; CELLS * CELLS];
    for &index in level {
        let point = surface.points[index];
        let within = 0.01_f32.max(3.0 * surface.depth_noise_m(point));
        if let (Some(cell), Some(height)) = (cell_of(point), plane.height_of(point))
            && height.abs() < within
        {
            counts[cell] = counts[cell].saturating_add(1);
        }
    }
    let seen: Vec<usize> = (0..counts.len()).filter(|cell| counts[*cell] >= 10).collect();
    let mut cells = vec![false; CELLS * CELLS];
    for cell in seen {
        let (x, y) = (cell % CELLS, cell / CELLS);
        let columns = x.saturating_sub(HIDDEN_CELLS)..(x + HIDDEN_CELLS + 1).min(CELLS);
        for row in y.saturating_sub(HIDDEN_CELLS)..(y + HIDDEN_CELLS + 1).min(CELLS) {
            cells[row * CELLS + columns.start..row * CELLS + columns.end].fill(true);
        }
    }
    cells
}

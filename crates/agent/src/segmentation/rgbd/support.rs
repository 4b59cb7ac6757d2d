//! Support surfaces: large horizontal planes.

use glam::{Vec2, Vec3};

use super::cloud::OrganizedCloud;

/// Cosine of the maximum tilt of a horizontal surface, 25 degrees: normals of noisy depth are that inaccurate.
const MIN_NORMAL_Z: f32 = 0.9;
/// Bin size of the height histogram (m).
const BIN_M: f32 = 0.005;
/// Height range of the histogram (m), limited by the robot's reach.
const HEIGHTS_M: [f32; 2] = [-0.5, 1.2];
/// Minimum area of a support [m²]; larger than any tray or board.
const MIN_AREA_M2: f32 = 0.15;
/// Cell size of a plane's occupancy grid (m).
const CELL_M: f32 = 0.05;
/// Cells along either axis, centred at the robot's base.
const CELLS: usize = 80;
/// Dilation of a plane's visible part [cells]: objects occlude their support.
const DILATION_CELLS: usize = 5;

/// A large horizontal plane: z = height + slope · xy.
pub(super) struct Plane {
    height: f32,
    slope: Vec2,
    /// Occupancy grid of the plane, seen from above.
    visible_cells: Vec<bool>,
}

impl Plane {
    /// Height of a point above the plane (m); `None` outside its extent.
    pub fn height_of(&self, point: Vec3) -> Option<f32> {
        let is_over = cell_of(point).is_some_and(|cell| self.visible_cells[cell]);
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

/// Support planes of a cloud, lowest first.
pub(super) fn planes(cloud: &OrganizedCloud) -> Vec<Plane> {
    let [lowest, highest] = HEIGHTS_M;
    let count = ((highest - lowest) / BIN_M) as usize;
    let mut areas = vec![0.0_f32; count];
    let horizontal: Vec<usize> = (0..cloud.points.len())
        .filter(|&index| cloud.normals[index].z > MIN_NORMAL_Z && (lowest..highest).contains(&cloud.points[index].z))
        .collect();
    for &index in &horizontal {
        let point = cloud.points[index];
        areas[((point.z - lowest) / BIN_M) as usize % count] += pixel_area_m2(cloud, index);
    }
    // Sum three bins: the plane may lie on a bin border, and noise spreads it.
    let around = |bin: usize| areas[bin.saturating_sub(1)..(bin + 2).min(count)].iter().sum::<f32>();
    let sums: Vec<f32> = (0..count).map(around).collect();
    let mut planes: Vec<Plane> = Vec::new();
    let mut is_taken = vec![false; count];
    loop {
        let free = (0..count).filter(|bin| !is_taken[*bin]);
        let Some(best) = free.max_by(|one, other| sums[*one].total_cmp(&sums[*other])) else { break };
        if sums[best] < MIN_AREA_M2 {
            break;
        }
        // Points within 3 cm belong to this plane: noise and flat objects.
        let near = (0.03 / BIN_M) as usize;
        is_taken[best.saturating_sub(near)..(best + near + 1).min(count)].fill(true);
        let height = lowest + (best as f32 + 0.5) * BIN_M;
        planes.push(fit_plane(cloud, &horizontal, height));
    }
    planes.sort_by(|one, other| one.height.total_cmp(&other.height));
    planes
}

/// Surface area covered by a pixel [m²].
fn pixel_area_m2(cloud: &OrganizedCloud, index: usize) -> f32 {
    let view = (cloud.camera - cloud.points[index]).normalize_or_zero();
    let footprint = cloud.footprint_m(cloud.points[index]);
    footprint * footprint / cloud.normals[index].dot(view).max(0.1)
}

/// Least-squares fit of a plane near a height.
fn fit_plane(cloud: &OrganizedCloud, horizontal: &[usize], height: f32) -> Plane {
    let mut plane = Plane { height, slope: Vec2::ZERO, visible_cells: vec![true; CELLS * CELLS] };
    // Inlier distance [m]: first a bin's width on either side, then as narrow as the noise allows.
    for within in [0.01_f32, 0.006, 0.004] {
        let near = horizontal.iter().copied().filter(|&index| {
            let point = cloud.points[index];
            let within = within.max(2.0 * cloud.depth_noise_m(point));
            plane.height_of(point).is_some_and(|height| height.abs() < within)
        });
        let points: Vec<Vec3> = near.map(|index| cloud.points[index]).collect();
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
    plane.visible_cells = visible_cells(cloud, horizontal, &plane);
    plane
}

/// Cells where the plane is visible, dilated.
fn visible_cells(cloud: &OrganizedCloud, horizontal: &[usize], plane: &Plane) -> Vec<bool> {
    let mut counts = vec![0_u16; CELLS * CELLS];
    for &index in horizontal {
        let point = cloud.points[index];
        let within = 0.01_f32.max(3.0 * cloud.depth_noise_m(point));
        if let (Some(cell), Some(height)) = (cell_of(point), plane.height_of(point))
            && height.abs() < within
        {
            counts[cell] = counts[cell].saturating_add(1);
        }
    }
    let seen: Vec<usize> = (0..counts.len()).filter(|cell| counts[*cell] >= 10).collect();
    let mut visible_cells = vec![false; CELLS * CELLS];
    for cell in seen {
        let (x, y) = (cell % CELLS, cell / CELLS);
        let columns = x.saturating_sub(DILATION_CELLS)..(x + DILATION_CELLS + 1).min(CELLS);
        for row in y.saturating_sub(DILATION_CELLS)..(y + DILATION_CELLS + 1).min(CELLS) {
            visible_cells[row * CELLS + columns.start..row * CELLS + columns.end].fill(true);
        }
    }
    visible_cells
}

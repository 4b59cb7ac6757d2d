//! Voxel indices of depth image pixels, eight pixels at a time.

use genmanip_core::{Intrinsics, RgbdImage};
use glam::DVec3;
use multiversion::multiversion;

use crate::collision::lanes::{LANES, Lanes};

/// A grid of cubic voxels, world frame.
pub(super) struct Grid {
    pub(super) low: DVec3,
    pub(super) cells_per_m: f64,
    /// Number of voxels along each axis.
    pub(super) count: u32,
}

/// Pixel rays of an image, world frame.
pub(super) struct View {
    camera: DVec3,
    /// Ray of the first pixel (its point at a depth of 1 m, relative to the camera), and the steps to the next column
    /// and the next row.
    corner: DVec3,
    right: DVec3,
    down: DVec3,
}

impl View {
    pub(super) fn new(image: &RgbdImage) -> Self {
        let Intrinsics { fx, fy, cx, cy, .. } = image.intrinsics;
        let [right, down, forward] = DVec3::AXES.map(|axis| image.world_from_camera.transform_vector(axis));
        let (right, down) = (right / fx, down / fy);
        Self { camera: image.world_from_camera.position, corner: forward - down * cy - right * cx, right, down }
    }

    /// Point seen by a pixel, world frame.
    pub(super) fn point(&self, row: usize, column: usize, depth_m: f32) -> DVec3 {
        self.camera + (self.corner + self.down * row as f64 + self.right * column as f64) * f64::from(depth_m)
    }
}

impl Grid {
    /// Columns and voxels of a row's pixels with depth inside the grid; of neighbours in one voxel only the first.
    pub(super) fn cells_of_row(&self, view: &View, row: usize, depths_m: &[f32], cells: &mut Vec<(usize, [u32; 3])>) {
        let in_cells = |vector: DVec3| (vector * self.cells_per_m).as_vec3().to_array();
        let (camera, start) = (in_cells(view.camera - self.low), in_cells(view.corner + view.down * row as f64));
        let (step, limit) = (in_cells(view.right), self.count as f32);
        cells.clear();
        find_cells(&std::array::from_fn(|axis| [camera[axis], start[axis], step[axis]]), limit, depths_m, cells);
    }
}

/// `axes` hold camera position, ray of the first column and step to the next column, all in voxels.
#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn find_cells(axes: &[[f32; 3]; 3], limit: f32, depths_m: &[f32], cells: &mut Vec<(usize, [u32; 3])>) {
    let (zero, nowhere) = (Lanes::all(0.0), Lanes::all(-1.0));
    let mut columns = Lanes::from_array(std::array::from_fn(|lane| lane as f32));
    let mut last = [-1; 3];
    for (index, eight) in depths_m.chunks(LANES).enumerate() {
        let mut depth = [0.0; LANES];
        depth[..eight.len()].copy_from_slice(eight);
        let depth = Lanes::from_array(depth);
        // NaN compares false, so it becomes 0, which means no depth.
        let depth = zero.below(depth).pick(depth, zero);
        let depth = depth.below(Lanes::all(f32::INFINITY)).pick(depth, zero);
        let along = |[camera, start, step]: [f32; 3]| (columns * step + Lanes::all(start)) * depth + Lanes::all(camera);
        let (x, y, z) = (along(axes[0]), along(axes[1]), along(axes[2]));
        // A negative number marks points outside the grid.
        let marked = zero.below(depth).pick(x, nowhere);
        let marked = x.lower(y).lower(z).below(zero).pick(nowhere, marked);
        let marked = x.higher(y).higher(z).below(Lanes::all(limit)).pick(marked, nowhere);
        let (x, y, z) = (marked.whole(), y.whole(), z.whole());
        for lane in 0..LANES {
            let cell = [x[lane], y[lane], z[lane]];
            if cell[0] >= 0 && cell != last {
                cells.push((index * LANES + lane, cell.map(|cell| cell as u32)));
                last = cell;
            }
        }
        columns = columns + Lanes::all(LANES as f32);
    }
}

//! Obstacle points from depth images: points that belong to nothing known.
//!
//! Every pixel becomes a point; one point per voxel is kept, and dropped if it lies on the robot (self-filtering), the
//! attached object or a known obstacle. The rest is a cloud of unknown surfaces; space behind them is not modelled.

mod pixels;
#[cfg(test)]
mod tests;

use genmanip_core::{Intrinsics, Pose, RgbdImage};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use pixels::{Grid, View};

use crate::collision::{Checker, Solid, SurfaceError};

/// Settings for the conversion of depth images to obstacle points.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthSettings {
    /// Voxel size (m); one point per voxel is kept.
    ///
    /// With radius and padding it determines how far a sharp corner of the robot can get between points: not to the
    /// surface as long as 0.7 voxels are less than radius plus padding.
    pub cell_m: f64,
    /// Collision radius of points (m).
    pub radius_m: f64,
    /// Points within this distance of the robot or the attached object are self-filtered (m).
    pub robot_margin_m: f64,
    /// Points within this distance of a known obstacle are attributed to it (m).
    pub known_margin_m: f64,
    /// Standard deviation of a measured depth of 1 m (m), growing with the square of the depth; both margins grow by
    /// four standard deviations. 0 for perfect depth.
    #[serde(default, skip_serializing_if = "is_perfect")]
    pub error_m: f64,
}

/// Depth error bound in standard deviations; about one point in ten thousand exceeds it.
const MAX_ERROR_SIGMAS: f64 = 4.0;
/// Depth beyond which margins stop growing (m); farther points are out of reach.
const MAX_GROWTH_DEPTH_M: f64 = 2.0;

#[expect(clippy::trivially_copy_pass_by_ref, reason = "what serde asks for")]
fn is_perfect(error_m: &f64) -> bool {
    *error_m == 0.0
}

impl Default for DepthSettings {
    fn default() -> Self {
        Self { cell_m: 0.007, radius_m: 0.002, robot_margin_m: 0.006, known_margin_m: 0.004, error_m: 0.0 }
    }
}

/// Reason why depth images cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DepthError {
    /// The number of depths differs from the number of pixels.
    #[error("depth image {image} has {got} depths, expected {width} x {height}")]
    Size {
        /// Index of the image.
        image: usize,
        /// Number of depths.
        got: usize,
        /// Image width (px).
        width: u32,
        /// Image height (px).
        height: u32,
    },
    /// The camera pose or projection is invalid.
    #[error("the camera of depth image {image} has a pose or a projection that is not finite, or no focal length")]
    Camera {
        /// Index of the image.
        image: usize,
    },
    /// The image has lens distortion.
    #[error(
        "depth image {image} has lens distortion, expected a pinhole image: convert it with `RgbdImage::pinhole_depth`"
    )]
    Lens {
        /// Index of the image.
        image: usize,
    },
    /// No image has a depth, so the surroundings are unknown.
    #[error("no pixel of {images} depth images has a depth, so obstacles are unknown")]
    Blind {
        /// Number of images.
        images: usize,
    },
    /// The voxel size is out of range.
    #[error("voxel size {cell_m} m: expected 0.001 to 0.1 m")]
    Cell {
        /// Voxel size (m).
        cell_m: f64,
    },
    /// The robot configuration in the images has the wrong length or is not finite.
    #[error("expected {expected} finite joint positions of the robot in the images, got {got:?}")]
    Configuration {
        /// Number of arm joints, which is the required length.
        expected: usize,
        /// Values given.
        got: Vec<f64>,
    },
    /// The remaining points form no valid cloud.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}

/// Unknown points, world frame, voxel-downsampled, in pixel order: on neither the robot at `config` nor the known
/// obstacles of `checker`; without points out of reach.
pub(crate) fn unknown_points(
    checker: &Checker,
    config: &[f64],
    images: &[RgbdImage],
    settings: &DepthSettings,
) -> Result<Vec<DVec3>, DepthError> {
    let expected = checker.chain().dof();
    if config.len() != expected || !config.iter().all(|q| q.is_finite()) {
        return Err(DepthError::Configuration { expected, got: config.to_vec() });
    }
    let mut cells = VoxelGrid::new(checker, config, settings)?;
    let (mut points, mut row_cells) = (Vec::new(), Vec::new());
    for (index, image) in images.iter().enumerate() {
        check(index, image)?;
        let (view, width) = (View::new(image), image.intrinsics.width as usize);
        for (row, depths) in image.depth_m.chunks_exact(width.max(1)).enumerate() {
            cells.grid.cells_of_row(&view, row, depths, &mut row_cells);
            for &(column, cell) in &row_cells {
                let depth_m = depths[column];
                points.extend(cells.new_point(cell, depth_m, || view.point(row, column, depth_m)));
            }
        }
    }
    let has_depth = images.iter().flat_map(|image| &image.depth_m).any(|depth_m| *depth_m > 0.0 && depth_m.is_finite());
    if has_depth { Ok(points) } else { Err(DepthError::Blind { images: images.len() }) }
}

fn check(index: usize, image: &RgbdImage) -> Result<(), DepthError> {
    let Intrinsics { width, height, fx, fy, cx, cy } = image.intrinsics;
    if image.depth_m.len() as u64 != u64::from(width) * u64::from(height) {
        return Err(DepthError::Size { image: index, got: image.depth_m.len(), width, height });
    }
    let Pose { position, rotation } = image.world_from_camera;
    let finite = position.is_finite() && rotation.is_finite() && [fx, fy, cx, cy].iter().all(|value| value.is_finite());
    if !(finite && fx > 0.0 && fy > 0.0) {
        return Err(DepthError::Camera { image: index });
    }
    if image.distortion.is_some() {
        return Err(DepthError::Lens { image: index });
    }
    Ok(())
}

/// Number of voxels along the edge of a block, as a power of two.
const BLOCK_BITS: u32 = 3;
/// 64-bit words of a block's occupancy bits.
const WORDS: usize = (1 << (3 * BLOCK_BITS)) / 64;

/// A sparse voxel grid over the robot's reach with occupied voxels and nearby known solids.
struct VoxelGrid<'a> {
    grid: Grid,
    /// Number of blocks along each axis.
    count: u32,
    /// Index into `blocks` plus one, for each block of the grid; 0 if empty.
    block_at: Vec<u32>,
    blocks: Vec<Block>,
    solids: Vec<(Solid<'a>, f64)>,
    /// Growth of the margins with squared depth [1/m].
    growth: f64,
    /// Indices of nearby solids, grouped by block.
    near: Vec<u32>,
}

struct Block {
    seen: [u64; WORDS],
    /// Start and end of the block's range in [`VoxelGrid::near`].
    near: [u32; 2],
}

impl<'a> VoxelGrid<'a> {
    fn new(checker: &'a Checker, config: &[f64], settings: &DepthSettings) -> Result<Self, DepthError> {
        let cell = settings.cell_m;
        if !(0.001..=0.1).contains(&cell) {
            return Err(DepthError::Cell { cell_m: cell });
        }
        let reach = checker.reach_m();
        let count = (2.0 * reach / (cell * f64::from(1 << BLOCK_BITS))).ceil() as u32;
        let margin = |is_robot: bool| if is_robot { settings.robot_margin_m } else { settings.known_margin_m };
        Ok(Self {
            grid: Grid { low: DVec3::splat(-reach), cells_per_m: 1.0 / cell, count: count << BLOCK_BITS },
            count,
            block_at: vec![0; (count as usize).pow(3)],
            blocks: Vec::new(),
            solids: checker.solids(config).map(|(solid, is_robot)| (solid, margin(is_robot))).collect(),
            near: Vec::new(),
            growth: MAX_ERROR_SIGMAS * settings.error_m,
        })
    }

    /// The point of a pixel if it is the first in its voxel and not on a known solid.
    fn new_point(&mut self, [x, y, z]: [u32; 3], depth_m: f32, point: impl Fn() -> DVec3) -> Option<DVec3> {
        let [bx, by, bz] = [x, y, z].map(|cell| (cell >> BLOCK_BITS) as usize);
        let count = self.count as usize;
        let place = (bz * count + by) * count + bx;
        let block = match self.block_at[place] {
            0 => self.add_block(place, [bx, by, bz]),
            index => index as usize - 1,
        };
        let inside = |cell: u32| cell & ((1 << BLOCK_BITS) - 1);
        let bit = (inside(z) << (2 * BLOCK_BITS) | inside(y) << BLOCK_BITS | inside(x)) as usize;
        let Block { seen, near: [first, end] } = &mut self.blocks[block];
        let (word, mask) = (&mut seen[bit / 64], 1 << (bit % 64));
        if *word & mask != 0 {
            return None;
        }
        *word |= mask;
        let point = point();
        let growth_m = self.growth * f64::from(depth_m).min(MAX_GROWTH_DEPTH_M).powi(2);
        let contains = |&index: &u32| {
            let (solid, margin) = &self.solids[index as usize];
            solid.is_within(point, margin + growth_m)
        };
        (!self.near[*first as usize..*end as usize].iter().any(contains)).then_some(point)
    }

    fn add_block(&mut self, place: usize, block: [usize; 3]) -> usize {
        let edge = f64::from(1 << BLOCK_BITS) / self.grid.cells_per_m;
        let center = self.grid.low + (DVec3::from_array(block.map(|index| index as f64)) + 0.5) * edge;
        let half_diagonal = 0.5 * 3.0_f64.sqrt() * edge;
        let first = self.near.len() as u32;
        for (index, (solid, margin)) in self.solids.iter().enumerate() {
            if !solid.is_surely_beyond(center, half_diagonal + margin + self.growth * MAX_GROWTH_DEPTH_M.powi(2)) {
                self.near.push(index as u32);
            }
        }
        self.blocks.push(Block { seen: [0; WORDS], near: [first, self.near.len() as u32] });
        self.block_at[place] = self.blocks.len() as u32;
        self.blocks.len() - 1
    }
}

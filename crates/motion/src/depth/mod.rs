//! From depth images to obstacles: points that nothing known explains.
//!
//! Every pixel becomes a point in the world; one point is kept per cell of a grid, and dropped again when it lies on
//! the robot, on what it carries or on an obstacle that is known already.
//! What is left is what the planner did not know about, as a cloud: the seen surfaces, not what is behind them.

mod pixels;
#[cfg(test)]
mod tests;

use genmanip_core::{Intrinsics, Pose, RgbdImage};
use glam::DVec3;
use serde::{Deserialize, Serialize};

use pixels::{Grid, View};

use crate::collision::{Checker, Solid, SurfaceError};

/// How depth images become a cloud.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthSettings {
    /// Edge of the cells of which each keeps one point, m.
    ///
    /// Together with radius and padding it decides how far a sharp corner of the robot can get between points: with
    /// points a cell apart, not to the surface as long as 0.7 cells are less than the radius and the padding.
    pub cell_m: f64,
    /// Radius of the balls that stand for the points, m.
    pub radius_m: f64,
    /// Points within this distance of the robot, or of what it carries, are its own, m.
    pub robot_margin_m: f64,
    /// Points within this distance of a known obstacle belong to it, m.
    pub known_margin_m: f64,
    /// Standard deviation of a measured depth of 1 m, m, which grows with the square of the depth: both margins grow by four
    /// of it. 0 for perfect depth.
    #[serde(default, skip_serializing_if = "is_perfect")]
    pub error_m: f64,
}

/// Errors of the depth by which a point may lie off the surface that it is of; one in some ten thousand lies farther.
const MOST_ERRORS: f64 = 4.0;
/// Depth beyond which margins do not grow any more, m: what is as far as that is out of the arm's reach.
const FARTHEST_M: f64 = 2.0;

#[expect(clippy::trivially_copy_pass_by_ref, reason = "what serde asks for")]
fn is_perfect(error_m: &f64) -> bool {
    *error_m == 0.0
}

impl Default for DepthSettings {
    fn default() -> Self {
        Self { cell_m: 0.007, radius_m: 0.002, robot_margin_m: 0.006, known_margin_m: 0.004, error_m: 0.0 }
    }
}

/// Depth images that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DepthError {
    /// The number of depths is not that of the pixels.
    #[error("depth image {image} has {got} depths, expected {width} x {height}")]
    Size {
        /// Index of the image.
        image: usize,
        /// Number of depths.
        got: usize,
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// A camera that is nowhere, or projects nothing.
    #[error("the camera of depth image {image} has a pose or a projection that is not finite, or no focal length")]
    Camera {
        /// Index of the image.
        image: usize,
    },
    /// An image that a lens bent.
    #[error("depth image {image} is bent by a lens, expected a pinhole's: `RgbdImage::pinhole_depth` makes one")]
    Lens {
        /// Index of the image.
        image: usize,
    },
    /// No image saw anything, so nothing is known about what stands around.
    #[error("no pixel of {images} depth images holds a depth: the robot would move blindly")]
    Blind {
        /// Number of images.
        images: usize,
    },
    /// A setting makes no sense.
    #[error("cells of {cell_m} m: expected 0.001 to 0.1 m")]
    Cell {
        /// The setting.
        cell_m: f64,
    },
    /// The joint positions of the robot in the images are not as many as its joints, or not finite.
    #[error("expected {expected} finite joint positions of the robot in the images, got {got:?}")]
    Configuration {
        /// Number of arm joints.
        expected: usize,
        /// What was given.
        got: Vec<f64>,
    },
    /// What is left cannot be a cloud.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}

/// Points in the world that neither the robot at `config` nor anything else that `checker` knows explains, thinned;
/// in the order of the pixels, those out of the robot's reach left out.
pub(crate) fn unexplained_points(
    checker: &Checker,
    config: &[f64],
    images: &[RgbdImage],
    settings: &DepthSettings,
) -> Result<Vec<DVec3>, DepthError> {
    let expected = checker.chain().dof();
    if config.len() != expected || !config.iter().all(|q| q.is_finite()) {
        return Err(DepthError::Configuration { expected, got: config.to_vec() });
    }
    let mut cells = Cells::new(checker, config, settings)?;
    let (mut points, mut of_row) = (Vec::new(), Vec::new());
    for (index, image) in images.iter().enumerate() {
        check(index, image)?;
        let (view, width) = (View::new(image), image.intrinsics.width as usize);
        for (row, depths) in image.depth_m.chunks_exact(width.max(1)).enumerate() {
            cells.grid.cells_of_row(&view, row, depths, &mut of_row);
            for &(column, cell) in &of_row {
                let depth_m = depths[column];
                points.extend(cells.new_point(cell, depth_m, || view.point(row, column, depth_m)));
            }
        }
    }
    let saw = images.iter().flat_map(|image| &image.depth_m).any(|depth_m| *depth_m > 0.0 && depth_m.is_finite());
    if saw { Ok(points) } else { Err(DepthError::Blind { images: images.len() }) }
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

/// Cells along the edge of a brick, as a power of two.
const BRICK_BITS: u32 = 3;
/// Words that hold a bit for each cell of a brick.
const WORDS: usize = (1 << (3 * BRICK_BITS)) / 64;

/// A sparse grid over the robot's reach that knows which cells were seen before, and what is known near them.
struct Cells<'a> {
    grid: Grid,
    /// Bricks along each axis.
    count: u32,
    /// Index into `bricks` plus one, for each brick of the grid; 0 where nothing was seen yet.
    brick_at: Vec<u32>,
    bricks: Vec<Brick>,
    solids: Vec<(Solid<'a>, f64)>,
    /// Growth of the margins with the square of the depth, 1/m.
    growth: f64,
    /// Indices of solids, brick after brick.
    near: Vec<u32>,
}

struct Brick {
    seen: [u64; WORDS],
    /// Range in `near`.
    near: [u32; 2],
}

impl<'a> Cells<'a> {
    fn new(checker: &'a Checker, config: &[f64], settings: &DepthSettings) -> Result<Self, DepthError> {
        let cell = settings.cell_m;
        if !(0.001..=0.1).contains(&cell) {
            return Err(DepthError::Cell { cell_m: cell });
        }
        let reach = checker.reach_m();
        let count = (2.0 * reach / (cell * f64::from(1 << BRICK_BITS))).ceil() as u32;
        let margin = |is_robot: bool| if is_robot { settings.robot_margin_m } else { settings.known_margin_m };
        Ok(Self {
            grid: Grid { low: DVec3::splat(-reach), cells_per_m: 1.0 / cell, count: count << BRICK_BITS },
            count,
            brick_at: vec![0; (count as usize).pow(3)],
            bricks: Vec::new(),
            solids: checker.solids(config).map(|(solid, is_robot)| (solid, margin(is_robot))).collect(),
            near: Vec::new(),
            growth: MOST_ERRORS * settings.error_m,
        })
    }

    /// The point of a pixel if it is the first in its cell and nothing known explains it.
    fn new_point(&mut self, [x, y, z]: [u32; 3], depth_m: f32, point: impl Fn() -> DVec3) -> Option<DVec3> {
        let [bx, by, bz] = [x, y, z].map(|cell| (cell >> BRICK_BITS) as usize);
        let count = self.count as usize;
        let place = (bz * count + by) * count + bx;
        let brick = match self.brick_at[place] {
            0 => self.add_brick(place, [bx, by, bz]),
            index => index as usize - 1,
        };
        let inside = |cell: u32| cell & ((1 << BRICK_BITS) - 1);
        let bit = (inside(z) << (2 * BRICK_BITS) | inside(y) << BRICK_BITS | inside(x)) as usize;
        let Brick { seen, near: [first, end] } = &mut self.bricks[brick];
        let (word, mask) = (&mut seen[bit / 64], 1 << (bit % 64));
        if *word & mask != 0 {
            return None;
        }
        *word |= mask;
        let point = point();
        let more = self.growth * f64::from(depth_m).min(FARTHEST_M).powi(2);
        let explains = |&index: &u32| {
            let (solid, margin) = &self.solids[index as usize];
            solid.is_within(point, margin + more)
        };
        (!self.near[*first as usize..*end as usize].iter().any(explains)).then_some(point)
    }

    fn add_brick(&mut self, place: usize, brick: [usize; 3]) -> usize {
        let edge = f64::from(1 << BRICK_BITS) / self.grid.cells_per_m;
        let center = self.grid.low + (DVec3::from_array(brick.map(|index| index as f64)) + 0.5) * edge;
        let half_diagonal = 0.5 * 3.0_f64.sqrt() * edge;
        let first = self.near.len() as u32;
        for (index, (solid, margin)) in self.solids.iter().enumerate() {
            if !solid.is_surely_beyond(center, half_diagonal + margin + self.growth * FARTHEST_M.powi(2)) {
                self.near.push(index as u32);
            }
        }
        self.bricks.push(Brick { seen: [0; WORDS], near: [first, self.near.len() as u32] });
        self.brick_at[place] = self.bricks.len() as u32;
        self.bricks.len() - 1
    }
}

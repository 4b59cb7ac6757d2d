//! Planar receivers: shadow masks on the horizontal tops of fixtures.
//!
//! On a plane, occluders between a texel of the shadow map and the light do not depend on the camera. Summed-area
//! tables (Crow, "Summed-Area Tables for Texture Mapping", 1984) give contact-hardening penumbrae (Fernando, 2005)
//! without noise, once for all cameras and updated only where the shadow map changed; a pixel interpolates four cells.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec2, Vec3};
use multiversion::multiversion;

use crate::gbuffer::points::{PixelCenters, Pixels, unpacked};
use crate::gbuffer::static_layer::{MarkCount, TILE};
use crate::gbuffer::view::CameraView;
use crate::lights::key_light::KeyLight;
use crate::raster::VisibilityBuffer;
use crate::scene::assets::{Part, RenderAssets};
use crate::simd::{BatchColumn, CHUNK, ZERO, floor, lerp, nearest_integer, turned, within};

use super::pcss::UNKNOWN;
use super::summed_area::SummedAreaTable;

/// Largest distance of a point from the plane [m]: rounding errors of depth.
const FLAT_M: f32 = 2e-4;
/// Smallest share of the bounding rectangle of the topmost triangles that they must fill. Chosen: legs are no
/// receivers.
const LEAST_COVER: f32 = 0.5;
/// Map size (texels) below which a cell is one texel, otherwise 2×2. Chosen: a cell is as large as a pixel of the
/// default static camera.
const LARGE_MAP: usize = 512;

/// Planar receivers of a scene.
#[derive(Debug, Default)]
pub(crate) struct PlanarReceivers {
    receivers: Vec<PlanarReceiver>,
    /// By surface number: index of its receiver plus one, 0 for none.
    of_surface: Vec<u8>,
    changes: MarkCount,
}

/// Horizontal top of a fixture.
#[derive(Debug)]
pub(crate) struct PlanarReceiver {
    /// Height in the world (m).
    height: f32,
    /// Cell column and row as linear functions of world x, y (m) and 1.
    cell_from_world: [[f32; 3]; 2],
    cells: SummedAreaTable,
    /// First block of 8×8 cells on the map, and number of blocks along both axes.
    first: [usize; 2],
    blocks: [usize; 2],
    /// Shadow mask at the centre of each cell.
    share: Vec<f32>,
    /// Range of the shadow mask by block.
    range: Vec<[f32; 2]>,
    /// Distance (cells) from each block within which occluders affect it.
    reach: Vec<usize>,
    /// Version of the shadow map in which each block last changed.
    changed_in: Vec<u64>,
}

/// First and last column and row of the blocks that some pixels read.
pub(crate) type Blocks = [[u16; 2]; 2];

impl PlanarReceivers {
    /// Receivers among the fixtures.
    pub fn new(assets: &RenderAssets, light: &KeyLight) -> Self {
        let mut own = Self { of_surface: vec![0; assets.parts.len() + 1], ..Self::default() };
        for (index, part) in assets.parts.iter().enumerate() {
            let known = u8::try_from(own.receivers.len() + 1).ok();
            if let (Some(number), Some(top)) = (known, PlanarReceiver::new(part, light)) {
                own.receivers.push(top);
                own.of_surface[index + 1] = number;
            }
        }
        own
    }

    /// Receiver of a surface number.
    pub fn of(&self, surface: u16) -> Option<&PlanarReceiver> {
        let number = *self.of_surface.get(usize::from(surface))?;
        self.receivers.get(usize::from(number).wrapping_sub(1))
    }

    /// Updates the receivers after the shadow map changed in some tiles.
    pub fn update(&mut self, map: &VisibilityBuffer, changed: &[bool], version: u64) {
        let tiles = map.width / TILE;
        self.changes.count(changed.iter().copied(), tiles, tiles);
        for top in &mut self.receivers {
            top.cells.follow(map, changed);
            top.follow(&self.changes, version);
        }
    }
}

impl PlanarReceiver {
    fn new(part: &Part, light: &KeyLight) -> Option<Self> {
        let (height, low, high) = horizontal_top(part)?;
        let plane = light.plane(height)?;
        let step = if light.size < LARGE_MAP { 1 } else { 2 };
        // The centre of a 2×2 cell is half a texel beyond that of its first texel.
        let cell = |[x, y, one]: [f32; 3]| {
            let step = step as f32;
            [x / step, y / step, (one - 0.5 * (step - 1.0)) / step]
        };
        let cell_from_world = [cell(plane.x), cell(plane.y)];
        let side = light.size / step;
        let corners =
            [low, Vec2::new(low.x, high.y), Vec2::new(high.x, low.y), high].map(|at| on_cells(&cell_from_world, at));
        let mut first = [0; 2];
        let mut blocks = [0; 2];
        for axis in 0..2 {
            let (from, to) =
                corners.iter().map(|corner| corner[axis]).fold((f32::MAX, f32::MIN), |(a, b), c| (a.min(c), b.max(c)));
            let from = (from.floor().max(0.0) as usize).min(side) / TILE;
            let to = ((to + 2.0).max(0.0) as usize).min(side).div_ceil(TILE);
            first[axis] = from;
            blocks[axis] = to.saturating_sub(from);
        }
        let count = blocks[0] * blocks[1];
        let cells = SummedAreaTable::new(step, plane.reversed_z, light, first, blocks);
        (count > 0).then(|| Self {
            height,
            cell_from_world,
            cells,
            first,
            blocks,
            share: vec![UNKNOWN; count * TILE * TILE],
            range: vec![[UNKNOWN; 2]; count],
            reach: vec![0; count],
            changed_in: vec![0; count],
        })
    }

    /// Cells per row.
    fn width(&self) -> usize {
        self.blocks[0] * TILE
    }

    fn follow(&mut self, changes: &MarkCount, version: u64) {
        // In map tiles: a block is one, or two along each axis.
        let step = self.cells.step as isize;
        let is_stale = |block: &usize| {
            let [column, row] = [self.first[0] + block % self.blocks[0], self.first[1] + block / self.blocks[0]];
            let from = [column as isize * step, row as isize * step];
            let to = from.map(|tile| tile + step - 1);
            let reach = (self.reach[*block] * self.cells.step).div_ceil(TILE) as isize;
            version == 1 || changes.any(from.map(|tile| tile - reach), to.map(|tile| tile + reach))
        };
        let stale: Vec<usize> = (0..self.range.len()).filter(is_stale).collect();
        let around = |place: &dyn Fn(usize) -> usize| {
            let places = || stale.iter().map(|&block| place(block));
            places().min().unwrap_or(0)..places().max().map_or(0, |last| last + 1)
        };
        if !stale.is_empty() {
            self.cells.add_up([around(&|block| block % self.blocks[0]), around(&|block| block / self.blocks[0])]);
        }
        stale.into_iter().for_each(|block| self.estimate(block, version));
    }

    /// Computes a block, and records a change.
    fn estimate(&mut self, block: usize, version: u64) {
        let width = self.width();
        let [column, row] = [block % self.blocks[0] * TILE, block / self.blocks[0] * TILE];
        let (shares, reach) = self.cells.shares(column, row);
        self.reach[block] = reach;
        let mut differs = false;
        for (step, line) in shares.iter().enumerate() {
            let out = &mut self.share[(row + step) * width + column..][..TILE];
            differs |= out != line;
            out.copy_from_slice(line);
        }
        if differs {
            self.changed_in[block] = version;
            self.range[block] = shares.iter().flatten().fold([1.0, 0.0], |range, &share| widened(range, [share; 2]));
        }
    }

    /// True if a point at a height (m) may lie on the receiver.
    #[inline(always)]
    pub fn holds(&self, height: f32) -> bool {
        (height - self.height).abs() < FLAT_M
    }

    /// Blocks read by pixels at some world positions (m).
    pub fn blocks_of(&self, places: impl Iterator<Item = Vec2>) -> Blocks {
        let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
        for place in places {
            let cell = on_cells(&self.cell_from_world, place);
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(cell[axis]), high[axis].max(cell[axis]));
            }
        }
        // More than rounding errors on both sides.
        let block = |axis: usize, cell: f32| {
            let last = (self.blocks[axis] * TILE - 1) as f32;
            (cell - (self.first[axis] * TILE) as f32).clamp(0.0, last) as u16 / TILE as u16
        };
        [[0, 1].map(|axis| block(axis, low[axis] - 0.01)), [0, 1].map(|axis| block(axis, high[axis] + 1.01))]
    }

    /// True if any of the blocks changed after a version.
    pub fn changed_after(&self, version: u64, blocks: Blocks) -> bool {
        self.each(blocks).any(|block| self.changed_in[block] > version)
    }

    /// The shadow mask if it is constant over some blocks.
    pub fn certain_share(&self, blocks: Blocks) -> Option<f32> {
        let [low, high] = self.each(blocks).map(|block| self.range[block]).fold([1.0, 0.0], widened);
        (low >= high).then_some(low)
    }

    fn each(&self, [from, to]: Blocks) -> impl Iterator<Item = usize> {
        let columns = self.blocks[0];
        (from[1]..=to[1])
            .flat_map(move |row| (from[0]..=to[0]).map(move |column| usize::from(row) * columns + usize::from(column)))
    }

    fn projection(&self, camera: &CameraView) -> CellProjection {
        let turn = [camera.turn.x_axis, camera.turn.y_axis, camera.turn.z_axis].map(|column| column.to_array());
        let size = [self.width(), self.blocks[1] * TILE];
        CellProjection {
            turn,
            viewpoint: camera.viewpoint.to_array(),
            inverse_focal: [1.0 / camera.focal.x, 1.0 / camera.focal.y],
            center: camera.center.to_array(),
            cell_from_world: std::array::from_fn(|axis| {
                let [x, y, one] = self.cell_from_world[axis];
                [x, y, one - (self.first[axis] * TILE) as f32]
            }),
            columns: size[0] as u32,
            last: size.map(|count| (count - 1) as f32),
        }
    }

    /// Writes the shadow mask of pixels on the receiver: whole tiles, given by their first pixels, and single ones.
    pub fn light(
        &self,
        [tiles, places]: [&[u32]; 2],
        centers: PixelCenters<'_>,
        camera: &CameraView,
        Reading { pixels, lanes }: &mut Reading,
        share: &mut [f32],
    ) {
        let (projection, width) = (self.projection(camera), centers.width);
        for &place in tiles {
            let [column, row] = unpacked(place).map(|at| at as usize);
            pixels.tile(place, centers);
            self.read(&projection, pixels, lanes);
            for (step, line) in lanes.share.as_chunks::<TILE>().0.iter().enumerate() {
                share[(row + step) * width + column..][..TILE].copy_from_slice(line);
            }
        }
        for places in places.chunks(CHUNK) {
            pixels.list(places, centers);
            self.read(&projection, pixels, lanes);
            for (&value, &pixel) in lanes.share.iter().zip(&pixels.pixel).take(pixels.count) {
                share[pixel as usize] = value;
            }
        }
    }

    /// Interpolates the shadow mask of a batch of pixels.
    fn read(&self, projection: &CellProjection, pixels: &Pixels, reading: &mut Lanes) {
        let width = self.width();
        find_cells(projection, pixels, reading);
        for i in 0..pixels.count {
            let index = reading.index[i] as usize;
            let (upper, lower) = (&self.share[index..], &self.share[index + width..]);
            if let ([a, b, ..], [c, d, ..]) = (upper, lower) {
                (reading.corners[0][i], reading.corners[1][i]) = (*a, *b);
                (reading.corners[2][i], reading.corners[3][i]) = (*c, *d);
            }
        }
        mix(reading);
    }
}

/// Height and corners of the horizontal top of a fixture, in the world.
pub(crate) fn horizontal_top(part: &Part) -> Option<(f32, Vec2, Vec2)> {
    let mesh = &*part.mesh;
    let height = mesh.positions.iter().map(|place| place.z).reduce(f32::max)?;
    let (mut low, mut high, mut area) = (Vec2::INFINITY, Vec2::NEG_INFINITY, 0.0);
    for triangle in &mesh.triangles {
        let corners = triangle.map(|corner| mesh.positions[corner as usize]);
        if corners.iter().all(|corner| height - corner.z < 1e-6) {
            let [a, b, c] = corners.map(Vec3::truncate);
            (low, high) = (low.min(a.min(b).min(c)), high.max(a.max(b).max(c)));
            area += 0.5 * (b - a).perp_dot(c - a).abs();
        }
    }
    let is_top = part.body.is_none() && !part.is_transparent() && area > LEAST_COVER * (high - low).element_product();
    is_top.then_some((height, low, high))
}

/// Cell column and row of a world position.
fn on_cells(cell_from_world: &[[f32; 3]; 2], place: Vec2) -> [f32; 2] {
    cell_from_world.map(|[x, y, one]| x * place.x + y * place.y + one)
}

fn widened([low, high]: [f32; 2], [a, b]: [f32; 2]) -> [f32; 2] {
    [if a < low { a } else { low }, if b > high { b } else { high }]
}

/// Scratch memory of [`PlanarReceiver::light`].
#[derive(Debug, Default)]
pub(crate) struct Reading {
    pixels: Pixels,
    lanes: Lanes,
}

/// Cells read by a batch of pixels.
#[derive(Debug)]
struct Lanes {
    index: [u32; CHUNK],
    /// Interpolation weights between the four cells.
    x: BatchColumn,
    y: BatchColumn,
    corners: [BatchColumn; 4],
    share: BatchColumn,
}

impl Default for Lanes {
    fn default() -> Self {
        Self { index: [0; CHUNK], x: ZERO, y: ZERO, corners: [ZERO; 4], share: ZERO }
    }
}

/// Projection of pixels onto the cells of a receiver.
struct CellProjection {
    turn: [[f32; 3]; 3],
    viewpoint: [f32; 3],
    inverse_focal: [f32; 2],
    center: [f32; 2],
    /// Cell column and row as linear functions of world x, y and 1.
    cell_from_world: [[f32; 3]; 2],
    columns: u32,
    /// Last column and row.
    last: [f32; 2],
}

impl CellProjection {
    /// Cell column and row of a pixel at a depth.
    #[inline(always)]
    fn cell(&self, column: f32, row: f32, depth: f32) -> [f32; 2] {
        let x = (column - self.center[0]) * self.inverse_focal[0] * depth;
        let y = (row - self.center[1]) * self.inverse_focal[1] * depth;
        let place = |axis: usize| turned(&self.turn, axis, [x, y, depth]) + self.viewpoint[axis];
        let place = [place(0), place(1)];
        let cell = |axis: usize| {
            let [x, y, one] = self.cell_from_world[axis];
            within(x.mul_add(place[0], y.mul_add(place[1], one)), 0.0, self.last[axis])
        };
        [cell(0), cell(1)]
    }

    /// Index of the first of the four cells around a position, and interpolation weights.
    #[inline(always)]
    fn split(&self, [column, row]: [f32; 2]) -> (u32, [f32; 2]) {
        let first = |at: f32, axis: usize| within(floor(at), 0.0, self.last[axis] - 1.0);
        let (left, top) = (first(column, 0), first(row, 1));
        (nearest_integer(top) * self.columns + nearest_integer(left), [column - left, row - top])
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn find_cells(projection: &CellProjection, pixels: &Pixels, reading: &mut Lanes) {
    for i in 0..CHUNK {
        let (index, [x, y]) = projection.split(projection.cell(pixels.column[i], pixels.row[i], pixels.depth[i]));
        (reading.index[i], reading.x[i], reading.y[i]) = (index, x, y);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn mix(reading: &mut Lanes) {
    let [a, b, c, d] = &reading.corners;
    for i in 0..CHUNK {
        let (upper, lower) = (lerp(a[i], b[i], reading.x[i]), lerp(c[i], d[i], reading.x[i]));
        reading.share[i] = lerp(upper, lower, reading.y[i]);
    }
}

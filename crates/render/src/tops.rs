//! Key light on the level tops of fixed things, above all on the table, which fills most of a picture.
//!
//! On a plane, what is between a texel of the shadow map and the light does not depend on who asks. Sums over rectangles
//! of texels (Crow, "Summed-Area Tables for Texture Mapping", 1984) therefore give contact-hardening soft edges
//! (Fernando, "Percentage-Closer Soft Shadows", 2005) without noise, once for all cameras; what did not change is kept from
//! frame to frame, and a pixel reads the four cells around it.

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use glam::{Vec2, Vec3};
use multiversion::multiversion;

use crate::assets::{Part, RenderAssets};
use crate::lanes::{CHUNK, Lane, ZERO, floor, nearest_integer, within};
use crate::layers::{MarkCount, TILE};
use crate::points::Pixels;
use crate::raster::Target;
use crate::refine::UNKNOWN;
use crate::shadow::{MAX_RADIUS, ShadowMap};
use crate::taps::GLASS_SHADE;
use crate::view::Lens;

/// How far from its plane a point of a top may be found, metres: the rounding of depths at some metres.
const FLAT_M: f32 = 2e-4;
/// Share of the box around the triangles at the greatest height that a top covers at least. Chosen: legs are no top.
const LEAST_COVER: f32 = 0.5;
/// Maps with fewer texels per side have a cell per texel, others per 2 × 2. Chosen: a cell is as large as a pixel of the
/// default static camera.
const LARGE_MAP: usize = 512;
/// Half the side of the square with the area of a disc, over its radius.
const SQUARE: f32 = 0.886_227;
/// What an opaque texel adds to a sum of what is covered.
const FULL: u32 = 10;
/// Steps of distances per metre in sums.
const STEPS_PER_M: f32 = 1024.0;
/// Bits of the covered texels in a cell and in a sum; those above hold distances.
const CELL_BITS: u32 = 8;
const COVER_BITS: u32 = 24;

/// The tops of a scene.
#[derive(Debug, Default)]
pub(crate) struct Tops {
    tops: Vec<Top>,
    /// By part, plus one: index of its top, plus one; 0 for none.
    of_surface: Vec<u8>,
    changes: MarkCount,
}

/// The top of one part.
#[derive(Debug)]
pub(crate) struct Top {
    /// World frame, metres.
    height: f32,
    /// From x and y in the world, metres, and 1 to column and row of a cell.
    cell_from_world: [[f32; 3]; 2],
    cells: Cells,
    /// First block of 8 × 8 cells on the map, and columns and rows of blocks.
    first: [usize; 2],
    blocks: [usize; 2],
    /// Share of the key light at the middle of each cell.
    share: Vec<f32>,
    /// Extremes by block.
    range: Vec<[f32; 2]>,
    /// Version of the shadow map in which each block changed last.
    changed_in: Vec<u64>,
}

/// What lies between a plane and the light: cells of the top and so many around them that every square fits.
#[derive(Debug)]
struct Cells {
    /// Texels along a side of a cell, and cells along a side of the map.
    step: usize,
    side: usize,
    /// Of the plane at a texel: at the first one, and what a column and a row add.
    nearness: [f32; 3],
    /// Cells beside those of the top, whole tiles of the map.
    margin: usize,
    /// First column and row, with the margin; they may lie beyond the map, where nothing is covered.
    first: [isize; 2],
    columns: usize,
    rows: usize,
    /// Covered texels and their distances by cell, see [`cover_tile`].
    covered: Vec<u32>,
    /// Sums of all cells above and to the left; a row and a column more than cells.
    sums: Vec<u64>,
    /// Half the side of the square in which blockers are looked for, cells.
    search: usize,
    /// Radius of a soft edge per metre of distance, texels.
    radius_per_m: f32,
    /// One over what a square is full of, by half its side in cells.
    inverse_full: Vec<f32>,
}

/// Blocks of a top that pixels read: first and last column and row.
pub(crate) type Blocks = [[isize; 2]; 2];

impl Tops {
    /// The tops of the fixed parts that a map covers.
    pub fn new(assets: &RenderAssets, shadow: &ShadowMap) -> Self {
        let mut own = Self { of_surface: vec![0; assets.parts.len() + 1], ..Self::default() };
        for (index, part) in assets.parts.iter().enumerate() {
            let known = u8::try_from(own.tops.len() + 1).ok();
            if let (Some(number), Some(top)) = (known, Top::new(part, shadow)) {
                own.tops.push(top);
                own.of_surface[index + 1] = number;
            }
        }
        own
    }

    /// The top of a part, by the number of its surface.
    pub fn of(&self, surface: u16) -> Option<&Top> {
        let number = *self.of_surface.get(usize::from(surface))?;
        self.tops.get(usize::from(number).wrapping_sub(1))
    }

    /// Follows the last update of a map, of which some tiles changed.
    pub fn update(&mut self, map: &Target, changed: &[bool], version: u64) {
        let tiles = map.width / TILE;
        self.changes.count(changed.iter().copied(), tiles, tiles);
        for top in &mut self.tops {
            top.cells.follow(map, changed);
            top.follow(&self.changes, version);
        }
    }
}

impl Top {
    fn new(part: &Part, shadow: &ShadowMap) -> Option<Self> {
        let (height, low, high) = level_top(part)?;
        let plane = shadow.plane(height)?;
        let step = if shadow.size() < LARGE_MAP { 1 } else { 2 };
        // The middle of a cell of two texels is half a texel beyond the first one's.
        let cell = |[x, y, one]: [f32; 3]| {
            let step = step as f32;
            [x / step, y / step, (one - 0.5 * (step - 1.0)) / step]
        };
        let cell_from_world = [cell(plane.x), cell(plane.y)];
        let side = shadow.size() / step;
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
        let cells = Cells::new(step, plane.nearness, shadow, first, blocks);
        (count > 0).then(|| Self {
            height,
            cell_from_world,
            cells,
            first,
            blocks,
            share: vec![UNKNOWN; count * TILE * TILE],
            range: vec![[UNKNOWN; 2]; count],
            changed_in: vec![0; count],
        })
    }

    /// Cells per row.
    fn width(&self) -> usize {
        self.blocks[0] * TILE
    }

    fn follow(&mut self, changes: &MarkCount, version: u64) {
        // In tiles of the map: a block is one, or two along each axis.
        let step = self.cells.step as isize;
        let reach = |texels: f32| (texels / TILE as f32).ceil() as isize;
        let (far, near) = (reach(MAX_RADIUS), reach(((self.cells.search + 1) * self.cells.step) as f32));
        for block in 0..self.range.len() {
            let [column, row] = [self.first[0] + block % self.blocks[0], self.first[1] + block / self.blocks[0]];
            let from = [column as isize * step, row as isize * step];
            let to = from.map(|tile| tile + step - 1);
            // Where nothing is between all points and the light, only what is looked for may change that.
            let reach = if self.range[block] == [1.0; 2] { near } else { far };
            if version == 1 || changes.any(from.map(|tile| tile - reach), to.map(|tile| tile + reach)) {
                self.estimate(block, version);
            }
        }
    }

    /// Estimates a block, and remembers whether it changed.
    fn estimate(&mut self, block: usize, version: u64) {
        let width = self.width();
        let [column, row] = [block % self.blocks[0] * TILE, block / self.blocks[0] * TILE];
        let shares = self.cells.shares(column, row);
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

    /// Whether a point of the world, metres, may lie on the top.
    #[inline(always)]
    pub fn holds(&self, height: f32) -> bool {
        (height - self.height).abs() < FLAT_M
    }

    /// The blocks that pixels read which see places of the top, metres.
    pub fn blocks_of(&self, places: impl Iterator<Item = Vec2>) -> Blocks {
        let (mut low, mut high) = ([f32::MAX; 2], [f32::MIN; 2]);
        for place in places {
            let cell = on_cells(&self.cell_from_world, place);
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(cell[axis]), high[axis].max(cell[axis]));
            }
        }
        // A little more on both sides than rounding can miss.
        let block = |axis: usize, cell: f32| {
            let last = (self.blocks[axis] * TILE - 1) as f32;
            (cell - (self.first[axis] * TILE) as f32).clamp(0.0, last) as isize / TILE as isize
        };
        [[0, 1].map(|axis| block(axis, low[axis] - 0.01)), [0, 1].map(|axis| block(axis, high[axis] + 1.01))]
    }

    /// Whether any of some blocks changed after a version of the shadow map.
    pub fn changed_after(&self, version: u64, blocks: Blocks) -> bool {
        self.each(blocks).any(|block| self.changed_in[block] > version)
    }

    /// The one share all over some blocks, if it is one.
    pub fn certain_share(&self, blocks: Blocks) -> Option<f32> {
        let [low, high] = self.each(blocks).map(|block| self.range[block]).fold([1.0, 0.0], widened);
        (low >= high).then_some(low)
    }

    fn each(&self, [from, to]: Blocks) -> impl Iterator<Item = usize> {
        let columns = self.blocks[0];
        (from[1]..=to[1])
            .flat_map(move |row| (from[0]..=to[0]).map(move |column| row as usize * columns + column as usize))
    }

    /// Writes the share of the key light that arrives at pixels which see the top.
    pub fn light(&self, pixels: &Pixels, lens: &Lens, reading: &mut Reading, share: &mut [f32]) {
        let width = self.width();
        let rows: [[f32; 3]; 2] = std::array::from_fn(|axis| {
            let [x, y, one] = self.cell_from_world[axis];
            [x, y, one - (self.first[axis] * TILE) as f32]
        });
        find_cells(&rows, [width, self.blocks[1] * TILE], pixels, lens, reading);
        for i in 0..pixels.count {
            let index = reading.index[i] as usize;
            let (upper, lower) = (&self.share[index..], &self.share[index + width..]);
            if let ([a, b, ..], [c, d, ..]) = (upper, lower) {
                (reading.corners[0][i], reading.corners[1][i]) = (*a, *b);
                (reading.corners[2][i], reading.corners[3][i]) = (*c, *d);
            }
        }
        mix(reading);
        if pixels.is_tile {
            for (values, &first) in reading.share.chunks_exact(TILE).zip(pixels.pixel.iter().step_by(TILE)) {
                share[first as usize..][..TILE].copy_from_slice(values);
            }
        } else {
            for (&value, &pixel) in reading.share.iter().zip(&pixels.pixel).take(pixels.count) {
                share[pixel as usize] = value;
            }
        }
    }
}

/// Height, and low and high corner of the level top of a fixed part, world frame.
fn level_top(part: &Part) -> Option<(f32, Vec2, Vec2)> {
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

/// Column and row of a place in the world among cells.
fn on_cells(cell_from_world: &[[f32; 3]; 2], place: Vec2) -> [f32; 2] {
    cell_from_world.map(|[x, y, one]| x * place.x + y * place.y + one)
}

fn widened([low, high]: [f32; 2], [a, b]: [f32; 2]) -> [f32; 2] {
    [if a < low { a } else { low }, if b > high { b } else { high }]
}

impl Cells {
    fn new(step: usize, nearness: [f32; 3], shadow: &ShadowMap, first: [usize; 2], blocks: [usize; 2]) -> Self {
        let search = half_side(shadow.search_radius() / step as f32).round() as usize;
        let widest = half_side(MAX_RADIUS / step as f32) as usize + 1;
        let margin = widest.max(search).next_multiple_of(TILE);
        let [columns, rows] = blocks.map(|blocks| blocks * TILE + 2 * margin);
        let full = |half: usize| ((2 * half + 1) * (2 * half + 1) * step * step) as f32 * FULL as f32;
        Self {
            step,
            side: shadow.size() / step,
            nearness,
            margin,
            first: first.map(|block| (block * TILE) as isize - margin as isize),
            covered: vec![0; columns * rows],
            sums: vec![0; (columns + 1) * (rows + 1)],
            columns,
            rows,
            search,
            radius_per_m: shadow.radius_per_m(),
            inverse_full: (0..=widest.max(search)).map(|half| 1.0 / full(half)).collect(),
        }
    }

    /// Reads the tiles of a map that changed.
    fn follow(&mut self, map: &Target, changed: &[bool]) {
        let (tiles, in_tile) = (map.width / TILE, TILE / self.step);
        let mut first_changed: Option<[usize; 2]> = None;
        let [from_column, from_row] = self.first.map(|first| first.max(0) as usize / in_tile);
        let end = |axis: usize, count: usize| (self.first[axis] + count as isize).max(0) as usize;
        let end = |axis: usize, count: usize| self.side.min(end(axis, count)).div_ceil(in_tile);
        let (end_column, end_row) = (end(0, self.columns), end(1, self.rows));
        for tile_row in from_row..end_row {
            for tile_column in from_column..end_column {
                if changed[tile_row * tiles + tile_column] {
                    self.read_tile(map, tile_column, tile_row);
                    let cell = [tile_column, tile_row].map(|tile| (tile * in_tile) as isize);
                    let cell = [0, 1].map(|axis| (cell[axis] - self.first[axis]).max(0) as usize);
                    let [column, row] = first_changed.unwrap_or(cell);
                    first_changed = Some([column.min(cell[0]), row.min(cell[1])]);
                }
            }
        }
        if let Some([column, row]) = first_changed {
            self.add_up(column, row);
        }
    }

    fn read_tile(&mut self, map: &Target, tile_column: usize, tile_row: usize) {
        let [at, per_column, per_row] = self.nearness;
        let (x, y) = (tile_column * TILE, tile_row * TILE);
        let plane = [at + per_column * x as f32 + per_row * y as f32, per_column, per_row];
        let cells = cover_tile(&map.nearness[y * map.stride + x..], map.stride, plane, self.step);
        let in_tile = TILE / self.step;
        for (dy, line) in cells.chunks_exact(in_tile).take(in_tile).enumerate() {
            let row = (tile_row * in_tile + dy) as isize - self.first[1];
            let column = (tile_column * in_tile) as isize - self.first[0];
            // The margin is made of whole tiles.
            if let (Ok(row), Ok(column)) = (usize::try_from(row), usize::try_from(column))
                && row < self.rows
                && column + in_tile <= self.columns
            {
                self.covered[row * self.columns + column..][..in_tile].copy_from_slice(line);
            }
        }
    }

    /// Sums from a column and a row on.
    fn add_up(&mut self, first_column: usize, first_row: usize) {
        let width = self.columns + 1;
        for row in first_row..self.rows {
            let (above, own) = self.sums[row * width..].split_at_mut(width);
            let mut sum = own[first_column] - above[first_column];
            let covered = &self.covered[row * self.columns..][first_column..self.columns];
            for ((own, above), &covered) in
                own[first_column + 1..].iter_mut().zip(&above[first_column + 1..]).zip(covered)
            {
                sum += u64::from(covered >> CELL_BITS) << COVER_BITS | u64::from(covered & ((1 << CELL_BITS) - 1));
                *own = above + sum;
            }
        }
    }

    /// Covered texels and their distances in a rectangle of cells from a first one on.
    #[inline(always)]
    fn within(&self, [x, y]: [usize; 2], side: usize) -> u64 {
        let width = self.columns + 1;
        let (top, bottom) = (y * width + x, (y + side) * width + x);
        self.sums[bottom + side] + self.sums[top] - self.sums[bottom] - self.sums[top + side]
    }

    /// Shares of the key light that reach the middles of the cells of a block of the top.
    fn shares(&self, column: usize, row: usize) -> [[f32; TILE]; TILE] {
        let [x, y] = [column + self.margin, row + self.margin];
        let around = |half: usize| unpack(self.within([x - half, y - half], TILE + 2 * half)).0;
        if around(self.search) == 0 {
            return [[1.0; TILE]; TILE];
        }
        let widest = self.inverse_full.len() - 1;
        let texels = ((TILE + 2 * widest) * self.step) as u32;
        if around(widest) == texels * texels * FULL {
            return [[0.0; TILE]; TILE];
        }
        let (width, half) = (self.columns + 1, self.search);
        let first = (y - half) * width + x - half;
        let found = search_block(&self.sums[first..], width, 2 * half + 1);
        let mut shares = [[1.0; TILE]; TILE];
        for (dy, line) in found.iter().enumerate() {
            for (dx, &sum) in line.iter().enumerate() {
                if sum > 0 {
                    shares[dy][dx] = self.share(x + dx, y + dy, sum);
                }
            }
        }
        shares
    }

    /// Share of the key light that reaches the middle of a cell, before which something was found.
    #[inline(always)]
    fn share(&self, x: usize, y: usize, found: u64) -> f32 {
        let (cover, distance) = unpack(found);
        let mean = distance as f32 / (cover as f32 * STEPS_PER_M);
        let half = half_side(within(mean * self.radius_per_m, 1.2, MAX_RADIUS) / self.step as f32);
        let half = if half > 0.0 { half } else { 0.0 };
        let whole = nearest_integer(floor(half)) as usize;
        let lit = |half: usize| {
            let (cover, _) = unpack(self.within([x - half, y - half], 2 * half + 1));
            1.0 - cover as f32 * self.inverse_full[half]
        };
        let (inner, outer) = (lit(whole), lit(whole + 1));
        inner + (outer - inner) * (half - whole as f32)
    }
}

/// What squares of so many cells around those of a block hold; `sums` start at the first square's corner.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn search_block(sums: &[u64], width: usize, side: usize) -> [[u64; TILE]; TILE] {
    let mut found = [[0; TILE]; TILE];
    for (row, line) in found.iter_mut().enumerate() {
        let (top, bottom) = (&sums[row * width..], &sums[(row + side) * width..]);
        let corners = [&top[..TILE], &top[side..][..TILE], &bottom[..TILE], &bottom[side..][..TILE]];
        for cell in 0..TILE {
            line[cell] = corners[3][cell] + corners[0][cell] - corners[2][cell] - corners[1][cell];
        }
    }
    found
}

/// How many cells beside the middle one are in the square with the area of a disc of a radius in cells.
fn half_side(radius: f32) -> f32 {
    SQUARE * radius - 0.5
}

fn unpack(sum: u64) -> (u32, u32) {
    ((sum & ((1 << COVER_BITS) - 1)) as u32, (sum >> COVER_BITS) as u32)
}

/// Covered texels, [`FULL`] for each opaque one, in the lowest [`CELL_BITS`] of the cells of a tile of the map, row by row;
/// above them their distances in [`STEPS_PER_M`], each as many times as its texel counts.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn cover_tile(map: &[f32], stride: usize, [at, per_column, per_row]: [f32; 3], step: usize) -> [u32; TILE * TILE] {
    const GLASS: u32 = (GLASS_SHADE * FULL as f32) as u32;
    let mut texels = [[0_u32; TILE]; TILE];
    for (row, line) in texels.iter_mut().enumerate() {
        let stored = &map[row * stride..][..TILE];
        let first = at + per_row * row as i32 as f32;
        for column in 0..TILE {
            let ahead = stored[column] - (first + per_column * column as i32 as f32);
            let weight = if stored[column].to_bits() & 1 == 1 { GLASS } else { FULL };
            let distance = nearest_integer(within(ahead, 0.0, 4.0) * STEPS_PER_M) * weight;
            line[column] = if ahead > 0.0 { distance << CELL_BITS | weight } else { 0 };
        }
    }
    if step == 1 {
        return std::array::from_fn(|cell| texels[cell / TILE][cell % TILE]);
    }
    const IN_TILE: usize = TILE / 2;
    let mut cells = [0; TILE * TILE];
    for row in 0..IN_TILE {
        for column in 0..IN_TILE {
            let pair = |row: usize| texels[row][2 * column] + texels[row][2 * column + 1];
            cells[row * IN_TILE + column] = pair(2 * row) + pair(2 * row + 1);
        }
    }
    cells
}

/// Where a chunk of pixels reads a top, and what it reads.
#[derive(Debug)]
pub(crate) struct Reading {
    index: [u32; CHUNK],
    /// How far a pixel's place lies from the first of its four cells towards the others.
    x: Lane,
    y: Lane,
    corners: [Lane; 4],
    share: Lane,
}

impl Default for Reading {
    fn default() -> Self {
        Self { index: [0; CHUNK], x: ZERO, y: ZERO, corners: [ZERO; 4], share: ZERO }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn find_cells(
    cell_from_world: &[[f32; 3]; 2],
    [columns, rows]: [usize; 2],
    pixels: &Pixels,
    lens: &Lens,
    reading: &mut Reading,
) {
    let turn = [lens.turn.x_axis, lens.turn.y_axis, lens.turn.z_axis].map(|column| column.to_array());
    let eye = lens.eye.to_array();
    let (inverse_x, inverse_y) = (1.0 / lens.focal.x, 1.0 / lens.focal.y);
    let (center_x, center_y) = (lens.center.x, lens.center.y);
    let limit = [(columns - 1) as i32 as f32, (rows - 1) as i32 as f32];
    let [by_column, by_row] = cell_from_world;
    for i in 0..CHUNK {
        let depth = pixels.depth[i];
        let (x, y) =
            ((pixels.column[i] - center_x) * inverse_x * depth, (pixels.row[i] - center_y) * inverse_y * depth);
        let place = |axis: usize| turn[0][axis] * x + turn[1][axis] * y + turn[2][axis] * depth + eye[axis];
        let place = [place(0), place(1)];
        let cell = |row: &[f32; 3], limit: f32| within(row[0] * place[0] + row[1] * place[1] + row[2], 0.0, limit);
        let (column, row) = (cell(by_column, limit[0]), cell(by_row, limit[1]));
        let (left, top) = (within(floor(column), 0.0, limit[0] - 1.0), within(floor(row), 0.0, limit[1] - 1.0));
        (reading.x[i], reading.y[i]) = (column - left, row - top);
        reading.index[i] = nearest_integer(top) * columns as u32 + nearest_integer(left);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn mix(reading: &mut Reading) {
    let [a, b, c, d] = &reading.corners;
    for i in 0..CHUNK {
        let upper = a[i] + (b[i] - a[i]) * reading.x[i];
        let lower = c[i] + (d[i] - c[i]) * reading.x[i];
        reading.share[i] = upper + (lower - upper) * reading.y[i];
    }
}

//! Shadows of the key light: a depth map seen from the light, read with contact-hardening soft edges
//! (Fernando, "Percentage-Closer Soft Shadows", 2005).

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use genmanip_core::Pose;
use glam::{Mat3A, Vec2, Vec3A};
use multiversion::multiversion;

use crate::assets::RenderAssets;
use crate::job::FrameState;
use crate::layers::{Layers, Motion, Rectangle, TILE};
use crate::mesh::Mesh;
use crate::points::{CHUNK, Points};
use crate::raster::{Corner, Target, nearest_integer, within};
use crate::variation::RenderVariation;
use crate::view::rotation;

/// Largest radius of a soft edge, texels.
const MAX_RADIUS: f32 = 30.0;
/// Taps of the search for blockers and of the filter.
const TAPS: usize = 8;
/// Turns of the taps.
pub(crate) const TURNS: usize = 16;

/// What the key light sees.
#[derive(Debug, Default)]
pub(crate) struct ShadowMap {
    layers: Layers,
    casters: Vec<Caster>,
    motions: Vec<Motion>,
    /// Smallest nearness of each tile and, over its surroundings, whatever a point there may look up.
    lowest: Vec<f32>,
    /// Largest one likewise.
    highest: Vec<f32>,
    own: [Vec<f32>; 2],
    /// Counts the updates.
    version: u64,
    /// The version in which each tile changed last.
    changed_in: Vec<u64>,
    light: Light,
}

/// The light's axes and the scale of the map.
#[derive(Clone, Copy, Debug, Default)]
struct Light {
    size: usize,
    /// Rows: the light's right, down and forward axes in the world.
    light_from_world: Mat3A,
    center: Vec3A,
    radius: f32,
    texels_per_m: f32,
    spread: f32,
}

#[derive(Clone, Debug, Default)]
struct Caster {
    pose: Pose,
    corners: Vec<Corner>,
}

/// Points that may lie in a soft edge, component by component.
#[derive(Debug, Default)]
pub(crate) struct Doubts {
    pixel: Vec<u32>,
    /// x, y, nearness, tilt along x and y, cosine and sine of the taps' turn, and the radius of the filter.
    values: [Vec<f32>; 8],
}

impl ShadowMap {
    /// Whether there is a map at all.
    pub fn is_on(&self) -> bool {
        self.light.size > 0
    }

    /// Counts the updates so far.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Draws everything that casts a shadow at a frame, `size` texels wide; what rests is kept from the last time.
    pub fn update(
        &mut self,
        assets: &RenderAssets,
        frame: &FrameState,
        variation: &RenderVariation,
        size: usize,
        level: usize,
    ) {
        self.version += 1;
        let size = size / TILE * TILE;
        let is_new = self.version == 1;
        self.light = Light::new(variation, size);
        if size == 0 {
            return;
        }
        self.casters.resize_with(assets.parts.len(), Caster::default);
        self.motions.resize_with(assets.parts.len(), Motion::default);
        for ((part, caster), motion) in assets.parts.iter().zip(&mut self.casters).zip(&mut self.motions) {
            if !(part.casts_shadow && part.surface.opacity >= 0.5) {
                continue;
            }
            let pose = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
            motion.moved = is_new || caster.pose != pose;
            motion.before.clone_from(&motion.now);
            if motion.moved {
                motion.now = caster.place(part.mesh.at_level(level), pose, &self.light);
            }
        }
        let casters = &self.casters;
        let draw = |part: usize, target: &mut Target| {
            let mesh = assets.parts[part].mesh.at_level(level);
            draw_casters(mesh, &casters[part].corners, mesh.closed, target);
        };
        if is_new {
            self.layers.redraw::<false>([size, size], 1, casters.len(), draw);
            self.changed_in.resize(self.layers.changed.len(), 0);
        } else {
            self.layers.follow::<false>(&self.motions, draw);
        }
        if self.layers.changed.contains(&true) {
            for (changed_in, _) in self.changed_in.iter_mut().zip(&self.layers.changed).filter(|(_, changed)| **changed)
            {
                *changed_in = self.version;
            }
            self.summarise();
        }
    }

    /// Tiles that changed after a version, row by row, and the number of tiles per row.
    pub fn changed_after(&self, version: u64) -> (impl Iterator<Item = bool>, usize) {
        (self.changed_in.iter().map(move |&changed_in| changed_in > version), self.layers.tile_columns)
    }

    /// The tiles, first and last column and row, on which the shadow at any of some points depends.
    pub fn tiles_of(&self, points: impl Iterator<Item = Vec3A>) -> [[isize; 2]; 2] {
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for point in points {
            let place = self.light.on_map(self.light.light_from_world * point);
            let place = Vec2::new(place.x, place.y);
            (low, high) = (low.min(place), high.max(place));
        }
        // The lift along the normal is at most two texels; the extremes reach four tiles beyond the point's own.
        let tile = |value: f32| (value.clamp(-1e6, 1e6) / TILE as f32).floor() as isize;
        [[tile(low.x - 2.0) - 4, tile(low.y - 2.0) - 4], [tile(high.x + 2.0) + 4, tile(high.y + 2.0) + 4]]
    }

    /// Share of the key light that reaches points, 0-1, where it is certain; lists the others as doubts.
    pub fn judge(&self, points: &Points, share: &mut [f32], doubts: &mut Doubts) {
        let mut places = Places::default();
        place_points(&self.light, points, &mut places);
        let limit = self.light.size as f32 - 1.0;
        for i in 0..points.count {
            let pixel = points.pixel[i] as usize;
            let (x, y) = (places.x[i], places.y[i]);
            if !(x >= 0.0 && y >= 0.0 && x <= limit && y <= limit) {
                share[pixel] = 1.0;
                continue;
            }
            let tile = y as usize / TILE * self.layers.tile_columns + x as usize / TILE;
            let (nearness, slack) = (places.nearness[i], places.slack[i]);
            share[pixel] = if self.highest[tile] <= nearness - slack {
                1.0
            } else if self.lowest[tile] >= nearness + slack {
                0.0
            } else {
                let (sine, cosine) = turn_of(points.turn[i]);
                doubts.pixel.push(points.pixel[i]);
                let values = [x, y, nearness, places.tilt_x[i], places.tilt_y[i], cosine, sine, 0.0];
                doubts.values.iter_mut().zip(values).for_each(|(list, value)| list.push(value));
                1.0
            };
        }
    }

    /// Resolves doubts with taps on the map.
    pub fn settle(&self, doubts: &mut Doubts, share: &mut [f32]) {
        let search = (self.light.spread * 0.5 * self.light.texels_per_m).clamp(2.0, MAX_RADIUS);
        let count = doubts.pixel.len();
        doubts.values.iter_mut().for_each(|list| list.resize(count.next_multiple_of(CHUNK), 0.0));
        let mut taps = Taps::default();
        for first in (0..count).step_by(CHUNK) {
            let values = doubts.values.each_ref().map(|list| chunk_at(list, first));
            let here = CHUNK.min(count - first);
            self.tap(&values, &[search; CHUNK], here, &mut taps);
            let mut radius = [0.0; CHUNK];
            let mut any = false;
            for i in 0..here {
                any |= taps.blockers[i] > 0.0;
                let mean = taps.distance[i] / taps.blockers[i].max(1.0);
                radius[i] = within(mean * self.light.spread * self.light.texels_per_m, 1.2, MAX_RADIUS);
            }
            if !any {
                continue;
            }
            let found = taps.blockers;
            self.tap(&values, &radius, here, &mut taps);
            for i in (0..here).filter(|&i| found[i] > 0.0) {
                share[doubts.pixel[first + i] as usize] = 1.0 - taps.blockers[i] / TAPS as f32;
            }
        }
        doubts.pixel.clear();
        doubts.values.iter_mut().for_each(Vec::clear);
    }

    /// How many taps are nearer to the light than the receiving plane, and by how much together.
    fn tap(&self, values: &[&[f32; CHUNK]; 8], radius: &[f32; CHUNK], count: usize, taps: &mut Taps) {
        (taps.blockers, taps.distance) = ([0.0; CHUNK], [0.0; CHUNK]);
        let map = &self.layers.target.nearness;
        for &[dx, dy] in spiral() {
            place_taps(values, radius, [dx, dy], self.light.size, taps);
            for i in 0..count {
                taps.stored[i] = map[taps.index[i] as usize];
            }
            add_taps(taps);
        }
    }

    /// Extremes per tile, then over the surroundings of each tile.
    fn summarise(&mut self) {
        let tiles = self.layers.tile_columns;
        let [low, high] = &mut self.own;
        low.resize(tiles * tiles, 0.0);
        high.resize(tiles * tiles, 0.0);
        summarise_tiles(&self.layers.target, &self.layers.changed, low, high);
        // A point looks for blockers within half the light's spread, and filters within the largest radius.
        let search = (self.light.spread * 0.5 * self.light.texels_per_m).clamp(2.0, MAX_RADIUS);
        let reach = |radius: f32| (radius as usize + 1).div_ceil(TILE);
        spread(low, tiles, reach(MAX_RADIUS), &mut self.lowest, |a, b| if a < b { a } else { b });
        spread(high, tiles, reach(search), &mut self.highest, |a, b| if a > b { a } else { b });
    }
}

impl Light {
    fn new(variation: &RenderVariation, size: usize) -> Self {
        let forward = -Vec3A::from_array(variation.light_direction).normalize_or(Vec3A::Z);
        let hint = if forward.z.abs() > 0.99 { Vec3A::X } else { Vec3A::Z };
        let right = forward.cross(hint).normalize();
        let light_from_world = Mat3A::from_cols(right, forward.cross(right), forward).transpose();
        let radius = variation.shadow_radius_m.max(0.01);
        Self {
            size,
            light_from_world,
            center: light_from_world * Vec3A::from_array(variation.shadow_center),
            radius,
            texels_per_m: size as f32 / (2.0 * radius),
            spread: variation.light_angular_radius.clamp(0.0, 1.0).tan(),
        }
    }

    fn on_map(&self, in_light: Vec3A) -> Corner {
        let local = in_light - self.center;
        Corner {
            x: (local.x + self.radius) * self.texels_per_m - 0.5,
            y: (local.y + self.radius) * self.texels_per_m - 0.5,
            nearness: 3.0 * self.radius - local.z,
        }
    }
}

impl Caster {
    /// Moves to a pose; returns the texels that it may cover.
    fn place(&mut self, mesh: &Mesh, pose: Pose, light: &Light) -> Rectangle {
        self.pose = pose;
        self.corners.clear();
        let turn = light.light_from_world * rotation(&pose);
        let shift = light.light_from_world * pose.position.as_vec3a();
        let center = turn * Vec3A::from(mesh.bounds_center) + shift - light.center;
        if center.x.abs().max(center.y.abs()) > light.radius + mesh.bounds_radius {
            return Rectangle::default();
        }
        self.corners.extend(mesh.positions.iter().map(|&position| light.on_map(turn * Vec3A::from(position) + shift)));
        let (low, high) = self.corners.iter().fold(([f32::MAX; 2], [f32::MIN; 2]), |(low, high), corner| {
            let (x, y) = (corner.x, corner.y);
            ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)])
        });
        Rectangle::around(low, high, light.size, light.size)
    }
}

/// Draws the sides that face the light, or both of a mesh that is not closed.
#[multiversion(targets("x86_64+avx2"))]
fn draw_casters(mesh: &Mesh, corners: &[Corner], closed: bool, target: &mut Target) {
    if corners.is_empty() {
        return;
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = [corners[triangle[0] as usize], corners[triangle[1] as usize], corners[triangle[2] as usize]];
        let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
        if area < 0.0 || !closed {
            target.draw::<false>([a, b, c], area, 0);
        }
    }
}

/// Points on the map.
struct Places {
    x: [f32; CHUNK],
    y: [f32; CHUNK],
    nearness: [f32; CHUNK],
    /// How much nearer the receiving plane is per texel.
    tilt_x: [f32; CHUNK],
    tilt_y: [f32; CHUNK],
    /// By how much it may be nearer anywhere in reach.
    slack: [f32; CHUNK],
}

impl Default for Places {
    fn default() -> Self {
        let zero = [0.0; CHUNK];
        Self { x: zero, y: zero, nearness: zero, tilt_x: zero, tilt_y: zero, slack: zero }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn place_points(light: &Light, points: &Points, places: &mut Places) {
    let axes = [light.light_from_world.x_axis, light.light_from_world.y_axis, light.light_from_world.z_axis]
        .map(|axis| axis.to_array());
    let center = light.center.to_array();
    let (texels_per_m, radius) = (light.texels_per_m, light.radius);
    let texel = 1.0 / texels_per_m;
    let longest = 2.0 * texel;
    for i in 0..CHUNK {
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        let slope = |row: usize| axes[0][row] * normal[0] + axes[1][row] * normal[1] + axes[2][row] * normal[2];
        let (slope_x, slope_y, slope_z) = (slope(0), slope(1), slope(2));
        let facing = if -slope_z > 0.05 { -slope_z } else { 0.05 };
        // A lift along the normal hides the steps of the map, more where the light grazes the surface.
        let lift = texel * (0.6 + 1.4 * (1.0 - facing));
        let at = [
            points.place[0][i] + normal[0] * lift,
            points.place[1][i] + normal[1] * lift,
            points.place[2][i] + normal[2] * lift,
        ];
        let local = |row: usize| axes[0][row] * at[0] + axes[1][row] * at[1] + axes[2][row] * at[2] - center[row];
        places.x[i] = (local(0) + radius) * texels_per_m - 0.5;
        places.y[i] = (local(1) + radius) * texels_per_m - 0.5;
        places.nearness[i] = 3.0 * radius - local(2);
        let (tilt_x, tilt_y) = (slope_x / -facing * texel, slope_y / -facing * texel);
        let length = (tilt_x * tilt_x + tilt_y * tilt_y).sqrt();
        let shrink = if length > longest { longest / length } else { 1.0 };
        places.tilt_x[i] = tilt_x * shrink;
        places.tilt_y[i] = tilt_y * shrink;
        places.slack[i] = length * shrink * MAX_RADIUS;
    }
}

/// Taps of a chunk of doubts.
struct Taps {
    index: [u32; CHUNK],
    /// Nearness of the receiving plane under the tap.
    plane: [f32; CHUNK],
    stored: [f32; CHUNK],
    blockers: [f32; CHUNK],
    distance: [f32; CHUNK],
}

impl Default for Taps {
    fn default() -> Self {
        let zero = [0.0; CHUNK];
        Self { index: [0; CHUNK], plane: zero, stored: zero, blockers: zero, distance: zero }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn place_taps(values: &[&[f32; CHUNK]; 8], radius: &[f32; CHUNK], offset: [f32; 2], size: usize, taps: &mut Taps) {
    let limit = (size - 1) as i32 as f32;
    let width = size as u32;
    let [x, y, nearness, tilt_x, tilt_y, cosine, sine, _] = values;
    for i in 0..CHUNK {
        let dx = (offset[0] * cosine[i] - offset[1] * sine[i]) * radius[i];
        let dy = (offset[0] * sine[i] + offset[1] * cosine[i]) * radius[i];
        let column = nearest_integer(within(x[i] + dx, 0.0, limit));
        let row = nearest_integer(within(y[i] + dy, 0.0, limit));
        taps.index[i] = row * width + column;
        taps.plane[i] = dx * tilt_x[i] + dy * tilt_y[i] + nearness[i];
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn add_taps(taps: &mut Taps) {
    for i in 0..CHUNK {
        let ahead = taps.stored[i] - taps.plane[i];
        taps.blockers[i] += if ahead > 0.0 { 1.0 } else { 0.0 };
        taps.distance[i] += if ahead > 0.0 { ahead } else { 0.0 };
    }
}

/// Extremes of the tiles that changed.
#[multiversion(targets("x86_64+avx2"))]
fn summarise_tiles(target: &Target, changed: &[bool], low: &mut [f32], high: &mut [f32]) {
    let tiles = target.width / TILE;
    for (tile, _) in changed.iter().enumerate().filter(|(_, changed)| **changed) {
        // One pair of extremes per column of the tile: columns are independent, so this runs in vectors.
        let (mut lows, mut highs) = ([f32::INFINITY; TILE], [0.0_f32; TILE]);
        for row in 0..TILE {
            let first = (tile / tiles * TILE + row) * target.width + tile % tiles * TILE;
            let texels = &target.nearness[first..first + TILE];
            for column in 0..TILE {
                let value = texels[column];
                lows[column] = if value < lows[column] { value } else { lows[column] };
                highs[column] = if value > highs[column] { value } else { highs[column] };
            }
        }
        low[tile] = lows.into_iter().fold(f32::INFINITY, f32::min);
        high[tile] = highs.into_iter().fold(0.0, f32::max);
    }
}

/// The extreme within so many tiles of each tile, along rows and then along columns.
fn spread(own: &[f32], tiles: usize, reach: usize, out: &mut Vec<f32>, join: impl Fn(f32, f32) -> f32 + Copy) {
    let mut rows = own.to_vec();
    for step in 1..=reach {
        for (row, own) in rows.chunks_exact_mut(tiles).zip(own.chunks_exact(tiles)) {
            for column in 0..tiles.saturating_sub(step) {
                row[column] = join(row[column], own[column + step]);
                row[column + step] = join(row[column + step], own[column]);
            }
        }
    }
    out.clone_from(&rows);
    for step in 1..=reach {
        for first in 0..tiles.saturating_sub(step) {
            for column in 0..tiles {
                let (upper, lower) = (first * tiles + column, (first + step) * tiles + column);
                out[upper] = join(out[upper], rows[lower]);
                out[lower] = join(out[lower], rows[upper]);
            }
        }
    }
}

/// A sunflower pattern on the unit disc.
fn spiral() -> &'static [[f32; 2]; TAPS] {
    static TABLE: std::sync::OnceLock<[[f32; 2]; TAPS]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|tap| {
            (Vec2::from_angle(tap as f32 * 2.399_963) * ((tap as f32 + 0.5) / TAPS as f32).sqrt()).to_array()
        })
    })
}

/// Sine and cosine of one of the turns.
pub(crate) fn turn_of(turn: u8) -> (f32, f32) {
    static TABLE: std::sync::OnceLock<[(f32, f32); TURNS]> = std::sync::OnceLock::new();
    let turns = TABLE
        .get_or_init(|| std::array::from_fn(|turn| (turn as f32 * std::f32::consts::TAU / TURNS as f32).sin_cos()));
    turns[turn as usize % TURNS]
}

/// So many values from a place on.
pub(crate) fn chunk_at(list: &[f32], first: usize) -> &[f32; CHUNK] {
    static NOTHING: [f32; CHUNK] = [0.0; CHUNK];
    list.get(first..).and_then(|rest| rest.first_chunk()).unwrap_or(&NOTHING)
}

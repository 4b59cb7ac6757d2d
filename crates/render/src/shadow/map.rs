//! Shadow map of the key light, with percentage-closer soft shadows (Fernando, "Percentage-Closer Soft Shadows", 2005).

#![allow(clippy::needless_range_loop, reason = "loops over lanes and axes by index are compiled for wide registers")]

use genmanip_core::Pose;
use glam::Vec3A;
use multiversion::multiversion;

use crate::gbuffer::points::Points;
use crate::gbuffer::static_layer::{LayeredBuffer, Motion, Rectangle, TILE};
use crate::gbuffer::view::rotation;
use crate::job::FrameState;
use crate::lights::key_light::{KeyLight, MAX_RADIUS};
use crate::lights::sky::luminance;
use crate::raster::{Corner, VisibilityBuffer, draw_mesh, extremes};
use crate::scene::assets::RenderAssets;
use crate::scene::material::Material;
use crate::scene::mesh::Mesh;
use crate::scene::variation::RenderVariation;
use crate::shadow::pcss::{PcfTaps, SampleQueue, TAPS, UNKNOWN, even_pattern, near_pattern, tap, turn_of};
use crate::simd::{BatchColumn, Column, floor, nearest_integer, whole_registers, within};

/// Depth map seen from the key light, with data that allows most lookups to be skipped.
#[derive(Debug, Default)]
pub(crate) struct ShadowMap {
    layers: LayeredBuffer,
    casters: Vec<Caster>,
    motions: Vec<Motion>,
    /// By tile of the map: largest reversed z in the tile; then the largest one in the cones from points of the tile to
    /// the light, in which blockers may lie.
    own_highest: Vec<f32>,
    highest: Vec<f32>,
    /// Number of updates so far.
    version: u64,
    /// Version in which each tile of the map last changed.
    changed_in: Vec<u64>,
    light: KeyLight,
    clear: Clear,
}

#[derive(Clone, Debug, Default)]
struct Caster {
    pose: Pose,
    corners: Vec<Corner>,
}

/// Bounds in the shadow map of the points that an image tile shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MapFootprint {
    /// First and last (column, row) of tiles of the map; the first exceeds the last for no points.
    tiles: [[i32; 2]; 2],
    /// Smallest reversed z of the points.
    lowest: f32,
}

impl Default for MapFootprint {
    fn default() -> Self {
        Self { tiles: [[0; 2], [-1; 2]], lowest: 0.0 }
    }
}

/// Largest penumbra radius in tiles of the map, rounded up.
const REACH_TILES: isize = 4;

impl MapFootprint {
    /// First and last (column, row) of the tiles of the map on which shadows within these bounds depend.
    pub fn reach(&self) -> [[isize; 2]; 2] {
        let [from, to] = self.tiles.map(|tile| tile.map(|at| at as isize));
        if from[0] > to[0] {
            return [from, to];
        }
        [from.map(|tile| tile - REACH_TILES), to.map(|tile| tile + REACH_TILES)]
    }
}

/// Queues of points that may lie in a penumbra: before the blocker search, and between search and filter.
#[derive(Debug, Default)]
pub(crate) struct UnresolvedSamples {
    points: MapPoints,
    search: SampleQueue,
    filter: SampleQueue,
    taps: PcfTaps,
}

impl ShadowMap {
    /// False if the variation switches shadows off.
    pub fn is_on(&self) -> bool {
        self.light.size > 0
    }

    /// Number of updates so far, to be compared with [`ShadowMap::changed_after`].
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Rasterises the shadow casters of a frame into a map of `size` × `size` texels; casters at rest keep theirs.
    pub fn update(
        &mut self,
        assets: &RenderAssets,
        frame: &FrameState,
        variation: &RenderVariation,
        size: usize,
        is_coarse: bool,
    ) {
        self.version += 1;
        let size = size / TILE * TILE;
        let is_new = self.version == 1;
        self.light = KeyLight::new(variation, size);
        if size == 0 {
            return;
        }
        self.casters.resize_with(assets.parts.len(), Caster::default);
        self.motions.resize_with(assets.parts.len(), Motion::default);
        for ((part, caster), motion) in assets.parts.iter().zip(&mut self.casters).zip(&mut self.motions) {
            if !part.casts_shadow {
                continue;
            }
            let pose = part.body.map_or(Pose::IDENTITY, |body| frame.body_poses[body]);
            motion.moved = is_new || caster.pose != pose;
            motion.before.clone_from(&motion.now);
            if motion.moved {
                motion.now = caster.place(part.mesh.caster(is_coarse), pose, &self.light);
            }
        }
        let (casters, motions, clear) = (&self.casters, &self.motions, &mut self.clear);
        let draw = |index: usize, target: &mut VisibilityBuffer| {
            let part = &assets.parts[index];
            let mesh = part.mesh.caster(is_coarse);
            if is_clear(&part.material) {
                clear.draw(mesh, &casters[index], &motions[index].now, target);
            } else {
                draw_caster(mesh, &casters[index], target);
            }
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

    /// Per tile of the map, true if it changed after a version; and the number of tiles per row.
    pub fn changed_after(&self, version: u64) -> (impl Iterator<Item = bool>, usize) {
        (self.changed_in.iter().map(move |&changed_in| changed_in > version), self.layers.tile_columns)
    }

    /// Bounds in the map of the convex hull of points in the world.
    pub fn footprint_of(&self, points: impl Iterator<Item = Vec3A>) -> MapFootprint {
        /// Largest shift of a lookup by the bias along the normal (texels).
        const MARGIN: f32 = 2.0;
        let (low, high) = extremes(points.map(|point| self.light.on_map(self.light.light_from_world * point)));
        let tile = |value: f32| (value.clamp(-1e6, 1e6) / TILE as f32).floor() as i32;
        let tiles = [[low.x - MARGIN, low.y - MARGIN].map(tile), [high.x + MARGIN, high.y + MARGIN].map(tile)];
        MapFootprint { tiles, lowest: low.reversed_z }
    }

    /// True if no shadow falls on any point within the bounds.
    pub fn lights(&self, footprint: &MapFootprint) -> bool {
        let count = self.layers.tile_columns;
        let [columns, mut rows] = [0, 1].map(|axis| {
            let [from, to] = footprint.tiles.map(|tile| tile[axis]);
            from.clamp(0, count as i32) as usize..(to + 1).clamp(0, count as i32) as usize
        });
        rows.all(|row| self.highest[row * count..][columns.clone()].iter().all(|&high| high <= footprint.lowest))
    }

    /// Writes the shadow mask of points that are certainly lit or face away from the light; queues the others.
    pub fn classify(&self, points: &Points, share: &mut [f32], unresolved: &mut UnresolvedSamples) {
        let UnresolvedSamples { points: on_map, search, filter, taps } = unresolved;
        place_points(&self.light, points, on_map);
        on_map.samples.pixel = points.pixel;
        let (limit, widest) = (self.light.size as f32 - 1.0, self.light.search_radius());
        for i in 0..points.count {
            let (x, y) = (on_map.samples.x[i], on_map.samples.y[i]);
            let is_on_map = x >= 0.0 && y >= 0.0 && x <= limit && y <= limit;
            let is_lit = || self.highest[on_map.tile[i] as usize] <= on_map.samples.reversed_z[i];
            share[points.pixel[i] as usize] = if on_map.facing[i] <= 0.0 {
                UNKNOWN
            } else if !is_on_map || is_lit() {
                1.0
            } else {
                (on_map.samples.sine[i], on_map.samples.cosine[i]) = turn_of(points.turn(i));
                if search.push(&on_map.samples, i, widest) {
                    self.search(search, filter, taps, share);
                }
                continue;
            };
        }
    }

    /// Computes the shadow mask of all points that are still queued.
    pub fn resolve(&self, unresolved: &mut UnresolvedSamples, share: &mut [f32]) {
        let UnresolvedSamples { search, filter, taps, .. } = unresolved;
        self.search(search, filter, taps, share);
        self.filter(filter, taps, share);
    }

    /// Searches blockers for the queued points; writes the shadow mask of fully lit points and of umbras, and queues
    /// the others for the filter.
    fn search(&self, search: &mut SampleQueue, filter: &mut SampleQueue, taps: &mut PcfTaps, share: &mut [f32]) {
        let widest = self.light.search_radius();
        tap(search, &self.layers.target, near_pattern(), taps);
        let (blockers, distance) = (taps.blockers, taps.distance);
        for i in 0..search.count {
            let found = blockers[i];
            let mean = distance[i] / if found > 0.0 { found } else { 1.0 };
            let radius = within(mean * self.light.spread * self.light.texels_per_m, 1.2, MAX_RADIUS);
            let pixel = search.pixel[i] as usize;
            if found == 0.0 {
                share[pixel] = 1.0;
            } else if found == TAPS as f32 && radius <= widest {
                // Umbra: all taps are blocked, and the smaller radius of the filter would find the same.
                share[pixel] = 0.0;
            } else if filter.push(search, i, radius) {
                self.filter(filter, taps, share);
            }
        }
        search.count = 0;
    }

    /// Computes the shadow mask by percentage-closer filtering, with the penumbra radius from the blocker search.
    fn filter(&self, filter: &mut SampleQueue, taps: &mut PcfTaps, share: &mut [f32]) {
        tap(filter, &self.layers.target, even_pattern(), taps);
        for i in 0..filter.count {
            share[filter.pixel[i] as usize] = 1.0 - taps.blockers[i] / TAPS as f32;
        }
        filter.count = 0;
    }

    /// Updates the largest reversed z of each tile, and in the cones from points of the tile to the light.
    fn summarise(&mut self) {
        let tiles = self.layers.tile_columns;
        self.own_highest.resize(tiles * tiles, 0.0);
        summarise_tiles(&self.layers.target, &self.layers.changed, &mut self.own_highest);
        let reach = (self.light.search_radius() as usize + 1).div_ceil(TILE);
        // The cones are computed along one axis after the other; the distances along both axes add up to at most √2
        // times the true distance.
        let rise = TILE as f32 / self.light.texels_per_m / self.light.spread.max(1e-6) / std::f32::consts::SQRT_2;
        dilate_cones(&self.own_highest, tiles, reach, rise, &mut self.highest);
    }
}

impl Caster {
    /// Places the caster at a pose and projects its vertices; returns its bounds in the map (texels), empty if outside.
    fn place(&mut self, mesh: &Mesh, pose: Pose, light: &KeyLight) -> Rectangle {
        self.pose = pose;
        self.corners.clear();
        let turn = light.light_from_world * rotation(&pose);
        let shift = light.light_from_world * pose.position.as_vec3a();
        let center = turn * Vec3A::from(mesh.bounds_center) + shift - light.center;
        if center.x.abs().max(center.y.abs()) > light.radius + mesh.bounds_radius {
            return Rectangle::default();
        }
        self.corners.extend(mesh.positions.iter().map(|&position| light.on_map(turn * Vec3A::from(position) + shift)));
        let (low, high) = extremes(self.corners.iter().copied());
        Rectangle::around([low.x, low.y], [high.x, high.y], light.size, light.size)
    }
}

/// Rasterises the front faces of a caster; both sides if its mesh is not closed.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn draw_caster(mesh: &Mesh, caster: &Caster, target: &mut VisibilityBuffer) {
    if caster.corners.is_empty() {
        return;
    }
    draw_mesh::<false>(&mesh.triangles, &caster.corners, [true, !mesh.closed], 0, target);
}

/// True if a material transmits so much light that its shadow is lighter
/// ([`GLASS_SHADE`](crate::shadow::pcss::GLASS_SHADE)).
fn is_clear(surface: &Material) -> bool {
    luminance((surface.tint(surface.base, 1.0, true) * surface.passing(1.0)).powf(2.0)) > 0.4
}

/// Scratch depth map of transparent casters; empty except while one is drawn.
#[derive(Debug, Default)]
struct Clear {
    target: VisibilityBuffer,
}

impl Clear {
    /// Merges a transparent caster into a map, and marks its texels by setting their lowest bit.
    fn draw(&mut self, mesh: &Mesh, caster: &Caster, covered: &Rectangle, map: &mut VisibilityBuffer) {
        if (self.target.width, self.target.height) != (map.width, map.height) {
            self.target.reset::<false>(map.width, map.height, 1);
        }
        draw_caster(mesh, caster, &mut self.target);
        for row in covered.rows.clone() {
            let texels = row * map.stride + covered.columns.start..row * map.stride + covered.columns.end;
            for (own, texel) in self.target.reversed_z[texels.clone()].iter_mut().zip(&mut map.reversed_z[texels]) {
                let reversed_z = f32::from_bits(std::mem::take(own).to_bits() | 1);
                *texel = if reversed_z > 1e-3 && reversed_z > *texel { reversed_z } else { *texel };
            }
        }
    }
}

/// Points projected into the shadow map.
#[derive(Debug, Default)]
struct MapPoints {
    /// Positions in the map, and gradients of the receiving planes.
    samples: SampleQueue,
    /// Index of the tile of the map.
    tile: Column<u32>,
    /// Cosine between normal and direction to the light.
    facing: BatchColumn,
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn place_points(light: &KeyLight, points: &Points, out: &mut MapPoints) {
    let MapPoints { samples, tile, facing } = out;
    let axes = [light.light_from_world.x_axis, light.light_from_world.y_axis, light.light_from_world.z_axis]
        .map(|axis| axis.to_array());
    let center = light.center.to_array();
    let (texels_per_m, radius) = (light.texels_per_m, light.radius);
    let (limit, tiles) = ((light.size - 1) as i32 as f32, (light.size / TILE) as u32);
    for i in 0..whole_registers(points.count) {
        let normal = [points.normal[0][i], points.normal[1][i], points.normal[2][i]];
        let slope = |row: usize| axes[0][row] * normal[0] + axes[1][row] * normal[1] + axes[2][row] * normal[2];
        let slopes = [slope(0), slope(1), slope(2)];
        let (lift, [tilt_x, tilt_y]) = light.lift_and_tilt(slopes);
        let at = [
            points.place[0][i] + normal[0] * lift,
            points.place[1][i] + normal[1] * lift,
            points.place[2][i] + normal[2] * lift,
        ];
        let local = |row: usize| axes[0][row] * at[0] + axes[1][row] * at[1] + axes[2][row] * at[2] - center[row];
        let x = (local(0) + radius) * texels_per_m - 0.5;
        let y = (local(1) + radius) * texels_per_m - 0.5;
        let tile_of = |at: f32| nearest_integer(floor(within(at, 0.0, limit) * (1.0 / TILE as f32)));
        tile[i] = tile_of(y) * tiles + tile_of(x);
        (samples.x[i], samples.y[i], samples.reversed_z[i]) = (x, y, 3.0 * radius - local(2));
        (samples.tilt_x[i], samples.tilt_y[i]) = (tilt_x, tilt_y);
        facing[i] = -slopes[2];
    }
}

/// Updates the largest reversed z of changed tiles.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn summarise_tiles(target: &VisibilityBuffer, changed: &[bool], highest: &mut [f32]) {
    let tiles = target.width / TILE;
    for (tile, _) in changed.iter().enumerate().filter(|(_, changed)| **changed) {
        // One maximum per column of the tile, so that the loop is vectorised.
        let mut highs = [0.0_f32; TILE];
        for row in 0..TILE {
            let first = (tile / tiles * TILE + row) * target.stride + tile % tiles * TILE;
            let texels = &target.reversed_z[first..first + TILE];
            for column in 0..TILE {
                highs[column] = if texels[column] > highs[column] { texels[column] } else { highs[column] };
            }
        }
        highest[tile] = highs.into_iter().fold(0.0, f32::max);
    }
}

/// Largest value in the cone from each tile to the light, whose height rises by `rise` per tile of distance: first
/// along rows, then along columns.
fn dilate_cones(own: &[f32], tiles: usize, reach: usize, rise: f32, out: &mut Vec<f32>) {
    // Combines each value with the value `step` tiles away, lowered by the rise of the cone.
    let widen = |list: &mut [f32], others: &[f32], step: usize| {
        let lost = rise * (step - 1) as f32;
        list.iter_mut().zip(others).for_each(|(value, &other)| *value = value.max(other - lost));
    };
    let mut rows = own.to_vec();
    for step in (1..=reach).filter(|&step| step < tiles) {
        for (row, own) in rows.chunks_exact_mut(tiles).zip(own.chunks_exact(tiles)) {
            widen(row, &own[step..], step);
            widen(&mut row[step..], own, step);
        }
    }
    out.clone_from(&rows);
    for step in (1..=reach).filter(|&step| step < tiles) {
        widen(out, &rows[step * tiles..], step);
        widen(&mut out[step * tiles..], &rows, step);
    }
}

//! Visible surfaces at the pixel centres, and the summary of each tile.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use std::ops::Range;

use glam::Vec3A;
use multiversion::multiversion;

use super::buffer::{LightBuffer, SEVERAL, TileSummary};
use crate::ambient::ssao::MAX_REACH;
use crate::gbuffer::points::MIXED;
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::{CameraView, View};
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::scene::assets::TRIANGLE_BITS;
use crate::shadow::map::MapFootprint;

/// Surface flags: on a planar receiver; a fixture other than the main support surface.
const ON_PLANE: u8 = 1;
const FIXTURE: u8 = 2;

impl LightBuffer {
    /// Reads the visibility buffer in the tiles that changed.
    pub fn read_surfaces(&mut self, scene: &RenderScene<'_>, opaque: &VisibilityBuffer, changed: &[bool], view: &View) {
        let RenderScene { assets, shadow, variation, irradiance_grid, .. } = *scene;
        let (camera, rays) = (&view.camera, Rays::new(&view.camera));
        let receivers = shadow.planar_receivers();
        let flags = |surface: u16| {
            let on_plane = if receivers.of(surface).is_some() { ON_PLANE } else { 0 };
            on_plane | if irradiance_grid.is_fixed(surface) { FIXTURE } else { 0 }
        };
        let flags: Vec<u8> = (0..=assets.parts.len() as u16).map(flags).collect();
        for tile in (0..self.tiles.len()).filter(|&tile| changed[tile]) {
            let [columns, rows] = self.pixels_of(tile);
            let TileContents { reversed_z: [low, high], first, differ, differ_all } =
                self.read_tile(opaque, columns.clone(), rows.clone());
            let surface = if differ >> TRIANGLE_BITS != 0 { SEVERAL } else { (first >> TRIANGLE_BITS) as u16 };
            let mut own_flags = 0;
            for row in rows.clone() {
                let surfaces = &self.surface[row * self.width..][columns.clone()];
                let surfaces = if surface == SEVERAL { surfaces } else { &surfaces[..1] };
                own_flags = surfaces.iter().fold(own_flags, |all, &surface| all | flags[usize::from(surface)]);
            }
            let receiver = receivers.of(surface).and_then(|receiver| {
                let (right, bottom) = (columns.end - 1, rows.end - 1);
                let corners =
                    [(columns.start, rows.start), (columns.start, bottom), (right, rows.start), (right, bottom)]
                        .map(|(x, y)| rays.point_at(x, y, self.depth[y * self.width + x]));
                let is_whole = corners.iter().all(|place| receiver.holds(place.z));
                is_whole.then(|| receiver.blocks_of(corners.iter().map(|place| place.truncate())))
            });
            let footprint = if receiver.is_some() || !shadow.is_on() || high == 0.0 {
                MapFootprint::default()
            } else {
                let depths = [1.0 / low, 1.0 / high];
                let corners = [columns.start, columns.end].into_iter().flat_map(|x| {
                    [rows.start, rows.end].into_iter().flat_map(move |y| depths.map(|depth| rays.point_at(x, y, depth)))
                });
                shadow.footprint_of(corners)
            };
            let reach = (variation.occlusion_radius_m * camera.focal.x * high).clamp(3.0, MAX_REACH);
            self.only[tile] = if differ_all == 0 { first } else { MIXED };
            self.tiles[tile] = TileSummary {
                surface,
                reach: reach as u16 + 2,
                footprint,
                receiver,
                has_receiver: receiver.is_none() && own_flags & ON_PLANE != 0,
                has_fixture: own_flags & FIXTURE != 0,
            };
        }
        self.find_uniform();
    }

    /// Finds the tiles that show one triangle together with their neighbours.
    fn find_uniform(&mut self) {
        let Self { columns, rows, only, .. } = self;
        let is_uniform = |tile: usize| {
            let (column, row) = (tile % *columns, tile / *columns);
            let across = column.saturating_sub(1)..(column + 2).min(*columns);
            let id = only[tile];
            id != MIXED
                && (row.saturating_sub(1)..(row + 2).min(*rows))
                    .all(|row| only[row * *columns..][across.clone()].iter().all(|&other| other == id))
        };
        self.only_around = (0..only.len()).map(is_uniform).collect();
    }

    /// Reads the visible surfaces of a tile.
    fn read_tile(&mut self, opaque: &VisibilityBuffer, columns: Range<usize>, rows: Range<usize>) -> TileContents {
        let first = rows.start * self.width + columns.start;
        let sample = (rows.start * opaque.stride + columns.start) * opaque.scale;
        let seen = Seen {
            width: self.width,
            depth: &mut self.depth[first..],
            ids: &mut self.ids[first..],
            surface: &mut self.surface[first..],
        };
        if columns.len() != TILE || rows.len() != TILE {
            return read_part(opaque, columns, rows, seen);
        }
        read_stored((&opaque.ids[sample..], &opaque.reversed_z[sample..], opaque.stride), seen)
    }
}

/// View rays in the world.
#[derive(Clone, Copy)]
struct Rays {
    viewpoint: Vec3A,
    /// Ray of pixel (0, 0), and its change per column and row.
    first: Vec3A,
    across: Vec3A,
    down: Vec3A,
}

impl Rays {
    fn new(camera: &CameraView) -> Self {
        let origin = (-camera.center / camera.focal).extend(1.0);
        let [across, down] = [camera.turn.x_axis / camera.focal.x, camera.turn.y_axis / camera.focal.y];
        Self { viewpoint: camera.viewpoint, first: camera.turn * Vec3A::from(origin), across, down }
    }

    fn point_at(&self, column: usize, row: usize, depth: f32) -> Vec3A {
        let [x, y] = [column, row].map(|at| at as i32 as f32);
        self.viewpoint + (self.first + self.across * x + self.down * y) * depth
    }
}

/// Visible surfaces of a tile.
struct TileContents {
    /// Range of reversed z, without the background.
    reversed_z: [f32; 2],
    /// Visibility id of the first pixel.
    first: u32,
    /// Bits in which ids of pixel centres, and of all samples, differ from it.
    differ: u32,
    differ_all: u32,
}

/// Output per pixel centre, from the first pixel of a tile on.
struct Seen<'a> {
    /// Pixels per row.
    width: usize,
    depth: &'a mut [f32],
    ids: &'a mut [u32],
    surface: &'a mut [u16],
}

/// Reads a whole tile from its first sample on.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn read_stored((ids, reversed_z, stride): (&[u32], &[f32], usize), seen: Seen<'_>) -> TileContents {
    const SCALE: usize = 2;
    let first = ids[0];
    let (mut extent, mut differ, mut differ_all) = (Extent::default(), [0_u32; TILE], [0_u32; TILE]);
    for row in 0..TILE {
        let (mut own, mut near) = ([0; TILE], [0.0; TILE]);
        for step in 0..SCALE {
            let line = &ids[(row * SCALE + step) * stride..][..TILE * SCALE];
            for ids in line.as_chunks::<TILE>().0 {
                (0..TILE).for_each(|sample| differ_all[sample] |= ids[sample] ^ first);
            }
        }
        let at = row * SCALE * stride;
        let (line, reversed_z) = (&ids[at..][..TILE * SCALE], &reversed_z[at..][..TILE * SCALE]);
        for column in 0..TILE {
            (own[column], near[column]) = (line[column * SCALE], reversed_z[column * SCALE]);
        }
        extent.widen(&near);
        let pixel = row * seen.width;
        let (depth, ids, surface) = (
            seen.depth[pixel..].first_chunk_mut(),
            seen.ids[pixel..].first_chunk_mut(),
            seen.surface[pixel..].first_chunk_mut::<TILE>(),
        );
        if let (Some(depth), Some(ids), Some(surface)) = (depth, ids, surface) {
            (*depth, *ids) = (depths_of(&near), own);
            for column in 0..TILE {
                surface[column] = (own[column] >> TRIANGLE_BITS) as u16;
                differ[column] |= own[column] ^ first;
            }
        }
    }
    let any = |bits: &[u32]| bits.iter().fold(0, |all, one| all | one);
    TileContents { reversed_z: extent.reversed_z(), first, differ: any(&differ), differ_all: any(&differ_all) }
}

/// Reads a tile that is cut by the image border.
#[cold]
fn read_part(opaque: &VisibilityBuffer, columns: Range<usize>, rows: Range<usize>, seen: Seen<'_>) -> TileContents {
    let scale = opaque.scale;
    let (first, _) = opaque.sample(columns.start * scale, rows.start * scale);
    let (mut extent, mut differ, mut differ_all) = (Extent::default(), 0, 0);
    for (y, row) in rows.enumerate() {
        for (x, column) in columns.clone().enumerate() {
            let (id, near) = opaque.sample(column * scale, row * scale);
            let pixel = y * seen.width + x;
            (seen.depth[pixel], seen.ids[pixel]) = (depths_of(&[near])[0], id);
            seen.surface[pixel] = (id >> TRIANGLE_BITS) as u16;
            extent.widen(&[near; TILE]);
            differ |= id ^ first;
            for step in 0..scale * scale {
                differ_all |= opaque.sample(column * scale + step % scale, row * scale + step / scale).0 ^ first;
            }
        }
    }
    TileContents { reversed_z: extent.reversed_z(), first, differ, differ_all }
}

/// Depths from reversed z, 0 for the background.
#[inline(always)]
fn depths_of<const N: usize>(near: &[f32; N]) -> [f32; N] {
    let mut depths = [0.0; N];
    for i in 0..N {
        depths[i] = if near[i] > 0.0 { 1.0 / near[i] } else { 0.0 };
    }
    depths
}

/// Range of reversed z by column, without the background.
struct Extent {
    low: [f32; TILE],
    high: [f32; TILE],
}

impl Default for Extent {
    fn default() -> Self {
        Self { low: [f32::INFINITY; TILE], high: [0.0; TILE] }
    }
}

impl Extent {
    #[inline(always)]
    fn widen(&mut self, near: &[f32; TILE]) {
        for column in 0..TILE {
            let (near, low, high) = (near[column], self.low[column], self.high[column]);
            self.low[column] = if (near > 0.0) & (near < low) { near } else { low };
            self.high[column] = if near > high { near } else { high };
        }
    }

    #[inline(always)]
    fn reversed_z(&self) -> [f32; 2] {
        let low = self.low.iter().fold(f32::INFINITY, |low, &near| if near < low { near } else { low });
        [low, self.high.iter().fold(0.0, |high, &near| if near > high { near } else { high })]
    }
}

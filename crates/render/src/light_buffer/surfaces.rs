//! Visible surfaces at the pixel centres, and the summary of each tile.

#![allow(clippy::needless_range_loop, reason = "loops over batch columns by index are compiled for wide registers")]

use glam::Vec3A;
use multiversion::multiversion;

use super::buffer::{HALF, LightBuffer, MIXED, SEVERAL, TileSummary};
use crate::ambient::ssao::MAX_REACH;
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::{CameraView, View};
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::scene::assets::TRIANGLE_BITS;
use crate::shadow::map::MapFootprint;

impl LightBuffer {
    /// Reads depths, ids and surfaces from the visibility buffer in changed tiles, and summarises these tiles.
    pub fn read_surfaces(&mut self, scene: &RenderScene<'_>, opaque: &VisibilityBuffer, changed: &[bool], view: &View) {
        let (camera, rays) = (&view.camera, Rays::new(&view.camera));
        let is_fixed = |surface: u16| {
            let part = usize::from(surface).checked_sub(1);
            part.is_some_and(|part| scene.assets.parts[part].body.is_none())
        };
        for tile in (0..self.tiles.len()).filter(|&tile| changed[tile]) {
            let [columns, rows] = self.pixels_of(tile);
            let first_pixel = rows.start * self.width + columns.start;
            let sample = (rows.start * opaque.stride + columns.start) * opaque.scale;
            let seen = Seen {
                width: self.width,
                depth: &mut self.depth[first_pixel..],
                ids: &mut self.ids[first_pixel..],
                surface: &mut self.surface[first_pixel..],
            };
            let TileContents { reversed_z: [low, high], first, differ, differ_all } =
                read_tile((&opaque.ids[sample..], &opaque.reversed_z[sample..], opaque.stride), seen);
            for place in 0..HALF * HALF {
                let [x, y] = [columns.start / 2 + place % HALF, rows.start / 2 + place / HALF];
                let (sample, pixel) = (y * self.width / 2 + x, 2 * (y * self.width + x));
                (self.half_depth[sample], self.half_surface[sample]) = (self.depth[pixel], self.surface[pixel]);
            }
            let surface = if differ >> TRIANGLE_BITS != 0 { SEVERAL } else { (first >> TRIANGLE_BITS) as u16 };
            // If the tile shows one surface, one pixel suffices to find its fixture.
            let lines = rows.clone().map(|row| row * self.width + columns.start);
            let shown = lines.flat_map(|first| &self.surface[first..first + TILE]);
            let shown = shown.take(if surface == SEVERAL { TILE * TILE } else { 1 }).copied();
            let fixture = shown.filter(|&surface| is_fixed(surface)).reduce(|a, b| if a == b { a } else { SEVERAL });
            let footprint = if !scene.shadow.is_on() || high == 0.0 {
                MapFootprint::default()
            } else {
                let corner = |x: usize, y: usize| [1.0 / low, 1.0 / high].map(|depth| rays.point_at(x, y, depth));
                let side = |y: usize| [corner(columns.start, y), corner(columns.end, y)];
                let corners = [side(rows.start), side(rows.end)];
                scene.shadow.footprint_of(corners.as_flattened().as_flattened().iter().copied())
            };
            let reach = (scene.variation.occlusion_radius_m * camera.focal.x * high).clamp(3.0, MAX_REACH);
            self.tiles[tile] = TileSummary {
                surface,
                fixture: fixture.unwrap_or(0),
                only: if differ_all == 0 { first } else { MIXED },
                reach: reach as u16 + 2,
                footprint,
            };
        }
    }
}

/// View rays in the world, scaled to a depth of 1 m.
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

/// Depth range and visibility ids of a tile.
struct TileContents {
    /// Smallest and largest reversed z of the pixel centres, without the background.
    reversed_z: [f32; 2],
    /// Visibility id of the first pixel.
    first: u32,
    /// Bits in which the ids of any pixel centre (`differ`), and of any sample (`differ_all`), differ from `first`.
    differ: u32,
    differ_all: u32,
}

/// Output buffers with one entry per pixel centre, sliced to begin at a tile's first pixel.
struct Seen<'a> {
    /// Distance between rows of the buffers (pixels).
    width: usize,
    depth: &'a mut [f32],
    ids: &'a mut [u32],
    surface: &'a mut [u16],
}

/// Reads a tile with 2×2 samples per pixel; `ids` and `reversed_z` begin at its first sample, `stride` in samples.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn read_tile((ids, reversed_z, stride): (&[u32], &[f32], usize), seen: Seen<'_>) -> TileContents {
    const SCALE: usize = 2;
    let first = ids[0];
    let (mut low, mut high) = ([f32::INFINITY; TILE], [0.0_f32; TILE]);
    let (mut differ, mut differ_all) = ([0_u32; TILE], [0_u32; TILE]);
    for row in 0..TILE {
        for step in 0..SCALE {
            let line = &ids[(row * SCALE + step) * stride..][..TILE * SCALE];
            for ids in line.as_chunks::<TILE>().0 {
                (0..TILE).for_each(|sample| differ_all[sample] |= ids[sample] ^ first);
            }
        }
        let at = row * SCALE * stride;
        let (line, reversed_z) = (&ids[at..][..TILE * SCALE], &reversed_z[at..][..TILE * SCALE]);
        let pixel = row * seen.width;
        let (depth, ids) = (&mut seen.depth[pixel..][..TILE], &mut seen.ids[pixel..][..TILE]);
        let surface = &mut seen.surface[pixel..][..TILE];
        for column in 0..TILE {
            let (id, near) = (line[column * SCALE], reversed_z[column * SCALE]);
            ids[column] = id;
            surface[column] = (id >> TRIANGLE_BITS) as u16;
            differ[column] |= id ^ first;
            depth[column] = if near > 0.0 { 1.0 / near } else { 0.0 };
            low[column] = if (near > 0.0) & (near < low[column]) { near } else { low[column] };
            high[column] = if near > high[column] { near } else { high[column] };
        }
    }
    let any = |bits: &[u32]| bits.iter().fold(0, |all, one| all | one);
    let low = low.into_iter().fold(f32::INFINITY, |low, near| if near < low { near } else { low });
    let high = high.into_iter().fold(0.0, |high, near| if near > high { near } else { high });
    TileContents { reversed_z: [low, high], first, differ: any(&differ), differ_all: any(&differ_all) }
}

//! Tiles on one plane: light varies so little over them that it is found at nodes of a grid on the picture and is linear
//! in multibounce_ao. Where the nodes are and what is found there depends on the picture alone, not on which tiles are shaded.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use multiversion::multiversion;

use super::ShadedPart;
use super::grid_cell::GridCell;
use super::points::{ShadingPoints, find_footprints, interpolate_one, locate};
use super::reflect::{ShadingTerms, reflect_nodes};
use crate::gbuffer::points::{PixelCenters, unpacked};
use crate::gbuffer::static_layer::TILE;
use crate::gbuffer::view::{CameraView, PartView};
use crate::scene::texture::octave;
use crate::simd::{BatchColumn, REGISTER, ZERO, dot, turned};

/// CoarseGrid that are lit at once: they fill a register.
const NODES: usize = REGISTER;
/// Tiles multibounce_ao nodes that can be lit at once: two in each of the columns of nodes but the first.
const TILES: usize = 2 * (NODES / 2 - 1);
/// Focal length, pixels, from which nodes stand two tiles apart along a row: these span less than 2.3 degrees then, as
/// one does at [`super::NARROW_PX`].
const WIDE_PX: f32 = 2.0 * super::NARROW_PX;

/// CoarseGrid around some tiles that show one triangle.
#[derive(Debug)]
pub(super) struct CoarseGrid {
    /// Column by column, the upper one first.
    points: ShadingPoints,
    pub light: ShadingTerms,
    /// Texture coordinates over depth, which are linear on the image.
    texture: [BatchColumn; 2],
    tiles: [GridCell; TILES],
}

impl Default for CoarseGrid {
    fn default() -> Self {
        let (points, light, tiles) = Default::default();
        Self { points, light, texture: [ZERO; 2], tiles }
    }
}

impl CoarseGrid {
    /// Becomes the nodes around the first of some tiles, given by their first pixels, and lights them; returns how many
    /// tiles those are. Whether the surface or the camera does not allow it is asked before.
    pub fn find(&mut self, tiles: &[u32], triangle: u32, part: &ShadedPart<'_>, centers: PixelCenters<'_>) -> usize {
        let ShadedPart { faces, viewpoint, surface, placed, camera, .. } = part;
        let step = if camera.focal.min_element() >= WIDE_PX { 2 } else { 1 };
        let count = self.place(tiles, step);
        let face = &faces[triangle as usize];
        let plane = (face.plane.truncate().to_array(), part.planes.distance(triangle));
        find_depths(&mut self.points, plane, placed, camera);
        locate::<NODES>(&mut self.points, placed, camera);
        interpolate_one::<NODES>(&mut self.points, face, *viewpoint);
        if let Some(texture) = &surface.texture {
            find_footprints::<NODES>(&mut self.points, placed, camera, texture.texels());
            let ShadingPoints { u, v, pixels, .. } = &self.points;
            for (own, place) in self.texture.iter_mut().zip([u, v]) {
                for i in 0..NODES {
                    own[i] = place[i] / pixels.depth[i];
                }
            }
        }
        for (around, &place) in self.tiles.iter_mut().zip(&tiles[..count]) {
            let [column, row] = unpacked(place).map(|at| at as usize);
            let depth = centers.depth[row * centers.width + column];
            let is_before_eye = |&at: &f32| at > 0.0 && at < 2.0 * depth;
            let ShadingPoints { texels, pixels, .. } = &self.points;
            let (texels, depths) = (&texels[around.at..][..4], &pixels.depth[around.at..][..4]);
            let is_even = || texels.iter().all(|&own| octave(own) == octave(texels[0]));
            around.is_linear = depths.iter().all(is_before_eye) && (surface.texture.is_none() || is_even());
        }
        reflect_nodes(&self.points, part, &mut self.light);
        count
    }

    /// Puts nodes around as many of some tiles as there is place for, so many tiles apart; returns the number of tiles.
    fn place(&mut self, tiles: &[u32], step: usize) -> usize {
        let pixels = &mut self.points.pixels;
        let (mut end, mut count, mut last) = (0, 0, None::<[usize; 2]>);
        for (&place, around) in tiles.iter().zip(&mut self.tiles) {
            let [column, row] = unpacked(place).map(|at| at as usize);
            let node = column / TILE / step;
            let new = match last {
                Some(before) if before == [node, row] => 0,
                Some([before, in_row]) if in_row == row && before + 1 == node => 1,
                _ => 2,
            };
            if end + 2 * new > NODES {
                break;
            }
            for column in 2 - new..2 {
                for (lane, row) in [(end, row), (end + 1, row + TILE)] {
                    pixels.column[lane] = ((node + column) * step * TILE) as f32;
                    pixels.row[lane] = row as f32;
                }
                end += 2;
            }
            last = Some([node, row]);
            let from = (column / TILE % step) as f32 / step as f32;
            *around = GridCell { at: end - 4, from, to: from + 1.0 / step as f32, is_linear: false };
            count += 1;
        }
        pixels.count = end;
        count
    }

    /// No tile has nodes.
    pub fn forget(&mut self) {
        self.tiles = Default::default();
    }

    /// Where a tile lies multibounce_ao nodes, if its light is linear multibounce_ao them.
    pub fn around(&self, tile: usize) -> Option<GridCell> {
        self.tiles.get(tile).copied().filter(|around| around.is_linear)
    }

    /// Texels per pixel over a tile.
    pub fn texels(&self, around: &GridCell) -> f32 {
        self.points.texels[around.at]
    }

    /// Finds the texture coordinates of the pixels of a tile, whose depths are given row by row.
    pub fn place_on_texture(&self, around: &GridCell, depths: [&[f32; TILE]; TILE], place: [&mut BatchColumn; 2]) {
        place_on_texture(&self.texture, around, depths, place);
    }
}

/// Finds the depths at the nodes of a plane, given by its normal and distance in the body's frame.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn find_depths(nodes: &mut ShadingPoints, (normal, distance): ([f32; 3], f32), placed: &PartView, camera: &CameraView) {
    let turn = [placed.body_from_camera.x_axis, placed.body_from_camera.y_axis, placed.body_from_camera.z_axis]
        .map(|column| column.to_array());
    let before = distance - dot(normal, placed.viewpoint_in_body.to_array());
    let pixels = &mut nodes.pixels;
    for i in 0..NODES {
        let x = (pixels.column[i] - camera.center.x) / camera.focal.x;
        let y = (pixels.row[i] - camera.center.y) / camera.focal.y;
        let ray = [turned(&turn, 0, [x, y, 1.0]), turned(&turn, 1, [x, y, 1.0]), turned(&turn, 2, [x, y, 1.0])];
        pixels.depth[i] = before / dot(normal, ray);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn place_on_texture(
    over_depth: &[BatchColumn; 2],
    around: &GridCell,
    depths: [&[f32; TILE]; TILE],
    place: [&mut BatchColumn; 2],
) {
    for (over_depth, out) in over_depth.iter().zip(place) {
        around.bilinear(over_depth, out);
        for row in 0..TILE {
            for column in 0..TILE {
                out[row * TILE + column] *= depths[row][column];
            }
        }
    }
}

//! Tiles on one plane: light varies so little over them that it is found at nodes of a grid on the picture and is linear
//! in between. Where the nodes are and what is found there depends on the picture alone, not on which tiles are shaded.

#![allow(clippy::needless_range_loop, reason = "loops over lanes by index are compiled for wide registers")]

use multiversion::multiversion;

use super::Appearance;
use super::reflect::{Reflected, reflect_nodes};
use super::spots::{Spots, find_footprints, interpolate_one, locate};
use super::tile_nodes::TileNodes;
use crate::lanes::{Lane, REGISTER, ZERO, dot, turned};
use crate::layers::TILE;
use crate::points::{Centers, unpacked};
use crate::texture::octave;
use crate::view::{Lens, PartView};

/// Nodes that are lit at once: they fill a register.
const NODES: usize = REGISTER;
/// Tiles between nodes that can be lit at once: two in each of the columns of nodes but the first.
const TILES: usize = 2 * (NODES / 2 - 1);
/// Focal length, pixels, from which nodes stand two tiles apart along a row: these span less than 2.3 degrees then, as
/// one does at [`super::NARROW_PX`].
const WIDE_PX: f32 = 2.0 * super::NARROW_PX;

/// Nodes around some tiles that show one triangle.
#[derive(Debug)]
pub(super) struct Nodes {
    /// Column by column, the upper one first.
    spots: Spots,
    pub light: Reflected,
    /// Texture coordinates over depth, which are linear on the image.
    texture: [Lane; 2],
    tiles: [TileNodes; TILES],
}

impl Default for Nodes {
    fn default() -> Self {
        let (spots, light, tiles) = Default::default();
        Self { spots, light, texture: [ZERO; 2], tiles }
    }
}

impl Nodes {
    /// Becomes the nodes around the first of some tiles, given by their first pixels, and lights them; returns how many
    /// tiles those are. Whether the surface or the lens does not allow it is asked before.
    pub fn find(&mut self, tiles: &[u32], triangle: u32, appearance: &Appearance<'_>, centers: Centers<'_>) -> usize {
        let Appearance { faces, eye, surface, placed, lens, .. } = appearance;
        let step = if lens.focal.min_element() >= WIDE_PX { 2 } else { 1 };
        let count = self.place(tiles, step);
        let face = &faces[triangle as usize];
        let plane = (face.plane.truncate().to_array(), appearance.planes.distance(triangle));
        find_depths(&mut self.spots, plane, placed, lens);
        locate::<NODES>(&mut self.spots, placed, lens);
        interpolate_one::<NODES>(&mut self.spots, face, *eye);
        if let Some(texture) = &surface.texture {
            find_footprints::<NODES>(&mut self.spots, placed, lens, texture.texels());
            let Spots { u, v, pixels, .. } = &self.spots;
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
            let Spots { texels, pixels, .. } = &self.spots;
            let (texels, depths) = (&texels[around.at..][..4], &pixels.depth[around.at..][..4]);
            let is_even = || texels.iter().all(|&own| octave(own) == octave(texels[0]));
            around.is_linear = depths.iter().all(is_before_eye) && (surface.texture.is_none() || is_even());
        }
        reflect_nodes(&self.spots, appearance, &mut self.light);
        count
    }

    /// Puts nodes around as many of some tiles as there is place for, so many tiles apart; returns the number of tiles.
    fn place(&mut self, tiles: &[u32], step: usize) -> usize {
        let pixels = &mut self.spots.pixels;
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
            *around = TileNodes { at: end - 4, from, to: from + 1.0 / step as f32, is_linear: false };
            count += 1;
        }
        pixels.count = end;
        count
    }

    /// No tile has nodes.
    pub fn forget(&mut self) {
        self.tiles = Default::default();
    }

    /// Where a tile lies between nodes, if its light is linear between them.
    pub fn around(&self, tile: usize) -> Option<TileNodes> {
        self.tiles.get(tile).copied().filter(|around| around.is_linear)
    }

    /// Texels per pixel over a tile.
    pub fn texels(&self, around: &TileNodes) -> f32 {
        self.spots.texels[around.at]
    }

    /// Finds the texture coordinates of the pixels of a tile, whose depths are given row by row.
    pub fn place_on_texture(&self, around: &TileNodes, depths: [&[f32; TILE]; TILE], place: [&mut Lane; 2]) {
        place_on_texture(&self.texture, around, depths, place);
    }
}

/// Finds the depths at the nodes of a plane, given by its normal and distance in the body's frame.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn find_depths(nodes: &mut Spots, (normal, distance): ([f32; 3], f32), placed: &PartView, lens: &Lens) {
    let turn = [placed.body_from_camera.x_axis, placed.body_from_camera.y_axis, placed.body_from_camera.z_axis]
        .map(|column| column.to_array());
    let before = distance - dot(normal, placed.eye_in_body.to_array());
    let pixels = &mut nodes.pixels;
    for i in 0..NODES {
        let x = (pixels.column[i] - lens.center.x) / lens.focal.x;
        let y = (pixels.row[i] - lens.center.y) / lens.focal.y;
        let ray = [turned(&turn, 0, [x, y, 1.0]), turned(&turn, 1, [x, y, 1.0]), turned(&turn, 2, [x, y, 1.0])];
        pixels.depth[i] = before / dot(normal, ray);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+fma", "x86_64+avx2+fma"))]
fn place_on_texture(over_depth: &[Lane; 2], around: &TileNodes, depths: [&[f32; TILE]; TILE], place: [&mut Lane; 2]) {
    for (over_depth, out) in over_depth.iter().zip(place) {
        around.spread(over_depth, out);
        for row in 0..TILE {
            for column in 0..TILE {
                out[row * TILE + column] *= depths[row][column];
            }
        }
    }
}

//! Tiles on one plane: light varies so little over them that it is found at their corners and is linear in between.

use super::Appearance;
use super::reflect::{CORNERS, Reflected, reflect_corners};
use super::spots::{Spots, find_footprints, interpolate_one, locate};
use crate::lanes::REGISTER;
use crate::layers::TILE;
use crate::points::{Centers, unpacked};
use crate::texture::octave;

/// Tiles whose corners are lit at once: they fill a register.
pub(crate) const TILES: usize = REGISTER / CORNERS;

/// Corners of some tiles that show one triangle, tile by tile.
#[derive(Debug, Default)]
pub(super) struct Corners {
    spots: Spots,
    pub light: Reflected,
    /// Whether all corners of a tile lie before the eye.
    are_before_eye: [bool; TILES],
}

impl Corners {
    /// Becomes the corners of tiles, given by their first pixels, and lights them; whether the surface or the lens does
    /// not allow it is asked before.
    pub fn find(&mut self, tiles: &[u32], triangle: u32, appearance: &Appearance<'_>, centers: Centers<'_>) {
        self.forget();
        for (tile, &place) in tiles.iter().enumerate().take(TILES) {
            self.are_before_eye[tile] = self.spots.span(tile * CORNERS, place, centers);
        }
        self.spots.pixels.count = tiles.len().min(TILES) * CORNERS;
        let Appearance { surface, placed, lens, .. } = appearance;
        locate::<REGISTER>(&mut self.spots, placed, lens);
        interpolate_one::<REGISTER>(&mut self.spots, &appearance.faces[triangle as usize], appearance.eye);
        if let Some(texture) = &surface.texture {
            find_footprints::<REGISTER>(&mut self.spots, placed, lens, texture.texels());
        }
        reflect_corners(&self.spots, appearance, &mut self.light);
    }

    /// No tile has corners.
    pub fn forget(&mut self) {
        self.are_before_eye = [false; TILES];
    }

    /// Whether the light of a tile is that at its corners.
    pub fn fit(&self, tile: usize) -> bool {
        self.are_before_eye[tile]
    }

    /// Texels per pixel over a tile, if the same size of the texture fits all of its corners.
    pub fn even_texels(&self, tile: usize) -> Option<f32> {
        let texels = &self.spots.texels[tile * CORNERS..][..CORNERS];
        let first = octave(texels[0]);
        texels.iter().all(|&texels| octave(texels) == first).then_some(texels[0])
    }
}

impl Spots {
    /// Puts the corners of a tile at a spot and the next ones; says whether all are before the eye.
    fn span(&mut self, at: usize, place: u32, centers: Centers<'_>) -> bool {
        const BEYOND: f32 = TILE as f32 / (TILE - 1) as f32;
        let [column, row] = unpacked(place);
        let pixel = row as usize * centers.width + column as usize;
        // Nearness is linear on the image.
        let [first, right, down] =
            [pixel, pixel + TILE - 1, pixel + (TILE - 1) * centers.width].map(|pixel| 1.0 / centers.depth[pixel]);
        let (right, down) = ((right - first) * BEYOND, (down - first) * BEYOND);
        let nearness = [first, first + right, first + down, first + right + down];
        for (corner, &nearness) in nearness.iter().enumerate() {
            let pixels = &mut self.pixels;
            pixels.column[at + corner] = column as f32 + (corner % 2 * TILE) as f32;
            pixels.row[at + corner] = row as f32 + (corner / 2 * TILE) as f32;
            pixels.depth[at + corner] = 1.0 / nearness;
        }
        nearness.into_iter().fold(f32::INFINITY, f32::min) > 0.5 * first
    }
}

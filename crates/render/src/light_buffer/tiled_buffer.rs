//! Values per pixel of which most tiles hold a single one: it is written only where it is another.

use std::ops::{Deref, DerefMut, Range};

use crate::gbuffer::static_layer::TILE;

/// One value per pixel, row by row.
#[derive(Debug, Default)]
pub(crate) struct TiledBuffer {
    width: usize,
    values: Vec<f32>,
    /// By tile: the bits of the one value that it holds.
    constant: Vec<Option<u32>>,
}

impl TiledBuffer {
    /// Becomes so many columns and rows of a value, in so many tiles.
    pub fn reset(&mut self, [width, height]: [usize; 2], tiles: usize, value: f32) {
        self.width = width;
        self.values.clear();
        self.values.resize(width * height, value);
        self.constant.clear();
        self.constant.resize(tiles, Some(value.to_bits()));
    }

    /// Gives all columns and rows of a tile, at most [`TILE`], a value.
    #[inline(always)]
    pub fn fill(&mut self, tile: usize, [columns, rows]: [Range<usize>; 2], value: f32) {
        let known = &mut self.constant[tile];
        if *known == Some(value.to_bits()) {
            return;
        }
        *known = Some(value.to_bits());
        for row in rows {
            let line = &mut self.values[row * self.width..][columns.clone()];
            match line.first_chunk_mut::<TILE>() {
                Some(whole) => *whole = [value; TILE],
                None => line.fill(value),
            }
        }
    }

    /// Forgets that a tile holds one value; to be called before its values are written one by one.
    #[inline(always)]
    pub fn set_varying(&mut self, tile: usize) {
        self.constant[tile] = None;
    }

    /// The one value that a tile holds, if that is known.
    #[inline(always)]
    pub fn constant(&self, tile: usize) -> Option<f32> {
        self.constant[tile].map(f32::from_bits)
    }
}

impl Deref for TiledBuffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.values
    }
}

impl DerefMut for TiledBuffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }
}

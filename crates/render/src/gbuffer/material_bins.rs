//! Pixels binned by part (a mesh of one material), so that each part is processed in batches.

use crate::gbuffer::points::{PixelCenters, Pixels};
use crate::simd::CHUNK;

/// [`packed`] pixels by part.
#[derive(Debug, Default)]
pub(crate) struct MaterialBins {
    parts: Vec<Bin>,
}

/// Pixels of one part.
#[derive(Debug, Default)]
struct Bin {
    /// First pixels of tiles that show only this part.
    tiles: Vec<u32>,
    /// Other pixels.
    pixels: Vec<u32>,
}

impl MaterialBins {
    pub fn clear(&mut self, parts: usize) {
        self.parts.resize_with(parts, Bin::default);
        for bin in &mut self.parts {
            bin.tiles.clear();
            bin.pixels.clear();
        }
    }

    /// Adds a pixel of a surface number; 0 is the background.
    pub fn push(&mut self, surface: u16, place: u32) {
        if let Some(bin) = (surface as usize).checked_sub(1).and_then(|part| self.parts.get_mut(part)) {
            bin.pixels.push(place);
        }
    }

    /// Adds a whole tile of one surface by its first pixel.
    pub fn push_whole(&mut self, surface: u16, place: u32) {
        if let Some(bin) = (surface as usize).checked_sub(1).and_then(|part| self.parts.get_mut(part)) {
            bin.tiles.push(place);
        }
    }

    /// Visible parts with the first pixels of their whole tiles and their other pixels.
    pub fn parts(&self) -> impl Iterator<Item = (usize, &[u32], &[u32])> {
        let is_seen = |(_, tiles, pixels): &(usize, &[u32], &[u32])| !tiles.is_empty() || !pixels.is_empty();
        self.parts.iter().enumerate().map(|(part, bin)| (part, &*bin.tiles, &*bin.pixels)).filter(is_seen)
    }

    /// Calls a function with each visible part and batches of its pixels.
    pub fn for_each(&self, pixels: &mut Pixels, centers: PixelCenters<'_>, mut call: impl FnMut(usize, &Pixels)) {
        for (part, tiles, places) in self.parts() {
            for &place in tiles {
                pixels.tile(place, centers);
                call(part, pixels);
            }
            for places in places.chunks(CHUNK) {
                pixels.list(places, centers);
                call(part, pixels);
            }
        }
    }
}

//! Pixels binned by part (a mesh of one material), so that each part is processed in batches.

use crate::gbuffer::points::{PixelCenters, Pixels};
use crate::simd::CHUNK;

/// [`packed`](crate::gbuffer::points::packed) pixels by part.
#[derive(Debug, Default)]
pub(crate) struct MaterialBins {
    parts: Vec<Vec<u32>>,
}

impl MaterialBins {
    pub fn clear(&mut self, parts: usize) {
        self.parts.resize_with(parts, Vec::new);
        self.parts.iter_mut().for_each(Vec::clear);
    }

    /// Adds packed pixels of a surface: number n is part n − 1; 0, the background, and unknown numbers are ignored.
    pub fn extend(&mut self, surface: u16, places: impl IntoIterator<Item = u32>) {
        if let Some(bin) = (surface as usize).checked_sub(1).and_then(|part| self.parts.get_mut(part)) {
            bin.extend(places);
        }
    }

    /// Part indices with the packed pixels in their bins; parts with empty bins are skipped.
    pub fn parts(&self) -> impl Iterator<Item = (usize, &[u32])> {
        self.parts.iter().enumerate().map(|(part, places)| (part, &**places)).filter(|(_, places)| !places.is_empty())
    }

    /// Calls a function with the part index and each batch of a part's pixels, for all parts with pixels; `pixels` is
    /// scratch memory for the batch.
    pub fn for_each(&self, pixels: &mut Pixels, centers: PixelCenters<'_>, mut call: impl FnMut(usize, &Pixels)) {
        for (part, places) in self.parts() {
            for places in places.chunks(CHUNK) {
                pixels.load(places, centers);
                call(part, pixels);
            }
        }
    }
}

//! A picture drawn strip by strip: triangles are sorted by the strips that they reach, and what is drawn of a strip stays
//! in the second cache until somebody has taken it over. Each sample gets the bits of a picture that is drawn as a whole.

use std::ops::Range;

use multiversion::multiversion;

use crate::layers::TILE;
use crate::raster::{Corner, Drawn, Target, extremes, first_sample};

/// Samples of a strip, eight bytes each: half of the smallest second cache of today's server processors, 512 KiB.
const STRIP_SAMPLES: usize = 32_768;

/// Triangles by strip.
#[derive(Debug, Default)]
pub(crate) struct Strips {
    size: [usize; 3],
    /// Rows of samples in a strip.
    rows: usize,
    triangles: Vec<Vec<([Corner; 3], u32)>>,
}

impl Strips {
    /// Becomes empty, for a target; strips consist of whole rows of tiles.
    pub fn begin(&mut self, target: &Target) {
        self.size = target.size();
        let [width, height, scale] = self.size;
        let tile = TILE * scale;
        self.rows = (STRIP_SAMPLES / width / tile).max(1) * tile;
        self.triangles.resize_with(height.div_ceil(self.rows), Vec::new);
        self.triangles.iter_mut().for_each(Vec::clear);
    }

    /// Number of strips.
    pub fn count(&self) -> usize {
        self.triangles.len()
    }

    /// Draws a strip, over nothing; returns its rows.
    pub fn draw(&self, strip: usize, target: &mut Target) -> Range<usize> {
        let rows = strip * self.rows..((strip + 1) * self.rows).min(target.height);
        target.clear_rows(rows.clone());
        draw_all(&self.triangles[strip], rows.start as u32..rows.end as u32, target);
        rows
    }
}

impl Drawn for Strips {
    #[inline(always)]
    fn size(&self) -> [usize; 3] {
        self.size
    }

    #[inline(always)]
    fn draw<const IDS: bool>(&mut self, corners: [Corner; 3], id: u32) {
        let (top, bottom) = extremes(corners[0].y, corners[1].y, corners[2].y);
        let (first, end) = (first_sample(top, self.size[1]) as usize, first_sample(bottom, self.size[1]) as usize);
        if first < end {
            for triangles in &mut self.triangles[first / self.rows..=(end - 1) / self.rows] {
                triangles.push((corners, id));
            }
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn draw_all(triangles: &[([Corner; 3], u32)], rows: Range<u32>, target: &mut Target) {
    for &(corners, id) in triangles {
        target.draw_rows::<true>(corners, id, rows.clone());
    }
}

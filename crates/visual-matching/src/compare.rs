//! Differences of two images by region: ΔE2000 and FLIP.

use std::collections::BTreeMap;

use genmanip_render::{FIRST_OBJECT, NOTHING, ROBOT, TABLE};
use serde::Serialize;

use crate::difference::delta_e;
use crate::flip::{PIXELS_PER_DEGREE, flip};

/// Difference of two images in one region.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RegionDifference {
    /// `all`, `table`, `robot`, `background`, or the object's number as `object 1`.
    pub region: String,
    /// Number of pixels.
    pub pixels: usize,
    /// Mean ΔE2000.
    pub delta_e: f64,
    /// Mean FLIP, 0-1.
    pub flip: f64,
}

/// Differences of two 8-bit sRGB images, by region of the instance ids; first that of all pixels. Empty if the sizes
/// differ.
pub fn by_region(reference: &[u8], test: &[u8], ids: &[u16], width: usize) -> Vec<RegionDifference> {
    let Some(flips) = flip(reference, test, width, PIXELS_PER_DEGREE).filter(|flips| flips.len() == ids.len()) else {
        return Vec::new();
    };
    let colors = delta_e(reference, test);
    let mut sums: BTreeMap<Option<u16>, (usize, f64, f64)> = BTreeMap::new();
    for ((color, flip), id) in colors.iter().zip(&flips).zip(ids) {
        for region in [None, Some(*id)] {
            let sum = sums.entry(region).or_default();
            *sum = (sum.0 + 1, sum.1 + color, sum.2 + f64::from(*flip));
        }
    }
    let mean = |(region, (pixels, color, flip)): (Option<u16>, (usize, f64, f64))| RegionDifference {
        region: region.map_or_else(|| "all".to_owned(), name),
        pixels,
        delta_e: color / pixels as f64,
        flip: flip / pixels as f64,
    };
    sums.into_iter().map(mean).collect()
}

fn name(id: u16) -> String {
    match id {
        NOTHING => "background".into(),
        TABLE => "table".into(),
        ROBOT => "robot".into(),
        object => format!("object {}", object - FIRST_OBJECT + 1),
    }
}

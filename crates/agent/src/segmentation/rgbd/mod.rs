//! Masks from colour and depth alone: no model, no network, no truth.
//!
//! 1. [`surface`]: points, normals and the noise of the depth, which is smoothed along surfaces where there is any.
//! 2. [`support`]: large level planes; what rises above them is looked at.
//! 3. [`regions`]: small regions of one surface and one colour.
//! 4. [`merge`]: neighbouring regions become things, by what their border looks like.

pub mod merge;
mod regions;
mod support;
mod surface;

use genmanip_core::RgbdImage;

use super::{Mask, SegmentError, SegmentQuestion, Segmenter};
use merge::Graph;
use regions::{NONE, RegionSettings, regions};
use surface::Surface;

/// How masks are made.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdSettings {
    /// What rises less above a support belongs to it, m.
    pub least_height_m: f32,
    /// The same as standard deviations of the height.
    pub least_height_noises: f32,
    /// Neighbouring regions belong to one thing when the chance is at least this.
    pub least_chance: f64,
    /// Smaller masks are left out, pixels.
    pub least_px: usize,
}

impl Default for RgbdSettings {
    fn default() -> Self {
        Self { least_height_m: 0.0025, least_height_noises: 3.5, least_chance: 0.5, least_px: 40 }
    }
}

/// Finds things in colour and depth.
#[derive(Clone, Debug, Default)]
pub struct RgbdSegmenter {
    /// How.
    pub settings: RgbdSettings,
}

impl Segmenter for RgbdSegmenter {
    /// Masks by size, largest first.
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError> {
        check(question.image)?;
        let cut = self.cut(question);
        let group = cut.graph.merge(merge::chance, self.settings.least_chance);
        let (width, height) = (question.image.width(), question.image.height());
        let mut areas = vec![0_usize; group.len()];
        let of_pixel = |label: &u32| if *label == NONE { NONE } else { group[*label as usize] };
        let things: Vec<u32> = cut.labels.iter().map(of_pixel).collect();
        for thing in things.iter().filter(|thing| **thing != NONE) {
            areas[*thing as usize] += 1;
        }
        let mut order: Vec<u32> =
            (0..areas.len() as u32).filter(|thing| areas[*thing as usize] >= self.settings.least_px).collect();
        order.sort_by_key(|thing| (std::cmp::Reverse(areas[*thing as usize]), *thing));
        Ok(order.iter().map(|thing| Mask::of_label(width, height, &things, thing)).collect())
    }
}

/// An image in small regions.
#[derive(Clone, Debug)]
pub struct Cut {
    /// Region of each pixel, `u32::MAX` for none.
    pub labels: Vec<u32>,
    /// The regions and their borders.
    pub graph: Graph,
}

impl RgbdSegmenter {
    /// The small regions that things are made of.
    pub fn cut(&self, question: &SegmentQuestion) -> Cut {
        let image = question.image;
        let colors = surface::colors(&image.rgb, image.width() as usize);
        let surface = Surface::new(image, &colors, question.ignore);
        let planes = support::planes(&surface);
        let (mut is_asked, mut is_support) = (vec![false; colors.len()], vec![false; colors.len()]);
        let mut heights = vec![0.0; colors.len()];
        for index in (0..colors.len()).filter(|index| surface.is_seen[*index]) {
            let point = surface.points[index];
            // The highest plane below; a point just below a plane belongs to it.
            let above = planes.iter().rev().filter_map(|plane| plane.height_of(point)).find(|height| *height > -0.01);
            let Some(height) = above else { continue };
            let least = self.least_height(&surface, index);
            heights[index] = height;
            is_support[index] = height < least;
            is_asked[index] = height >= least;
        }
        if let Some(within) = question.within {
            for (asked, inside) in is_asked.iter_mut().zip(&within.pixels) {
                *asked &= inside;
            }
        }
        let (labels, count) = regions(&surface, &colors, &is_asked, &RegionSettings::default());
        let graph = Graph::new(&surface, &colors, &heights, &is_support, &labels, count);
        Cut { labels, graph }
    }

    fn least_height(&self, surface: &Surface, index: usize) -> f32 {
        let point = surface.points[index];
        let view = (surface.eye - point).normalize_or_zero();
        let noise_m = surface.depth_noise_m(point) * view.z.abs();
        self.settings.least_height_m.max(self.settings.least_height_noises * noise_m)
    }
}

fn check(image: &RgbdImage) -> Result<(), SegmentError> {
    let count = image.width() as usize * image.height() as usize;
    if image.depth_m.len() != count || image.rgb.len() != 3 * count || count == 0 {
        return Err(SegmentError::Unsuited {
            needed: format!("colour and depth of {count} pixels"),
            found: format!("{} bytes of colour, {} depths", image.rgb.len(), image.depth_m.len()),
        });
    }
    Ok(())
}

//! Masks from colour and depth alone: no model, no network, no truth.
//!
//! 1. `surface`: points, normals and the noise of the depth, which is smoothed along surfaces where there is any.
//! 2. `support`: large level planes; what rises above them is looked at.
//! 3. `regions`: small regions of one surface and one colour.
//! 4. `merge`: neighbouring regions become things, by what their border looks like.

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
    /// The same for regions within one thing, whose parts are asked for.
    pub least_chance_in_thing: f64,
    /// Smaller masks are left out, pixels.
    pub least_px: usize,
}

impl Default for RgbdSettings {
    fn default() -> Self {
        Self {
            least_height_m: 0.0025,
            least_height_noises: 3.5,
            least_chance: 0.5,
            least_chance_in_thing: 0.97,
            least_px: 40,
        }
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
        // Of one thing everything belongs together; its parts are what is left at a much higher chance.
        let least =
            if question.within.is_some() { self.settings.least_chance_in_thing } else { self.settings.least_chance };
        let group = cut.graph.merge(merge::chance, least);
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

#[cfg(test)]
mod tests {
    use super::*;
    use genmanip_core::{Camera, Intrinsics};
    use glam::{DVec2, DVec3};

    /// A table with boxes on it, each from a lower to an upper corner and of one colour.
    fn image(boxes: &[(DVec3, DVec3, [u8; 3])]) -> RgbdImage {
        let intrinsics = Intrinsics::from_vertical_fov(256, 144, 0.5);
        let world_from_camera = Camera::pose_looking_at(DVec3::new(1.4, 0.1, 1.0), DVec3::new(0.5, 0.0, 0.0));
        let eye = world_from_camera.position;
        let (mut depth, mut rgb) = (Vec::new(), Vec::new());
        for index in 0..256 * 144 {
            let pixel = DVec2::new(f64::from(index % 256), f64::from(index / 256));
            let along = world_from_camera.transform_vector(intrinsics.unproject(pixel, 1.0));
            let hit = |(low, high, color): &(DVec3, DVec3, [u8; 3])| {
                let (one, other) = ((*low - eye) / along, (*high - eye) / along);
                let (near, far) = (one.min(other).max_element(), one.max(other).min_element());
                (near < far).then_some((near, *color))
            };
            let nearest = boxes.iter().filter_map(hit).min_by(|one, other| one.0.total_cmp(&other.0));
            let (at, color) = nearest.unwrap_or((-eye.z / along.z, [190, 170, 140]));
            depth.push(at as f32);
            rgb.extend(color);
        }
        RgbdImage { rgb, ..RgbdImage::of_depth(intrinsics, world_from_camera, depth) }
    }

    fn cube(x: f64, y: f64, z: f64, size: f64, color: [u8; 3]) -> (DVec3, DVec3, [u8; 3]) {
        let low = DVec3::new(x - size / 2.0, y - size / 2.0, z);
        (low, low + DVec3::splat(size), color)
    }

    #[test]
    fn boxes_apart_are_told_apart() {
        let red = [200, 40, 40];
        let cases = [
            ("an empty table", vec![], 0),
            ("apart, alike", vec![cube(0.5, -0.15, 0.0, 0.08, red), cube(0.5, 0.15, 0.0, 0.08, red)], 2),
        ];
        for (name, boxes, expected) in cases {
            let image = image(&boxes);
            let question = SegmentQuestion { image: &image, ignore: &[], within: None };
            let masks = RgbdSegmenter::default().segment(&question).unwrap();
            assert_eq!(masks.len(), expected, "{name}");
            assert_eq!(masks, RgbdSegmenter::default().segment(&question).unwrap(), "{name}: twice the same");
            for index in 0..image.depth_m.len() {
                assert!(masks.iter().filter(|mask| mask.pixels[index]).count() <= 1, "{name}: pixel {index}");
            }
        }
    }

    #[test]
    fn nothing_is_found_where_it_is_not_asked_for() {
        let image = image(&[cube(0.5, -0.15, 0.0, 0.08, [200, 40, 40]), cube(0.5, 0.15, 0.0, 0.08, [40, 40, 200])]);
        let all = SegmentQuestion { image: &image, ignore: &[], within: None };
        let masks = RgbdSegmenter::default().segment(&all).unwrap();
        let ignore = masks[0].pixels.clone();
        let rest = RgbdSegmenter::default().segment(&SegmentQuestion { ignore: &ignore, ..all.clone() }).unwrap();
        assert!(rest.iter().any(|mask| mask.iou(&masks[1]) > 0.9));
        assert!(rest.iter().all(|mask| mask.indices().all(|index| !ignore[index])));
        let parts = RgbdSegmenter::default().segment(&SegmentQuestion { within: Some(&masks[1]), ..all }).unwrap();
        assert!(!parts.is_empty());
        assert!(parts.iter().all(|part| part.indices().all(|index| masks[1].pixels[index])));
    }

    #[test]
    fn images_without_colour_or_depth_are_refused() {
        let image = RgbdImage { rgb: vec![], ..image(&[]) };
        let question = SegmentQuestion { image: &image, ignore: &[], within: None };
        let error = RgbdSegmenter::default().segment(&question).unwrap_err();
        assert_eq!(
            error.to_string(),
            "segmentation needs colour and depth of 36864 pixels in the image: 0 bytes of colour, 36864 depths"
        );
    }
}

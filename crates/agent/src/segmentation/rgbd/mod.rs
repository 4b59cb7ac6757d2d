//! Segmentation from colour and depth: no learned model, no network, no ground truth.
//!
//! 1. `cloud`: organised point cloud with normals and the noise of the depth, which is smoothed along surfaces if
//!    noisy.
//! 2. `support`: large horizontal planes; only points above them are segmented.
//! 3. `regions`: oversegmentation into small regions of one surface and one colour.
//! 4. `merge`: merges neighbouring regions into objects by a classifier on their border.
//! 5. `handles`: joins arched handles to their bodies.

mod cloud;
mod handles;
pub mod merge;
mod regions;
mod support;

use genmanip_core::RgbdImage;

use super::{Mask, SegmentError, SegmentQuestion, Segmenter};
use cloud::OrganizedCloud;
use merge::Graph;
use regions::{NONE, RegionSettings, regions};

/// Settings of the segmentation by colour and depth.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdSettings {
    /// Minimum height of an object above its support (m).
    pub min_height_m: f32,
    /// Minimum height of an object above its support, in standard deviations of the measured height.
    pub min_height_sigmas: f32,
    /// Minimum merge probability of neighbouring regions of one object.
    pub min_probability: f64,
    /// Minimum merge probability of neighbouring regions of one part, when one object is segmented into parts.
    pub min_probability_within_object: f64,
    /// Minimum area of a mask (px); smaller masks are dropped.
    pub min_area_px: usize,
}

impl Default for RgbdSettings {
    fn default() -> Self {
        Self {
            min_height_m: 0.0025,
            min_height_sigmas: 3.5,
            min_probability: 0.5,
            min_probability_within_object: 0.97,
            min_area_px: 40,
        }
    }
}

/// Segments objects in colour and depth images.
#[derive(Clone, Debug, Default)]
pub struct RgbdSegmenter {
    /// Thresholds of the segmentation.
    pub settings: RgbdSettings,
}

impl Segmenter for RgbdSegmenter {
    /// Masks by descending area.
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError> {
        check(question.image)?;
        let oversegment = self.oversegment(question);
        // Within one object all regions belong together; its parts remain separate at a much higher threshold.
        let min = if question.within.is_some() {
            self.settings.min_probability_within_object
        } else {
            self.settings.min_probability
        };
        let group = oversegment.graph.merge(merge::merge_probability, min);
        let (width, height) = (question.image.width(), question.image.height());
        let mut areas = vec![0_usize; group.len()];
        let of_pixel = |label: &u32| if *label == NONE { NONE } else { group[*label as usize] };
        let object_labels: Vec<u32> = oversegment.labels.iter().map(of_pixel).collect();
        for object in object_labels.iter().filter(|object| **object != NONE) {
            areas[*object as usize] += 1;
        }
        let mut order: Vec<u32> =
            (0..areas.len() as u32).filter(|object| areas[*object as usize] >= self.settings.min_area_px).collect();
        order.sort_by_key(|object| (std::cmp::Reverse(areas[*object as usize]), *object));
        let masks = order.iter().map(|object| Mask::of_label(width, height, &object_labels, object)).collect();
        Ok(if question.within.is_some() { masks } else { handles::joined(masks, question.image) })
    }
}

/// An image divided into small regions, before they are merged into objects.
#[derive(Clone, Debug)]
pub struct Oversegmentation {
    /// Region of each pixel, `u32::MAX` for none.
    pub labels: Vec<u32>,
    /// Region adjacency graph, with the regions as nodes.
    pub graph: Graph,
}

impl RgbdSegmenter {
    /// Oversegments the image into small regions.
    pub fn oversegment(&self, question: &SegmentQuestion) -> Oversegmentation {
        let image = question.image;
        let colors = cloud::colors(&image.rgb, image.width() as usize);
        let cloud = OrganizedCloud::new(image, &colors, question.ignore);
        let planes = support::planes(&cloud);
        let (mut is_foreground, mut is_support) = (vec![false; colors.len()], vec![false; colors.len()]);
        let mut heights = vec![0.0; colors.len()];
        for index in (0..colors.len()).filter(|index| cloud.is_seen[*index]) {
            let point = cloud.points[index];
            // The highest plane below the point; a point just below a plane belongs to it.
            let above = planes.iter().rev().filter_map(|plane| plane.height_of(point)).find(|height| *height > -0.01);
            let Some(height) = above else { continue };
            let min = self.min_height(&cloud, index);
            heights[index] = height;
            is_support[index] = height < min;
            is_foreground[index] = height >= min;
        }
        if let Some(within) = question.within {
            for (asked, inside) in is_foreground.iter_mut().zip(&within.pixels) {
                *asked &= inside;
            }
        }
        let (labels, count) = regions(&cloud, &colors, &is_foreground, &RegionSettings::default());
        let graph = Graph::new(&cloud, &colors, &heights, &is_support, &labels, count);
        Oversegmentation { labels, graph }
    }

    fn min_height(&self, cloud: &OrganizedCloud, index: usize) -> f32 {
        let point = cloud.points[index];
        let view = (cloud.camera - point).normalize_or_zero();
        let noise_m = cloud.depth_noise_m(point) * view.z.abs();
        self.settings.min_height_m.max(self.settings.min_height_sigmas * noise_m)
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

    /// A table with boxes, each given by lower corner, upper corner and colour.
    fn image(boxes: &[(DVec3, DVec3, [u8; 3])]) -> RgbdImage {
        let intrinsics = Intrinsics::from_vertical_fov(256, 144, 0.5);
        let world_from_camera = Camera::pose_looking_at(DVec3::new(1.4, 0.1, 1.0), DVec3::new(0.5, 0.0, 0.0));
        let camera = world_from_camera.position;
        let (mut depth, mut rgb) = (Vec::new(), Vec::new());
        for index in 0..256 * 144 {
            let pixel = DVec2::new(f64::from(index % 256), f64::from(index / 256));
            let along = world_from_camera.transform_vector(intrinsics.unproject(pixel, 1.0));
            let hit = |(low, high, color): &(DVec3, DVec3, [u8; 3])| {
                let (one, other) = ((*low - camera) / along, (*high - camera) / along);
                let (near, far) = (one.min(other).max_element(), one.max(other).min_element());
                (near < far).then_some((near, *color))
            };
            let nearest = boxes.iter().filter_map(hit).min_by(|one, other| one.0.total_cmp(&other.0));
            let (at, color) = nearest.unwrap_or((-camera.z / along.z, [190, 170, 140]));
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

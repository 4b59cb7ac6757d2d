//! Perception: segmented RGB-D images of several cameras and the 3D positions of the objects in them.

mod camera_mistake;
mod height_map;
mod object;
mod placement;
mod smoothing;
mod stray_points;

use std::sync::Arc;

use genmanip_core::RgbdImage;
use glam::DVec3;

pub use camera_mistake::{CameraMistake, camera_mistake};
pub use height_map::HeightMap;
pub use object::ObservedObject;
pub use placement::{CellSettings, PlacementTarget, on_plane, targets};
pub use smoothing::{RESIDUAL_NOISE, smoothed};

use self::stray_points::without_stray_points;
use crate::image::RgbImage;
use crate::segmentation::{Mask, SegmentError, SegmentQuestion, Segmenter};

/// Maximum depth difference between two views of one point [m]: about the depth range of one pixel on a slanted
/// surface, plus noise.
const DEPTH_TOLERANCE_M: f64 = 0.01;
/// Minimum share of a mask's visible points inside a mask of another view for the two to match. Chosen by hand.
const MIN_OVERLAP: f64 = 0.5;
/// Minimum number of common points for two masks to match. Chosen by hand.
const MIN_COMMON_POINTS: usize = 5;

/// Segmented image of one camera.
#[derive(Clone, Debug)]
pub struct View {
    /// Camera name.
    pub camera: String,
    /// Colour and depth image.
    pub image: Arc<RgbdImage>,
    /// Masks of the objects in the image.
    pub masks: Arc<[Mask]>,
}

/// Segmented images of all cameras at one moment.
#[derive(Clone, Debug)]
pub struct SegmentedViews {
    /// Views; the first one is shown to models.
    pub views: Vec<View>,
    /// For each mask of the first view, the matching mask in each further view.
    matches: Vec<Vec<Option<usize>>>,
}

impl SegmentedViews {
    /// Segments images and matches masks across views. `ignore` marks the pixels of the robot and of the held object,
    /// per image.
    ///
    /// # Errors
    /// Fails if an image cannot be segmented.
    pub fn new(
        images: Vec<(String, Arc<RgbdImage>)>,
        ignore: &[Vec<bool>],
        segmenter: &dyn Segmenter,
    ) -> Result<Self, SegmentError> {
        let none = Vec::new();
        let mut views = Vec::with_capacity(images.len());
        for (index, (camera, image)) in images.into_iter().enumerate() {
            let ignore = ignore.get(index).unwrap_or(&none);
            let masks = segmenter.segment(&SegmentQuestion { image: &image, ignore, within: None })?;
            let fits = |mask: &Mask| mask.width == image.width() && mask.height == image.height() && mask.is_whole();
            if let Some(mask) = masks.iter().find(|mask| !fits(mask)) {
                let (width, height) = (image.width(), image.height());
                return Err(SegmentError::Service(format!(
                    "a mask has {} x {} pixels ({} values), expected {width} x {height}",
                    mask.width,
                    mask.height,
                    mask.pixels.len()
                )));
            }
            views.push(View { camera, image, masks: masks.into() });
        }
        let matches = match_masks(&views);
        Ok(Self { views, matches })
    }

    /// View shown to models; `None` without views.
    pub fn shown(&self) -> Option<&View> {
        self.views.first()
    }

    /// Moves another view to the front, to be shown to models.
    #[must_use]
    pub fn with_shown_view(&self, view: usize) -> Self {
        let mut views = self.views.clone();
        let first = views.remove(view.min(views.len().saturating_sub(1)));
        views.insert(0, first);
        let matches = match_masks(&views);
        Self { views, matches }
    }

    /// Points of an object from all cameras, by its mask in the first view; world frame. Outliers on the background
    /// behind the object are removed.
    pub fn points(&self, mask: usize) -> Vec<DVec3> {
        let mut points = Vec::new();
        let mut shown = None;
        for (view, mask) in self.masks_of(mask) {
            points.extend(view.points(&view.masks[mask]));
            shown.get_or_insert(points.len());
        }
        without_stray_points(points, shown.unwrap_or_default())
    }

    /// Images with the depth of an object removed, including one pixel around its outline.
    pub fn without(&self, mask: usize) -> Vec<RgbdImage> {
        let mut images: Vec<RgbdImage> = self.views.iter().map(|view| view.image.pinhole_depth()).collect();
        for (index, view) in self.views.iter().enumerate() {
            let Some(mask) = self.mask_in(index, mask) else { continue };
            let dilated = view.masks[mask].dilated();
            for (depth, _) in images[index].depth_m.iter_mut().zip(dilated.pixels).filter(|(_, inside)| *inside) {
                *depth = 0.0;
            }
        }
        images
    }

    /// Camera positions, world frame.
    pub fn camera_positions(&self) -> Vec<DVec3> {
        self.views.iter().map(|view| view.image.world_from_camera.position).collect()
    }

    fn mask_in(&self, view: usize, mask: usize) -> Option<usize> {
        if view == 0 { Some(mask) } else { *self.matches.get(mask)?.get(view - 1)? }
    }

    fn masks_of(&self, mask: usize) -> impl Iterator<Item = (&View, usize)> {
        self.views.iter().enumerate().filter_map(move |(index, view)| Some((view, self.mask_in(index, mask)?)))
    }
}

impl View {
    /// Points of a mask, world frame.
    pub fn points<'a>(&'a self, mask: &'a Mask) -> impl Iterator<Item = DVec3> + 'a {
        mask.indices().filter_map(|index| self.image.point(index))
    }

    /// Colour image; black without colour.
    pub fn picture(&self) -> RgbImage {
        let (width, height) = (self.image.width(), self.image.height());
        RgbImage::new(width, height, self.image.rgb.clone()).unwrap_or_else(|| RgbImage::plain(width, height, [0; 3]))
    }

    /// Pixel that sees a point; `None` if the point is occluded or outside the image.
    fn pixel_of(&self, point: DVec3) -> Option<usize> {
        let seen = self.image.world_from_camera.inverse().transform_point(point);
        let pixel = self.image.pixel_of(point)?.round();
        let (width, height) = (self.image.width(), self.image.height());
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < f64::from(width) && pixel.y < f64::from(height);
        let index = inside.then(|| pixel.y as usize * width as usize + pixel.x as usize)?;
        let depth = f64::from(*self.image.depth_m.get(index)?);
        ((depth - seen.z).abs() <= DEPTH_TOLERANCE_M).then_some(index)
    }
}

/// For each mask of the first view, the matching mask in each further view: most visible points of either mask lie in
/// the other.
fn match_masks(views: &[View]) -> Vec<Vec<Option<usize>>> {
    let Some((first, others)) = views.split_first() else { return Vec::new() };
    let partner = |mask: &Mask, other: &View| {
        let best = best_overlap(first, mask, other)?;
        let back = best_overlap(other, &other.masks[best], first)?;
        (first.masks[back] == *mask).then_some(best)
    };
    first.masks.iter().map(|mask| others.iter().map(|other| partner(mask, other)).collect()).collect()
}

/// Mask of `other` that contains most of the points of `mask` visible in `other`. `None` if no mask contains enough of
/// them.
fn best_overlap(view: &View, mask: &Mask, other: &View) -> Option<usize> {
    let seen: Vec<usize> = view.points(mask).filter_map(|point| other.pixel_of(point)).collect();
    let votes = other.masks.iter().map(|mask| seen.iter().filter(|&&index| mask.pixels[index]).count());
    let (best, count) = votes.enumerate().max_by_key(|&(index, count)| (count, std::cmp::Reverse(index)))?;
    (count >= MIN_COMMON_POINTS && count as f64 >= MIN_OVERLAP * seen.len() as f64).then_some(best)
}

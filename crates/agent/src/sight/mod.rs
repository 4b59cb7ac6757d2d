//! What is seen at one moment: images of several cameras, the things in them, and where these are.

mod cell;
mod heights;
mod smooth;
mod thing;

use std::sync::Arc;

use genmanip_core::RgbdImage;
use glam::DVec3;

pub use cell::{CellSettings, Placing, on_plane, targets};
pub use heights::HeightMap;
pub use smooth::{LEFT_OVER, smoothed};
pub use thing::Thing;

use crate::picture::Picture;
use crate::segmentation::{Mask, SegmentError, SegmentQuestion, Segmenter};

/// Two measured depths of one point may differ by this much, m: a pixel's width at a slant, and little noise.
const SAME_DEPTH_M: f64 = 0.01;
/// Share of a mask's visible points that another camera must see as one thing for the two masks to be the same thing's.
const SAME_THING: f64 = 0.5;
/// Fewest points that tell whether two masks are the same thing's.
const FEWEST_COMMON: usize = 5;

/// One camera's image with the things in it.
#[derive(Clone, Debug)]
pub struct View {
    /// The camera.
    pub camera: String,
    /// Colour and depth.
    pub image: Arc<RgbdImage>,
    /// The things.
    pub masks: Arc<[Mask]>,
}

/// What all cameras see at one moment; the first is the one that models are shown.
#[derive(Clone, Debug)]
pub struct Sight {
    /// The images, the shown one first.
    pub views: Vec<View>,
    /// For each mask of the first view, the mask of the same thing in each further view.
    same: Vec<Vec<Option<usize>>>,
}

impl Sight {
    /// Segments images, and finds out which masks are of the same things. `ignore` holds the pixels of the robot and
    /// of what it carries, for each image.
    ///
    /// # Errors
    /// When there are no masks of an image.
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
        let same = same_things(&views);
        Ok(Self { views, same })
    }

    /// The view that models are shown.
    pub fn shown(&self) -> Option<&View> {
        self.views.first()
    }

    /// The same with another view as the one that models are shown.
    #[must_use]
    pub fn shown_by(&self, view: usize) -> Self {
        let mut views = self.views.clone();
        let first = views.remove(view.min(views.len().saturating_sub(1)));
        views.insert(0, first);
        let same = same_things(&views);
        Self { views, same }
    }

    /// Points on the thing of a mask of the first view, from all cameras.
    pub fn points(&self, mask: usize) -> Vec<DVec3> {
        let mut points = Vec::new();
        for (view, mask) in self.masks_of(mask) {
            points.extend(view.points(&view.masks[mask]));
        }
        points
    }

    /// The images with a thing cut out of their depth, a pixel beyond its outline too: what is left is everything else.
    pub fn without(&self, mask: usize) -> Vec<RgbdImage> {
        let mut images: Vec<RgbdImage> = self.views.iter().map(|view| view.image.pinhole_depth()).collect();
        for (index, view) in self.views.iter().enumerate() {
            let Some(mask) = self.mask_in(index, mask) else { continue };
            let grown = view.masks[mask].grown();
            for (depth, _) in images[index].depth_m.iter_mut().zip(grown.pixels).filter(|(_, inside)| *inside) {
                *depth = 0.0;
            }
        }
        images
    }

    /// Where the cameras are.
    pub fn eyes(&self) -> Vec<DVec3> {
        self.views.iter().map(|view| view.image.world_from_camera.position).collect()
    }

    fn mask_in(&self, view: usize, mask: usize) -> Option<usize> {
        if view == 0 { Some(mask) } else { *self.same.get(mask)?.get(view - 1)? }
    }

    fn masks_of(&self, mask: usize) -> impl Iterator<Item = (&View, usize)> {
        self.views.iter().enumerate().filter_map(move |(index, view)| Some((view, self.mask_in(index, mask)?)))
    }
}

impl View {
    /// The points in the world that a mask's pixels see.
    pub fn points<'a>(&'a self, mask: &'a Mask) -> impl Iterator<Item = DVec3> + 'a {
        mask.indices().filter_map(|index| self.image.point(index))
    }

    /// The image as a picture; black where there is no colour.
    pub fn picture(&self) -> Picture {
        let (width, height) = (self.image.width(), self.image.height());
        Picture::new(width, height, self.image.rgb.clone()).unwrap_or_else(|| Picture::plain(width, height, [0; 3]))
    }

    /// The pixel that sees a point of the world, if the point is what it sees.
    fn pixel_of(&self, point: DVec3) -> Option<usize> {
        let seen = self.image.world_from_camera.inverse().transform_point(point);
        let pixel = self.image.pixel_of(point)?.round();
        let (width, height) = (self.image.width(), self.image.height());
        let inside = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < f64::from(width) && pixel.y < f64::from(height);
        let index = inside.then(|| pixel.y as usize * width as usize + pixel.x as usize)?;
        let depth = f64::from(*self.image.depth_m.get(index)?);
        ((depth - seen.z).abs() <= SAME_DEPTH_M).then_some(index)
    }
}

/// For each mask of the first view, the mask in each further view that sees the same thing: most points of the one that
/// the other camera sees lie in the other mask, and the other way round.
fn same_things(views: &[View]) -> Vec<Vec<Option<usize>>> {
    let Some((first, others)) = views.split_first() else { return Vec::new() };
    let partner = |mask: &Mask, other: &View| {
        let best = most_common(first, mask, other)?;
        let back = most_common(other, &other.masks[best], first)?;
        (first.masks[back] == *mask).then_some(best)
    };
    first.masks.iter().map(|mask| others.iter().map(|other| partner(mask, other)).collect()).collect()
}

/// The mask of `other` in which most points of a mask lie that `other` sees at all.
fn most_common(view: &View, mask: &Mask, other: &View) -> Option<usize> {
    let seen: Vec<usize> = view.points(mask).filter_map(|point| other.pixel_of(point)).collect();
    let votes = other.masks.iter().map(|mask| seen.iter().filter(|&&index| mask.pixels[index]).count());
    let (best, count) = votes.enumerate().max_by_key(|&(index, count)| (count, std::cmp::Reverse(index)))?;
    (count >= FEWEST_COMMON && count as f64 >= SAME_THING * seen.len() as f64).then_some(best)
}

//! Finding the things in an image: the interface that every source of masks implements.

use genmanip_core::RgbdImage;

/// Anything that finds the things in an image: our own segmentation, a server, a recording.
///
/// Calls block and may come from several threads at once.
pub trait Segmenter: Send + Sync {
    /// The things in the image, each at most once, in an order that depends on the question alone.
    ///
    /// # Errors
    /// Says why there are no masks; retries are over by then.
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError>;
}

/// What is to be segmented.
#[derive(Clone, Debug)]
pub struct SegmentQuestion<'a> {
    /// Colour and depth, with where the camera is.
    pub image: &'a RgbdImage,
    /// Pixels, by index, that may not belong to a mask: the robot as its joint positions say, and what it holds; empty for none.
    pub ignore: &'a [bool],
    /// The part of the image to be cut into parts of one thing; `None` to find the things of the whole image.
    pub within: Option<&'a Mask>,
}

/// The pixels of one thing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Pixels per row of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Whether a pixel belongs to the thing, row by row from the top left.
    pub pixels: Vec<bool>,
}

/// Why there are no masks.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SegmentError {
    /// The image lacks a channel that the method needs.
    #[error("segmentation needs {needed} in the image: {found}")]
    Unsuited {
        /// What is needed.
        needed: String,
        /// What is there.
        found: String,
    },
    /// The service did not answer, or answered something that cannot be used.
    #[error("the segmentation service: {0}")]
    Service(String),
}

impl Mask {
    /// Whether there is a value for each pixel.
    pub fn is_whole(&self) -> bool {
        self.pixels.len() as u64 == u64::from(self.width) * u64::from(self.height)
    }

    /// Indices of the pixels that belong to the thing, in order.
    pub fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.pixels.iter().enumerate().filter(|(_, inside)| **inside).map(|(index, _)| index)
    }

    /// The mask with all eight neighbours of its pixels.
    #[must_use]
    pub fn grown(&self) -> Self {
        let mut grown = self.clone();
        let (width, height) = (self.width as i64, self.height as i64);
        for index in self.indices() {
            let (x, y) = (index as i64 % width, index as i64 / width);
            for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
                let (x, y) = (x + dx, y + dy);
                if (0..width).contains(&x) && (0..height).contains(&y) {
                    grown.pixels[(y * width + x) as usize] = true;
                }
            }
        }
        grown
    }

    /// The pixels that both have, as a share of those that either has; 0 for masks of different sizes.
    pub fn iou(&self, other: &Self) -> f64 {
        if self.pixels.len() != other.pixels.len() {
            return 0.0;
        }
        let pairs = || self.pixels.iter().zip(&other.pixels);
        let both = pairs().filter(|(a, b)| **a && **b).count();
        let either = pairs().filter(|(a, b)| **a || **b).count();
        both as f64 / either.max(1) as f64
    }
}

//! Finding the things in an image: the interface that every source of masks implements.
//!
//! - [`Mask`] holds the pixels of one thing.
//! - [`RgbdSegmenter`] is our own way: colour and depth, no model.
//! - [`RobotSilhouette`] says which pixels are the robot's own.

mod mask;
pub mod rgbd;
mod robot;

use genmanip_core::RgbdImage;

pub use mask::Mask;
pub use rgbd::{RgbdSegmenter, RgbdSettings};
pub use robot::RobotSilhouette;

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

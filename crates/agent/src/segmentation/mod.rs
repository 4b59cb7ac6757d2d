//! Object segmentation: the interface of all mask sources.
//!
//! - [`Mask`]: pixel mask of one object.
//! - [`RgbdSegmenter`]: built-in segmentation by colour and depth, without a learned model.
//! - [`RobotSilhouette`]: projection of the robot into an image.

mod mask;
pub mod rgbd;
mod robot;

use genmanip_core::RgbdImage;

pub use mask::Mask;
pub use rgbd::{RgbdSegmenter, RgbdSettings};
pub use robot::RobotSilhouette;

/// A source of object masks: built-in segmentation, a server, a recording.
///
/// Calls block and may come from several threads at once.
pub trait Segmenter: Send + Sync {
    /// Segments the image into disjoint objects, in an order that depends on the question alone.
    ///
    /// # Errors
    /// Reports why there are no masks, after all retries.
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError>;
}

/// Request to segment an image.
#[derive(Clone, Debug)]
pub struct SegmentQuestion<'a> {
    /// Colour and depth image with its camera pose.
    pub image: &'a RgbdImage,
    /// Pixels excluded from masks: the robot, according to its joint positions, and the held object; empty for none.
    pub ignore: &'a [bool],
    /// Object to be segmented into parts; `None` to segment the whole image into objects.
    pub within: Option<&'a Mask>,
}

/// Reason why an image could not be segmented.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SegmentError {
    /// The image does not hold what the method needs.
    #[error("segmentation needs {needed} in the image: {found}")]
    Unsuited {
        /// Required contents of the image, in words.
        needed: String,
        /// Contents found instead, in words.
        found: String,
    },
    /// The service did not answer, or its answer is invalid.
    #[error("the segmentation service: {0}")]
    Service(String),
}

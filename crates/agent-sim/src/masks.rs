//! Masks from the renderer's ids.

use genmanip_agent::segmentation::{Mask, SegmentError, SegmentQuestion, Segmenter};

use super::Truth;
use crate::oracle_segmenter::OracleSegmenter;

/// Fewest pixels that are a mask: what is smaller cannot be seen by anyone.
const FEWEST_PIXELS: usize = 20;

/// The masks of all objects, as they are; results made with it say so.
pub struct OracleMasks {
    truth: Truth,
}

impl OracleMasks {
    /// Of an episode.
    pub fn new(truth: Truth) -> Self {
        Self { truth }
    }
}

impl Segmenter for OracleMasks {
    fn segment(&self, question: &SegmentQuestion) -> Result<Vec<Mask>, SegmentError> {
        let known = self.truth.image(question.image).ok_or_else(|| SegmentError::Unsuited {
            needed: "an image of this episode".into(),
            found: "another one".into(),
        })?;
        let mut masks = OracleSegmenter.segment(&SegmentQuestion { image: &known, ..question.clone() })?;
        masks.retain(|mask| mask.area() >= FEWEST_PIXELS);
        // By where they are in the picture, so that numbers say nothing about the scene.
        masks.sort_by_key(|mask| mask.indices().next());
        Ok(masks)
    }
}

//! Ground-truth masks from the renderer's ids.

use genmanip_agent::segmentation::{Mask, SegmentError, SegmentQuestion, Segmenter};

use super::GroundTruth;
use crate::oracle_segmenter::OracleSegmenter;

/// Minimum mask area, pixels; smaller masks are omitted, since no model could recognise them. Chosen by hand.
const MIN_PIXELS: usize = 20;

/// Segmenter with the ground-truth masks of all objects; results made with it are labelled `oracle`.
pub struct OracleMasks {
    truth: GroundTruth,
}

impl OracleMasks {
    /// Segmenter for the episode that `truth` belongs to.
    pub fn new(truth: GroundTruth) -> Self {
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
        masks.retain(|mask| mask.area() >= MIN_PIXELS);
        // Sorted by position in the image, so that mask numbers reveal nothing about the scenario.
        masks.sort_by_key(|mask| mask.indices().next());
        Ok(masks)
    }
}

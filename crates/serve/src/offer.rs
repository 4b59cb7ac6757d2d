//! What is computed for a request, without any HTTP.

use std::sync::Arc;

use genmanip_agent::segmentation::{Mask, RgbdSegmenter, SegmentQuestion, Segmenter};
use genmanip_agent::services::grasps::{GraspReply, GraspRequest};
use genmanip_agent::services::masks::{RunLengths, ScoredMask, SegmentReply, SegmentRequest};
use genmanip_agent::services::{GraspQuestion, GraspSource, SampledGrasps};
use genmanip_motion::Planner;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A service.
#[derive(Clone, Debug)]
pub enum Offer {
    /// Masks from colour and depth.
    Segment(RgbdSegmenter),
    /// Grasps from points, for the gripper of a planner.
    Grasp(Arc<Planner>),
}

/// A request that gets no answer.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// It is not what is described.
    Malformed(String),
    /// It is, but nothing can be computed from it.
    Unsuited(String),
}

impl Offer {
    /// Name, e.g. `segment`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Segment(_) => "segment",
            Self::Grasp(_) => "grasp",
        }
    }

    /// Where it is asked, e.g. `/segment`.
    pub fn path(&self) -> &'static str {
        match self {
            Self::Segment(_) => "/segment",
            Self::Grasp(_) => "/grasp",
        }
    }

    /// The body of the answer to a body.
    pub(crate) fn answer(&self, body: &[u8]) -> Result<Vec<u8>, Refusal> {
        match self {
            Self::Segment(segmenter) => segmented(segmenter, &read(body)?),
            Self::Grasp(planner) => grasped(planner, &read(body)?),
        }
    }
}

fn segmented(segmenter: &RgbdSegmenter, request: &SegmentRequest) -> Result<Vec<u8>, Refusal> {
    let (image, ignore, within) = request.read().map_err(Refusal::Malformed)?;
    let question = SegmentQuestion { image: &image, ignore: &ignore, within: within.as_ref() };
    let masks = segmenter.segment(&question).map_err(|error| Refusal::Unsuited(error.to_string()))?;
    // Our masks come in an order that means something, but without a score.
    let scored = |mask: &Mask| ScoredMask { segmentation: RunLengths::of(mask), score: None };
    written(&SegmentReply { masks: masks.iter().map(scored).collect() })
}

fn grasped(planner: &Arc<Planner>, request: &GraspRequest) -> Result<Vec<u8>, Refusal> {
    let [points, scene] = request.read().map_err(Refusal::Malformed)?;
    let (world_from_camera, table_height) = (request.world_from_camera, request.table_height);
    let eyes = &[world_from_camera.position];
    let question = GraspQuestion { points: &points, scene: &scene, world_from_camera, eyes, table_height };
    let grasps = SampledGrasps::new(Arc::clone(planner)).grasps(&question);
    let grasps = grasps.map_err(|error| Refusal::Unsuited(error.to_string()))?;
    written(&GraspReply::of(&grasps, &world_from_camera))
}

fn read<T: DeserializeOwned>(body: &[u8]) -> Result<T, Refusal> {
    let from = &mut serde_json::Deserializer::from_slice(body);
    serde_path_to_error::deserialize(from)
        .map_err(|error| Refusal::Malformed(format!("at {}: {}", error.path(), error.inner())))
}

fn written(reply: &impl Serialize) -> Result<Vec<u8>, Refusal> {
    serde_json::to_vec(reply).map_err(|error| Refusal::Unsuited(format!("the answer cannot be written: {error}")))
}

//! What is computed for a request, without any HTTP.

use std::fmt;
use std::sync::Arc;

use genmanip_agent::ask::TranscriptRecorder;
use genmanip_agent::segmentation::{Mask, RgbdSegmenter, SegmentQuestion, Segmenter};
use genmanip_agent::services::agent_request::ActRequest;
use genmanip_agent::services::grasps::{GraspReply, GraspRequest};
use genmanip_agent::services::masks::{RunLengths, ScoredMask, SegmentReply, SegmentRequest};
use genmanip_agent::services::{GraspQuestion, GraspSource, SampledGrasps};
use genmanip_agent::{ActQuestion, Agent, plan_pick_and_place};
use genmanip_core::Document;
use genmanip_motion::Planner;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::env::EnvOffer;
use crate::jobs::Ended;
use crate::refusal::Refusal;

/// A service.
#[derive(Clone, Debug)]
pub enum Offer {
    /// Masks from colour and depth.
    Segment(RgbdSegmenter),
    /// Grasps from points, for the gripper of a planner.
    Grasp(Arc<Planner>),
    /// Motions from an image, the arm's joints and an instruction, as jobs.
    Agent(AgentOffer),
    /// Environments that programs drive.
    Env(Arc<EnvOffer>),
}

/// An agent that is made anew for every job.
#[derive(Clone)]
pub struct AgentOffer {
    /// Of the arm that is to move.
    pub planner: Arc<Planner>,
    /// Makes one, with [`AgentSettings::for_one_image`](genmanip_agent::AgentSettings::for_one_image), and its transcript.
    pub make: Arc<dyn Fn() -> Result<(Agent, TranscriptRecorder), String> + Send + Sync>,
}

impl fmt::Debug for AgentOffer {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("AgentOffer").finish_non_exhaustive()
    }
}

/// What a job computes.
pub(crate) type Work = Box<dyn FnOnce() -> Ended + Send>;

impl Offer {
    /// Name, e.g. `segment`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Segment(_) => "segment",
            Self::Grasp(_) => "grasp",
            Self::Agent(_) => "agent",
            Self::Env(_) => "env",
        }
    }

    /// Where it is asked, e.g. `/segment`.
    pub fn path(&self) -> &'static str {
        match self {
            Self::Segment(_) => "/segment",
            Self::Grasp(_) => "/grasp",
            Self::Agent(_) => "/agent",
            Self::Env(_) => "/env",
        }
    }

    /// What its answers are written in; errors are JSON.
    pub(crate) fn media_type(&self) -> &'static str {
        match self {
            Self::Segment(_) | Self::Grasp(_) | Self::Agent(_) => "application/json",
            Self::Env(_) => "application/msgpack",
        }
    }

    /// The body of the answer to a body, where the connection waits for it.
    pub(crate) fn answer(&self, body: &[u8]) -> Result<Vec<u8>, Refusal> {
        match self {
            Self::Segment(segmenter) => segmented(segmenter, &read(body)?),
            Self::Grasp(planner) => grasped(planner, &read(body)?),
            Self::Env(offer) => offer.answer(body),
            Self::Agent(_) => Err(Refusal::Unsuited("the agent answers in jobs".into())),
        }
    }

    /// What a body asks for, checked, where it is computed as a job.
    pub(crate) fn work(&self, body: &[u8]) -> Result<Work, Refusal> {
        let Self::Agent(offer) = self else { return Err(Refusal::Unsuited("this is answered at once".into())) };
        let request: ActRequest = read(body)?;
        let question = request.read(offer.planner.robot().arm_dof()).map_err(Refusal::Malformed)?;
        let offer = offer.clone();
        Ok(Box::new(move || offer.ended(&question)))
    }
}

impl AgentOffer {
    fn ended(&self, question: &ActQuestion) -> Ended {
        let (mut agent, transcribed) = match (self.make)() {
            Ok(made) => made,
            Err(error) => return Ended { error: Some(error), ..Ended::default() },
        };
        let (acted, error) = match plan_pick_and_place(&mut agent, &transcribed, &self.planner, question) {
            Ok(acted) => (Some(acted), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let pictures = transcribed.pictures();
        let drawn = pictures.iter().filter_map(|(name, picture)| Some((name.clone(), Arc::new(picture.png().ok()?))));
        let transcript = serde_json::from_str(&transcribed.transcript().to_json()).unwrap_or_default();
        Ended { acted, error, transcript, pictures: drawn.collect() }
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
    let camera_positions = &[world_from_camera.position];
    let question = GraspQuestion { points: &points, scene: &scene, world_from_camera, camera_positions, table_height };
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

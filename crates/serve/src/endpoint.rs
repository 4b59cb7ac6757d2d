//! Endpoints: processing of requests, independent of HTTP.

use std::fmt;
use std::sync::Arc;

use genmanip_agent::ask::TranscriptRecorder;
use genmanip_agent::perception::camera_mistake;
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

use crate::env::EnvEndpoint;
use crate::jobs::Ended;
use crate::request_error::RequestError;

/// Service that a server offers, with its resources.
#[derive(Clone, Debug)]
pub enum Endpoint {
    /// Segmentation of RGB-D images.
    Segment(RgbdSegmenter),
    /// Grasp sampling on point clouds, for the gripper of a planner's robot.
    Grasp(Arc<Planner>),
    /// Pick-and-place planning from an image, joint positions and an instruction, as asynchronous jobs.
    Agent(AgentEndpoint),
    /// Environment sessions.
    Env(Arc<EnvEndpoint>),
}

/// Resources of the agent service; every job gets an agent of its own.
#[derive(Clone)]
pub struct AgentEndpoint {
    /// Planner of the arm.
    pub planner: Arc<Planner>,
    /// Factory of an agent with [`AgentSettings::for_one_image`](genmanip_agent::AgentSettings::for_one_image), and of
    /// the
    /// recorder of its transcript.
    pub make: Arc<dyn Fn() -> Result<(Agent, TranscriptRecorder), String> + Send + Sync>,
}

impl fmt::Debug for AgentEndpoint {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("AgentOffer").finish_non_exhaustive()
    }
}

/// Computation of a job, to be run on a blocking thread.
pub(crate) type Work = Box<dyn FnOnce() -> Ended + Send>;

impl Endpoint {
    /// Name, e.g. `segment`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Segment(_) => "segment",
            Self::Grasp(_) => "grasp",
            Self::Agent(_) => "agent",
            Self::Env(_) => "env",
        }
    }

    /// URL path, e.g. `/segment`.
    pub fn path(&self) -> &'static str {
        match self {
            Self::Segment(_) => "/segment",
            Self::Grasp(_) => "/grasp",
            Self::Agent(_) => "/agent",
            Self::Env(_) => "/env",
        }
    }

    /// Media type of responses; errors are JSON.
    pub(crate) fn media_type(&self) -> &'static str {
        match self {
            Self::Segment(_) | Self::Grasp(_) | Self::Agent(_) => "application/json",
            Self::Env(_) => "application/msgpack",
        }
    }

    /// Processes a request synchronously; returns the response body.
    ///
    /// # Errors
    /// If the body is not a request, cannot be processed, or the endpoint answers by jobs.
    pub fn answer(&self, body: &[u8]) -> Result<Vec<u8>, RequestError> {
        match self {
            Self::Segment(segmenter) => segmented(segmenter, &read(body)?),
            Self::Grasp(planner) => grasped(planner, &read(body)?),
            Self::Env(endpoint) => endpoint.answer(body),
            Self::Agent(_) => Err(RequestError::Unsuited("the agent runs as jobs".into())),
        }
    }

    /// Validates a request and returns the computation of its job.
    pub(crate) fn work(&self, body: &[u8]) -> Result<Work, RequestError> {
        let Self::Agent(endpoint) = self else {
            return Err(RequestError::Unsuited("this endpoint is synchronous".into()));
        };
        let request: ActRequest = read(body)?;
        let question = request.read(endpoint.planner.robot().arm_dof()).map_err(RequestError::Malformed)?;
        if let Some(mistake) = camera_mistake(&question.image) {
            return Err(RequestError::Unsuited(mistake.to_string()));
        }
        let endpoint = endpoint.clone();
        Ok(Box::new(move || endpoint.run(&question)))
    }
}

impl AgentEndpoint {
    fn run(&self, question: &ActQuestion) -> Ended {
        let (mut agent, transcribed) = match (self.make)() {
            Ok(made) => made,
            Err(error) => return Ended { error: Some(error), ..Ended::default() },
        };
        let (acted, error) = match plan_pick_and_place(&mut agent, &transcribed, &self.planner, question) {
            Ok(acted) => (Some(acted), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let pictures = transcribed.pictures();
        let encoded = pictures.iter().filter_map(|(name, picture)| Some((name.clone(), Arc::new(picture.png().ok()?))));
        let transcript = serde_json::from_str(&transcribed.transcript().to_json()).unwrap_or_default();
        Ended { acted, error, transcript, pictures: encoded.collect() }
    }
}

fn segmented(segmenter: &RgbdSegmenter, request: &SegmentRequest) -> Result<Vec<u8>, RequestError> {
    let (image, ignore, within) = request.read().map_err(RequestError::Malformed)?;
    let question = SegmentQuestion { image: &image, ignore: &ignore, within: within.as_ref() };
    let masks = segmenter.segment(&question).map_err(|error| RequestError::Unsuited(error.to_string()))?;
    // The built-in segmenter orders its masks, but gives no scores.
    let scored = |mask: &Mask| ScoredMask { segmentation: RunLengths::of(mask), score: None };
    serialized(&SegmentReply { masks: masks.iter().map(scored).collect() })
}

fn grasped(planner: &Arc<Planner>, request: &GraspRequest) -> Result<Vec<u8>, RequestError> {
    let [points, scene] = request.read().map_err(RequestError::Malformed)?;
    let (world_from_camera, table_height) = (request.world_from_camera, request.table_height);
    let camera_positions = &[world_from_camera.position];
    let question = GraspQuestion { points: &points, scene: &scene, world_from_camera, camera_positions, table_height };
    let grasps = SampledGrasps::new(Arc::clone(planner)).grasps(&question);
    let grasps = grasps.map_err(|error| RequestError::Unsuited(error.to_string()))?;
    serialized(&GraspReply::of(&grasps, &world_from_camera))
}

fn read<T: DeserializeOwned>(body: &[u8]) -> Result<T, RequestError> {
    let from = &mut serde_json::Deserializer::from_slice(body);
    serde_path_to_error::deserialize(from)
        .map_err(|error| RequestError::Malformed(format!("at {}: {}", error.path(), error.inner())))
}

fn serialized(reply: &impl Serialize) -> Result<Vec<u8>, RequestError> {
    serde_json::to_vec(reply)
        .map_err(|error| RequestError::Unsuited(format!("the response cannot be serialised: {error}")))
}

//! What the oracle services know, and how they learn it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_agent::Agent;
use genmanip_agent::segmentation::Mask;
use genmanip_core::{
    ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, PrivilegedState, RgbdImage, Seed,
};
use genmanip_render::object_of_instance;
use genmanip_rollout::Stage;
use genmanip_scene::relations::PosedScene;

/// What is true at the moment, shared by the oracle services of one episode.
#[derive(Clone)]
pub struct Truth {
    stage: Stage,
    now: Arc<Mutex<Now>>,
}

/// One moment.
#[derive(Clone, Default)]
pub(super) struct Now {
    pub state: Option<PrivilegedState>,
    images: Vec<RgbdImage>,
    pub seed: Option<Seed>,
    pub injected: Vec<Injection>,
}

/// A wrong answer that the oracle gave on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Injection {
    /// Number of the ask.
    pub ask: usize,
    /// Stage of the ask.
    pub stage: genmanip_agent::ask::Stage,
}

impl Truth {
    /// Of an episode on a stage.
    pub fn new(stage: &Stage) -> Self {
        Self { stage: stage.clone(), now: Arc::default() }
    }

    /// Wrong answers that were given on purpose so far.
    pub fn injected(&self) -> Vec<Injection> {
        self.now().injected.clone()
    }

    pub(super) fn stage(&self) -> &Stage {
        &self.stage
    }

    pub(super) fn now(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn state(&self) -> Option<PrivilegedState> {
        self.now().state.clone()
    }

    /// Everything where it is now.
    pub(super) fn scene(&self) -> PosedScene {
        match &self.now().state {
            Some(state) => self.stage.posed(&state.objects),
            None => self.stage.start().clone(),
        }
    }

    /// A shown image as the renderer made it, with ids; `None` for an image that is not known.
    pub(super) fn image(&self, image: &RgbdImage) -> Option<RgbdImage> {
        let same = |known: &&RgbdImage| {
            known.world_from_camera == image.world_from_camera && known.intrinsics == image.intrinsics
        };
        self.now().images.iter().find(same).cloned()
    }

    /// The masks of all objects in an image that was shown, by their index; `None` for an image that is not known.
    pub(super) fn masks(&self, image: &RgbdImage) -> Option<Vec<(usize, Mask)>> {
        let known = self.image(image)?;
        let (width, height) = (known.width(), known.height());
        let count = self.stage.models.len();
        let mut masks = vec![Mask { width, height, pixels: vec![false; known.ids.len()] }; count];
        let mut seen = vec![false; count];
        for (index, &id) in known.ids.iter().enumerate() {
            if let Some(object) = object_of_instance(id).filter(|object| *object < count) {
                masks[object].pixels[index] = true;
                seen[object] = true;
            }
        }
        Some(masks.into_iter().enumerate().filter(|(object, _)| seen[*object]).collect())
    }
}

/// The agent with oracle services: they are told the truth before each of its turns, and it is not.
pub struct WithTruth {
    agent: Agent,
    truth: Truth,
}

impl WithTruth {
    /// An agent whose services know `truth`.
    pub fn new(agent: Agent, truth: Truth) -> Self {
        Self { agent, truth }
    }
}

impl Policy for WithTruth {
    fn spec(&self) -> PolicySpec {
        let mut spec = PolicySpec { privileged: true, ..self.agent.spec() };
        for camera in &mut spec.cameras {
            camera.channels.ids = true;
        }
        spec
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        *self.truth.now() = Now { seed: Some(start.seed), ..Now::default() };
        self.agent.reset(&EpisodeStart { scenario: None, ..start.clone() })
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let mut seen = Observation { privileged: None, ..observation.clone() };
        let ids = |image: &RgbdImage| RgbdImage { rgb: Vec::new(), depth_m: Vec::new(), ..image.clone() };
        {
            let mut now = self.truth.now();
            now.state.clone_from(&observation.privileged);
            now.images = observation.images.values().map(ids).collect();
        }
        for image in seen.images.values_mut() {
            image.ids = Vec::new();
        }
        self.agent.act(&seen)
    }
}

//! What the oracle services know, and how they learn it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_agent::Agent;
use genmanip_agent::segmentation::Mask;
use genmanip_core::{
    ActionChunk, Atom, EpisodeStart, GoalVerdict, Observation, Policy, PolicyError, PolicySpec, PrivilegedState,
    RgbdImage, Seed,
};
use genmanip_layout::{Move, moves};
use genmanip_relations::{PosedScene, judge_atom, judge_goal};
use genmanip_render::object_of_instance;
use genmanip_rollout::{RolloutSettings, Stage};

use super::failure::FailureClass;

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
    pub planted: Vec<Planted>,
}

/// Something that was done wrong on purpose; the failure analysis is not told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planted {
    /// Number of the ask; of what is no answer, the number of the ask before it.
    pub ask: usize,
    /// What it is to make fail.
    pub class: FailureClass,
}

impl Truth {
    /// Of an episode on a stage.
    pub fn new(stage: &Stage) -> Self {
        Self { stage: stage.clone(), now: Arc::default() }
    }

    /// What was done wrong on purpose so far.
    pub fn planted(&self) -> Vec<Planted> {
        self.now().planted.clone()
    }

    pub(super) fn plant(&self, ask: usize, class: FailureClass) {
        self.now().planted.push(Planted { ask, class });
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

    /// Moves of each alternative of the goal that are not done, of what can be carried.
    pub(super) fn undone(&self, scene: &PosedScene) -> Vec<Vec<Move>> {
        let stage = &self.stage;
        let holds = |atom: &Atom| judge_atom(scene, atom, &stage.relations).holds;
        let is_open = |step: &Move| step.state().is_none() && !step.atoms.iter().all(holds);
        moves(&stage.goal, scene).into_iter().map(|plan| plan.into_iter().filter(is_open).collect()).collect()
    }

    /// The same move of another object.
    pub(super) fn about(&self, step: &Move, object: usize) -> Move {
        let id = self.stage.start().objects().nth(object).map(|posed| posed.id.clone());
        let Some(id) = id.filter(|_| object != step.object) else { return step.clone() };
        let atom = |atom: &Atom| match atom {
            Atom::Relation { relation, reference, second_reference, .. } => Atom::Relation {
                subject: id.clone(),
                relation: *relation,
                reference: reference.clone(),
                second_reference: second_reference.clone(),
            },
            state @ Atom::State { .. } => state.clone(),
        };
        Move { object, atoms: step.atoms.iter().map(atom).collect() }
    }

    /// Whether the goal holds now, with what moves and what is held.
    pub(super) fn verdict(&self) -> GoalVerdict {
        let rest = self.state().map(|state| Stage::rest(&state.objects, state.grasped, &RolloutSettings::default()));
        judge_goal(&self.scene(), &self.stage.goal, &rest.unwrap_or_default(), &self.stage.relations)
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
    /// Whether the fingers are still to jam once.
    jams: bool,
    /// The agent before each of its turns, where they are remembered.
    turns: Option<Turns>,
}

/// The agent before each of its turns, in their order.
pub type Turns = Arc<Mutex<Vec<Agent>>>;

/// Widths that differ less are the same, m.
const SAME_WIDTH_M: f32 = 1e-4;

impl WithTruth {
    /// An agent whose services know `truth`.
    pub fn new(agent: Agent, truth: Truth) -> Self {
        Self { agent, truth, jams: false, turns: None }
    }

    /// The same, but at the first grasp the fingers stay open: trouble that no answer is to blame for.
    #[must_use]
    pub fn jamming(self, jams: bool) -> Self {
        Self { jams, ..self }
    }

    /// The same, and the agent as it is before each turn is kept in `turns`.
    #[must_use]
    pub fn remembered_in(self, turns: Option<Turns>) -> Self {
        Self { turns, ..self }
    }

    /// Keeps the fingers open from where they would begin to close for good; says whether they would.
    fn jam(actions: &mut [Vec<f32>]) -> bool {
        let width = |action: &Vec<f32>| action.last().copied().unwrap_or_default();
        let Some(held) = actions.last().map(width) else { return false };
        let is_rest = |pair: &[Vec<f32>]| (width(&pair[0]) - width(&pair[1])).abs() < SAME_WIDTH_M;
        let open = actions.windows(2).rposition(|pair| is_rest(pair) && width(&pair[0]) > held + SAME_WIDTH_M);
        let Some(open) = open else { return false };
        let stuck = width(&actions[open]);
        for action in &mut actions[open..] {
            if let Some(width) = action.last_mut() {
                *width = width.max(stuck);
            }
        }
        true
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
        let ids = |image: &Arc<RgbdImage>| RgbdImage { ids: image.ids.clone(), ..image.without_pixels() };
        {
            let mut now = self.truth.now();
            now.state.clone_from(&observation.privileged);
            now.images = observation.images.values().map(ids).collect();
        }
        for image in seen.images.values_mut() {
            let (rgb, depth_m) = (image.rgb.clone(), image.depth_m.clone());
            *image = Arc::new(RgbdImage { rgb, depth_m, ..image.without_pixels() });
        }
        if let Some(turns) = &self.turns {
            let (before, _) = self.agent.branch(self.agent.services().clone());
            turns.lock().unwrap_or_else(PoisonError::into_inner).push(before);
        }
        let mut chunk = self.agent.act(&seen)?;
        if self.jams && Self::jam(&mut chunk.actions) {
            self.jams = false;
            self.truth.plant(self.agent.asks(), FailureClass::GraspExecution);
        }
        Ok(chunk)
    }
}

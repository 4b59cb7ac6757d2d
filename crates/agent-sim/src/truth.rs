//! Ground truth of an episode for the oracle services, and the policy wrapper that updates it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use genmanip_agent::Agent;
use genmanip_agent::segmentation::Mask;
use genmanip_core::{
    ActionChunk, Atom, EpisodeStart, FailureClass, GoalVerdict, Observation, Policy, PolicyError, PolicySpec,
    PrivilegedState, RgbdImage, Seed,
};
use genmanip_layout::{Move, moves};
use genmanip_relations::{PosedScene, judge_atom, judge_goal};
use genmanip_render::object_of_instance;
use genmanip_rollout::{RolloutSettings, Stage};

/// Current ground truth, shared by the oracle services of one episode.
#[derive(Clone)]
pub struct GroundTruth {
    stage: Stage,
    now: Arc<Mutex<Now>>,
}

/// Ground truth at one moment.
#[derive(Clone, Default)]
pub(super) struct Now {
    pub state: Option<PrivilegedState>,
    images: Vec<Arc<RgbdImage>>,
    pub seed: Option<Seed>,
    pub injected: Vec<InjectedError>,
}

/// Error injected into an answer or action; the failure attribution does not see it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InjectedError {
    /// Number, from 0, of the question whose answer is wrong. For a wrong grasp, that of the question before it; for
    /// fingers that stay open, the number of questions asked so far, which is the number of the next one.
    pub ask: usize,
    /// Failure class that the error is meant to cause.
    pub class: FailureClass,
}

impl GroundTruth {
    /// Ground truth of an episode on a stage.
    pub fn new(stage: &Stage) -> Self {
        Self { stage: stage.clone(), now: Arc::default() }
    }

    /// Errors injected so far.
    pub fn injected(&self) -> Vec<InjectedError> {
        self.now().injected.clone()
    }

    pub(super) fn record_injected(&self, ask: usize, class: FailureClass) {
        self.now().injected.push(InjectedError { ask, class });
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

    /// Scene with all objects at their current poses.
    pub(super) fn scene(&self) -> PosedScene {
        match &self.now().state {
            Some(state) => self.stage.posed(&state.objects),
            None => self.stage.start().clone(),
        }
    }

    /// Unfinished moves of each goal alternative, without state changes of articulated objects.
    pub(super) fn undone(&self, scene: &PosedScene) -> Vec<Vec<Move>> {
        let stage = &self.stage;
        let holds = |atom: &Atom| judge_atom(scene, atom, &stage.relations).holds;
        let is_open = |step: &Move| step.state().is_none() && !step.atoms.iter().all(holds);
        moves(&stage.goal, scene).into_iter().map(|plan| plan.into_iter().filter(is_open).collect()).collect()
    }

    /// Move with another object as its subject.
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

    /// Verdict on the goal in the current state; a condition on an object that moves or is held does not hold.
    pub(super) fn verdict(&self) -> GoalVerdict {
        let rest = self.state().map(|state| Stage::rest(&state.objects, state.grasped, &RolloutSettings::default()));
        judge_goal(&self.scene(), &self.stage.goal, &rest.unwrap_or_default(), &self.stage.relations)
    }

    /// Rendered image with ids that has the same camera pose and intrinsics as an image shown to the agent; `None` if
    /// there is none.
    pub(super) fn image(&self, image: &RgbdImage) -> Option<Arc<RgbdImage>> {
        let same = |known: &&Arc<RgbdImage>| {
            known.world_from_camera == image.world_from_camera && known.intrinsics == image.intrinsics
        };
        self.now().images.iter().find(same).cloned()
    }

    /// Index and mask of each object visible in an image shown to the agent; `None` for an unknown camera view.
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

/// Policy wrapper that updates the ground truth of the oracle services before each turn and hides it from the agent.
pub struct GroundTruthFeed {
    agent: Agent,
    truth: GroundTruth,
    /// True while a failure of the fingers to close is still to be injected.
    jams: bool,
    /// Snapshots of the agent before each turn; `None` if they are not kept.
    turns: Option<TurnSnapshots>,
}

/// Snapshots of the agent before each turn, in order.
pub type TurnSnapshots = Arc<Mutex<Vec<Agent>>>;

/// Difference (m) below which commanded gripper widths are equal.
const SAME_WIDTH_M: f32 = 1e-4;

impl GroundTruthFeed {
    /// Wraps an agent whose services share `truth`.
    pub fn new(agent: Agent, truth: GroundTruth) -> Self {
        Self { agent, truth, jams: false, turns: None }
    }

    /// With `jams`, injects an execution error: at the first grasp the fingers stay open.
    #[must_use]
    pub fn with_jam(self, jams: bool) -> Self {
        Self { jams, ..self }
    }

    /// Stores a snapshot of the agent in `turns` before each turn.
    #[must_use]
    pub fn with_snapshots(self, turns: Option<TurnSnapshots>) -> Self {
        Self { turns, ..self }
    }

    /// Overwrites the commanded widths so that the fingers stay open instead of closing at the end; returns false if
    /// they do not close.
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

impl Policy for GroundTruthFeed {
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
        {
            let mut now = self.truth.now();
            now.state.clone_from(&observation.privileged);
            now.images = observation.images.values().cloned().collect();
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
            self.truth.record_injected(self.agent.asks(), FailureClass::GraspExecution);
        }
        Ok(chunk)
    }
}

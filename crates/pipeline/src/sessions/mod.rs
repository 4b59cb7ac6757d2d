//! Sessions: an environment that another program drives one action at a time, in the same process or over a connection.
//!
//! ```text
//! Scenes ─► Session ─reset(index, seed)─► step(action)… ─► finish ─► EpisodeResult
//!                     observe() · save() / restore() at any time
//! ```
//!
//! A session is judged exactly like an episode loop: with the actions of a policy, it ends with the result that
//! `evaluate` gives that policy.

mod scenes;

use std::sync::Arc;

use genmanip_core::{
    ActionSpec, CameraRequest, Ending, EpisodeResult, GoalVerdict, ImageChannels, Observation, PolicySpec,
    PrivilegedState, RgbdImage,
};
use genmanip_rollout::cloud_verdict::cloud_verdict;
use genmanip_rollout::environment::{Conclusion, Event, Snapshot};
use genmanip_rollout::evaluate::Case;
use genmanip_rollout::shaping::{Milestone, Progress, Shaping};
use genmanip_rollout::{ActionOutcome, Driver, Environment, RolloutError, Stage};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use genmanip_workspace::WorkspaceError;
pub use scenes::{DEFAULT_KEPT, SceneSource};

/// Actions and observations of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SessionSettings {
    /// Action space: meaning of the numbers of an action.
    pub action: ActionSpec,
    /// Actions per second; the control rate must be a whole multiple.
    pub rate_hz: f64,
    /// Cameras whose images each observation contains.
    #[serde(default)]
    pub cameras: Vec<CameraRequest>,
    /// True if observations contain simulator ground truth; results are then marked `oracle`.
    #[serde(default)]
    pub privileged: bool,
    /// Maximum simulated time of an episode, s; `None` for that of the scenario's suite or run.
    #[serde(default)]
    pub horizon_s: Option<f64>,
    /// True if an episode ends once the goal has held for the settling time; `None` for the setting of the suite or run.
    #[serde(default)]
    pub stop_on_success: Option<bool>,
    /// Discount factor per action for potential-based reward shaping, see [`genmanip_rollout::shaping`]; `None` for
    /// rewards without shaping.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shaping_discount: Option<f64>,
}

impl SessionSettings {
    /// Settings without cameras and simulator ground truth.
    pub fn new(action: ActionSpec, rate_hz: f64) -> Self {
        Self {
            action,
            rate_hz,
            cameras: Vec::new(),
            privileged: false,
            horizon_s: None,
            stop_on_success: None,
            shaping_discount: None,
        }
    }

    /// Fails for settings that the scenes do not support.
    ///
    /// # Errors
    /// The first unsupported setting, with the supported values as the hint.
    pub fn check(&self, scenes: &SceneSource) -> Result<(), WorkspaceError> {
        let refuse = |what: String, hint: &str| Err(WorkspaceError::input(what).with_hint(hint));
        if let Some(horizon_s) = self.horizon_s.filter(|horizon_s| !(*horizon_s > 0.0 && horizon_s.is_finite())) {
            return refuse(format!("`horizon_s`: {horizon_s} is not possible"), "expected seconds above 0");
        }
        if let Some(discount) = self.shaping_discount.filter(|discount| !(*discount > 0.0 && *discount <= 1.0)) {
            let hint = "expected the discount of the learner, above 0 and at most 1";
            return refuse(format!("`shaping_discount`: {discount} is not possible"), hint);
        }
        let spec = self.spec();
        for world in scenes.worlds() {
            if let Err(wrong) = spec.control_steps(f64::from(world.physics.control_rate_hz)) {
                return refuse(wrong, "the control rate is that of the world, `[physics] control_rate_hz`");
            }
            if let Some(request) = self.cameras.iter().find(|request| world.camera(&request.name).is_none()) {
                let known: Vec<&str> = world.cameras.iter().map(|camera| camera.name.as_str()).collect();
                return Err(WorkspaceError::unknown("camera", "cameras", &request.name, &known));
            }
        }
        Ok(())
    }

    /// The settings as the specification of a policy.
    fn spec(&self) -> PolicySpec {
        PolicySpec {
            action: self.action,
            cameras: self.cameras.clone(),
            privileged: self.privileged,
            ..PolicySpec::native("session", self.rate_hz)
        }
    }
}

/// An environment that another program drives.
#[derive(Debug)]
pub struct Session {
    scenes: Arc<SceneSource>,
    settings: SessionSettings,
    environment: Environment,
    under_way: Option<UnderWay>,
}

#[derive(Clone, Debug)]
struct UnderWay {
    case: Case,
    stage: Stage,
    driver: Driver,
    verdict: GoalVerdict,
    ending: Option<Ending>,
    shaping: Shaping,
    progress: Progress,
}

impl UnderWay {
    fn score(&self, milestone: Milestone) -> f64 {
        match milestone {
            Milestone::Goal => self.verdict.score,
            Milestone::Reach | Milestone::Lift => f64::from(u8::from(self.progress.is_reached)),
        }
    }

    fn success(&self, milestone: Milestone) -> bool {
        match milestone {
            Milestone::Goal => self.verdict.success,
            Milestone::Reach | Milestone::Lift => self.progress.is_reached,
        }
    }
}

/// Outcome of one action.
#[derive(Clone, Debug, PartialEq)]
pub struct StepOutcome {
    /// Change of the score since the previous step: the rewards of an episode sum to its last score minus its
    /// initial one. With shaping, the shaping reward is added.
    pub reward: f64,
    /// Score, 0 to 1: that of the latest verdict on the goal; 1 once the scenes' milestone was reached.
    pub score: f64,
    /// True if the goal or the milestone is reached.
    pub success: bool,
    /// Latest verdict on the goal.
    pub verdict: GoalVerdict,
    /// True if the goal held for the settling time and the settings end the episode then.
    pub terminated: bool,
    /// True if the maximum simulated time is over.
    pub truncated: bool,
    /// Reason that the action was not executed and the previous command was held (inverse kinematics has no solution);
    /// `None` if it was executed.
    pub refused: Option<String>,
    /// Events that occurred during the step.
    pub events: Vec<Event>,
}

/// State of a session, for [`Session::restore`].
#[derive(Clone, Debug)]
pub struct SessionState {
    snapshot: Snapshot,
    under_way: UnderWay,
}

impl Session {
    /// A session before its first episode.
    ///
    /// # Errors
    /// As [`SessionSettings::check`].
    pub fn new(scenes: Arc<SceneSource>, settings: SessionSettings) -> Result<Self, WorkspaceError> {
        settings.check(&scenes)?;
        let environment = Environment::new(scenes.settings().rollout.clone());
        Ok(Self { scenes, settings, environment, under_way: None })
    }

    /// Scenes in which the episodes start.
    pub fn scenes(&self) -> &Arc<SceneSource> {
        &self.scenes
    }

    /// Settings of the session.
    pub fn settings(&self) -> &SessionSettings {
        &self.settings
    }

    /// Begins an episode; an unfinished one is dropped.
    ///
    /// For a scenario, `seed` selects the random stream of the episode, by default that of `evaluate`. For a task, it
    /// is
    /// the number of the layout, by default 0.
    ///
    /// # Errors
    /// For an index out of range, a task without a layout, and settings that the scenario does not support.
    pub fn reset(&mut self, index: usize, seed: Option<u64>) -> Result<(), WorkspaceError> {
        let (case, stage) = self.scenes.open(index, seed)?;
        let mut rollout = self.scenes.settings().rollout.clone();
        rollout.horizon_s = self.settings.horizon_s.or(case.horizon_s).unwrap_or(rollout.horizon_s);
        rollout.stop_on_success = self.settings.stop_on_success.unwrap_or(rollout.stop_on_success);
        let unserved = |error: RolloutError| match error {
            RolloutError::Spec { source, .. } => {
                WorkspaceError::input(format!("the session cannot be served: {source}"))
                    .with_hint("`action`, `rate_hz`, `cameras` and `privileged` are those of a policy's spec")
            }
            error => broken(error),
        };
        let driver = Driver::new(&self.settings.spec(), &stage, &rollout).map_err(unserved)?;
        self.under_way = None;
        if *self.environment.settings() != rollout {
            self.environment = Environment::new(rollout);
        }
        self.environment.reset(&stage, case.seed);
        let verdict = self.environment.verdict().map_err(broken)?;
        let shaping = Shaping::new(&stage, self.scenes.milestone());
        let progress = self.progress(&shaping, &stage)?;
        self.under_way = Some(UnderWay { case, stage, driver, verdict, ending: None, shaping, progress });
        Ok(())
    }

    /// Present progress towards goal and milestone; a default value where neither rewards nor the end of an episode
    /// need it.
    fn progress(&self, shaping: &Shaping, stage: &Stage) -> Result<Progress, WorkspaceError> {
        match self.settings.shaping_discount.is_some() || self.scenes.milestone() != Milestone::Goal {
            true => shaping.progress(&self.environment, stage).map_err(broken),
            false => Ok(Progress::default()),
        }
    }

    /// Executes an action. If the episode ends with it, the last command is held for the settling time and the goal is
    /// judged; that verdict is final.
    ///
    /// # Errors
    /// Before the first reset; after the end; for an invalid action (the state is unchanged then); and when the
    /// simulation becomes unstable.
    pub fn step(&mut self, action: &[f32]) -> Result<StepOutcome, WorkspaceError> {
        let mut under_way = self.under_way.take().ok_or_else(|| broken(RolloutError::NotReset))?;
        let outcome = self.advance(&mut under_way, action);
        self.under_way = Some(under_way);
        outcome
    }

    fn advance(&mut self, under_way: &mut UnderWay, action: &[f32]) -> Result<StepOutcome, WorkspaceError> {
        let environment = &mut self.environment;
        if under_way.ending.is_some() {
            return Err(broken(RolloutError::EpisodeOver { frames: environment.frames().len() }));
        }
        under_way.driver.begin_chunk(environment).map_err(broken)?;
        let turn = under_way.driver.act(environment, action).map_err(broken)?;
        let ActionOutcome { verdict, mut events, mut terminated, truncated, refused, .. } = turn;
        let before = (under_way.score(self.scenes.milestone()), under_way.progress.potential);
        under_way.verdict = verdict.unwrap_or_else(|| under_way.verdict.clone());
        under_way.progress = self.progress(&under_way.shaping, &under_way.stage)?;
        let environment = &mut self.environment;
        match self.scenes.milestone() {
            Milestone::Goal if terminated || truncated => {
                let settled = environment.settle().map_err(broken)?;
                under_way.verdict = settled.verdict.unwrap_or_else(|| under_way.verdict.clone());
                events.extend(settled.events);
            }
            Milestone::Goal => {}
            Milestone::Reach | Milestone::Lift => {
                terminated |= under_way.progress.is_reached && environment.settings().stop_on_success;
            }
        }
        if terminated || truncated {
            under_way.ending = Some(if terminated { Ending::Success } else { Ending::Horizon });
        }
        let (score, success) = (under_way.score(self.scenes.milestone()), under_way.success(self.scenes.milestone()));
        let shaped =
            self.settings.shaping_discount.map_or(0.0, |discount| discount * under_way.progress.potential - before.1);
        let (reward, verdict) = (score - before.0 + shaped, under_way.verdict.clone());
        Ok(StepOutcome { reward, score, success, verdict, terminated, truncated, refused, events })
    }

    /// Current observation: state, images, and simulator ground truth if the settings request it.
    ///
    /// # Errors
    /// Before the first reset, and for a camera that cannot be rendered.
    pub fn observe(&mut self) -> Result<Observation, WorkspaceError> {
        let mut observation = self.seen()?;
        if self.settings.privileged {
            observation.privileged = Some(self.environment.truth().map_err(broken)?);
        }
        Ok(observation)
    }

    /// Like [`Session::observe`], but the grasped object is that of the last control step; saves about 0.1 ms.
    ///
    /// # Errors
    /// As [`Session::observe`].
    pub fn observe_quickly(&mut self) -> Result<Observation, WorkspaceError> {
        let mut observation = self.seen()?;
        if self.settings.privileged {
            let objects = self.environment.objects().map_err(broken)?;
            let grasped = self.environment.frames().last().and_then(|frame| frame.grasped);
            observation.privileged = Some(PrivilegedState { objects, grasped });
        }
        Ok(observation)
    }

    fn seen(&mut self) -> Result<Observation, WorkspaceError> {
        let mut observation = self.environment.observe(&self.settings.cameras).map_err(broken)?;
        if let Some(under_way) = &self.under_way {
            under_way.driver.add_target(&self.environment, &mut observation).map_err(broken)?;
        }
        Ok(observation)
    }

    /// Image for display, independent of the cameras of the settings.
    ///
    /// # Errors
    /// Before the first reset, and for an unknown camera.
    pub fn picture(&mut self, camera: &str, size: Option<[u32; 2]>) -> Result<RgbdImage, WorkspaceError> {
        let request = CameraRequest { size, ..CameraRequest::new(camera, ImageChannels::RGB) };
        let mut seen = self.environment.observe(&[request]).map_err(broken)?;
        seen.images.remove(camera).map(Arc::unwrap_or_clone).ok_or_else(|| broken(RolloutError::NotReset))
    }

    /// Current verdict of the goal, without settling.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn verdict(&mut self) -> Result<GoalVerdict, WorkspaceError> {
        self.environment.verdict().map_err(broken)
    }

    /// Stage of the current episode; `None` before the first reset and after [`Session::finish`].
    pub fn stage(&self) -> Option<&Stage> {
        self.under_way.as_ref().map(|under_way| &under_way.stage)
    }

    /// Case of the current episode (scenario, id and seed); `None` before the first reset and after
    /// [`Session::finish`].
    pub fn case(&self) -> Option<&Case> {
        self.under_way.as_ref().map(|under_way| &under_way.case)
    }

    /// Number of control steps of the episode so far, each of 1/60 s.
    pub fn control_steps(&self) -> usize {
        self.environment.frames().len()
    }

    /// Ends the episode, with settling if it has not happened yet; returns a result like that of `evaluate`.
    ///
    /// # Errors
    /// Before the first reset, and when the simulation becomes unstable.
    pub fn finish(&mut self, policy: &str) -> Result<EpisodeResult, WorkspaceError> {
        let UnderWay { case, stage, ending, .. } =
            self.under_way.take().ok_or_else(|| broken(RolloutError::NotReset))?;
        let out_of_time = || if self.environment.steps_left() == 0 { Ending::Horizon } else { Ending::Finished };
        let ending = ending.unwrap_or_else(out_of_time);
        let conclusion = Conclusion { id: &case.id, policy, oracle: self.settings.privileged, ending, gave_up: None };
        let mut episode = self.environment.finish(conclusion).map_err(broken)?;
        episode.result.cloud = cloud_verdict(&stage, &episode).map_err(broken)?;
        Ok(episode.result)
    }

    /// Saves the complete state of the episode.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn save(&self) -> Result<SessionState, WorkspaceError> {
        let under_way = self.under_way.clone().ok_or_else(|| broken(RolloutError::NotReset))?;
        Ok(SessionState { snapshot: self.environment.save().map_err(broken)?, under_way })
    }

    /// Restores a saved state: the same actions then yield the same bytes.
    ///
    /// # Errors
    /// When the physics engine refuses the state.
    pub fn restore(&mut self, saved: &SessionState) -> Result<(), WorkspaceError> {
        self.environment.restore(&saved.snapshot).map_err(broken)?;
        self.under_way = Some(saved.under_way.clone());
        Ok(())
    }
}

/// Version that the physics engine reports.
pub fn engine_version() -> String {
    genmanip_sim::engine_version()
}

fn broken(error: RolloutError) -> WorkspaceError {
    match error {
        RolloutError::NotReset => {
            WorkspaceError::input("there is no episode").with_hint("reset begins one; finish takes it away")
        }
        error @ RolloutError::EpisodeOver { .. } => WorkspaceError::input(error.to_string()),
        error @ RolloutError::Action(_) => WorkspaceError::input(error.to_string()).with_hint("nothing has changed"),
        error @ RolloutError::UnknownCamera { .. } => WorkspaceError::input(error.to_string()),
        error => WorkspaceError::broken("the session broke", error),
    }
}

//! The pipeline as a policy: asks, plans, moves, looks again.

mod hand;
mod job;
mod pick;
mod put;

use std::sync::Arc;

use genmanip_core::{
    ActionChunk, CameraRequest, EpisodeStart, Failure, FailureCause, ImageChannels, Observation, Policy, PolicyError,
    PolicySpec, RgbdImage, Seed,
};
use genmanip_motion::{DepthSettings, GeometryError, Planner};

use self::hand::Hand;
use self::job::Job;
use self::put::Held;
use crate::ask::{
    Answer, FailedStage, Marks, PromptSet, Question, Reasks, Shown, Stage, Transcribed, VisionModel, ask, ask_each,
};
use crate::picture::marks;
use crate::segmentation::{RobotSilhouette, Segmenter};
use crate::services::GraspSource;
use crate::settings::AgentSettings;
use crate::sight::{LEFT_OVER, Sight, View, smoothed};

/// What the agent asks.
#[derive(Clone)]
pub struct Services {
    /// The vision-language model.
    pub model: Arc<dyn VisionModel>,
    /// The source of masks.
    pub segmenter: Arc<dyn Segmenter>,
    /// The source of grasps.
    pub grasps: Arc<dyn GraspSource>,
    /// The words of the questions.
    pub prompts: Arc<PromptSet>,
}

/// The modular manipulation system as a policy: it needs RGB-D images of fixed cameras and the robot's own state.
///
/// A clone shares the transcript; see [`Agent::branch`].
#[derive(Clone)]
pub struct Agent {
    /// In results.
    name: String,
    settings: AgentSettings,
    services: Services,
    planner: Arc<Planner>,
    silhouette: Arc<RobotSilhouette>,
    transcribed: Transcribed,
    seed: Seed,
    instruction: String,
    subtasks: Vec<String>,
    /// Index of the sub-task under way.
    current: usize,
    rounds: usize,
    /// Picks begun for the current sub-task, and in the episode.
    picks: usize,
    all_picks: u64,
    phase: Phase,
}

#[derive(Clone)]
enum Phase {
    /// Nothing in the hand, and the next thing is to be taken.
    Free,
    /// A pick was executed.
    Picked(Box<Held>),
    /// A placement was executed.
    Placed,
    /// What was dropped, or put back, is to be picked again.
    Again,
}

impl Agent {
    /// An agent that plans for the robot of `planner`; `transcribed` is filled as it works.
    ///
    /// # Errors
    /// A robot with a broken collision piece.
    pub fn new(
        settings: AgentSettings,
        services: Services,
        planner: &Arc<Planner>,
        transcribed: Transcribed,
    ) -> Result<Self, GeometryError> {
        let silhouette = Arc::new(RobotSilhouette::new(planner.robot())?);
        let mut planner = planner.with_search(settings.motion.search_nodes);
        if settings.depth_error_m > 0.0 {
            let error_m = LEFT_OVER * settings.depth_error_m;
            planner = planner.with_depth(DepthSettings { error_m, ..planner.settings().depth.clone() });
        }
        Ok(Self {
            name: "agent".into(),
            settings,
            services,
            silhouette,
            planner: Arc::new(planner),
            transcribed,
            seed: Seed::new(0),
            instruction: String::new(),
            subtasks: Vec::new(),
            current: 0,
            rounds: 0,
            picks: 0,
            all_picks: 0,
            phase: Phase::Free,
        })
    }

    /// The agent as it is at this moment, with services that may be others, and a transcript of its own that begins
    /// with what was asked and done so far: what would become of the episode from here on.
    #[must_use]
    pub fn branch(&self, services: Services) -> (Self, Transcribed) {
        let transcribed = self.transcribed.copied();
        (Self { services, transcribed: transcribed.clone(), ..self.clone() }, transcribed)
    }

    /// Questions asked so far in the episode, repeated ones included.
    pub fn asks(&self) -> usize {
        self.transcribed.asks()
    }

    /// How it works.
    pub fn settings(&self) -> &AgentSettings {
        &self.settings
    }

    /// What it asks.
    pub fn services(&self) -> &Services {
        &self.services
    }

    /// The same agent under another name in results, which says what serves it.
    #[must_use]
    pub fn named(self, name: String) -> Self {
        Self { name, ..self }
    }

    fn images(&self, observation: &Observation) -> Result<Vec<(String, Arc<RgbdImage>)>, PolicyError> {
        let image = |name: &String| {
            let image = observation.images.get(name).filter(|image| !image.depth_m.is_empty());
            let image =
                image.ok_or_else(|| PolicyError::Unsuited(format!("needs colour and depth of camera `{name}`")))?;
            let image = match self.settings.depth_error_m {
                error_m if error_m > 0.0 => Arc::new(smoothed(image, error_m)),
                _ => Arc::clone(image),
            };
            Ok((name.clone(), image))
        };
        self.settings.cameras.iter().map(image).collect()
    }

    /// What is seen now, segmented.
    fn look(&self, observation: &Observation, hand: &Hand) -> Result<Sight, Stop> {
        let images = self.images(observation)?;
        let robot = |(_, image): &(String, Arc<RgbdImage>)| self.silhouette.pixels(&hand.arm, hand.width_m, image);
        let ignore: Vec<Vec<bool>> = images.iter().map(robot).collect();
        let sight = Sight::new(images, &ignore, self.services.segmenter.as_ref());
        Ok(sight.map_err(|error| FailedStage::new("segmentation", FailedStage::SERVICE, error.to_string()))?)
    }

    /// Asks a question about a view.
    fn ask(&self, view: &View, asked: Asked) -> Result<Answer, FailedStage> {
        let reasks = Reasks { most: self.settings.reasks, not_found: asked.is_last_view };
        ask(self.services.model.as_ref(), self.question(view, asked), reasks, &self.transcribed)
    }

    /// Asks two questions about a view at once.
    fn ask_both(&self, view: &View, asked: [Asked; 2]) -> [Result<Answer, FailedStage>; 2] {
        let reasks = Reasks { most: self.settings.reasks, not_found: true };
        let questions = asked.map(|asked| self.question(view, asked));
        ask_each(self.services.model.as_ref(), questions, reasks, &self.transcribed)
    }

    fn question(&self, view: &View, asked: Asked) -> Question {
        let Asked { stage, instruction, object_name, start_point, pictures, marks, .. } = asked;
        let arrows = if self.settings.arrows { marks::ARROWS } else { "" };
        let inputs = crate::ask::Inputs { instruction, object_name, start_point, arrows };
        let (prompt, text) = self.services.prompts.fill(stage, inputs);
        Question {
            stage,
            ask: 0,
            prompt,
            text,
            instruction: instruction.into(),
            pictures,
            marks,
            view: Arc::clone(&view.image),
            reasoning: self.settings.reasoning,
            refused: Vec::new(),
        }
    }

    /// The picture of a view, with the robot's directions where they are wanted.
    fn plain(&self, view: &View) -> Shown {
        let mut picture = view.picture();
        if self.settings.arrows {
            marks::arrows(&mut picture, &view.image, self.settings.table_m);
        }
        Shown { name: "picture", picture: Arc::new(picture) }
    }

    fn decompose(&mut self, view: &View) -> Result<(), Stop> {
        self.rounds += 1;
        let pictures = vec![self.plain(view)];
        let instruction = self.instruction.clone();
        let asked = Asked { pictures, ..Asked::new(Stage::Decompose, &instruction) };
        if let Answer::Decompose(answer) = self.ask(view, asked)? {
            (self.subtasks, self.current, self.picks) = (answer.subtasks, 0, 0);
        }
        Ok(())
    }

    /// Asks for everything about the current sub-task and takes hold of the thing.
    fn begin(&mut self, observation: &Observation, hand: &Hand) -> Result<ActionChunk, Stop> {
        let mut sight = self.look(observation, hand)?;
        let mut view = sight.shown().cloned().ok_or_else(|| PolicyError::Unsuited("needs a camera".into()))?;
        if self.subtasks.is_empty() {
            self.decompose(&view)?;
        }
        // What was asked for a pick that could not be planned.
        let mut kept: Option<Job> = None;
        let mut camera = 0;
        loop {
            self.picks += 1;
            self.all_picks += 1;
            let seed = self.seed.fork("pick").fork_index(self.all_picks);
            let is_last_view = !self.settings.other_views || camera + 1 >= sight.views.len();
            let asked = match kept.take() {
                Some(job) => job.held_elsewhere(self, &view, seed),
                None => Job::asked(self, &sight, &view, is_last_view, hand, seed),
            };
            let planned = asked.and_then(|job| match pick::plan(self, &sight, &job, hand, seed) {
                Ok(pick) => Ok((job, pick)),
                Err(failure) => {
                    kept = Some(job);
                    Err(failure)
                }
            });
            match planned {
                Ok((job, pick)) => {
                    self.transcribed.acted(observation.time_s, format!("takes {}: {}", job.name, pick.words));
                    self.phase = Phase::Picked(Box::new(Held { job, grasp: pick.grasp, points: pick.points }));
                    return Ok(ActionChunk { actions: pick.commands, finished: false });
                }
                Err(failure) => {
                    self.transcribed.acted(observation.time_s, failure.to_string());
                    let is_hidden = failure.stage == Stage::Object.name()
                        && ["not_found", "no_masks"].contains(&failure.cause.as_str());
                    if is_hidden && !is_last_view {
                        // What one camera does not show, another may: each view moves to the front in its turn.
                        camera += 1;
                        sight = sight.shown_by(camera);
                        view = sight.views[0].clone();
                        self.picks -= 1;
                        continue;
                    }
                    let asked_enough = failure.cause == FailedStage::SERVICE
                        || Stage::ALL.iter().any(|stage| stage.name() == failure.stage);
                    if asked_enough || self.picks >= self.settings.picks {
                        return Err(failure.into());
                    }
                }
            }
        }
    }

    /// After a placement: is the task done, and what comes next?
    fn check(&mut self, observation: &Observation, hand: &Hand) -> Result<ActionChunk, Stop> {
        let images = self.images(observation)?;
        let view = images.into_iter().next().map(|(camera, image)| View { camera, image, masks: Vec::new().into() });
        let view = view.ok_or_else(|| PolicyError::Unsuited("needs a camera".into()))?;
        let pictures = vec![self.plain(&view)];
        let instruction = self.instruction.clone();
        let answer = self.ask(&view, Asked { pictures, ..Asked::new(Stage::Check, &instruction) })?;
        let remaining = match answer {
            Answer::Check(answer) if answer.finished => {
                return Ok(ActionChunk { actions: Vec::new(), finished: true });
            }
            Answer::Check(answer) if self.settings.check_splits => answer.remaining,
            _ => Vec::new(),
        };
        self.current += 1;
        self.picks = 0;
        if self.current >= self.subtasks.len() {
            if self.rounds >= self.settings.rounds {
                let evidence = format!("not finished after {} rounds", self.rounds);
                return Err(FailedStage::new("check", "rounds", evidence).into());
            }
            if !remaining.is_empty() {
                self.rounds += 1;
            }
            (self.subtasks, self.current) = (remaining, 0);
        }
        self.begin(observation, hand)
    }

    fn next(&mut self, observation: &Observation) -> Result<ActionChunk, Stop> {
        let hand = Hand::of(observation, self.planner.robot().arm_dof())?;
        match std::mem::replace(&mut self.phase, Phase::Free) {
            Phase::Free | Phase::Again => self.begin(observation, &hand),
            Phase::Picked(held) => self.put(*held, observation, &hand),
            Phase::Placed => self.check(observation, &hand),
        }
    }

    fn put(&mut self, held: Held, observation: &Observation, hand: &Hand) -> Result<ActionChunk, Stop> {
        let time_s = observation.time_s;
        let seed = self.seed.fork("put").fork_index(self.all_picks);
        if self.settings.look_again && !held.is_held(hand, &self.settings.motion) {
            self.transcribed.acted(time_s, format!("{} is not between the fingers", held.job.name));
            if self.picks >= self.settings.picks {
                let evidence = format!("{} was not in the hand after {} picks", held.job.name, self.picks);
                return Err(FailedStage::new("execute", "slipped", evidence).into());
            }
            self.phase = Phase::Again;
            return Ok(ActionChunk { actions: put::drop(self, &held, hand, seed), finished: false });
        }
        match put::plan(self, &held, hand, seed) {
            Ok((actions, words)) => {
                self.transcribed.acted(time_s, format!("puts {} down: {words}", held.job.name));
                self.phase = Phase::Placed;
                Ok(ActionChunk { actions, finished: false })
            }
            Err(failure) => {
                self.transcribed.acted(time_s, failure.to_string());
                if self.picks >= self.settings.picks {
                    return Err(failure.into());
                }
                self.phase = Phase::Again;
                let actions = put::back(self, &held, hand, seed).unwrap_or_else(|_| put::drop(self, &held, hand, seed));
                Ok(ActionChunk { actions, finished: false })
            }
        }
    }
}

impl Policy for Agent {
    fn spec(&self) -> PolicySpec {
        let request =
            |name: &String| CameraRequest { size: self.settings.size, ..CameraRequest::new(name, ImageChannels::RGBD) };
        PolicySpec {
            cameras: self.settings.cameras.iter().map(request).collect(),
            ..PolicySpec::native(&self.name, 60.0)
        }
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.seed = start.seed;
        self.instruction.clone_from(&start.instruction);
        self.subtasks.clear();
        (self.current, self.rounds, self.picks, self.all_picks, self.phase) = (0, 0, 0, 0, Phase::Free);
        self.transcribed.begin(&start.instruction, self.settings.preset.name());
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.next(observation).map_err(|stop| match stop {
            Stop::Failed(failure) => {
                self.transcribed.failed(&failure);
                // Nobody has failed at the task when a service does not answer.
                if failure.cause == FailedStage::SERVICE {
                    return PolicyError::Unreachable(failure.to_string());
                }
                PolicyError::GaveUp(Failure { cause: failure.kind(), evidence: failure.to_string() })
            }
            Stop::Policy(error) => error,
        })
    }
}

/// Why the agent does not go on.
enum Stop {
    Failed(FailedStage),
    Policy(PolicyError),
}

impl From<FailedStage> for Stop {
    fn from(failure: FailedStage) -> Self {
        Self::Failed(failure)
    }
}

impl From<PolicyError> for Stop {
    fn from(error: PolicyError) -> Self {
        Self::Policy(error)
    }
}

impl FailedStage {
    /// The cause under which results count it.
    fn kind(&self) -> FailureCause {
        match (self.stage.as_str(), self.cause.as_str()) {
            ("grasp", "out_of_reach") => FailureCause::NoIk,
            ("grasp", _) => FailureCause::NoGrasp,
            ("motion", _) => FailureCause::Planning,
            ("execute", _) => FailureCause::Slipped,
            ("check", "rounds") => FailureCause::GoalMissed,
            _ => FailureCause::Policy,
        }
    }
}

/// What is filled into a question.
struct Asked<'a> {
    stage: Stage,
    instruction: &'a str,
    object_name: &'a str,
    start_point: &'a str,
    pictures: Vec<Shown>,
    marks: Marks,
    /// Whether no other view can be shown where the answer is that nothing fits.
    is_last_view: bool,
}

impl<'a> Asked<'a> {
    fn new(stage: Stage, instruction: &'a str) -> Self {
        Self {
            stage,
            instruction,
            object_name: "",
            start_point: "",
            pictures: Vec::new(),
            marks: Marks::None,
            is_last_view: true,
        }
    }
}

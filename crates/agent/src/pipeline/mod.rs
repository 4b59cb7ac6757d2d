//! The agent pipeline as a policy: ask the model, plan, execute, observe again.

mod arm_state;
mod destination;
mod pick;
mod place;
mod subtask;

use std::sync::Arc;

use genmanip_core::{
    ActionChunk, AgentStage, CameraRequest, EpisodeStart, FailedStage, ImageChannels, Observation, Policy, PolicyError,
    PolicySpec, Pose, RgbdImage, Seed, StageCause,
};
use genmanip_motion::{DepthSettings, GeometryError, Planner};

use self::arm_state::ArmState;
use self::destination::Placement;
use self::place::HeldObject;
use self::subtask::{ObjectChoice, Retry, Subtask};
use crate::ask::{
    Answer, Marks, PromptSet, PromptVariant, Question, QuestionImage, QuestionKind, RetryLimits, TAKES,
    TranscriptRecorder, VisionModel, ask, ask_each,
};
use crate::image::marks;
use crate::perception::{RESIDUAL_NOISE, SegmentedViews, View, smoothed};
use crate::segmentation::{RobotSilhouette, Segmenter};
use crate::services::GraspSource;
use crate::settings::{AgentSettings, Asks};

/// Models and services that the agent queries.
#[derive(Clone)]
pub struct Services {
    /// Vision-language model that answers the questions.
    pub model: Arc<dyn VisionModel>,
    /// Source of segmentation masks.
    pub segmenter: Arc<dyn Segmenter>,
    /// Source of grasp candidates.
    pub grasps: Arc<dyn GraspSource>,
    /// Prompt templates of the questions.
    pub prompts: Arc<PromptSet>,
}

/// The modular manipulation system as a policy. It needs RGB-D images of fixed cameras and the proprioceptive state.
///
/// A clone shares the transcript; see [`Agent::branch`].
#[derive(Clone)]
pub struct Agent {
    /// Policy name written to results.
    name: String,
    settings: AgentSettings,
    services: Services,
    planner: Arc<Planner>,
    silhouette: Arc<RobotSilhouette>,
    transcribed: TranscriptRecorder,
    seed: Seed,
    instruction: String,
    subtasks: Vec<String>,
    /// Index of the current sub-task.
    current: usize,
    rounds: usize,
    /// Number of picks started for the current sub-task, and (`all_picks`) in the whole episode.
    picks: usize,
    all_picks: u64,
    /// Failures at the current sub-task, one sentence each, for the next questions.
    tried: Vec<String>,
    /// Grasps of the current sub-task from which the object slipped, world frame.
    slipped: Vec<Pose>,
    /// Valid answers to the placement questions of the current sub-task. `None` before they are answered.
    placement: Option<Placement>,
    phase: Phase,
}

#[derive(Clone)]
enum Phase {
    /// The gripper is empty; the next object is to be picked.
    ReadyToPick,
    /// A pick was executed; the gripper width shows later if it holds the object.
    Picked(Box<HeldObject>),
    /// A placement of an object of this name was executed.
    Placed(String),
    /// The object was dropped or put back and is to be picked again.
    RetryPick(Box<Retry>),
}

impl Agent {
    /// Creates an agent for the robot of `planner`; the agent records its questions and actions in `transcribed`.
    ///
    /// # Errors
    /// Fails if a collision piece of the robot is invalid.
    pub fn new(
        settings: AgentSettings,
        services: Services,
        planner: &Arc<Planner>,
        transcribed: TranscriptRecorder,
    ) -> Result<Self, GeometryError> {
        let silhouette = Arc::new(RobotSilhouette::new(planner.robot())?);
        let mut planner = planner.with_search(settings.motion.search_nodes);
        if settings.depth_error_m > 0.0 {
            let error_m = RESIDUAL_NOISE * settings.depth_error_m;
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
            tried: Vec::new(),
            slipped: Vec::new(),
            placement: None,
            phase: Phase::ReadyToPick,
        })
    }

    /// Clones the agent in its current state with other services and a copy of the transcript so far, for
    /// counterfactual rollouts from this moment on.
    #[must_use]
    pub fn branch(&self, services: Services) -> (Self, TranscriptRecorder) {
        let transcribed = self.transcribed.copied();
        (Self { services, transcribed: transcribed.clone(), ..self.clone() }, transcribed)
    }

    /// Number of questions asked in this episode, retries included.
    pub fn asks(&self) -> usize {
        self.transcribed.asks()
    }

    /// Settings of the agent.
    pub fn settings(&self) -> &AgentSettings {
        &self.settings
    }

    /// External services of the agent.
    pub fn services(&self) -> &Services {
        &self.services
    }

    /// Sets the policy name written to results; it names the services in use.
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

    /// Segments the current images of all cameras.
    fn segment(&self, observation: &Observation, state: &ArmState) -> Result<SegmentedViews, Stop> {
        let images = self.images(observation)?;
        let robot = |(_, image): &(String, Arc<RgbdImage>)| self.silhouette.pixels(&state.arm, state.width_m, image);
        let ignore: Vec<Vec<bool>> = images.iter().map(robot).collect();
        let views = SegmentedViews::new(images, &ignore, self.services.segmenter.as_ref());
        Ok(views.map_err(|error| FailedStage::new(AgentStage::Segmentation, StageCause::Service, error.to_string()))?)
    }

    /// Asks the model one question about a view.
    fn ask(&self, view: &View, asked: QuestionDraft) -> Result<Answer, FailedStage> {
        let reasks = RetryLimits { most: self.settings.reasks, not_found: asked.is_last_view };
        ask(self.services.model.as_ref(), self.question(view, asked), reasks, &self.transcribed)
    }

    /// Asks the model two questions about a view concurrently.
    fn ask_two(&self, view: &View, asked: [QuestionDraft; 2]) -> [Result<Answer, FailedStage>; 2] {
        let reasks = RetryLimits { most: self.settings.reasks, not_found: true };
        let questions = asked.map(|asked| self.question(view, asked));
        ask_each(self.services.model.as_ref(), questions, reasks, &self.transcribed)
    }

    fn question(&self, view: &View, asked: QuestionDraft) -> Question {
        let QuestionDraft { stage, instruction, object_name, start_point, pictures, marks, variant, .. } = asked;
        let arrows = if self.settings.arrows { marks::directions(&view.image) } else { String::new() };
        let inputs = crate::ask::Inputs { instruction, object_name, start_point, arrows: &arrows };
        let (prompt, mut text) = self.services.prompts.fill(stage, variant, inputs);
        text += &self.told_of_failures(stage);
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

    /// Paragraph on earlier failures at the sub-task, appended to a question about it; empty if there are none.
    fn told_of_failures(&self, stage: QuestionKind) -> String {
        let is_of_subtask = match stage {
            QuestionKind::Decompose | QuestionKind::Check => false,
            QuestionKind::Object
            | QuestionKind::Part
            | QuestionKind::GrabPoint
            | QuestionKind::GridPath
            | QuestionKind::PointToPoint => true,
        };
        if self.settings.asks == Asks::Every || !is_of_subtask || self.tried.is_empty() {
            return String::new();
        }
        format!("\n\nTried before, and failed:\n- {}", self.tried.join("\n- "))
    }

    /// Makes another sub-task the current one.
    fn begin_subtask(&mut self, current: usize) {
        (self.current, self.picks, self.placement) = (current, 0, None);
        self.tried.clear();
        self.slipped.clear();
    }

    /// Image of a view, with the robot's direction arrows if the settings ask for them.
    fn annotated_view(&self, view: &View) -> QuestionImage {
        let mut picture = view.picture();
        if self.settings.arrows {
            marks::arrows(&mut picture, &view.image, self.settings.table_m);
        }
        QuestionImage { name: "picture", picture: Arc::new(picture) }
    }

    fn decompose(&mut self, view: &View) -> Result<(), Stop> {
        self.rounds += 1;
        let pictures = vec![self.annotated_view(view)];
        let instruction = self.instruction.clone();
        let asked = QuestionDraft { pictures, ..QuestionDraft::new(QuestionKind::Decompose, &instruction) };
        if let Answer::Decompose(answer) = self.ask(view, asked)? {
            self.subtasks = answer.subtasks;
            self.begin_subtask(0);
        }
        Ok(())
    }

    /// Asks all questions of the current sub-task and plans its pick. In a retry, an object that stands where it stood
    /// is not asked for again, and another one first in the view that showed it before.
    fn pick(
        &mut self,
        observation: &Observation,
        state: &ArmState,
        retry: Option<&Retry>,
    ) -> Result<ActionChunk, Stop> {
        let mut views = self.segment(observation, state)?;
        let mut kept = None;
        if let Some(retry) = retry.filter(|_| self.settings.asks == Asks::Needed)
            && let Some(shown) = retry.shown(&views)
        {
            views = shown;
            kept = retry.found(&views).map(|mask| (mask, retry));
        }
        let mut view = views.shown().cloned().ok_or_else(|| PolicyError::Unsuited("needs a camera".into()))?;
        if self.subtasks.is_empty() {
            self.decompose(&view)?;
        }
        // Answers to reuse after a pick that could not be planned.
        let mut answered: Option<Subtask> = None;
        let mut camera = 0;
        loop {
            self.picks += 1;
            self.all_picks += 1;
            let seed = self.seed.fork("pick").fork_index(self.all_picks);
            let is_last_view = !self.settings.other_views || camera + 1 >= views.views.len();
            let asked = match answered.take() {
                Some(subtask) => subtask.regrasp(self, &view, seed),
                None => {
                    let choice = match kept {
                        Some((mask, retry)) => ObjectChoice::Kept { mask, retry },
                        None => ObjectChoice::Asked { is_last_view },
                    };
                    Subtask::asked(self, &views, &view, choice, state, seed)
                }
            };
            let planned = asked.and_then(|subtask| match pick::plan(self, &views, &subtask, state, seed) {
                Ok(pick) => Ok((subtask, pick)),
                Err(failure) => {
                    answered = Some(subtask);
                    Err(failure)
                }
            });
            match planned {
                Ok((subtask, pick)) => {
                    self.transcribed.acted(observation.time_s, format!("{TAKES}{}: {}", subtask.name, pick.words));
                    self.placement = Some(subtask.placement.clone());
                    self.phase =
                        Phase::Picked(Box::new(HeldObject { subtask, grasp: pick.grasp, points: pick.points }));
                    return Ok(ActionChunk { actions: pick.commands, finished: false });
                }
                Err(failure) => {
                    self.transcribed.acted(observation.time_s, failure.to_string());
                    let is_hidden = failure.stage == AgentStage::Object
                        && matches!(failure.cause, StageCause::NotFound | StageCause::NoMasks);
                    if is_hidden && !is_last_view {
                        // An object hidden from one camera may be visible to another: show each view to the model in
                        // turn.
                        camera += 1;
                        views = views.with_shown_view(camera);
                        view = views.views[0].clone();
                        self.picks -= 1;
                        continue;
                    }
                    let point = answered.as_ref().and_then(Subtask::point_words).unwrap_or_default();
                    self.tried.push(format!("{point}{failure}"));
                    let asked_enough = failure.cause == StageCause::Service
                        || QuestionKind::ALL.iter().any(|&kind| AgentStage::from(kind) == failure.stage);
                    if asked_enough || self.picks >= self.settings.picks {
                        return Err(failure.into());
                    }
                }
            }
        }
    }

    /// After a placement, checks the task or continues with the next sub-task.
    fn placed(&mut self, name: &str, observation: &Observation, state: &ArmState) -> Result<ActionChunk, Stop> {
        match self.subtasks.get(self.current + 1) {
            Some(next) if self.settings.asks == Asks::Needed && !names(next, name) => {
                self.begin_subtask(self.current + 1);
                self.pick(observation, state, None)
            }
            Some(_) | None => self.check(observation, state),
        }
    }

    /// After a placement, asks whether the task is finished and continues with the next sub-task.
    fn check(&mut self, observation: &Observation, state: &ArmState) -> Result<ActionChunk, Stop> {
        let images = self.images(observation)?;
        let view = images.into_iter().next().map(|(camera, image)| View { camera, image, masks: Vec::new().into() });
        let view = view.ok_or_else(|| PolicyError::Unsuited("needs a camera".into()))?;
        let pictures = vec![self.annotated_view(&view)];
        let instruction = self.instruction.clone();
        let answer =
            self.ask(&view, QuestionDraft { pictures, ..QuestionDraft::new(QuestionKind::Check, &instruction) })?;
        let remaining = match answer {
            Answer::Check(answer) if answer.finished => {
                return Ok(ActionChunk { actions: Vec::new(), finished: true });
            }
            Answer::Check(answer) if self.settings.check_splits => answer.remaining,
            _ => Vec::new(),
        };
        self.begin_subtask(self.current + 1);
        let left = self.subtasks.len().saturating_sub(self.current);
        if left > 0 && self.settings.asks == Asks::Needed && !remaining.is_empty() {
            // If the check lists more sub-tasks than remained, they count as a new round.
            let rounds = self.rounds + usize::from(remaining.len() > left);
            if rounds <= self.settings.rounds {
                (self.subtasks, self.current, self.rounds) = (remaining, 0, rounds);
            }
        } else if left == 0 {
            if self.rounds >= self.settings.rounds {
                let evidence = format!("not finished after {} rounds", self.rounds);
                return Err(FailedStage::new(AgentStage::Check, StageCause::Rounds, evidence).into());
            }
            if !remaining.is_empty() {
                self.rounds += 1;
            }
            (self.subtasks, self.current) = (remaining, 0);
        }
        self.pick(observation, state, None)
    }

    fn next(&mut self, observation: &Observation) -> Result<ActionChunk, Stop> {
        let state = ArmState::of(observation, self.planner.robot().arm_dof())?;
        match std::mem::replace(&mut self.phase, Phase::ReadyToPick) {
            Phase::ReadyToPick => self.pick(observation, &state, None),
            Phase::RetryPick(retry) => self.pick(observation, &state, Some(&retry)),
            Phase::Picked(held) => self.place(*held, observation, &state),
            Phase::Placed(name) => self.placed(&name, observation, &state),
        }
    }

    fn place(&mut self, held: HeldObject, observation: &Observation, state: &ArmState) -> Result<ActionChunk, Stop> {
        let time_s = observation.time_s;
        let seed = self.seed.fork("put").fork_index(self.all_picks);
        if self.settings.look_again && !held.is_grasped(state, &self.settings.motion) {
            self.transcribed.acted(time_s, format!("{} is not between the fingers", held.subtask.name));
            if self.picks >= self.settings.picks {
                let evidence = format!("{} was not in the gripper after {} picks", held.subtask.name, self.picks);
                return Err(FailedStage::new(AgentStage::Execute, StageCause::Slipped, evidence).into());
            }
            let point = held.subtask.point_words().unwrap_or_default();
            self.tried.push(format!("{point}took {}, but it was not between the fingers then", held.subtask.name));
            self.slipped.push(held.subtask.object.pose * held.grasp.object_from_tcp.pose);
            let actions = place::drop(self, &held, state, seed);
            self.phase = Phase::RetryPick(Box::new(Retry::new(held.subtask, true)));
            return Ok(ActionChunk { actions, finished: false });
        }
        match place::plan(self, &held, state, seed) {
            Ok((actions, words)) => {
                self.transcribed.acted(time_s, format!("puts {} down: {words}", held.subtask.name));
                self.phase = Phase::Placed(held.subtask.name);
                Ok(ActionChunk { actions, finished: false })
            }
            Err(failure) => {
                self.transcribed.acted(time_s, failure.to_string());
                if self.picks >= self.settings.picks {
                    return Err(failure.into());
                }
                self.tried.push(failure.to_string());
                self.placement = None;
                let actions =
                    place::put_back(self, &held, state, seed).unwrap_or_else(|_| place::drop(self, &held, state, seed));
                self.phase = Phase::RetryPick(Box::new(Retry::new(held.subtask, false)));
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
        self.begin_subtask(0);
        (self.rounds, self.all_picks, self.phase) = (0, 0, Phase::ReadyToPick);
        self.transcribed.begin(&start.instruction, self.settings.preset.name());
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.next(observation).map_err(|stop| match stop {
            Stop::Failed(failure) => {
                self.transcribed.failed(&failure);
                // A failure of a service is no failure of the agent at the task.
                if failure.cause == StageCause::Service {
                    return PolicyError::Unreachable(failure.to_string());
                }
                PolicyError::GaveUp(failure.failure())
            }
            Stop::Policy(error) => error,
        })
    }
}

/// Words that may stand before the noun of any object, so that they tell none from another.
const DETERMINERS: [&str; 13] =
    ["a", "an", "the", "this", "that", "its", "same", "other", "in", "into", "on", "onto", "of"];

/// True if a sub-task may mention an object: it has the last word of the object's name, which is the noun, but not only
/// as another object's (`puzzle cube` is no `green cube`).
fn names(subtask: &str, object: &str) -> bool {
    let words = |text: &str| -> Vec<String> {
        let words = text.split(|letter: char| !letter.is_alphanumeric()).filter(|word| !word.is_empty());
        words.map(str::to_lowercase).collect()
    };
    let (subtask, object) = (words(subtask), words(object));
    let Some((noun, adjectives)) = object.split_last() else { return true };
    let may_be_meant = |at: usize| match at.checked_sub(1).map(|before| &subtask[before]) {
        // A name of the noun alone says too little to tell objects apart.
        Some(before) if !adjectives.is_empty() => DETERMINERS.contains(&before.as_str()) || adjectives.contains(before),
        _ => true,
    };
    subtask.iter().enumerate().any(|(at, word)| word == noun && may_be_meant(at))
}

/// Reason for stopping the episode.
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

/// Inputs from which a [`Question`] is made.
struct QuestionDraft<'a> {
    stage: QuestionKind,
    instruction: &'a str,
    object_name: &'a str,
    start_point: &'a str,
    pictures: Vec<QuestionImage>,
    marks: Marks,
    /// True if there is no other view to show when the model answers that no mark fits.
    is_last_view: bool,
    variant: PromptVariant,
}

impl<'a> QuestionDraft<'a> {
    fn new(stage: QuestionKind, instruction: &'a str) -> Self {
        Self {
            stage,
            instruction,
            object_name: "",
            start_point: "",
            pictures: Vec::new(),
            marks: Marks::None,
            is_last_view: true,
            variant: PromptVariant::Plain,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::names;

    #[test]
    fn a_sub_task_names_an_object_by_its_noun() {
        let check =
            |subtask: &str, object: &str, expected: bool| assert_eq!(names(subtask, object), expected, "{subtask}");
        check("Put the spoon into the mug.", "dark blue Mug", true);
        check("Put the spoon on the mug's saucer.", "mug", true);
        check("Put the spoon on the plate.", "mug", false);
        check("Put the smug cat on the plate.", "mug", false);
        // The word before the noun tells objects apart.
        check("Pick up the puzzle cube and place it on the plate.", "green cube", false);
        check("Place the puzzle cube on the green cube.", "green cube", true);
        check("Place the puzzle cube on the cube.", "green cube", true);
        check("Pick up the red block.", "block", true);
        // An object without a name may be the one meant.
        check("Put the spoon on the plate.", "", true);
    }
}

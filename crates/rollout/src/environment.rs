//! The environment: a scenario that anyone can step, observe, judge, save and restore.
//!
//! The episode loop, and whatever else drives the robot, drives this one.
//! Two places step a simulation themselves and say why: grasp trials, and the bit-exact replay.
//!
//! ```text
//! reset(stage, seed) ─► step(command)… ─► settle() ─► finish(how it ended) ─► Episode
//!                        │ observe() · truth() · verdict() · save() / restore() at any time
//! ```

use std::sync::Arc;

use genmanip_core::{
    CameraRequest, Ending, Episode, EpisodeResult, Failure, FailureCause, Frame, GoalVerdict, GripperPhase,
    ObjectState, Observation, PrivilegedState, Seed, StrayContact,
};
use genmanip_relations::{PosedScene, RelationSettings, joint_state, judge_goal};
use genmanip_sim::{BodyId, Sim};

use crate::images::{Exposure, Painter, sensor_seed};
use crate::{RolloutError, RolloutSettings, Stage, evidence};

/// So long after the hand last held something it is still letting go of it, s.
const LETTING_GO_S: f64 = 1.0;

/// An episode under way, or none before the first [`Environment::reset`].
///
/// Everything that happens is a function of the stage and of the commands; the seed only names the episode's stream.
#[derive(Debug)]
pub struct Environment {
    settings: RolloutSettings,
    session: Option<Session>,
    /// Kept from episode to episode of the same stage.
    painter: Option<Painter>,
}

/// What one control step led to.
#[derive(Clone, Debug)]
pub struct Step {
    /// After the step, without images and simulator truth; see [`Environment::observe`] and [`Environment::truth`].
    pub observation: Observation,
    /// The goal's verdict, at those steps where the loop judges: every `judge_every`, and after settling.
    pub verdict: Option<GoalVerdict>,
    /// The goal has held for the settling time and the settings say to stop then, or the episode has settled.
    pub terminated: bool,
    /// The longest allowed time is over.
    pub truncated: bool,
    /// What happened during the step.
    pub events: Vec<Event>,
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Start of the control interval in which it happened; for the goal, the time it was judged.
    pub time_s: f64,
    /// What happened.
    pub kind: EventKind,
}

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// Both fingers began to press on an object, by its index.
    Grasped(usize),
    /// They no longer do.
    Released(usize),
    /// A link of the robot began to touch what it should not, or what it touches changed.
    StrayContact([BodyId; 2]),
    /// The goal holds, and did not when it was judged before.
    GoalReached,
    /// The goal does not hold any more.
    GoalLost,
}

/// Who acted in an episode and how it ended, as only the driver knows.
#[derive(Clone, Debug, PartialEq)]
pub struct Conclusion<'a> {
    /// Name of the episode, usable as a file name.
    pub id: &'a str,
    /// Name of the policy.
    pub policy: &'a str,
    /// Whether it read simulator truth.
    pub oracle: bool,
    /// How it ended.
    pub ending: Ending,
    /// Why the policy gave up, in its own words.
    pub word: Option<Failure>,
}

/// Everything an episode's continuation depends on, at one moment: simulation, judge's memory, recording and events.
#[derive(Clone, Debug)]
pub struct Snapshot {
    stage: Stage,
    seed: Seed,
    state: Vec<f64>,
    record: Record,
}

impl Snapshot {
    /// The simulation's complete state.
    pub fn state(&self) -> &[f64] {
        &self.state
    }
}

#[derive(Debug)]
struct Session {
    stage: Stage,
    seed: Seed,
    sim: Sim,
    record: Record,
    /// The scene as relations see it, of which a look moves only what the goal depends on.
    seen: PosedScene,
}

/// What has become of the episode so far, the simulation's own state apart.
#[derive(Clone, Debug)]
struct Record {
    initial_state: Vec<f64>,
    frames: Vec<Frame>,
    events: Vec<Event>,
    success_once: bool,
    /// Number of control steps after which the goal was first seen to hold without having been lost since.
    held_since: Option<usize>,
    worst_stray_n: f64,
    stray_contact: Option<StrayContact>,
    /// Bodies of the stray contact in the last interval.
    touching: Option<[BodyId; 2]>,
    /// The object that was in the hand last, and when.
    last_held: Option<(usize, f64)>,
    /// State each object was in when it was last judged: a state lasts until it is clearly left.
    joint_states: Vec<Option<String>>,
    /// Number of control steps before settling, and the verdict after it.
    settled: Option<(usize, GoalVerdict)>,
}

impl Environment {
    /// An environment without an episode.
    pub fn new(settings: RolloutSettings) -> Self {
        Self { settings, session: None, painter: None }
    }

    /// How long episodes last and when things count as being at rest.
    pub fn settings(&self) -> &RolloutSettings {
        &self.settings
    }

    /// Begins an episode at the stage's start; whatever was under way is dropped.
    pub fn reset(&mut self, stage: &Stage, seed: Seed) -> Observation {
        let sim = Sim::new(Arc::clone(&stage.scene));
        let record = Record {
            initial_state: sim.state(),
            frames: Vec::new(),
            events: Vec::new(),
            success_once: false,
            held_since: None,
            worst_stray_n: 0.0,
            stray_contact: None,
            touching: None,
            last_held: None,
            joint_states: joint_states(stage.start(), &stage.relations),
            settled: None,
        };
        let seen = stage.start().clone();
        self.session.insert(Session { stage: stage.clone(), seed, sim, record, seen }).observation()
    }

    /// Runs one control interval with a native command: arm joint targets and the gripper's opening width.
    ///
    /// # Errors
    /// Before the first reset, after the episode is over, for a command of the wrong length or not finite (nothing has
    /// changed then), and when the simulation becomes unstable.
    pub fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        if session.is_terminated(&self.settings) || session.is_truncated(&self.settings) {
            return Err(RolloutError::EpisodeOver { frames: session.record.frames.len() });
        }
        session.step(command, &self.settings)
    }

    /// Holds the last command for the settling time and judges the goal: the terminal observation with the final
    /// verdict. The robot's home is held when there was no command. Settling again changes nothing.
    ///
    /// # Errors
    /// Before the first reset, and when the simulation becomes unstable.
    pub fn settle(&mut self) -> Result<Step, RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        let known = session.record.events.len();
        if session.record.settled.is_none() {
            let (command, before) = (session.last_command(), session.record.frames.len());
            for _ in 0..steps_in(self.settings.settle_s, &session.stage) {
                session.step(&command, &self.settings)?;
            }
            let (verdict, _) = session.judge(&self.settings);
            session.record.settled = Some((before, verdict));
        }
        Ok(Step {
            observation: session.observation(),
            verdict: session.record.settled.as_ref().map(|(_, verdict)| verdict.clone()),
            terminated: true,
            truncated: session.is_truncated(&self.settings),
            events: session.record.events[known..].to_vec(),
        })
    }

    /// Lets go of what pictures keep for the next ones, some 30 MB per camera; the next ones are the same, and take longer.
    pub fn forget_pictures(&mut self) {
        self.painter = None;
    }

    /// What is seen now: the robot's own state, and an image per request, drawn from the present state.
    ///
    /// It may be asked at any time, also before the first step and after settling; simulator truth is apart, see
    /// [`Environment::truth`].
    ///
    /// # Errors
    /// Before the first reset, and for a camera that is not there or cannot be drawn.
    pub fn observe(&mut self, cameras: &[CameraRequest]) -> Result<Observation, RolloutError> {
        let session = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        let mut observation = session.observation();
        if cameras.is_empty() {
            return Ok(observation);
        }
        let painter = match self.painter.take().filter(|painter| painter.is_of(&session.stage)) {
            Some(painter) => self.painter.insert(painter),
            None => self.painter.insert(Painter::new(&session.stage)?),
        };
        let seen = cameras.iter().map(|request| session.stage.camera(request)).collect::<Result<Vec<_>, _>>()?;
        let views: Vec<_> = seen.iter().zip(cameras).map(|(camera, request)| (camera, request.channels)).collect();
        let (objects, arm) = (session.sim.object_states(), session.sim.joint_positions());
        let objects = objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let before = &session.record.frames[..];
        let noise = sensor_seed(session.seed, before.len());
        let exposure = Exposure { noise, before, step_s: 1.0 / session.stage.control_rate_hz() };
        let images = painter.paint_state(&arm, session.sim.gripper_width(), objects, &views, exposure)?;
        observation.images =
            cameras.iter().map(|request| request.name.clone()).zip(images.into_iter().map(Arc::new)).collect();
        Ok(observation)
    }

    /// Simulator truth, for privileged policies only.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn truth(&mut self) -> Result<PrivilegedState, RolloutError> {
        let sim = &mut self.session.as_mut().ok_or(RolloutError::NotReset)?.sim;
        Ok(PrivilegedState { objects: sim.object_states(), grasped: sim.grasped() })
    }

    /// Where the objects are: the part of the truth that costs next to nothing.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn objects(&self) -> Result<Vec<ObjectState>, RolloutError> {
        self.session.as_ref().map(|session| session.sim.object_states()).ok_or(RolloutError::NotReset)
    }

    /// The goal as it is now, nothing held and nothing moving; the judge's memory of joint states is left alone.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn verdict(&mut self) -> Result<GoalVerdict, RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        Ok(session.judge(&self.settings).0)
    }

    /// Why the episode would fail if it ended now, judged as at its end but without any further settling; a policy that
    /// gave up has its word. Empty where the goal holds.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn failures(&mut self, word: Option<Failure>) -> Result<Vec<Failure>, RolloutError> {
        let verdict = self.verdict()?;
        let Session { stage, record, .. } = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        if verdict.success {
            return Ok(Vec::new());
        }
        Ok(evidence::explain(stage, &record.frames, &verdict, word, &self.settings))
    }

    /// Control steps that are left before the longest allowed time is over; 0 without an episode.
    pub fn steps_left(&self) -> usize {
        self.session.as_ref().map_or(0, |session| {
            steps_in(self.settings.horizon_s, &session.stage).saturating_sub(session.record.frames.len())
        })
    }

    /// The command in force, native: the last one as applied; the robot's home before the first step.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn command(&self) -> Result<Vec<f32>, RolloutError> {
        self.session.as_ref().map(Session::last_command).ok_or(RolloutError::NotReset)
    }

    /// Arm joint positions, rad.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn joint_positions(&self) -> Result<Vec<f64>, RolloutError> {
        self.session.as_ref().map(|session| session.sim.joint_positions()).ok_or(RolloutError::NotReset)
    }

    /// Control steps so far.
    pub fn frames(&self) -> &[Frame] {
        self.session.as_ref().map_or(&[], |session| &session.record.frames)
    }

    /// What has happened so far.
    pub fn events(&self) -> &[Event] {
        self.session.as_ref().map_or(&[], |session| &session.record.events)
    }

    /// Ends the episode, settling it if that has not been done: the recording with its judged result.
    ///
    /// # Errors
    /// Before the first reset, and when the simulation becomes unstable.
    pub fn finish(&mut self, conclusion: Conclusion) -> Result<Episode, RolloutError> {
        self.settle()?;
        let session = self.session.take().ok_or(RolloutError::NotReset)?;
        session.finish(conclusion, &self.settings)
    }

    /// Everything the continuation depends on.
    ///
    /// # Errors
    /// Before the first reset.
    pub fn save(&self) -> Result<Snapshot, RolloutError> {
        let Session { stage, seed, sim, record, .. } = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        Ok(Snapshot { stage: stage.clone(), seed: *seed, state: sim.state(), record: record.clone() })
    }

    /// Goes back to a saved moment, of this or another episode: the same commands then lead to the same bytes.
    ///
    /// # Errors
    /// When the physics engine refuses the state.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), RolloutError> {
        let Snapshot { stage, seed, state, record } = snapshot.clone();
        let mut sim = Sim::new(Arc::clone(&stage.scene));
        sim.set_state(&state)?;
        let seen = stage.start().clone();
        self.session = Some(Session { stage, seed, sim, record, seen });
        Ok(())
    }
}

impl Session {
    fn observation(&self) -> Observation {
        let mut state = self.sim.joint_positions();
        state.push(self.sim.gripper_width());
        Observation {
            time_s: self.record.frames.len() as f64 / self.stage.control_rate_hz(),
            state: [(Observation::STATE.to_owned(), state)].into(),
            ..Observation::default()
        }
    }

    fn step(&mut self, command: &[f32], settings: &RolloutSettings) -> Result<Step, RolloutError> {
        let frame = self.sim.control_step(command)?;
        let mut events = self.events_of(&frame);
        self.note_stray(&frame);
        self.record.frames.push(frame);
        let frames = self.record.frames.len();
        let verdict = frames.is_multiple_of(settings.judge_every.max(1)).then(|| {
            let (verdict, states) = self.look(settings);
            self.record.joint_states = states;
            verdict
        });
        let observation = self.observation();
        if let Some(verdict) = &verdict {
            self.record.success_once |= verdict.success;
            let kind = match (verdict.success, self.record.held_since) {
                (true, None) => Some(EventKind::GoalReached),
                (false, Some(_)) => Some(EventKind::GoalLost),
                _ => None,
            };
            events.extend(kind.map(|kind| Event { time_s: observation.time_s, kind }));
            self.record.held_since = verdict.success.then(|| self.record.held_since.unwrap_or(frames));
        }
        self.record.events.extend_from_slice(&events);
        Ok(Step {
            observation,
            verdict,
            terminated: self.is_terminated(settings),
            truncated: self.is_truncated(settings),
            events,
        })
    }

    fn is_terminated(&self, settings: &RolloutSettings) -> bool {
        let held = |since: usize| self.record.frames.len() - since >= steps_in(settings.settle_s, &self.stage);
        self.record.settled.is_some() || settings.stop_on_success && self.record.held_since.is_some_and(held)
    }

    fn is_truncated(&self, settings: &RolloutSettings) -> bool {
        let frames = self.record.settled.as_ref().map_or(self.record.frames.len(), |(before, _)| *before);
        frames >= steps_in(settings.horizon_s, &self.stage)
    }

    /// What a frame shows that the one before did not.
    fn events_of(&mut self, frame: &Frame) -> Vec<Event> {
        let event = |kind| Event { time_s: frame.time_s, kind };
        let before = self.record.frames.last().and_then(|last| last.grasped);
        let mut events = Vec::new();
        if before != frame.grasped {
            events.extend(before.map(|object| event(EventKind::Released(object))));
            events.extend(frame.grasped.map(|object| event(EventKind::Grasped(object))));
        }
        let touching = self.sim.stray_bodies();
        if touching != self.record.touching {
            events.extend(touching.map(|bodies| event(EventKind::StrayContact(bodies))));
            self.record.touching = touching;
        }
        events
    }

    /// Keeps who touched what in the hardest stray contact so far.
    fn note_stray(&mut self, frame: &Frame) {
        let record = &mut self.record;
        record.last_held = frame.grasped.map(|object| (object, frame.time_s)).or(record.last_held);
        let Some([link, other]) = self.sim.stray_bodies().filter(|_| frame.stray_contact_n > record.worst_stray_n)
        else {
            return;
        };
        let before = record.frames.last().unwrap_or(frame).command.last().copied().unwrap_or_default();
        record.worst_stray_n = frame.stray_contact_n;
        record.stray_contact = Some(StrayContact {
            time_s: frame.time_s,
            link: self.stage.scene.body_name(link),
            other: self.stage.scene.body_name(other),
            hand: GripperPhase::of(frame, before),
            let_go: record.last_held.is_some_and(|(held, last_s)| {
                matches!(other, BodyId::Object { object, .. } if object == held)
                    && frame.time_s - last_s <= LETTING_GO_S
            }),
        });
    }

    fn last_command(&self) -> Vec<f32> {
        let start = || {
            let arm = self.stage.scenario.world.robot.start().iter().map(|&q| q as f32);
            arm.chain([self.stage.robot.gripper.max_width as f32]).collect()
        };
        self.record.frames.last().map_or_else(start, |frame| frame.command.clone())
    }

    /// A look at the goal on the way: the verdict, and the state each object is in, as [`Session::judge`] but cheaper.
    ///
    /// Contacts are computed again only while something is held, or to confirm that the goal holds; until then what the
    /// last control step began with counts as held. What is held satisfies nothing, so no success is missed or made up.
    fn look(&mut self, settings: &RolloutSettings) -> (GoalVerdict, Vec<Option<String>>) {
        let objects = self.sim.object_states();
        for &index in self.stage.judged.iter() {
            let object = &objects[index];
            self.seen.set_pose(index, object.pose, &object.joint_positions);
        }
        self.seen.set_previous_states(self.record.joint_states.iter().cloned());
        let states = joint_states(&self.seen, &self.stage.relations);
        let was_held = self.record.frames.last().is_some_and(|frame| frame.grasped.is_some());
        let mut rest = Stage::rest(&objects, if was_held { self.sim.grasped() } else { None }, settings);
        let mut verdict = judge_goal(&self.seen, &self.stage.goal, &rest, &self.stage.relations);
        if verdict.success && !was_held {
            rest.held = self.sim.grasped();
            if rest.held.is_some() {
                verdict = judge_goal(&self.seen, &self.stage.goal, &rest, &self.stage.relations);
            }
        }
        (verdict, states)
    }

    /// The verdict, and the state each object is in.
    fn judge(&mut self, settings: &RolloutSettings) -> (GoalVerdict, Vec<Option<String>>) {
        let objects = self.sim.object_states();
        let rest = Stage::rest(&objects, self.sim.grasped(), settings);
        let mut scene = self.stage.posed(&objects);
        scene.set_previous_states(self.record.joint_states.iter().cloned());
        let states = joint_states(&scene, &self.stage.relations);
        (judge_goal(&scene, &self.stage.goal, &rest, &self.stage.relations), states)
    }

    fn finish(mut self, conclusion: Conclusion, settings: &RolloutSettings) -> Result<Episode, RolloutError> {
        let verdict = match self.record.settled.take() {
            Some((_, verdict)) => verdict,
            None => self.judge(settings).0,
        };
        let other_request_success = self.stage.scenario.other_request.as_ref().map(|request| {
            let objects = self.sim.object_states();
            let rest = Stage::rest(&objects, self.sim.grasped(), settings);
            judge_goal(&self.stage.posed(&objects), &request.goal, &rest, &self.stage.relations).success
        });
        let Conclusion { id, policy, oracle, ending, word } = conclusion;
        let Self { stage, seed, sim, record, .. } = self;
        let word = word.or_else(|| timeout(ending, settings.horizon_s));
        let success = verdict.success;
        let failures =
            if success { Vec::new() } else { evidence::explain(&stage, &record.frames, &verdict, word, settings) };
        let path = record.frames.windows(2).map(|w| (w[1].tcp.position - w[0].tcp.position).length()).sum();
        let result = EpisodeResult {
            id: id.into(),
            scenario_id: stage.scenario.id.clone(),
            task_id: stage.scenario.task.id.clone(),
            policy: policy.into(),
            oracle,
            seed,
            success,
            success_once: record.success_once || success,
            verdict,
            ending: Some(ending),
            failures,
            duration_s: record.frames.len() as f64 / stage.control_rate_hz(),
            horizon_s: settings.horizon_s,
            control_rate_hz: stage.control_rate_hz(),
            frames: record.frames.len(),
            tcp_path_m: path,
            max_stray_contact_n: record.worst_stray_n,
            stray_contact: record.stray_contact,
            world_hashes: Some(stage.scenario.world.hashes()),
            cloud: None,
            other_request_success,
            correction: None,
            engine: genmanip_sim::engine_version(),
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
        };
        Ok(Episode {
            scenario: (*stage.scenario).clone(),
            result,
            initial_state: record.initial_state,
            final_state: sim.state(),
            frames: record.frames,
        })
    }
}

/// What is said of an episode whose time was over.
pub(crate) fn timeout(ending: Ending, after_s: f64) -> Option<Failure> {
    let evidence = || format!("not finished after {after_s} s");
    (ending == Ending::Horizon).then(|| Failure { cause: FailureCause::Timeout, evidence: evidence() })
}

/// Control steps in a time.
pub(crate) fn steps_in(time_s: f64, stage: &Stage) -> usize {
    (time_s * stage.control_rate_hz()).round() as usize
}

/// The state each object is in.
fn joint_states(scene: &PosedScene, relations: &RelationSettings) -> Vec<Option<String>> {
    (0..scene.objects().len()).map(|index| joint_state(scene, index, relations)).collect()
}

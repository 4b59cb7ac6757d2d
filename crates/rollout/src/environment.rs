//! The environment: a scenario to step, observe, judge, save and restore.
//!
//! The episode loop and all other drivers of the robot use it. Two exceptions step a simulation themselves and state
//! why: grasp trials, and bit-exact replay.
//!
//! ```text
//! reset(stage, seed) ─► step(command)… ─► settle() ─► finish(conclusion) ─► Episode
//!                        │ observe() · truth() · verdict() · save() / restore() · mark() / rewind() at any time
//! ```

use std::sync::Arc;

use genmanip_core::{
    CameraRequest, Ending, Episode, EpisodeResult, ExpertStyle, Failure, FailureCause, Frame, GoalVerdict,
    GripperPhase, ObjectState, Observation, PrivilegedState, Seed, StrayContact,
};
use genmanip_relations::{PosedScene, RelationSettings, joint_state, judge_goal};
use genmanip_sim::{BodyId, Sim};

use crate::evidence::Unreachable;
use crate::images::{Exposure, StageRenderer, sensor_seed};
use crate::recording::{Memory, Record};
use crate::{RolloutError, RolloutSettings, Stage, evidence};

pub use crate::recording::{Event, EventKind, Mark, Snapshot};

/// Time after the last grip during which contact with the object counts as part of the release, s. Chosen by hand.
const RELEASE_S: f64 = 1.0;

/// Environment with an episode in progress, or none before the first [`Environment::reset`].
///
/// The course of the episode is a function of the stage and the commands; the seed only identifies the episode's random
/// stream.
#[derive(Debug)]
pub struct Environment {
    settings: RolloutSettings,
    session: Option<Session>,
    /// Renderer, reused by all episodes of the same stage; `None` before the first image.
    renderer: Option<StageRenderer>,
}

/// Result of one control step.
#[derive(Clone, Debug)]
pub struct Step {
    /// State after the step, without images and simulator ground truth; see [`Environment::observe`] and
    /// [`Environment::truth`].
    pub observation: Observation,
    /// Goal verdict if this step was judged (every `judge_every` steps and after settling), else `None`.
    pub verdict: Option<GoalVerdict>,
    /// True if the goal has held for the settling time and the settings say to stop then, or if the episode has
    /// settled.
    pub terminated: bool,
    /// True if the time limit is reached.
    pub truncated: bool,
    /// Events in the simulation during the step.
    pub events: Vec<Event>,
}

/// Facts about the end of an episode that only the driver knows.
#[derive(Clone, Debug, PartialEq)]
pub struct Conclusion<'a> {
    /// Id of the episode, usable as a file name.
    pub id: &'a str,
    /// Name of the policy, written to the result.
    pub policy: &'a str,
    /// True if the policy read simulator ground truth.
    pub oracle: bool,
    /// Ending of the episode, as the driver saw it.
    pub ending: Ending,
    /// The policy's reason for giving up, if it did; `None` otherwise.
    pub gave_up: Option<Failure>,
}

#[derive(Debug)]
struct Session {
    stage: Stage,
    seed: Seed,
    sim: Sim,
    record: Record,
    /// Geometry for relations; during the episode, only the objects that the goal depends on are updated.
    scene: PosedScene,
}

impl Environment {
    /// Environment before the first [`Environment::reset`].
    pub fn new(settings: RolloutSettings) -> Self {
        Self { settings, session: None, renderer: None }
    }

    /// Settings of the episode loop.
    pub fn settings(&self) -> &RolloutSettings {
        &self.settings
    }

    /// Starts an episode in the stage's initial state; any episode in progress is dropped.
    pub fn reset(&mut self, stage: &Stage, seed: Seed) -> Observation {
        let sim = Sim::new(Arc::clone(&stage.scene));
        let record = Record {
            initial_state: sim.state(),
            frames: Vec::new(),
            events: Vec::new(),
            memory: Memory { joint_states: joint_states(stage.start(), &stage.relations), ..Memory::default() },
        };
        let scene = stage.start().clone();
        self.session.insert(Session { stage: stage.clone(), seed, sim, record, scene }).observation()
    }

    /// Runs one control interval with a native command: arm joint targets (rad), then gripper opening (m).
    ///
    /// # Errors
    /// If the environment was not reset, the episode is over, the command has the wrong length or is not finite
    /// (nothing changes in these cases), or the simulation becomes unstable.
    pub fn step(&mut self, command: &[f32]) -> Result<Step, RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        if session.is_terminated(&self.settings) || session.is_truncated(&self.settings) {
            return Err(RolloutError::EpisodeOver { frames: session.record.frames.len() });
        }
        session.step(command, &self.settings)
    }

    /// Holds the last command (the robot's home if there was none) for the settling time and judges the goal: the
    /// terminal observation with the final verdict. Idempotent.
    ///
    /// # Errors
    /// If the environment was not reset, or the simulation becomes unstable.
    pub fn settle(&mut self) -> Result<Step, RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        let known = session.record.events.len();
        if session.record.memory.settled.is_none() {
            let (command, before) = (session.last_command(), session.record.frames.len());
            for _ in 0..steps_in(self.settings.settle_s, &session.stage) {
                session.step(&command, &self.settings)?;
            }
            let (verdict, _) = session.judge(&self.settings);
            session.record.memory.settled = Some((before, verdict));
        }
        Ok(Step {
            observation: session.observation(),
            verdict: session.record.memory.settled.as_ref().map(|(_, verdict)| verdict.clone()),
            terminated: true,
            truncated: session.is_truncated(&self.settings),
            events: session.record.events[known..].to_vec(),
        })
    }

    /// Drops the per-camera render caches, about 30 MB per camera; the next images are the same but take longer.
    pub fn drop_render_caches(&mut self) {
        self.renderer = None;
    }

    /// Observation now: the robot's state, and one image per request, rendered from the current state.
    ///
    /// May be called at any time, also before the first step and after settling. Simulator ground truth is separate,
    /// see [`Environment::truth`].
    ///
    /// # Errors
    /// If the environment was not reset, a camera does not exist, or rendering fails.
    pub fn observe(&mut self, cameras: &[CameraRequest]) -> Result<Observation, RolloutError> {
        let session = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        let mut observation = session.observation();
        if cameras.is_empty() {
            return Ok(observation);
        }
        let renderer = match self.renderer.take().filter(|renderer| renderer.is_of(&session.stage)) {
            Some(renderer) => self.renderer.insert(renderer),
            None => self.renderer.insert(StageRenderer::new(&session.stage)?),
        };
        let seen = cameras.iter().map(|request| session.stage.camera(request)).collect::<Result<Vec<_>, _>>()?;
        let views: Vec<_> = seen.iter().zip(cameras).map(|(camera, request)| (camera, request.channels)).collect();
        let (objects, arm) = (session.sim.object_states(), session.sim.joint_positions());
        let objects = objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let before = &session.record.frames[..];
        let noise = sensor_seed(session.seed, before.len());
        let exposure = Exposure { noise, before, step_s: 1.0 / session.stage.control_rate_hz() };
        let images = renderer.render_state(&arm, session.sim.gripper_width(), objects, &views, exposure)?;
        observation.images =
            cameras.iter().map(|request| request.name.clone()).zip(images.into_iter().map(Arc::new)).collect();
        Ok(observation)
    }

    /// Simulator ground truth, for privileged policies only.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn truth(&mut self) -> Result<PrivilegedState, RolloutError> {
        let sim = &mut self.session.as_mut().ok_or(RolloutError::NotReset)?.sim;
        Ok(PrivilegedState { objects: sim.object_states(), grasped: sim.grasped() })
    }

    /// States of the objects; cheaper than [`Environment::truth`].
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn objects(&self) -> Result<Vec<ObjectState>, RolloutError> {
        self.session.as_ref().map(|session| session.sim.object_states()).ok_or(RolloutError::NotReset)
    }

    /// Verdict of the current state, with rest and release required; does not update the judge's memory of joint
    /// states.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn verdict(&mut self) -> Result<GoalVerdict, RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        Ok(session.judge(&self.settings).0)
    }

    /// Counts an action that was not executed because its pose is unreachable.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn count_unreachable(&mut self, reason: &str) -> Result<(), RolloutError> {
        let record = &mut self.session.as_mut().ok_or(RolloutError::NotReset)?.record;
        let step = record.frames.len();
        let first = || Unreachable { actions: 0, step, reason: reason.to_owned() };
        record.memory.unreachable.get_or_insert_with(first).actions += 1;
        Ok(())
    }

    /// Failures of the episode if it ended now, judged without further settling; includes the policy's reason `gave_up`
    /// for giving up. Empty if the goal holds.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn failures(&mut self, gave_up: Option<Failure>) -> Result<Vec<Failure>, RolloutError> {
        let verdict = self.verdict()?;
        let Session { stage, record, .. } = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        if verdict.success {
            return Ok(Vec::new());
        }
        Ok(evidence::explain(stage, record.seen(), &verdict, gave_up, &self.settings))
    }

    /// Control steps left before the time limit; 0 without an episode.
    pub fn steps_left(&self) -> usize {
        self.session.as_ref().map_or(0, |session| {
            steps_in(self.settings.horizon_s, &session.stage).saturating_sub(session.record.frames.len())
        })
    }

    /// Native command in force: the last one as applied; the robot's home before the first step.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn command(&self) -> Result<Vec<f32>, RolloutError> {
        self.session.as_ref().map(Session::last_command).ok_or(RolloutError::NotReset)
    }

    /// Arm joint positions, rad.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn joint_positions(&self) -> Result<Vec<f64>, RolloutError> {
        self.session.as_ref().map(|session| session.sim.joint_positions()).ok_or(RolloutError::NotReset)
    }

    /// Frames recorded so far, one per control step.
    pub fn frames(&self) -> &[Frame] {
        self.session.as_ref().map_or(&[], |session| &session.record.frames)
    }

    /// Events of the episode so far, in order.
    pub fn events(&self) -> &[Event] {
        self.session.as_ref().map_or(&[], |session| &session.record.events)
    }

    /// Ends the episode, after settling if not yet settled: the recording with its result.
    ///
    /// # Errors
    /// If the environment was not reset, or the simulation becomes unstable.
    pub fn finish(&mut self, conclusion: Conclusion) -> Result<Episode, RolloutError> {
        self.settle()?;
        let session = self.session.take().ok_or(RolloutError::NotReset)?;
        session.finish(conclusion, &self.settings)
    }

    /// Saves the complete state of the episode.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn save(&self) -> Result<Snapshot, RolloutError> {
        let Session { stage, seed, sim, record, .. } = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        Ok(Snapshot { stage: stage.clone(), seed: *seed, state: sim.state(), record: record.clone() })
    }

    /// Restores a snapshot of this or another episode: the same commands then give the same bytes.
    ///
    /// # Errors
    /// If the physics engine rejects the state.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), RolloutError> {
        let Snapshot { stage, seed, state, record } = snapshot.clone();
        let mut sim = Sim::new(Arc::clone(&stage.scene));
        sim.set_state(&state)?;
        let scene = stage.start().clone();
        self.session = Some(Session { stage, seed, sim, record, scene });
        Ok(())
    }

    /// Marks the present moment of the episode.
    ///
    /// # Errors
    /// If the environment was not reset.
    pub fn mark(&self) -> Result<Mark, RolloutError> {
        let Session { sim, record, .. } = self.session.as_ref().ok_or(RolloutError::NotReset)?;
        let (frames, events) = (record.frames.len(), record.events.len());
        Ok(Mark { state: sim.state(), memory: record.memory.clone(), frames, events })
    }

    /// Returns to a marked moment of this episode; later frames and events are dropped from the recording. The same
    /// commands then give the same bytes.
    ///
    /// # Errors
    /// If the environment was not reset, or the physics engine rejects the state.
    pub fn rewind(&mut self, mark: &Mark) -> Result<(), RolloutError> {
        let session = self.session.as_mut().ok_or(RolloutError::NotReset)?;
        let mut sim = Sim::new(Arc::clone(&session.stage.scene));
        sim.set_state(&mark.state)?;
        (session.sim, session.scene) = (sim, session.stage.start().clone());
        session.record.frames.truncate(mark.frames);
        session.record.events.truncate(mark.events);
        session.record.memory = mark.memory.clone();
        Ok(())
    }
}

impl Session {
    fn observation(&self) -> Observation {
        let mut state = self.sim.joint_positions();
        let tool = self.stage.robot.tcp_pose(&state).to_row().to_vec();
        state.push(self.sim.gripper_width());
        let command = self.last_command().into_iter().map(f64::from).collect();
        let named = [(Observation::STATE, state), (Observation::COMMAND, command), (Observation::TOOL, tool)];
        Observation {
            time_s: self.record.frames.len() as f64 / self.stage.control_rate_hz(),
            state: named.map(|(key, values)| (key.to_owned(), values)).into(),
            ..Observation::default()
        }
    }

    fn step(&mut self, command: &[f32], settings: &RolloutSettings) -> Result<Step, RolloutError> {
        let frame = self.sim.control_step(command)?;
        let mut events = self.events_of(&frame);
        self.record_stray_contact(&frame);
        self.record.frames.push(frame);
        let frames = self.record.frames.len();
        let verdict = frames.is_multiple_of(settings.judge_every.max(1)).then(|| {
            let (verdict, states) = self.judge_incrementally(settings);
            self.record.memory.joint_states = states;
            verdict
        });
        let observation = self.observation();
        if let Some(verdict) = &verdict {
            self.record.memory.success_once |= verdict.success;
            let kind = match (verdict.success, self.record.memory.held_since) {
                (true, None) => Some(EventKind::GoalReached),
                (false, Some(_)) => Some(EventKind::GoalLost),
                _ => None,
            };
            events.extend(kind.map(|kind| Event { time_s: observation.time_s, kind }));
            self.record.memory.held_since = verdict.success.then(|| self.record.memory.held_since.unwrap_or(frames));
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
        self.record.memory.settled.is_some()
            || settings.stop_on_success && self.record.memory.held_since.is_some_and(held)
    }

    fn is_truncated(&self, settings: &RolloutSettings) -> bool {
        let frames = self.record.memory.settled.as_ref().map_or(self.record.frames.len(), |(before, _)| *before);
        frames >= steps_in(settings.horizon_s, &self.stage)
    }

    /// Events of a frame, relative to the previous one.
    fn events_of(&mut self, frame: &Frame) -> Vec<Event> {
        let event = |kind| Event { time_s: frame.time_s, kind };
        let before = self.record.frames.last().and_then(|last| last.grasped);
        let mut events = Vec::new();
        if before != frame.grasped {
            events.extend(before.map(|object| event(EventKind::Released(object))));
            events.extend(frame.grasped.map(|object| event(EventKind::Grasped(object))));
        }
        let stray_bodies = self.sim.stray_bodies();
        if stray_bodies != self.record.memory.stray_bodies {
            events.extend(stray_bodies.map(|bodies| event(EventKind::StrayContact(bodies))));
            self.record.memory.stray_bodies = stray_bodies;
        }
        events
    }

    /// Records the bodies of the strongest stray contact so far.
    fn record_stray_contact(&mut self, frame: &Frame) {
        let record = &mut self.record;
        record.memory.last_gripped = frame.grasped.map(|object| (object, frame.time_s)).or(record.memory.last_gripped);
        let Some([link, other]) =
            self.sim.stray_bodies().filter(|_| frame.stray_contact_n > record.memory.worst_stray_n)
        else {
            return;
        };
        let before = record.frames.last().unwrap_or(frame).command.last().copied().unwrap_or_default();
        record.memory.worst_stray_n = frame.stray_contact_n;
        record.memory.stray_contact = Some(StrayContact {
            time_s: frame.time_s,
            link: self.stage.scene.body_name(link),
            other: self.stage.scene.body_name(other),
            hand: GripperPhase::of(frame, before),
            let_go: record.memory.last_gripped.is_some_and(|(held, last_s)| {
                matches!(other, BodyId::Object { object, .. } if object == held) && frame.time_s - last_s <= RELEASE_S
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

    /// Verdict and object states, equal to [`Session::judge`] but cheaper.
    ///
    /// Contacts are recomputed only while an object is gripped, or to confirm that the goal holds; otherwise the grip at the
    /// start of the last control step is used. A gripped object satisfies no condition, so the success is still exact.
    fn judge_incrementally(&mut self, settings: &RolloutSettings) -> (GoalVerdict, Vec<Option<String>>) {
        let objects = self.sim.object_states();
        for &index in self.stage.judged.iter() {
            let object = &objects[index];
            self.scene.set_pose(index, object.pose, &object.joint_positions);
        }
        self.scene.set_previous_states(self.record.memory.joint_states.iter().cloned());
        let states = joint_states(&self.scene, &self.stage.relations);
        let was_held = self.record.frames.last().is_some_and(|frame| frame.grasped.is_some());
        let mut rest = Stage::rest(&objects, if was_held { self.sim.grasped() } else { None }, settings);
        let mut verdict = judge_goal(&self.scene, &self.stage.goal, &rest, &self.stage.relations);
        if verdict.success && !was_held {
            rest.held = self.sim.grasped();
            if rest.held.is_some() {
                verdict = judge_goal(&self.scene, &self.stage.goal, &rest, &self.stage.relations);
            }
        }
        (verdict, states)
    }

    /// Verdict on the goal, and named state of each object's joints.
    fn judge(&mut self, settings: &RolloutSettings) -> (GoalVerdict, Vec<Option<String>>) {
        let objects = self.sim.object_states();
        let rest = Stage::rest(&objects, self.sim.grasped(), settings);
        let mut scene = self.stage.posed(&objects);
        scene.set_previous_states(self.record.memory.joint_states.iter().cloned());
        let states = joint_states(&scene, &self.stage.relations);
        (judge_goal(&scene, &self.stage.goal, &rest, &self.stage.relations), states)
    }

    fn finish(mut self, conclusion: Conclusion, settings: &RolloutSettings) -> Result<Episode, RolloutError> {
        let verdict = match self.record.memory.settled.take() {
            Some((_, verdict)) => verdict,
            None => self.judge(settings).0,
        };
        let other_request_success = self.stage.scenario.other_request.as_ref().map(|request| {
            let objects = self.sim.object_states();
            let rest = Stage::rest(&objects, self.sim.grasped(), settings);
            judge_goal(&self.stage.posed(&objects), &request.goal, &rest, &self.stage.relations).success
        });
        let Conclusion { id, policy, oracle, ending, gave_up } = conclusion;
        let Self { stage, seed, sim, record, .. } = self;
        let gave_up = gave_up.or_else(|| timeout(ending, settings.horizon_s));
        let success = verdict.success;
        let failures =
            if success { Vec::new() } else { evidence::explain(&stage, record.seen(), &verdict, gave_up, settings) };
        let path = record.frames.windows(2).map(|w| (w[1].tcp.position - w[0].tcp.position).length()).sum();
        let result = EpisodeResult {
            id: id.into(),
            scenario_id: stage.scenario.id.clone(),
            task_id: stage.scenario.task.id.clone(),
            policy: policy.into(),
            oracle,
            seed,
            success,
            success_once: record.memory.success_once || success,
            verdict,
            ending: Some(ending),
            failures,
            duration_s: record.frames.len() as f64 / stage.control_rate_hz(),
            horizon_s: settings.horizon_s,
            control_rate_hz: stage.control_rate_hz(),
            frames: record.frames.len(),
            unreachable_actions: record.memory.unreachable.as_ref().map_or(0, |seen| seen.actions),
            tcp_path_m: path,
            max_stray_contact_n: record.memory.worst_stray_n,
            stray_contact: record.memory.stray_contact,
            world_hashes: Some(stage.scenario.world.hashes()),
            cloud: None,
            other_request_success,
            correction: None,
            expert: ExpertStyle::Default,
            agent_failure: None,
            source: None,
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

/// Failure of an episode that reached its time limit. `None` for another ending.
pub(crate) fn timeout(ending: Ending, after_s: f64) -> Option<Failure> {
    let evidence = || format!("not finished after {after_s} s");
    (ending == Ending::Horizon).then(|| Failure { cause: FailureCause::Timeout, evidence: evidence() })
}

/// Number of control steps in a time span.
pub(crate) fn steps_in(time_s: f64, stage: &Stage) -> usize {
    (time_s * stage.control_rate_hz()).round() as usize
}

/// Named state of each object's joints; `None` for objects without named states or between them.
fn joint_states(scene: &PosedScene, relations: &RelationSettings) -> Vec<Option<String>> {
    (0..scene.objects().len()).map(|index| joint_state(scene, index, relations)).collect()
}

//! The one loop: observe, act, step, record; settle; judge.

use genmanip_core::{
    ActionSpace, Episode, EpisodeResult, EpisodeStart, Failure, FailureCause, Frame, GoalVerdict, HandPhase,
    Observation, Policy, PolicyError, PolicySpec, PrivilegedState, Seed, StrayContact,
};
use genmanip_scene::relations::{PosedScene, RelationSettings, joint_state, judge_goal};
use genmanip_sim::{BodyId, Sim, SimError};
use std::sync::Arc;

use crate::{RolloutError, RolloutSettings, Stage, evidence};

/// So long after the hand last held something it is still letting go of it, s.
const LETTING_GO_S: f64 = 1.0;

/// Runs one episode and judges it.
///
/// The policy acts until it says it is finished, gives up or the horizon ends; then the last command is held for
/// `settle_s` and the goal is judged on posed geometry, nothing held and nothing moving.
///
/// # Errors
/// Only for defects: a spec that cannot be served, or a simulation that becomes unstable.
/// A policy that fails is a result, not an error.
pub fn run_episode(
    stage: &Stage,
    policy: &mut dyn Policy,
    id: &str,
    seed: Seed,
    settings: &RolloutSettings,
) -> Result<Episode, RolloutError> {
    let spec = policy.spec();
    let repeat = check_spec(&spec, stage)?;
    let mut recording = Recording::new(stage, settings);
    let horizon = (settings.horizon_s * stage.control_rate_hz()).round() as usize;
    let start = EpisodeStart {
        instruction: stage.scenario.task.instruction.clone(),
        seed: seed.fork("policy"),
        cameras: stage.scenario.world.cameras.iter().filter(|c| spec.cameras.contains(&c.name)).cloned().collect(),
        scenario: spec.privileged.then(|| Arc::clone(&stage.scenario)),
    };

    let mut failure = policy.reset(&start).err().map(as_failure);
    while failure.is_none() {
        let left = horizon - recording.frames.len();
        if left == 0 {
            failure = Some(Failure {
                cause: FailureCause::Timeout,
                evidence: format!("not finished after {} s", settings.horizon_s),
            });
            break;
        }
        let chunk = match policy.act(&recording.observe(&spec)) {
            Ok(chunk) => chunk,
            Err(error) => {
                failure = Some(as_failure(error));
                break;
            }
        };
        if chunk.actions.is_empty() && !chunk.finished {
            failure = Some(broke("returned no action".into()));
            break;
        }
        let count = if spec.execute_steps == 0 { usize::MAX } else { spec.execute_steps };
        let commands = chunk.actions.iter().take(count).flat_map(|action| std::iter::repeat_n(action, repeat));
        for command in commands.take(left) {
            failure = recording.step_of_policy(command)?;
            if failure.is_some() {
                break;
            }
        }
        // What was cut off, by the horizon or by `execute_steps`, was not finished.
        let executed = chunk.actions.len() <= count && chunk.actions.len().saturating_mul(repeat) <= left;
        if chunk.finished && executed {
            break;
        }
    }
    recording.settle()?;
    Ok(recording.finish(id, seed, &spec, failure))
}

/// How many control steps one action lasts; refuses what this loop cannot serve.
fn check_spec(spec: &PolicySpec, stage: &Stage) -> Result<usize, RolloutError> {
    let refuse = |reason: String| Err(RolloutError::Spec { policy: spec.name.clone(), reason });
    let control_rate_hz = stage.control_rate_hz();
    let repeat = control_rate_hz / spec.rate_hz;
    if !(repeat >= 1.0 && repeat.fract() == 0.0) {
        return refuse(format!("rate {} Hz does not divide the control rate of {control_rate_hz} Hz", spec.rate_hz));
    }
    if spec.action.space != ActionSpace::JointPosition || spec.action.gripper != "width_m" {
        return refuse("expected native actions: absolute joint positions and the gripper width in metres".into());
    }
    if let Some(key) = spec.state_keys.iter().find(|key| *key != "observation.state") {
        return refuse(format!("unknown state key `{key}`, there is `observation.state`"));
    }
    if let Some(camera) = spec.cameras.first() {
        let known = stage.scenario.world.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        return refuse(format!(
            "camera `{camera}` would have to be rendered in the loop, which comes with learned policies; the \
             scenario's cameras are {known}"
        ));
    }
    Ok(repeat as usize)
}

fn as_failure(error: PolicyError) -> Failure {
    match error {
        PolicyError::GaveUp(failure) => failure,
        PolicyError::Unsuited(reason) => broke(reason),
    }
}

fn broke(evidence: String) -> Failure {
    Failure { cause: FailureCause::Policy, evidence }
}

struct Recording<'a> {
    stage: &'a Stage,
    settings: &'a RolloutSettings,
    sim: Sim,
    initial_state: Vec<f64>,
    frames: Vec<Frame>,
    success_once: bool,
    worst_stray_n: f64,
    stray_contact: Option<StrayContact>,
    /// The object that was in the hand last, and when.
    last_held: Option<(usize, f64)>,
    /// State each object was in when it was last judged: a state lasts until it is clearly left.
    states: Vec<Option<String>>,
}

impl<'a> Recording<'a> {
    fn new(stage: &'a Stage, settings: &'a RolloutSettings) -> Self {
        let sim = Sim::new(Arc::clone(&stage.scene));
        let initial_state = sim.state();
        let states = joint_states(stage.start(), &stage.relations);
        Self {
            stage,
            settings,
            sim,
            initial_state,
            frames: Vec::new(),
            success_once: false,
            worst_stray_n: 0.0,
            stray_contact: None,
            last_held: None,
            states,
        }
    }

    fn observe(&mut self, spec: &PolicySpec) -> Observation {
        let mut state = self.sim.joint_positions();
        state.push(self.sim.gripper_width());
        Observation {
            time_s: self.frames.len() as f64 / self.stage.control_rate_hz(),
            state: [("observation.state".to_owned(), state)].into(),
            images: Default::default(),
            privileged: spec
                .privileged
                .then(|| PrivilegedState { objects: self.sim.object_states(), grasped: self.sim.grasped() }),
        }
    }

    /// A step with what a policy asks for; an action that is none is the policy's failure.
    fn step_of_policy(&mut self, action: &[f32]) -> Result<Option<Failure>, RolloutError> {
        match self.step(action) {
            Err(RolloutError::Sim(error @ (SimError::CommandLength { .. } | SimError::CommandNotFinite { .. }))) => {
                Ok(Some(broke(format!("action for control step {}: {error}", self.frames.len()))))
            }
            Err(error) => Err(error),
            Ok(()) => Ok(None),
        }
    }

    fn step(&mut self, action: &[f32]) -> Result<(), RolloutError> {
        let frame = self.sim.control_step(action)?;
        self.note_stray(&frame);
        self.frames.push(frame);
        if self.frames.len().is_multiple_of(self.settings.judge_every) {
            self.success_once |= self.judge().success;
        }
        Ok(())
    }

    /// Keeps who touched what in the hardest stray contact so far.
    fn note_stray(&mut self, frame: &Frame) {
        self.last_held = frame.grasped.map(|object| (object, frame.time_s)).or(self.last_held);
        let Some([link, other]) = self.sim.stray_bodies().filter(|_| frame.stray_contact_n > self.worst_stray_n) else {
            return;
        };
        let before = self.frames.last().unwrap_or(frame).command.last().copied().unwrap_or_default();
        self.worst_stray_n = frame.stray_contact_n;
        self.stray_contact = Some(StrayContact {
            time_s: frame.time_s,
            link: self.stage.scene.body_name(link),
            other: self.stage.scene.body_name(other),
            hand: HandPhase::of(frame, before),
            let_go: self.last_held.is_some_and(|(held, last_s)| {
                matches!(other, BodyId::Object { object, .. } if object == held)
                    && frame.time_s - last_s <= LETTING_GO_S
            }),
        });
    }

    fn settle(&mut self) -> Result<(), RolloutError> {
        let command = match self.frames.last() {
            Some(frame) => frame.command.clone(),
            None => self.home_command(),
        };
        for _ in 0..(self.settings.settle_s * self.stage.control_rate_hz()).round() as usize {
            self.step(&command)?;
        }
        Ok(())
    }

    fn home_command(&self) -> Vec<f32> {
        let arm = self.stage.scenario.world.robot.home.iter().map(|&q| q as f32);
        arm.chain([self.stage.robot.gripper.max_width as f32]).collect()
    }

    fn judge(&mut self) -> GoalVerdict {
        let states = self.sim.object_states();
        let rest = Stage::rest(&states, self.sim.grasped(), self.settings);
        let mut scene = self.stage.posed(&states);
        scene.set_previous_states(self.states.iter().cloned());
        self.states = joint_states(&scene, &self.stage.relations);
        judge_goal(&scene, &self.stage.scenario.task.goal, &rest, &self.stage.relations)
    }

    fn finish(mut self, id: &str, seed: Seed, spec: &PolicySpec, failure: Option<Failure>) -> Episode {
        let verdict = self.judge();
        let success = verdict.success;
        let failure = (!success).then(|| evidence::explain(self.stage, &self.frames, &verdict, failure, self.settings));
        let path = self.frames.windows(2).map(|w| (w[1].tcp.position - w[0].tcp.position).length()).sum();
        let result = EpisodeResult {
            id: id.into(),
            scenario_id: self.stage.scenario.id.clone(),
            task_id: self.stage.scenario.task.id.clone(),
            policy: spec.name.clone(),
            oracle: spec.privileged,
            seed,
            success,
            success_once: self.success_once || success,
            verdict,
            failure,
            duration_s: self.frames.len() as f64 / self.stage.control_rate_hz(),
            horizon_s: self.settings.horizon_s,
            control_rate_hz: self.stage.control_rate_hz(),
            frames: self.frames.len(),
            tcp_path_m: path,
            max_stray_contact_n: self.worst_stray_n,
            stray_contact: self.stray_contact,
            world_hashes: Some(self.stage.scenario.world.hashes()),
            engine: genmanip_sim::engine_version(),
            genmanip_version: env!("CARGO_PKG_VERSION").into(),
        };
        Episode {
            scenario: (*self.stage.scenario).clone(),
            result,
            initial_state: self.initial_state,
            final_state: self.sim.state(),
            frames: self.frames,
        }
    }
}

/// The state each object is in.
fn joint_states(scene: &PosedScene, relations: &RelationSettings) -> Vec<Option<String>> {
    (0..scene.objects().len()).map(|index| joint_state(scene, index, relations)).collect()
}

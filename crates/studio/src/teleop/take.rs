//! Takes: teleoperated episodes with the log of their operator, run by the ordinary loop, stored and replayed.

use std::cell::Cell;

use genmanip_core::{Correction, Document, Ending, Episode, EpisodeSource, Frame, Seed};
use genmanip_data::{Attachment, DataError, EpisodeStore};
use genmanip_rollout::environment::Conclusion;
use genmanip_rollout::episode_loop::BeforeTurn;
use genmanip_rollout::go_to;
use genmanip_rollout::{Environment, RolloutError, RolloutSettings, Stage, replay, run_episode_with, run_policy};
use genmanip_teleop::record::{
    EVENTS_FILE, OperatorRecord, Playback, RECORD_FILE, RecordedEvent, Stretch, events_from_lines,
};
use genmanip_teleop::{EpisodeLog, OperatorKind, TeleopSettings, Teleoperation};
use genmanip_workspace::WorkspaceError;

use super::live::Live;

/// Name of the policy in results of takes.
pub const POLICY: &str = "teleop";

/// A teleoperated episode with its log.
#[derive(Clone, Debug)]
pub struct Take {
    /// Judged episode with its source.
    pub episode: Episode,
    log: EpisodeLog,
}

impl Take {
    /// Runs an episode of an operator; `before_turn` is called before each control step.
    ///
    /// # Errors
    /// As [`run_episode_with`].
    pub fn run(
        stage: &Stage,
        policy: &mut Teleoperation,
        id: &str,
        seed: Seed,
        settings: &RolloutSettings,
        before_turn: &mut BeforeTurn,
    ) -> Result<Self, RolloutError> {
        let (mut log, frame) = (EpisodeLog::new(policy), policy.frame());
        let episode = run_episode_with(stage, policy, id, seed, settings, before_turn)?;
        log.add_operator(policy, frame, 0, episode.frames.len());
        Ok(Self::of(episode, log))
    }

    /// Ends the episode of an environment in which the stretches of `log` were acted, and judges it. `oracle` is true if
    /// one of those in command read simulator truth.
    ///
    /// # Errors
    /// As [`Environment::finish`].
    pub fn finish(
        environment: &mut Environment,
        log: EpisodeLog,
        id: &str,
        ending: Ending,
        oracle: bool,
    ) -> Result<Self, RolloutError> {
        let episode = environment.finish(Conclusion { id, policy: POLICY, oracle, ending, gave_up: None })?;
        Ok(Self::of(episode, log))
    }

    fn of(mut episode: Episode, log: EpisodeLog) -> Self {
        let kind = log.record().operator.kind;
        let stretches = log.in_command();
        // A motion to a pose that the person chose is the person's, and no policy was taken over from.
        let policy_of = |stretch: &Stretch| stretch.policy.clone().filter(|name| name != go_to::NAME);
        let has_policy = stretches.iter().any(|stretch| policy_of(stretch).is_some());
        episode.result.source = Some(match kind {
            OperatorKind::Person if has_policy => EpisodeSource::Correction,
            kind => kind.episode_source(),
        });
        let taken_over = stretches.windows(2).find_map(|pair| {
            let policy = policy_of(&pair[0]).filter(|_| policy_of(&pair[1]).is_none())?;
            Some(Correction { policy, from_step: pair[1].from, failures: Vec::new() })
        });
        episode.result.correction = taken_over;
        Self { episode, log }
    }

    /// The take without its idle ends: simulated anew from its events, and from the commands of other policies, and
    /// judged anew. `None` if there is nothing to cut, or if the verdict would change.
    ///
    /// # Errors
    /// If the simulation becomes unstable.
    pub fn trimmed(&self, stage: &Stage, settings: &RolloutSettings) -> Result<Option<Self>, WorkspaceError> {
        let Some(trim) = self.log.trim() else { return Ok(None) };
        let result = &self.episode.result;
        let [head, end] = trim.cut;
        let tail = self.log.in_command().last().map_or(0, |last| last.to - end);
        let frames = &self.episode.frames[head..];
        let script = Script { in_command: &trim.in_command, events: &trim.events, frames };
        let (mut environment, mut log) = script.run(stage, settings, result.seed, &self.log.record())?;
        log.trimmed_from(&self.log, [head, tail]);
        let trimmed = Self::finish(&mut environment, log, &result.id, Ending::Finished, result.oracle)
            .map_err(|error| WorkspaceError::broken(format!("the trimmed take {} broke", result.id), error))?;
        Ok(Some(trimmed).filter(|trimmed| trimmed.episode.result.success == result.success))
    }

    /// Adds the take to a store.
    ///
    /// # Errors
    /// As [`EpisodeStore::write`].
    pub fn store(&self, store: &EpisodeStore) -> Result<(), DataError> {
        let attachments = [
            Attachment { name: RECORD_FILE.into(), bytes: self.log.record().to_json().into_bytes() },
            Attachment { name: EVENTS_FILE.into(), bytes: self.log.lines() },
        ];
        store.write(&self.episode, &attachments)
    }
}

/// Course of a take: who was in command when, the operator's events, and frames with the commands of other policies.
struct Script<'a> {
    in_command: &'a [Stretch],
    events: &'a [RecordedEvent],
    frames: &'a [Frame],
}

impl Script<'_> {
    /// Simulates the course anew, with the settings of `record`: the environment before settling, and its log.
    fn run(
        &self,
        stage: &Stage,
        settings: &RolloutSettings,
        seed: Seed,
        record: &OperatorRecord,
    ) -> Result<(Environment, EpisodeLog), WorkspaceError> {
        let broke = |error: RolloutError| WorkspaceError::broken("the take cannot be simulated anew", error);
        let operator = |frame, events| {
            let mapping = genmanip_teleop::mapping::MappingSettings { frame, ..record.mapping.clone() };
            let (target, input, camera) = (record.target.clone(), record.input.clone(), record.camera.clone());
            let follow = record.follow.clone();
            let source = Box::new(Playback::new(record.operator.clone(), events));
            let settings = TeleopSettings { mapping, target, input, follow, camera };
            Teleoperation::new(settings, source, &stage.robot, &stage.scenario.world).map_err(WorkspaceError::input)
        };
        let mut environment = Environment::new(settings.clone());
        environment.reset(stage, seed);
        let end = Cell::new(0);
        let stop = |environment: &Environment| match environment.frames().len() < end.get() {
            true => Ok(()),
            false => Err(interrupted()),
        };
        let mut robot = Live::new(environment, Box::new(stop));
        let mut log = EpisodeLog::new(&operator(record.mapping.frame, Vec::new())?);
        for Stretch { from, to, policy, frame } in self.in_command.iter().cloned() {
            end.set(to);
            if let Some(name) = policy {
                for frame in self.frames.get(from..to).unwrap_or_default() {
                    robot.environment.step(&frame.command).map_err(broke)?;
                }
                log.add_policy(&name, from, to);
                continue;
            }
            let own = self.events.iter().filter(|event| (from..to).contains(&event.step)).cloned().collect();
            let mut policy = operator(frame.unwrap_or(record.mapping.frame), own)?.starting_at(from);
            let frame = policy.frame();
            match run_policy(&mut robot, stage, &mut policy, seed, settings) {
                Ok(_) => {}
                Err(_) if robot.environment.frames().len() == to => {}
                Err(error) => return Err(broke(error)),
            }
            log.add_operator(&policy, frame, from, robot.environment.frames().len());
        }
        Ok((robot.environment, log))
    }
}

/// Error that ends the stretch of a policy in command; the caller knows the reason.
pub(super) fn interrupted() -> RolloutError {
    RolloutError::NotRun { policy: POLICY.into(), reason: "the stretch has ended".into(), mistake: false }
}

/// True if a stored take replays to the same bytes from its commands, and gives the same commands and states from its
/// raw events, with the recorded commands where another policy was in command; `settings` are those of its episode.
///
/// # Errors
/// If the take cannot be read, or the simulation becomes unstable.
pub fn is_replayed(
    stage: &Stage,
    store: &EpisodeStore,
    id: &str,
    settings: &RolloutSettings,
) -> Result<bool, WorkspaceError> {
    let unread = |error| WorkspaceError::broken(format!("episode {id} cannot be read back"), error);
    let episode = store.read(id).map_err(unread)?;
    let text = |name: &str| store.read_attachment(id, name).map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let record = OperatorRecord::from_json(&text(RECORD_FILE).map_err(unread)?)
        .map_err(|error| WorkspaceError::broken(format!("the record of episode {id} cannot be read back"), error))?;
    let events = events_from_lines(&text(EVENTS_FILE).map_err(unread)?)
        .map_err(|error| WorkspaceError::broken(format!("the events of episode {id} cannot be read back"), error))?;
    let broke = |error: RolloutError| WorkspaceError::broken(format!("the replay of episode {id} broke"), error);
    let by_commands = replay::check(stage, &episode).map_err(broke)?.identical;
    let throughout = [Stretch { from: 0, to: episode.frames.len(), policy: None, frame: None }];
    let in_command = if record.in_command.is_empty() { &throughout[..] } else { &record.in_command };
    let script = Script { in_command, events: &events, frames: &episode.frames };
    let (mut environment, log) = script.run(stage, settings, episode.result.seed, &record)?;
    let ending = episode.result.ending.unwrap_or(Ending::Finished);
    let again = Take::finish(&mut environment, log, id, ending, episode.result.oracle).map_err(broke)?.episode;
    let bits = |state: &[f64]| state.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    Ok(by_commands && again.frames == episode.frames && bits(&again.final_state) == bits(&episode.final_state))
}

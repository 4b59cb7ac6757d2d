//! Takes: teleoperated episodes with the record of their operator, run by the ordinary loop, stored and replayed.

use genmanip_core::{Document, Episode, Seed};
use genmanip_data::{Attachment, DataError, EpisodeStore};
use genmanip_rollout::episode_loop::BeforeTurn;
use genmanip_rollout::{RolloutError, RolloutSettings, Stage, replay, run_episode, run_episode_with};
use genmanip_teleop::record::{EVENTS_FILE, OperatorRecord, Playback, RECORD_FILE, events_from_lines, events_to_lines};
use genmanip_teleop::{TeleopSettings, Teleoperation};
use genmanip_workspace::WorkspaceError;

/// A teleoperated episode and the files beside it.
#[derive(Clone, Debug)]
pub struct Take {
    /// Judged episode with its source.
    pub episode: Episode,
    /// Record of the operator, and raw events.
    pub attachments: [Attachment; 2],
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
        let mut episode = run_episode_with(stage, policy, id, seed, settings, before_turn)?;
        let record = policy.record();
        episode.result.source = Some(record.operator.kind.episode_source());
        let attachments = [
            Attachment { name: RECORD_FILE.into(), bytes: record.to_json().into_bytes() },
            Attachment { name: EVENTS_FILE.into(), bytes: events_to_lines(policy.events()) },
        ];
        Ok(Self { episode, attachments })
    }

    /// Adds the take to a store.
    ///
    /// # Errors
    /// As [`EpisodeStore::write`].
    pub fn store(&self, store: &EpisodeStore) -> Result<(), DataError> {
        store.write(&self.episode, &self.attachments)
    }
}

/// True if a stored take replays to the same bytes from its commands, and gives the same commands and states from its
/// raw events; `settings` are those of its episode.
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
    let source = Box::new(Playback::new(record.operator, events));
    let teleop =
        TeleopSettings { mapping: record.mapping, target: record.target, input: record.input, camera: record.camera };
    let mut policy =
        Teleoperation::new(teleop, source, &stage.robot, &stage.scenario.world).map_err(WorkspaceError::input)?;
    let again = run_episode(stage, &mut policy, id, episode.result.seed, settings).map_err(broke)?;
    let bits = |state: &[f64]| state.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    Ok(by_commands && again.frames == episode.frames && bits(&again.final_state) == bits(&episode.final_state))
}

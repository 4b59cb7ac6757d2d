//! Policies that report their turns and can be stopped between them.

use std::sync::Arc;

use genmanip_core::{ActionChunk, AgentFailure, EpisodeStart, Frame, Observation, Policy, PolicyError, PolicySpec};

use super::{Make, PolicyContext};
use genmanip_workspace::WorkspaceError;

/// Callback with the time of the episode, s; false ends the episode.
pub(super) type BeforeTurn = Arc<dyn Fn(f64) -> bool + Send + Sync>;

/// Policies of `make`, each calling `before_turn` before each of its turns.
pub(super) fn watched(make: Make, before_turn: BeforeTurn) -> Make {
    Box::new(move |episode: &PolicyContext| -> Result<Box<dyn Policy>, WorkspaceError> {
        Ok(Box::new(Watched { policy: make(episode)?, before_turn: Arc::clone(&before_turn) }))
    })
}

struct Watched {
    policy: Box<dyn Policy>,
    before_turn: BeforeTurn,
}

impl Watched {
    fn go_on(&self, time_s: f64) -> Result<(), PolicyError> {
        let stopped = || PolicyError::Unreachable("the episode was stopped".into());
        (self.before_turn)(time_s).then_some(()).ok_or_else(stopped)
    }
}

impl Policy for Watched {
    fn spec(&self) -> PolicySpec {
        self.policy.spec()
    }

    fn reset(&mut self, start: &EpisodeStart) -> Result<(), PolicyError> {
        self.go_on(0.0)?;
        self.policy.reset(start)
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        self.go_on(observation.time_s)?;
        self.policy.act(observation)
    }

    fn analyse(&self, frames: &[Frame]) -> Option<AgentFailure> {
        self.policy.analyse(frames)
    }
}

//! Wrapper of a policy that calls back before each of its decisions, which can end the episode.

use std::sync::Arc;

use genmanip_core::{ActionChunk, AgentFailure, EpisodeStart, Frame, Observation, Policy, PolicyError, PolicySpec};

/// Callback with the simulated time of the episode, s; returns false to end the episode.
pub(super) type BeforeTurn = Arc<dyn Fn(f64) -> bool + Send + Sync>;

/// A policy that calls `before_turn` before each of its decisions.
pub(super) struct Watched {
    pub policy: Box<dyn Policy>,
    pub before_turn: BeforeTurn,
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

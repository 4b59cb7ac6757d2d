//! Policies without learning: standing still, and open-loop playback.

use genmanip_core::{ActionChunk, ActionContract, Episode, EpisodeStart, Observation, Policy, PolicyError, PolicySpec};

/// Stands still: a baseline that shows that no scenario solves itself.
#[derive(Clone, Debug, Default)]
pub struct DoNothing {
    /// Duration until the policy reports that it has finished, s.
    pub duration_s: f64,
}

/// Applies recorded actions open loop.
#[derive(Clone, Debug)]
pub struct OpenLoop {
    spec: PolicySpec,
    actions: Vec<Vec<f32>>,
}

impl OpenLoop {
    /// Replays the commands of a recorded episode as they were applied.
    pub fn replay(episode: &Episode) -> Self {
        let actions = episode.frames.iter().map(|frame| frame.command.clone()).collect();
        Self { spec: PolicySpec::native("replay", episode.result.control_rate_hz), actions }
    }

    /// Plays back actions of a data set (one row per action) under its contract, at its rate.
    pub fn playback(contract: &ActionContract, actions: Vec<Vec<f32>>) -> Self {
        let spec = PolicySpec { action: contract.action, ..PolicySpec::native("playback", contract.rate_hz) };
        Self { spec, actions }
    }
}

impl Policy for DoNothing {
    fn spec(&self) -> PolicySpec {
        PolicySpec::native("do_nothing", 60.0)
    }

    fn reset(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let state = observation
            .state
            .get(Observation::STATE)
            .ok_or_else(|| PolicyError::Unsuited("`observation.state` is missing".into()))?;
        let stay: Vec<f32> = state.iter().map(|&value| value as f32).collect();
        Ok(ActionChunk { actions: vec![stay; (self.duration_s * 60.0) as usize], finished: true })
    }
}

impl Policy for OpenLoop {
    fn spec(&self) -> PolicySpec {
        self.spec.clone()
    }

    fn reset(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        Ok(())
    }

    fn act(&mut self, _observation: &Observation) -> Result<ActionChunk, PolicyError> {
        Ok(ActionChunk { actions: self.actions.clone(), finished: true })
    }
}

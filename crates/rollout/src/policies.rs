//! Policies that need no learning: the control arm and the replay.

use genmanip_core::{ActionChunk, Episode, EpisodeStart, Observation, Policy, PolicyError, PolicySpec};

/// Stands still: the control that shows that no scenario solves itself.
#[derive(Clone, Debug, Default)]
pub struct DoNothing {
    /// Seconds it stands still before it says it is finished.
    pub duration_s: f64,
}

/// Applies recorded commands without looking.
#[derive(Clone, Debug)]
pub struct OpenLoopReplay {
    commands: Vec<Vec<f32>>,
}

impl OpenLoopReplay {
    /// From the commands of a recorded episode.
    pub fn of(episode: &Episode) -> Self {
        Self { commands: episode.frames.iter().map(|frame| frame.command.clone()).collect() }
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

impl Policy for OpenLoopReplay {
    fn spec(&self) -> PolicySpec {
        PolicySpec::native("replay", 60.0)
    }

    fn reset(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        Ok(())
    }

    fn act(&mut self, _observation: &Observation) -> Result<ActionChunk, PolicyError> {
        Ok(ActionChunk { actions: self.commands.clone(), finished: true })
    }
}

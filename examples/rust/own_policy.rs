//! Runs a policy of one's own on a scenario, judges the episode and records it into an episode store:
//! `cargo run --release -p genmanip --example own_policy -- scenario.json episodes`

use std::error::Error;
use std::path::PathBuf;

use genmanip::core::{ActionChunk, EpisodeStart, Observation, Policy, PolicyError, PolicySpec, Seed};
use genmanip::data::EpisodeStore;
use genmanip::rollout::{RolloutSettings, run_episode};
use genmanip::workspace::scenarios;

/// Swings the first joint slowly and keeps the gripper open.
struct Swing {
    turns: usize,
}

impl Policy for Swing {
    fn spec(&self) -> PolicySpec {
        // Absolute joint targets [rad] and gripper width [m] at 60 Hz, from joint positions alone.
        PolicySpec::native("swing", 60.0)
    }

    fn reset(&mut self, _start: &EpisodeStart) -> Result<(), PolicyError> {
        self.turns = 0;
        Ok(())
    }

    fn act(&mut self, observation: &Observation) -> Result<ActionChunk, PolicyError> {
        let state = observation.state.get(Observation::STATE).ok_or(PolicyError::Unsuited("no state".into()))?;
        let mut target: Vec<f32> = state.iter().map(|&value| value as f32).collect();
        let actions = (0..30).map(|_| {
            target[0] += 0.005;
            target.clone()
        });
        self.turns += 1;
        Ok(ActionChunk { actions: actions.collect(), finished: self.turns == 4 })
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let (scenario, store) = arguments.next().zip(arguments.next()).ok_or("usage: own_policy SCENARIO.json STORE")?;
    let stage = scenarios::read_stage(&scenario)?;
    let episode = run_episode(&stage, &mut Swing { turns: 0 }, "swing-0", Seed::new(1), &RolloutSettings::default())?;
    // A verdict lists every atom of the goal with its measured quantity, threshold and margin.
    let result = serde_json::to_string_pretty(&episode.result.verdict)?;
    EpisodeStore::create(store)?.write(&episode, &[])?;
    std::fs::write("verdict.json", result)?;
    Ok(())
}

//! Replay: recorded commands applied open loop in a new simulation.

use std::sync::Arc;

use genmanip_core::{Episode, World, WorldPart};
use genmanip_sim::{ContactReport, Sim};

use crate::{RolloutError, Stage};

/// Comparison of a replay with the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayCheck {
    /// True if the final state equals the recorded one bit for bit.
    pub identical: bool,
    /// Maximum absolute difference between entries of the final states, in mixed units; 0 if identical.
    pub largest_difference: f64,
    /// Number of control steps replayed.
    pub frames: usize,
}

/// Restores the recorded initial state, applies every recorded command and compares the final state bit for bit.
///
/// Steps the simulation itself: it starts from the recorded state instead of the stage's initial state, neither judges
/// nor records, and must show that commands and state alone determine the result.
///
/// # Errors
/// If the physics or judging settings differ from those of the recording (names the field), the simulation becomes
/// unstable, or the recorded state does not match the scene.
pub fn check(stage: &Stage, episode: &Episode) -> Result<ReplayCheck, RolloutError> {
    check_world(&stage.scenario.world, episode)?;
    let mut sim = Sim::new(Arc::clone(&stage.scene));
    sim.set_state(&episode.initial_state)?;
    for frame in &episode.frames {
        sim.control_step(&frame.command)?;
    }
    let state = sim.state();
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    Ok(ReplayCheck {
        identical: bits(&state) == bits(&episode.final_state),
        largest_difference: state.iter().zip(&episode.final_state).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max),
        frames: episode.frames.len(),
    })
}

/// Contacts during an episode, which are not recorded: recomputed by replay.
pub struct ContactReplay<'a> {
    episode: &'a Episode,
    sim: Sim,
    /// Number of control steps replayed.
    done: usize,
}

impl<'a> ContactReplay<'a> {
    /// Starts before the first command of an episode.
    ///
    /// # Errors
    /// As [`check`].
    pub fn new(stage: &Stage, episode: &'a Episode) -> Result<Self, RolloutError> {
        check_world(&stage.scenario.world, episode)?;
        let mut sim = Sim::new(Arc::clone(&stage.scene));
        sim.set_state(&episode.initial_state)?;
        Ok(Self { episode, sim, done: 0 })
    }

    /// Contacts at the start of a control step, in the world frame; steps must be requested in increasing order.
    ///
    /// # Errors
    /// If the simulation becomes unstable.
    pub fn at(&mut self, control_step: usize) -> Result<Vec<ContactReport>, RolloutError> {
        for frame in self.episode.frames.get(self.done..control_step).unwrap_or_default() {
            self.sim.control_step(&frame.command)?;
            self.done += 1;
        }
        Ok(self.sim.contacts())
    }
}

/// Error if the world differs from the recording in more than appearance.
fn check_world(world: &World, episode: &Episode) -> Result<(), RolloutError> {
    let refuse = |field: String, expected: &str, got: &str| {
        let (expected, got) = (expected.to_owned(), got.to_owned());
        Err(RolloutError::OtherWorld { scenario: episode.scenario.id.clone(), field, expected, got })
    };
    if let Some(difference) = episode.scenario.world.refusal(world) {
        return refuse(difference.field, &difference.ours, &difference.theirs);
    }
    let Some(recorded) = &episode.result.world_hashes else { return Ok(()) };
    let now = world.hashes();
    for part in [WorldPart::Physics, WorldPart::Judging] {
        if recorded.of(part) != now.of(part) {
            return refuse(format!("{} (hash of all its fields)", part.name()), recorded.of(part), now.of(part));
        }
    }
    Ok(())
}

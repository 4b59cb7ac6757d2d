//! Recorded commands applied open loop in a fresh simulation.

use std::sync::Arc;

use genmanip_core::{Episode, World, WorldPart};
use genmanip_sim::{ContactReport, Sim};

use crate::{RolloutError, Stage};

/// What a replay shows.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayCheck {
    /// The final state is the recorded one, bit for bit.
    pub identical: bool,
    /// Largest difference between the final states, mixed units; 0 when identical.
    pub largest_difference: f64,
    /// Number of control steps replayed.
    pub frames: usize,
}

/// Restores the recorded initial state, applies every recorded command and compares the final state by its bits.
///
/// It steps the simulation itself, since it starts from the recorded state instead of the stage's start, neither judges
/// nor records, and must show that commands and state alone decide the end.
///
/// # Errors
/// When the episode was recorded in a world of other physics or other judging, naming the field that differs;
/// when the simulation becomes unstable or the recorded state does not fit the scene.
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

/// Who touches whom during an episode, which it does not record: found by replaying it.
pub struct ContactReplay<'a> {
    episode: &'a Episode,
    sim: Sim,
    /// Control steps that were replayed.
    done: usize,
}

impl<'a> ContactReplay<'a> {
    /// Before the first command of an episode.
    ///
    /// # Errors
    /// As [`check`].
    pub fn new(stage: &Stage, episode: &'a Episode) -> Result<Self, RolloutError> {
        check_world(&stage.scenario.world, episode)?;
        let mut sim = Sim::new(Arc::clone(&stage.scene));
        sim.set_state(&episode.initial_state)?;
        Ok(Self { episode, sim, done: 0 })
    }

    /// Contacts at the start of a control step, in the world; steps are asked for in their order.
    ///
    /// # Errors
    /// When the simulation becomes unstable.
    pub fn at(&mut self, control_step: usize) -> Result<Vec<ContactReport>, RolloutError> {
        for frame in self.episode.frames.get(self.done..control_step).unwrap_or_default() {
            self.sim.control_step(&frame.command)?;
            self.done += 1;
        }
        Ok(self.sim.contacts())
    }
}

/// Refuses a world that differs in more than looks from the one the episode was recorded in.
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

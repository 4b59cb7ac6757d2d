//! The potential of a dense reward along the expert's episodes.

use genmanip_rollout::shaping::{Milestone, Progress, Shaping};
use genmanip_rollout::{Environment, RolloutSettings};

use crate::episodes;

/// Progress before each command of an episode, and after the last one.
fn progress(index: usize, milestone: Milestone) -> Vec<Progress> {
    let (stage, episode) = &episodes()[index];
    let mut environment = Environment::new(RolloutSettings::default());
    environment.reset(stage, episode.result.seed);
    let shaping = Shaping::new(stage, milestone);
    let mut seen = vec![shaping.progress(&environment, stage).unwrap()];
    for frame in &episode.frames {
        environment.step(&frame.command).unwrap();
        seen.push(shaping.progress(&environment, stage).unwrap());
    }
    seen
}

/// It begins low, reaches 1 where the goal holds, and an expert hardly ever loses any of it.
#[test]
fn the_potential_rises_along_an_experts_episode() {
    let potentials: Vec<f64> = progress(0, Milestone::Goal).iter().map(|seen| seen.potential).collect();
    assert!(potentials.iter().all(|potential| (0.0..=1.0).contains(potential)));
    assert!(potentials[0] < 0.2, "{}", potentials[0]);
    assert_eq!(potentials.last(), Some(&1.0));
    let rises = potentials.windows(2).map(|pair| (pair[1] - pair[0]).max(0.0)).sum::<f64>();
    let falls = potentials.windows(2).map(|pair| (pair[0] - pair[1]).max(0.0)).sum::<f64>();
    let deepest = potentials.windows(2).map(|pair| pair[0] - pair[1]).fold(0.0, f64::max);
    // Objects that settle are at rest and not in turn; the arm moves away before it approaches the next place.
    assert!(rises - falls > 0.8 && falls < 0.5 && deepest < 0.15, "rises {rises}, falls {falls}, deepest {deepest}");
}

/// Reaching comes before lifting, and both before the goal.
#[test]
fn milestones_are_reached_in_their_order() {
    let first = |milestone| progress(0, milestone).iter().position(|seen| seen.is_reached);
    let (reached, lifted) = (first(Milestone::Reach).unwrap(), first(Milestone::Lift).unwrap());
    assert!(0 < reached && reached < lifted, "{reached} {lifted}");
    assert_eq!(first(Milestone::Goal), None, "the goal is the judge's");
}

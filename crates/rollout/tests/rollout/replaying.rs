//! Recorded commands in a fresh simulation.

use genmanip_core::Seed;
use genmanip_rollout::policies::OpenLoopReplay;
use genmanip_rollout::{RolloutSettings, replay, run_episode};

use crate::episodes;

#[test]
fn the_final_state_is_reached_to_the_last_bit() {
    for (stage, episode) in episodes() {
        let check = replay::check(stage, episode).unwrap();
        assert!(check.identical, "{check:?}");
        assert_eq!((check.largest_difference, check.frames), (0.0, episode.frames.len()));
    }
}

/// The check can fail: a thousandth of a radian in one command is noticed.
#[test]
fn a_changed_command_is_noticed() {
    let (stage, episode) = &episodes()[1];
    let mut changed = episode.clone();
    let middle = changed.frames.len() / 2;
    changed.frames[middle].command[0] += 1e-3;
    let check = replay::check(stage, &changed).unwrap();
    assert!(!check.identical && check.largest_difference > 0.0, "{check:?}");

    let mut foreign = episode.clone();
    foreign.initial_state.pop();
    let error = replay::check(stage, &foreign).unwrap_err().to_string();
    assert!(error.contains("another scene"), "{error}");
}

/// As a policy the recording needs no truth, succeeds as it did, and is not called an oracle.
#[test]
fn the_recording_is_a_policy_that_succeeds_blindly() {
    for (stage, episode) in episodes() {
        let mut policy = OpenLoopReplay::of(episode);
        let again = run_episode(stage, &mut policy, "again", Seed::new(0), &RolloutSettings::default()).unwrap();
        assert!(again.result.success && !again.result.oracle, "{:?}", again.result.failures);
        assert_eq!(again.frames[..episode.frames.len()], episode.frames);
    }
}

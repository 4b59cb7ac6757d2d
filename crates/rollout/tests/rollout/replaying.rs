//! Replay of recorded commands in a new simulation.

use std::sync::Arc;

use genmanip_assets::Catalogue;
use genmanip_core::Seed;
use genmanip_data::EpisodeStore;
use genmanip_rollout::policies::OpenLoop;
use genmanip_rollout::{RolloutSettings, Stage, replay, run_episode};

use crate::{episodes, planner, stage};

#[test]
fn the_final_state_is_reproduced_bit_for_bit() {
    for (stage, episode) in episodes() {
        let check = replay::check(stage, episode).unwrap();
        assert!(check.identical, "{check:?}");
        assert_eq!((check.largest_difference, check.frames), (0.0, episode.frames.len()));
    }
}

/// Episodes recorded when objects were named and hashed by uid.
#[test]
fn episodes_of_version_1_open_and_replay() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../cli/testdata/version_1/run/episodes");
    let store = EpisodeStore::open(folder).unwrap();
    let ids = store.ids().unwrap();
    assert_eq!(ids.len(), 2, "{ids:?}");
    for id in ids {
        let episode = store.read(&id).unwrap();
        let hashes = || episode.scenario.objects.iter().map(|placed| placed.physics_hash.as_str());
        assert!(hashes().all(|hash| hash.starts_with("v1:")), "{id}");
        let stage = stage(episode.scenario.clone());
        let check = replay::check(&stage, &episode).unwrap();
        // Other machines reach the same verdicts, not the same bits.
        assert!(check.identical || check.largest_difference < 1e-3, "{id}: {check:?}");
        let mut changed = episode.scenario.clone();
        changed.objects[0].physics_hash = "v1:000000000000".into();
        let opened = Stage::open(Arc::new(changed), Catalogue::builtin(), planner().robot());
        let refused = opened.err().unwrap().to_string();
        assert!(
            refused.contains("physics hash") && refused.contains(episode.scenario.objects[0].id.as_str()),
            "{refused}"
        );
    }
}

/// The check is sensitive: a change of a thousandth of a radian in one command is detected.
#[test]
fn a_changed_command_is_detected() {
    let (stage, episode) = &episodes()[1];
    let mut changed = episode.clone();
    let middle = changed.frames.len() / 2;
    changed.frames[middle].command[0] += 1e-3;
    let check = replay::check(stage, &changed).unwrap();
    assert!(!check.identical && check.largest_difference > 0.0, "{check:?}");

    let mut foreign = episode.clone();
    foreign.initial_state.pop();
    let error = replay::check(stage, &foreign).unwrap_err().to_string();
    assert!(error.contains("a different scene"), "{error}");
}

/// Replayed as a policy, the recording needs no ground truth, succeeds again, and is not marked as an oracle.
#[test]
fn a_replay_policy_succeeds_without_observations() {
    for (stage, episode) in episodes() {
        let mut policy = OpenLoop::replay(episode);
        let again = run_episode(stage, &mut policy, "again", Seed::new(0), &RolloutSettings::default()).unwrap();
        assert!(again.result.success && !again.result.oracle, "{:?}", again.result.failures);
        assert_eq!(again.frames[..episode.frames.len()], episode.frames);
    }
}

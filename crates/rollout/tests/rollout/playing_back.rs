//! Playback of data set rows through the policy interface solves the original tasks.

use genmanip_core::Ending;
use genmanip_data::export::choice::{ACTIONS, ROTATIONS, action};
use genmanip_data::lerobot::{self, LerobotDataset, LerobotSettings};
use genmanip_data::{EpisodeStore, ExportSettings, Selection};
use genmanip_rollout::policies::OpenLoop;
use genmanip_rollout::{RolloutSettings, run_episode};

use crate::episodes;

#[test]
fn rows_of_every_action_space_solve_the_task_again() {
    let folder = tempfile::tempdir().unwrap();
    let store = EpisodeStore::create(folder.path().join("store")).unwrap();
    let recorded = episodes();
    for (_, episode) in recorded {
        store.write(episode, &[]).unwrap();
    }
    for (number, (name, space)) in ACTIONS.into_iter().enumerate() {
        let rows = ExportSettings {
            action: action(space, ROTATIONS[number % ROTATIONS.len()].1),
            cameras: Vec::new(),
            depth: false,
            ..ExportSettings::default()
        };
        let settings = LerobotSettings { export: rows, record: false, ..LerobotSettings::default() };
        let target = folder.path().join(name);
        lerobot::export(&store, &Selection::Verified, &recorded[0].0.robot, &settings, &target).unwrap();
        let dataset = LerobotDataset::open(&target).unwrap();
        for (row, (stage, episode)) in dataset.episodes().iter().map(|row| {
            let is_own = |(_, episode): &&(_, genmanip_core::Episode)| episode.result.id == row.store_id;
            (row, recorded.iter().find(is_own).unwrap())
        }) {
            let mut policy = OpenLoop::playback(dataset.contract(), dataset.actions(row).unwrap());
            let seed = episode.result.seed;
            let played = run_episode(stage, &mut policy, name, seed, &RolloutSettings::default()).unwrap();
            let result = &played.result;
            assert!(result.success, "{name}: {}: {:?}", row.store_id, result.failures);
            assert_eq!((result.ending, result.oracle), (Some(Ending::Finished), false));
        }
    }
}

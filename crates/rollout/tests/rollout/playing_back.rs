//! Rows of a data set, played back open loop through the policy interface, solve the tasks that they come from.

use genmanip_core::glam::{DQuat, DVec3};
use genmanip_core::{ActionSpace, ActionSpec, Ending, GripperEncoding, Pose, RotationEncoding};
use genmanip_data::export::choice::{ACTIONS, ROTATIONS, action};
use genmanip_data::lerobot::{self, LerobotDataset, LerobotSettings};
use genmanip_data::{EpisodeStore, ExportSettings, Selection};
use genmanip_motion::IkSettings;
use genmanip_rollout::adapter::{Adapter, ArmReference};
use genmanip_rollout::policies::OpenLoop;
use genmanip_rollout::{RolloutSettings, run_episode};

use crate::{episodes, planner};

#[test]
fn rows_of_every_action_solve_the_task_again() {
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

/// A tool that goes round and round does not drive the elbow into a limit: the arm comes back to where it began.
#[test]
fn the_elbow_stays_where_it_belongs() {
    let robot = planner().robot();
    let spec = ActionSpec {
        rotation: RotationEncoding::SixD,
        ..ActionSpec::new(ActionSpace::EePose, GripperEncoding::WidthM)
    };
    let adapter = Adapter::new(spec, robot, &IkSettings::default(), 1.0 / 60.0, 4).unwrap();
    let start = robot.tcp_pose(&robot.home);
    let mut command = robot.home.clone();
    for row in 0..600 {
        let angle = f64::from(row) * 0.1;
        let target = Pose::new(
            start.position + DVec3::new(0.12 * angle.sin(), 0.25 * (angle.cos() - 1.0), 0.05 * (2.0 * angle).sin()),
            DQuat::from_rotation_z(0.6 * angle.sin()) * start.rotation,
        );
        let numbers = target.position.to_array().into_iter().chain(spec.rotation.encode(target.rotation));
        let action: Vec<f32> = numbers.map(|value| value as f32).chain([0.08]).collect();
        let from = ArmReference { command: &command, width_m: 0.08, measured: &command, chunk_start: &command };
        let native = adapter.to_native(&action, from).unwrap();
        let next: Vec<f64> = native[3][..7].iter().map(|&q| f64::from(q)).collect();
        let step = next.iter().zip(&command).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(step < 0.2, "row {row}: a joint moves by {step} rad");
        let far = next.iter().zip(&robot.home).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(far < 1.5, "row {row}: a joint is {far} rad from home");
        assert!((robot.tcp_pose(&next).position - target.position).length() < 1e-5);
        command = next;
    }
}

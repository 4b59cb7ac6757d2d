//! The native episode store, and an export of it.

use divan::{Bencher, black_box};
use genmanip::assets::robots::panda;
use genmanip::data::{EpisodeStore, ExportSettings, LerobotSettings, Selection, lerobot};

const STORE: &str = "crates/cli/testdata/version_1/run/episodes";
const EPISODE: &str = "017_pick_and_place-000";

fn store() -> EpisodeStore {
    EpisodeStore::open(crate::repository(STORE)).expect("a store of the tests")
}

/// One episode with its hashes checked.
#[divan::bench]
fn read(bencher: Bencher) {
    let store = store();
    bencher.bench_local(|| store.read(black_box(EPISODE)).expect("a valid episode"));
}

/// One episode into an empty store, flushed to the disk.
#[divan::bench]
fn write(bencher: Bencher) {
    let episode = store().read(EPISODE).expect("a valid episode");
    let empty = || {
        let folder = tempfile::tempdir().expect("a temporary folder");
        (EpisodeStore::create(folder.path().join("episodes")).expect("an empty folder"), folder)
    };
    bencher.with_inputs(empty).bench_local_values(|(store, folder)| {
        store.write(&episode, &[]).expect("an episode with another id");
        folder
    });
}

/// Two episodes as LeRobot v3.0, without images.
#[divan::bench(sample_count = 20)]
fn export_lerobot(bencher: Bencher) {
    let (store, robot) = (store(), panda());
    let export = ExportSettings { cameras: Vec::new(), depth: false, ..ExportSettings::default() };
    let settings = LerobotSettings { export, ..LerobotSettings::default() };
    let empty = || tempfile::tempdir().expect("a temporary folder");
    bencher.with_inputs(empty).bench_local_values(|folder| {
        let target = folder.path().join("dataset");
        lerobot::export(&store, &Selection::Recorded, &robot, &settings, &target).expect("a data set");
        folder
    });
}

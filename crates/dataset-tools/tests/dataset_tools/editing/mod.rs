//! Merged, split and filtered data sets are equal to exports of the same episodes.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use arrow_array::RecordBatch;
use genmanip_core::{Scenario, Seed};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{DataError, EpisodeStore, ExportReport, Selection};
use genmanip_dataset_tools::check;
use genmanip_dataset_tools::edit::{self, By, Condition};
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::Value;

use crate::checking::{checked, consistent_episode, listed, settings, store};
use crate::synthetic::{attach_images, robot, tree};

/// A store of six episodes, the fourth of which failed, in a temporary folder for data sets.
struct Fixture {
    folder: tempfile::TempDir,
    store: EpisodeStore,
}

impl Fixture {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = store(&folder.path().join("store"));
        Self { folder, store }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn settings() -> LerobotSettings {
        settings(genmanip_data::export::default_action())
    }

    /// Exports the episodes with these numbers.
    fn export(&self, name: &str, numbers: &[usize]) -> PathBuf {
        let ids = self.store.ids().unwrap();
        let selection = Selection::Ids(numbers.iter().map(|number| ids[*number].clone()).collect());
        let dataset = self.at(name);
        lerobot::export(&self.store, &selection, &robot(), &Self::settings(), &dataset).unwrap();
        dataset
    }
}

fn table(path: &Path) -> RecordBatch {
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    builder.with_batch_size(100_000).build().unwrap().next().unwrap().unwrap()
}

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn ids(dataset: &Path) -> Vec<String> {
    lerobot::LerobotDataset::open(dataset).unwrap().episodes().iter().map(|row| row.store_id.clone()).collect()
}

/// Everything except colour statistics must be equal: colour histograms are not part of a data set.
fn assert_same(made: &Path, exported: &Path) {
    assert_eq!(listed(&checked(made)), "", "{}", made.display());
    for (made, exported) in
        [(made.to_owned(), exported.to_owned()), (lerobot::depth_path(made), lerobot::depth_path(exported))]
    {
        let (left, right) = (tree(&made), tree(&exported));
        assert_eq!(left.keys().collect::<Vec<_>>(), right.keys().collect::<Vec<_>>());
        for (path, bytes) in &left {
            let name = path.to_str().unwrap();
            if name.starts_with("meta/episodes") {
                let [left, right] = [&made, &exported].map(|root| table(&root.join(path)));
                assert_eq!(left, right, "{name}");
            } else if !["README.md", "meta/stats.json", "meta/genmanip.json"].contains(&name) {
                assert!(*bytes == right[path], "{name} of {}", made.display());
            }
        }
        let [left, right] = [made, exported].map(|root| json(root.join("meta/stats.json")));
        let keys = |stats: &Value| stats.as_object().unwrap().keys().cloned().collect::<BTreeSet<_>>();
        assert_eq!(keys(&left), keys(&right));
        for key in keys(&left) {
            if !key.starts_with("observation.images") {
                assert_eq!(left[&key], right[&key], "{key}");
                continue;
            }
            for name in ["min", "max", "mean", "std", "count"] {
                let [a, b] = [&left, &right].map(|stats| stats[&key][name].to_string());
                let near = |text: &str| -> Vec<f64> {
                    let numbers = text.split(|c: char| "[],".contains(c)).filter(|text| !text.is_empty());
                    numbers.map(|number| (number.parse::<f64>().unwrap() * 1e9).round()).collect()
                };
                assert_eq!(near(&a), near(&b), "{name} of {key}");
            }
        }
    }
}

#[test]
fn a_merge_equals_an_export_of_all_episodes() {
    let fixture = Fixture::new();
    let parts = [fixture.export("a", &[0, 1, 2, 3]), fixture.export("b", &[4]), fixture.export("c", &[5])];
    let whole = fixture.export("whole", &[0, 1, 2, 3, 4, 5]);
    let mut calls = 0;
    let report = edit::merge(&parts, &fixture.at("merged"), &mut |total| calls += usize::from(total == 12)).unwrap();
    assert_eq!((report.episodes, report.frames, calls), (6, checked(&whole).frames, 12));
    assert_same(&fixture.at("merged"), &whole);
    // The order of the parts determines the order of the episodes.
    let [a, b, c] = parts;
    edit::merge(&[c, a.clone(), b], &fixture.at("other"), &mut |_| {}).unwrap();
    assert_same(&fixture.at("other"), &fixture.export("other-whole", &[5, 0, 1, 2, 3, 4]));

    let refused = |datasets: &[PathBuf], expected: &str| {
        let error = edit::merge(datasets, &fixture.at("refused"), &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected} in {error}");
        assert!(!fixture.at("refused").exists() && !fixture.at("refused-depth").exists());
    };
    refused(&[], "at least one");
    refused(&[a.clone(), whole.clone()], "each episode only once");
    refused(&[a.clone(), fixture.at("store")], "LeRobotDataset v3.0 written by");
    let settings = LerobotSettings { record: false, ..Fixture::settings() };
    lerobot::export(&fixture.store, &Selection::Verified, &robot(), &settings, &fixture.at("bare")).unwrap();
    refused(&[a.clone(), fixture.at("bare")], "export settings of");
    let mut slower = Fixture::settings();
    slower.export.cameras = vec!["wrist".into()];
    lerobot::export(&fixture.store, &Selection::Verified, &robot(), &slower, &fixture.at("one-eyed")).unwrap();
    refused(&[a.clone(), fixture.at("one-eyed")], "features of");
    let error = edit::merge(&[a], &whole, &mut |_| {}).unwrap_err();
    assert!(matches!(error, DataError::Exists { .. }), "{error}");
}

/// Runs with different seeds give their episodes the same ids.
#[test]
fn equal_ids_of_different_runs_are_renamed() {
    let fixture = Fixture::new();
    let other = EpisodeStore::create(fixture.at("other-store")).unwrap();
    for number in [0, 1] {
        let mut episode = consistent_episode(number, 40 - number);
        episode.result.seed = Seed::new(99 + number as u64);
        // Like the ids that `collect` assigns.
        episode.scenario.id = episode.result.id.clone();
        episode.result.scenario_id = episode.result.id.clone();
        other.write(&episode, &[]).unwrap();
        attach_images(&other, number, 40 - number, 15);
    }
    let a = fixture.export("a", &[0, 1, 2]);
    let b = fixture.at("b");
    lerobot::export(&other, &Selection::Verified, &robot(), &Fixture::settings(), &b).unwrap();
    let merged = fixture.at("merged");
    edit::merge(&[a, b], &merged, &mut |_| {}).unwrap();
    assert_eq!(listed(&checked(&merged)), "");
    let [first, second] = ["scenario-0-a0", "scenario-1-a0"].map(String::from);
    let expected = [first.clone(), second, "scenario-2-a0".into(), "scenario-0-a0.2".into(), "scenario-1-a0.2".into()];
    assert_eq!(ids(&merged), expected);
    let record = EpisodeStore::open(merged.join("extras/record")).unwrap();
    let [known, renamed] =
        [(&other, first.as_str()), (&record, "scenario-0-a0.2")].map(|(store, id)| store.read(id).unwrap());
    assert_eq!(renamed.scenario, Scenario { id: "scenario-0-a0.2".into(), ..known.scenario.clone() });
    assert_eq!((&renamed.frames, &renamed.final_state), (&known.frames, &known.final_state));
}

#[test]
fn split_parts_are_valid_and_disjoint() {
    let fixture = Fixture::new();
    let whole = fixture.export("whole", &[0, 1, 2, 3, 4, 5]);
    let shares = [("train".to_owned(), 0.5), ("test".to_owned(), 0.5)];
    let split = |by, name: &str| -> Vec<ExportReport> {
        edit::split(&whole, &shares, by, Seed::new(7), &fixture.at(name), &mut |_| {}).unwrap()
    };
    for (by, name) in [(By::Task, "by-task"), (By::Episode, "by-episode")] {
        let parts = split(by, name);
        assert_eq!(parts.iter().map(|part| part.episodes).collect::<Vec<_>>(), [3, 3]);
        let mut all: BTreeMap<String, usize> = BTreeMap::new();
        for part in &parts {
            assert_eq!(listed(&checked(&part.dataset)), "");
            ids(&part.dataset).into_iter().for_each(|id| *all.entry(id).or_default() += 1);
        }
        assert!(all.len() == 6 && all.values().all(|count| *count == 1), "{all:?}");
        let [train, test] = [0, 1].map(|part: usize| checked(&parts[part].dataset));
        let shared: BTreeSet<String> = check::leaks(&train, &test)
            .iter()
            .map(|leak| leak.expected.split(" not in").next().unwrap().into())
            .collect();
        let expected = if by == By::Task { vec![] } else { vec!["a sentence".to_owned()] };
        assert_eq!(shared.into_iter().collect::<Vec<_>>(), expected, "{name}");
    }
    for (shares, expected) in [
        (vec![("train".to_owned(), 0.5)], "sum of the shares"),
        (vec![("../train".to_owned(), 1.0)], "name of a part"),
        (vec![("a".to_owned(), 0.5), ("a".to_owned(), 0.5)], "name of a part"),
        (vec![("a".to_owned(), 1.0), ("b".to_owned(), -0.0)], "share of b"),
        (["a", "b", "c"].map(|name| (name.to_owned(), 1.0 / 3.0)).to_vec(), "different sentences"),
    ] {
        let made = edit::split(&whole, &shares, By::Task, Seed::new(7), &fixture.at("refused"), &mut |_| {});
        let error = made.unwrap_err().to_string();
        assert!(error.contains(expected), "{expected} in {error}");
    }
    assert!(!fixture.at("refused").exists());
}

#[test]
fn filter_and_delete_equal_an_export_of_the_remaining_episodes() {
    let fixture = Fixture::new();
    let whole = fixture.export("whole", &[0, 1, 2, 3, 4, 5]);
    for (number, (conditions, kept)) in [
        (&["success=true"][..], &[0, 1, 2, 4, 5][..]),
        (&["success=false"], &[3]),
        (&["task=task-1"], &[1, 3, 5]),
        // Every second scenario has a second object.
        (&["object=uid-1", "success=true"], &[1, 5]),
        (&["store_id=scenario-4-a0", "kind=pick_and_place"], &[4]),
        (&["source=expert,teleop", "success=false"], &[3]),
    ]
    .into_iter()
    .enumerate()
    {
        let conditions: Vec<Condition> = conditions.iter().map(|text| text.parse().unwrap()).collect();
        let made = fixture.at(&format!("filtered-{number}"));
        edit::filter(&whole, &conditions, &made, &mut |_| {}).unwrap();
        assert_same(&made, &fixture.export(&format!("chosen-{number}"), kept));
    }
    let made = fixture.at("deleted");
    edit::delete(&whole, &edit::numbers("0,2-3").unwrap(), &made, &mut |_| {}).unwrap();
    assert_same(&made, &fixture.export("rest", &[1, 4, 5]));
    // Editing an edited data set.
    edit::delete(&made, &[0].into(), &fixture.at("again"), &mut |_| {}).unwrap();
    assert_same(&fixture.at("again"), &fixture.export("last", &[4, 5]));

    let filtered = |text: &str| {
        let condition = text.parse::<Condition>().unwrap();
        edit::filter(&whole, &[condition], &fixture.at("refused"), &mut |_| {}).unwrap_err().to_string()
    };
    for (condition, expected) in [
        ("colour=red", "got `colour`"),
        ("success=perhaps", "a value of that column"),
        ("kind=unheard_of", "remaining episodes"),
    ] {
        let error = filtered(condition);
        assert!(error.contains(expected), "{expected} in {error}");
    }
    let error = edit::delete(&whole, &[6].into(), &fixture.at("refused"), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("0 to 5"), "{error}");
    let all = (0..6).collect();
    assert!(edit::delete(&whole, &all, &fixture.at("refused"), &mut |_| {}).is_err());
    assert!(!fixture.at("refused").exists());
}

#[test]
fn damaged_data_sets_are_not_copied() {
    let fixture = Fixture::new();
    let whole = fixture.export("whole", &[0, 1, 2]);
    for name in [
        "data/chunk-000/file-000.parquet",
        "videos/observation.images.wrist/chunk-000/file-000.mp4",
        "extras/record/scenario-1-a0/frames.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
    ] {
        let path = whole.join(name);
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..bytes.len() - 7]).unwrap();
        let error = edit::delete(&whole, &[0].into(), &fixture.at("made"), &mut |_| {});
        assert!(error.is_err(), "{name}");
        assert!(!fixture.at("made").exists() && !fixture.at("made-depth").exists(), "{name}");
        fs::write(&path, bytes).unwrap();
    }
    edit::delete(&whole, &[0].into(), &fixture.at("made"), &mut |_| {}).unwrap();
}

#[test]
fn cards_describe_the_contents() {
    let fixture = Fixture::new();
    let whole = fixture.export("whole", &[0, 1, 2, 3]);
    for dataset in [whole.clone(), lerobot::depth_path(&whole)] {
        let card = lerobot::write_card(&dataset).unwrap();
        assert_eq!((card.kinds["pick_and_place"], card.sentences), ([4, 3], 2));
        assert_eq!(card.objects, ["uid-0", "uid-1"].map(String::from).into());
        assert_eq!(card.imported.len(), 0);
        let before = tree(&dataset);
        assert_eq!(lerobot::write_card(&dataset).unwrap(), card);
        assert_eq!(tree(&dataset), before, "writing a card is idempotent");
        assert_eq!(listed(&checked(&whole)), "");
        let described = json(dataset.join("croissant.json"));
        let info = json(dataset.join("meta/info.json"));
        let fields: BTreeSet<&str> = described["recordSet"][0]["field"]
            .as_array()
            .unwrap()
            .iter()
            .map(|field| field["name"].as_str().unwrap())
            .collect();
        let is_column = |entry: &Value| entry["dtype"] != "video";
        let features = info["features"].as_object().unwrap().iter().filter(|(_, entry)| is_column(entry));
        assert_eq!(fields, features.map(|(key, _)| key.as_str()).collect());
        assert!(fs::read_to_string(dataset.join("README.md")).unwrap().contains("| pick_and_place | 4 | 3 |"));
    }
    assert!(lerobot::write_card(&fixture.at("store")).is_err());
    let path = whole.join("meta/info.json");
    let valid = fs::read_to_string(&path).unwrap();
    for (text, expected) in [
        (valid.replace("v3.0", "v2.1"), "expected v3.0 of LeRobotDataset, got \"v2.1\""),
        ("{".into(), "expected JSON"),
    ] {
        fs::write(&path, text).unwrap();
        let errors = [
            lerobot::write_card(&whole).unwrap_err(),
            edit::delete(&whole, &[0].into(), &fixture.at("made"), &mut |_| {}).unwrap_err(),
        ];
        for error in errors.map(|error| error.to_string()) {
            assert!(error.contains(expected) && error.contains(path.to_str().unwrap()), "{expected} in {error}");
        }
    }
}

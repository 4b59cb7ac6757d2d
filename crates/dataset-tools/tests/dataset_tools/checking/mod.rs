//! The check of data sets finds every corruption, and nothing in valid data sets.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Float64Type, Int64Type};
use arrow_array::{
    Array, ArrayRef, BinaryArray, BooleanArray, FixedSizeListArray, ListArray, PrimitiveArray, RecordBatch,
    StringArray, StructArray,
};
use arrow_schema::{DataType, Field};
use genmanip_core::{ActionSpec, Episode, Failure, FailureCause, RobotModel};
use genmanip_data::export::ExtraColumns;
use genmanip_data::export::choice::{ACTIONS, ROTATIONS, action};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{EpisodeStore, ExportSettings, Selection, zarr};
use genmanip_dataset_tools::check::{self, DatasetCheck, leaks};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use serde_json::{Value, json};

use crate::synthetic::{attach_images, episode, robot};

/// Control steps of the episodes; three episodes per file.
const STEPS: [usize; 6] = [48, 60, 37, 40, 52, 44];

fn robots() -> Vec<Arc<RobotModel>> {
    vec![Arc::new(robot())]
}

/// An episode whose tool poses agree with its joint positions, as simulated ones do.
pub fn consistent_episode(number: usize, steps: usize) -> Episode {
    let is_failed = number == 3;
    let mut episode = episode(number, steps, !is_failed);
    if is_failed {
        episode.result.failures = vec![Failure { cause: FailureCause::Slipped, evidence: "the mug slipped".into() }];
    }
    for frame in &mut episode.frames {
        frame.tcp = robot().tcp_pose(&frame.joint_position);
    }
    episode
}

pub fn store(root: &Path) -> EpisodeStore {
    let store = EpisodeStore::create(root).unwrap();
    for (number, steps) in STEPS.into_iter().enumerate() {
        store.write(&consistent_episode(number, steps), &[]).unwrap();
        attach_images(&store, number, steps, 15);
    }
    store
}

pub fn settings(action: ActionSpec) -> LerobotSettings {
    LerobotSettings {
        export: ExportSettings { action, ..ExportSettings::default() },
        episodes_per_file: 3,
        episodes_per_depth_file: 2,
        ..LerobotSettings::default()
    }
}

pub fn checked(dataset: &Path) -> DatasetCheck {
    check::check(dataset, &robots()).unwrap()
}

pub fn listed(checked: &DatasetCheck) -> String {
    checked.findings.iter().map(|finding| format!("{finding:?}\n")).collect()
}

pub fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

#[test]
fn exported_data_sets_are_valid() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(&folder.path().join("store"));
    let mut names = Vec::new();
    for (number, (name, space)) in ACTIONS.into_iter().enumerate() {
        let settings = settings(action(space, ROTATIONS[number % ROTATIONS.len()].1));
        let dataset = folder.path().join(name);
        lerobot::export(&store, &Selection::Recorded, &robot(), &settings, &dataset).unwrap();
        names.push(dataset);
        let dataset = folder.path().join(format!("{name}-v21"));
        lerobot::export_v21(&store, &Selection::Recorded, &robot(), &settings, &dataset).unwrap();
        names.push(dataset);
    }
    let dataset = folder.path().join("zarr");
    zarr::export(&store, &Selection::Recorded, &robot(), &ExportSettings::default(), &dataset).unwrap();
    names.push(dataset);
    for dataset in names {
        let checked = checked(&dataset);
        assert_eq!(listed(&checked), "", "{}", dataset.display());
        let rows: usize = STEPS.iter().map(|steps| steps.div_ceil(4)).sum();
        assert_eq!((checked.episodes, checked.frames), (STEPS.len(), rows));
    }
}

/// A data set to corrupt; the seed determines the position.
struct Victim {
    root: PathBuf,
    seed: usize,
}

/// Name, change of a data set, and the check that must find it.
type Corruption = (&'static str, fn(&Victim), &'static str);

impl Victim {
    fn pick(&self, count: usize) -> usize {
        (self.seed.wrapping_mul(2_654_435_761) >> 8) % count
    }

    fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// One of the two data, video or episodes files.
    fn file(&self, of: &str) -> PathBuf {
        let ending = if of.starts_with("videos") { "mp4" } else { "parquet" };
        self.path(&format!("{of}/chunk-000/file-{:03}.{ending}", self.pick(2)))
    }

    fn json(&self, name: &str, change: impl Fn(&mut Value)) {
        let path = self.path(name);
        let mut value: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        change(&mut value);
        fs::write(path, format!("{value:#}")).unwrap();
    }

    fn bytes(&self, path: &Path, change: impl Fn(&mut Vec<u8>)) {
        let mut bytes = fs::read(path).unwrap();
        change(&mut bytes);
        fs::write(path, bytes).unwrap();
    }

    fn flip(&self, path: &Path) {
        self.bytes(path, |bytes| {
            let at = bytes.len() / 4 + self.pick(bytes.len() / 2);
            bytes[at] ^= 0x55;
        });
    }

    /// Changes a number in a random row of a column, never the last row.
    fn number(&self, path: &Path, column: &str, change: fn(f64) -> f64) {
        let batch = read(path);
        let row = self.pick(batch.num_rows() - 1);
        replace(path, &batch, column, |array| with_number(array, row, change));
    }

    fn text(&self, path: &Path, column: &str, change: impl Fn(&str) -> String) {
        let batch = read(path);
        let row = self.pick(batch.num_rows());
        replace(path, &batch, column, |array| {
            let texts = array.as_string::<i32>();
            let each =
                (0..texts.len()).map(|at| if at == row { change(texts.value(at)) } else { texts.value(at).into() });
            Arc::new(StringArray::from_iter_values(each))
        });
    }

    fn lines(&self, name: &str, change: impl Fn(&mut Value)) {
        let path = self.path(name);
        let text = fs::read_to_string(&path).unwrap();
        let row = self.pick(text.lines().count());
        let line = |(at, line): (usize, &str)| {
            let mut value: Value = serde_json::from_str(line).unwrap();
            if at == row {
                change(&mut value);
            }
            format!("{value}\n")
        };
        let changed: String = text.lines().enumerate().map(line).collect();
        fs::write(path, changed).unwrap();
    }

    fn sibling(&self) -> Self {
        Self { root: lerobot::depth_path(&self.root), seed: self.seed }
    }
}

fn read(path: &Path) -> RecordBatch {
    let builder = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    let rows = builder.metadata().file_metadata().num_rows() as usize;
    builder.with_batch_size(rows).build().unwrap().next().unwrap().unwrap()
}

fn write(path: &Path, batch: &RecordBatch) {
    let mut writer = ArrowWriter::try_new(File::create(path).unwrap(), batch.schema(), None).unwrap();
    writer.write(batch).unwrap();
    writer.close().unwrap();
}

fn replace(path: &Path, batch: &RecordBatch, column: &str, change: impl Fn(&ArrayRef) -> ArrayRef) {
    let at = batch.schema().index_of(column).unwrap();
    let mut columns = batch.columns().to_vec();
    columns[at] = change(&columns[at]);
    write(path, &RecordBatch::try_new(batch.schema(), columns).unwrap());
}

/// The column with the first number of a row changed.
fn with_number(array: &ArrayRef, row: usize, change: fn(f64) -> f64) -> ArrayRef {
    fn changed<T: arrow_array::ArrowPrimitiveType>(
        array: &ArrayRef,
        row: usize,
        change: impl Fn(T::Native) -> T::Native,
    ) -> ArrayRef {
        let mut values = array.as_primitive::<T>().values().to_vec();
        values[row] = change(values[row]);
        Arc::new(PrimitiveArray::<T>::from_iter_values(values))
    }
    match array.data_type() {
        DataType::Int64 => changed::<Int64Type>(array, row, |value| change(value as f64) as i64),
        DataType::Float32 => changed::<Float32Type>(array, row, |value| change(f64::from(value)) as f32),
        DataType::Float64 => changed::<Float64Type>(array, row, change),
        DataType::Boolean => {
            let flags = array.as_boolean();
            Arc::new(BooleanArray::from_iter((0..flags.len()).map(|at| Some(flags.value(at) != (at == row)))))
        }
        DataType::FixedSizeList(field, length) => {
            let lists = array.as_fixed_size_list();
            let values = with_number(lists.values(), row * *length as usize, change);
            Arc::new(FixedSizeListArray::new(Arc::clone(field), *length, values, None))
        }
        DataType::List(field) => {
            let lists = array.as_list::<i32>();
            let values = with_number(lists.values(), lists.value_offsets()[row] as usize, change);
            Arc::new(ListArray::new(Arc::clone(field), lists.offsets().clone(), values, None))
        }
        other => panic!("no numbers in {other}"),
    }
}

/// Changes one depth image of a table.
fn with_image(path: &Path, row: usize, change: impl Fn(&mut Vec<u8>)) {
    let key = "observation.images.static_depth";
    replace(path, &read(path), key, |array| {
        let parts = array.as_struct();
        let bytes = parts.column_by_name("bytes").unwrap().as_binary::<i32>();
        let mut files: Vec<Vec<u8>> = (0..bytes.len()).map(|at| bytes.value(at).to_vec()).collect();
        change(&mut files[row]);
        let bytes: ArrayRef = Arc::new(BinaryArray::from_iter_values(files));
        let paths: ArrayRef = Arc::new(StringArray::new_null(parts.len()));
        Arc::new(StructArray::from(vec![
            (Arc::new(Field::new("bytes", DataType::Binary, true)), bytes),
            (Arc::new(Field::new("path", DataType::Utf8, true)), paths),
        ]))
    });
}

const STATIC: &str = "videos/observation.images.static";
const WRIST: &str = "videos/observation.images.wrist";

/// Corruptions of a data set of version 3.0.
const CORRUPTIONS: [Corruption; 53] = [
    ("one episode more", |s| s.json("meta/info.json", |info| info["total_episodes"] = json!(7)), "info"),
    ("fewer frames", |s| s.json("meta/info.json", |info| info["total_frames"] = json!(3)), "info"),
    ("tasks", |s| s.json("meta/info.json", |info| info["total_tasks"] = json!(5)), "info"),
    ("another rate", |s| s.json("meta/info.json", |info| info["fps"] = json!(30)), "timestamps"),
    ("split", |s| s.json("meta/info.json", |info| info["splits"]["train"] = json!("0:4")), "info"),
    (
        "shape of the state",
        |s| s.json("meta/info.json", |info| info["features"]["observation.state"]["shape"] = json!([7])),
        "features",
    ),
    (
        "a column that is not described",
        |s| s.json("meta/info.json", |info| drop(info["features"].as_object_mut().unwrap().remove("sim.grip_force"))),
        "features",
    ),
    (
        "size of a video",
        |s| s.json("meta/info.json", |info| info["features"]["observation.images.wrist"]["shape"][0] = json!(72)),
        "video",
    ),
    (
        "rate of the contract",
        |s| s.json("meta/action_contract.json", |contract| contract["rate_hz"] = json!(30.0)),
        "contract",
    ),
    (
        "names of the contract",
        |s| s.json("meta/action_contract.json", |contract| contract["names"].as_array_mut().unwrap().swap(1, 3)),
        "contract",
    ),
    (
        "space of the contract",
        |s| s.json("meta/action_contract.json", |contract| contract["action"]["space"] = json!("joint_delta")),
        "action",
    ),
    (
        "robot of the contract",
        |s| s.json("meta/action_contract.json", |contract| contract["robot"] = json!("another")),
        "contract",
    ),
    ("no contract", |s| fs::remove_file(s.path("meta/action_contract.json")).unwrap(), "contract"),
    (
        "mean of the actions",
        |s| s.json("meta/stats.json", |stats| stats["action"]["mean"][s.pick(8)] = json!(0.7)),
        "statistics",
    ),
    (
        "quantile of the states",
        |s| s.json("meta/stats.json", |stats| stats["observation.state"]["q99"][s.pick(8)] = json!(0.02)),
        "statistics",
    ),
    ("count", |s| s.json("meta/stats.json", |stats| stats["ee.state"]["count"] = json!([70])), "statistics"),
    ("no statistics of a column", |s| s.json("meta/stats.json", |stats| stats["is_idle"] = json!({})), "statistics"),
    ("settings", |s| s.json("meta/lerobot_settings.json", |settings| settings["export"]["fps"] = json!(30)), "info"),
    ("a sentence", |s| s.text(&s.path("meta/tasks.parquet"), "task", |text| format!("{text} Now.")), "tasks"),
    ("index of a sentence", |s| s.number(&s.path("meta/tasks.parquet"), "task_index", |index| index + 1.0), "tasks"),
    ("length of an episode", |s| s.number(&s.file("meta/episodes"), "length", |length| length + 1.0), "episodes"),
    ("first row", |s| s.number(&s.file("meta/episodes"), "dataset_from_index", |from| from + 2.0), "episodes"),
    ("episode index", |s| s.number(&s.file("meta/episodes"), "episode_index", |index| index + 1.0), "episodes"),
    ("data file", |s| s.number(&s.file("meta/episodes"), "data/file_index", |file| 1.0 - file), "rows"),
    (
        "the same episode twice",
        |s| {
            let path = s.file("meta/episodes");
            let first = read(&path).column_by_name("store_id").unwrap().as_string::<i32>().value(1).to_owned();
            let row = Victim { seed: 0, root: s.root.clone() };
            row.text(&path, "store_id", |_| first.clone());
        },
        "episodes",
    ),
    ("outcome", |s| s.number(&s.file("meta/episodes"), "success", |success| success), "record"),
    ("seed", |s| s.number(&s.file("meta/episodes"), "seed", |seed| seed / 2.0), "record"),
    (
        "beginning in a video",
        |s| s.number(&s.file("meta/episodes"), "videos/observation.images.wrist/from_timestamp", |at| at + 0.07),
        "video",
    ),
    (
        "statistics of an episode",
        |s| s.number(&s.file("meta/episodes"), "stats/action/max", |most| most + 0.01),
        "statistics",
    ),
    (
        "half a scenario",
        |s| s.text(&s.file("meta/episodes"), "scenario_json", |text| text[..text.len() / 2].into()),
        "episodes",
    ),
    ("a time", |s| s.number(&s.file("data"), "timestamp", |at| at + 0.005), "timestamps"),
    ("a frame index", |s| s.number(&s.file("data"), "frame_index", |index| index + 1.0), "rows"),
    ("an index", |s| s.number(&s.file("data"), "index", |index| index + 1.0), "rows"),
    ("an episode index", |s| s.number(&s.file("data"), "episode_index", |index| index + 1.0), "rows"),
    ("a task index", |s| s.number(&s.file("data"), "task_index", |index| index + 1.0), "rows"),
    ("a step index", |s| s.number(&s.file("data"), "subtask_index", |index| index + 7.0), "rows"),
    ("no steps", |s| fs::remove_file(s.path("meta/subtasks.parquet")).unwrap(), "files"),
    ("a step", |s| s.text(&s.path("meta/subtasks.parquet"), "subtask", |text| format!("{text} Now.")), "rows"),
    ("a number that is none", |s| s.number(&s.file("data"), "sim.grip_force", |_| f64::NAN), "values"),
    ("a joint position", |s| s.number(&s.file("data"), "observation.state", |q| q + 0.01), "state"),
    ("a rotation", |s| s.number(&s.file("data"), "ee.quaternion", |w| w + 0.2), "state"),
    ("an action", |s| s.number(&s.file("data"), "action", |q| q - 0.01), "action"),
    ("a velocity", |s| s.number(&s.file("data"), "sim.joint_velocity", |v| v + 1e-3), "statistics"),
    ("an early end", |s| s.number(&s.file("data"), "next.done", |done| done), "rows"),
    (
        "a row less",
        |s| {
            let path = s.file("data");
            let batch = read(&path);
            write(&path, &batch.slice(0, batch.num_rows() - 1));
        },
        "rows",
    ),
    ("half a table", |s| s.bytes(&s.file("data"), |bytes| bytes.truncate(bytes.len() / 2)), "files"),
    ("a lost table", |s| fs::remove_file(s.file("data")).unwrap(), "files"),
    (
        "a foreign file",
        |s| fs::copy(s.file("data"), s.path("data/chunk-000/file-007.parquet")).map(drop).unwrap(),
        "files",
    ),
    ("a lost video", |s| fs::remove_file(s.file(WRIST)).unwrap(), "files"),
    ("half a video", |s| s.bytes(&s.file(STATIC), |bytes| bytes.truncate(bytes.len() * 2 / 3)), "video"),
    (
        "a video of other episodes",
        |s| {
            let path = |file| s.path(&format!("{STATIC}/chunk-000/file-00{file}.mp4"));
            fs::copy(path(0), path(1)).unwrap();
        },
        "video",
    ),
    (
        "lengths of units in a video",
        |s| {
            s.bytes(&s.file(WRIST), |bytes| {
                let media = bytes.windows(4).position(|window| window == b"mdat").unwrap();
                bytes[media + 5] ^= 0x40;
            });
        },
        "video",
    ),
    (
        "the card",
        |s| {
            s.bytes(&s.path("README.md"), |bytes| {
                let text =
                    String::from_utf8(bytes.clone()).unwrap().replace("\"total_frames\": ", "\"total_frames\": 1");
                *bytes = text.into_bytes();
            })
        },
        "card",
    ),
];

/// Corruptions of the depth sibling and of the native record.
const OF_SIBLINGS: [Corruption; 9] = [
    ("no depth", |s| fs::remove_dir_all(s.sibling().root).unwrap(), "depth"),
    (
        "a byte of a depth picture",
        |s| {
            let path = s.sibling().path("data/chunk-000/file-001.parquet");
            with_image(&path, s.pick(5), |file| {
                let at = file.len() / 2;
                file[at] ^= 0x11;
            });
        },
        "depth",
    ),
    (
        "half a depth picture",
        |s| with_image(&s.sibling().path("data/chunk-000/file-000.parquet"), s.pick(9), |file| file.truncate(60)),
        "depth",
    ),
    (
        "depth of other episodes",
        |s| s.text(&s.sibling().file("meta/episodes"), "store_id", |id| format!("{id}-b")),
        "depth",
    ),
    ("a time of depth", |s| s.number(&s.sibling().file("data"), "timestamp", |at| at + 0.01), "timestamps"),
    (
        "a byte of the record",
        |s| s.flip(&s.path(&format!("extras/record/scenario-{}-a0/frames.parquet", s.pick(6)))),
        "record",
    ),
    (
        "a lost record",
        |s| fs::remove_dir_all(s.path(&format!("extras/record/scenario-{}-a0", s.pick(6)))).unwrap(),
        "record",
    ),
    ("no record", |s| fs::remove_dir_all(s.path("extras")).unwrap(), "record"),
    (
        "a temporary file of a killed process",
        |s| fs::write(s.path("meta/.tasks.parquet.partial-1"), b"half").unwrap(),
        "files",
    ),
];

const OF_V21: [Corruption; 11] = [
    ("totals", |s| s.json("meta/info.json", |info| info["total_frames"] = json!(3)), "info"),
    ("a line of episodes", |s| s.lines("meta/episodes.jsonl", |line| line["length"] = json!(11)), "rows"),
    ("twice", |s| s.lines("meta/episodes.jsonl", |line| line["store_id"] = json!("scenario-0-a0")), "record"),
    ("a step", |s| s.lines("meta/subtasks.jsonl", |line| line["subtask"] = json!("Dance.")), "rows"),
    ("a sentence", |s| s.lines("meta/tasks.jsonl", |line| line["task"] = json!("Dance.")), "tasks"),
    (
        "statistics of an episode",
        |s| s.lines("meta/episodes_stats.jsonl", |line| line["stats"]["action"]["min"][2] = json!(-2.0)),
        "statistics",
    ),
    (
        "a joint",
        |s| s.number(&s.path("data/chunk-000/episode_000002.parquet"), "observation.state", |q| q + 0.01),
        "state",
    ),
    ("a time", |s| s.number(&s.path("data/chunk-000/episode_000004.parquet"), "timestamp", |q| q + 0.01), "timestamps"),
    ("a lost table", |s| fs::remove_file(s.path("data/chunk-000/episode_000001.parquet")).unwrap(), "files"),
    (
        "another video",
        |s| {
            let path =
                |episode| s.path(&format!("videos/chunk-000/observation.images.static/episode_00000{episode}.mp4"));
            fs::copy(path(0), path(1)).unwrap();
        },
        "video",
    ),
    ("no statistics for openpi", |s| fs::remove_file(s.path("norm_stats.json")).unwrap(), "files"),
];

const OF_ZARR: [Corruption; 6] = [
    ("fewer rows", |s| s.json("data/action/.zarray", |array| array["shape"][0] = json!(60)), "rows"),
    ("episodes", |s| s.json(".zattrs", |about| drop(about["episodes"].as_array_mut().unwrap().pop())), "episodes"),
    ("a lost chunk", |s| fs::remove_file(s.path("data/observation.images.static/7.0.0.0")).unwrap(), "files"),
    ("half a chunk", |s| s.bytes(&s.path("data/action/0.0"), |bytes| bytes.truncate(bytes.len() / 2)), "values"),
    ("a foreign file", |s| fs::write(s.path("data/notes.txt"), b"hello").unwrap(), "files"),
    ("chunks of another size", |s| s.json("data/ee.state/.zarray", |array| array["chunks"][1] = json!(6)), "values"),
];

/// Each corruption is found by its check, with the file and an expected value.
fn assert_all_are_found(corruptions: &[Corruption], valid: &Path) {
    let folder = tempfile::tempdir().unwrap();
    for (seed, (name, corrupt, check)) in corruptions.iter().enumerate() {
        let root = folder.path().join(seed.to_string()).join("dataset");
        copy(valid, &root);
        let depth = lerobot::depth_path(valid);
        if depth.exists() {
            copy(&depth, &lerobot::depth_path(&root));
        }
        corrupt(&Victim { root: root.clone(), seed: seed + 1 });
        let checked = checked(&root);
        let found = checked.findings.iter().find(|finding| finding.check == *check);
        let finding = found.unwrap_or_else(|| panic!("{name}: not found by `{check}`, but: {}", listed(&checked)));
        assert!(!finding.file.is_empty() && finding.expected != finding.found, "{name}: {finding:?}");
        fs::remove_dir_all(folder.path().join(seed.to_string())).unwrap();
    }
}

#[test]
fn columns_of_simulator_ground_truth_are_valid() {
    let folder = tempfile::tempdir().unwrap();
    let mut settings = settings(genmanip_data::export::default_action());
    settings.export.columns = vec![ExtraColumns::Sim];
    (settings.export.cameras, settings.export.depth) = (vec![], false);
    let dataset = folder.path().join("dataset");
    lerobot::export(&store(&folder.path().join("store")), &Selection::Verified, &robot(), &settings, &dataset).unwrap();
    let checked = checked(&dataset);
    assert!(checked.findings.is_empty(), "{}", listed(&checked));
}

#[test]
fn every_corruption_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let store = store(&folder.path().join("store"));
    let settings = settings(ExportSettings::default().action);
    let dataset = folder.path().join("dataset");
    lerobot::export(&store, &Selection::Recorded, &robot(), &settings, &dataset).unwrap();
    assert_all_are_found(&CORRUPTIONS, &dataset);
    assert_all_are_found(&OF_SIBLINGS, &dataset);
    let v21 = folder.path().join("v21");
    lerobot::export_v21(&store, &Selection::Recorded, &robot(), &settings, &v21).unwrap();
    assert_all_are_found(&OF_V21, &v21);
    let group = folder.path().join("zarr");
    zarr::export(&store, &Selection::Recorded, &robot(), &settings.export, &group).unwrap();
    assert_all_are_found(&OF_ZARR, &group);
}

/// Leaks: the same scenario, the same sentence in other case, the same numbers under another id.
#[test]
fn leaks_between_training_and_test_data_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let export = |name: &str, number: usize, change: &dyn Fn(&mut Episode)| {
        let store = EpisodeStore::create(folder.path().join(format!("{name}-store"))).unwrap();
        let mut episode = consistent_episode(number, 48);
        change(&mut episode);
        store.write(&episode, &[]).unwrap();
        let rows = ExportSettings { cameras: Vec::new(), depth: false, ..ExportSettings::default() };
        let settings = LerobotSettings { export: rows, ..LerobotSettings::default() };
        let dataset = folder.path().join(name);
        lerobot::export(&store, &Selection::Verified, &robot(), &settings, &dataset).unwrap();
        let checked = checked(&dataset);
        assert_eq!(listed(&checked), "", "{name}");
        checked
    };
    let renamed = |episode: &mut Episode, id: &str| {
        episode.scenario.id = id.into();
        episode.result.scenario_id = id.into();
    };
    let train = export("train", 0, &|_| {});
    let other = export("other", 1, &|_| {});
    let sentence = export("sentence", 2, &|episode| episode.scenario.task.instruction.make_ascii_uppercase());
    let numbers = export("numbers", 0, &|episode| {
        renamed(episode, "another");
        episode.scenario.task.instruction = "Something else.".into();
    });
    let leaked = |test: &DatasetCheck| leaks(&train, test).iter().map(|leak| leak.expected.clone()).collect::<Vec<_>>();
    assert_eq!(leaked(&other), Vec::<String>::new());
    assert_eq!(leaked(&train).len(), 3, "{:?}", leaked(&train));
    assert!(leaked(&sentence)[0].starts_with("a sentence not in"), "{:?}", leaked(&sentence));
    assert!(leaked(&numbers)[0].starts_with("states and actions not in"), "{:?}", leaked(&numbers));
}

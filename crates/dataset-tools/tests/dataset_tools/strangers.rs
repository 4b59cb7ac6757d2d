//! Datasets of other programs' versions, as their tools leave them: checked, imported, or refused with the place.

use std::path::{Path, PathBuf};

use std::sync::Arc;

use arrow_array::types::Float32Type;
use arrow_array::{Array, ArrayRef, Int64Array, LargeBinaryArray, LargeListArray, RecordBatch, StringArray};
use genmanip_data::columns::{Column, image_files};
use genmanip_data::table::{Purpose, Table, TableWriter};
use genmanip_dataset_tools::import::{self, ImportSettings};

use crate::checking::{checked, listed};

fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/strangers").join(name)
}

/// All values of a column of a data file.
fn column(file: &Path, key: &str) -> Vec<f64> {
    let batch = Table::open(file).unwrap().whole(|column| column == key).unwrap();
    Column::of(batch.column_by_name(key).unwrap()).unwrap().values
}

/// v2.1 without statistics of the whole, v2.0, and images within the tables.
#[test]
fn versions_of_other_tools_are_checked_and_imported() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["data_v21_plain", "data_v20", "data_v21_image"] {
        let report = checked(&source(name));
        assert_eq!(listed(&report), "", "{name}");
        assert_eq!((report.episodes, report.frames), (2, 21), "{name}");
        let out = folder.path().join(name);
        let made = import::import(&source(name), &ImportSettings::default(), &out, &mut |_| {}).unwrap();
        assert_eq!((made.written.episodes, listed(&checked(&out)).as_str()), (2, ""), "{name}");
        let imported = out.join("data/chunk-000/file-000.parquet");
        for key in ["action", "observation.state"] {
            let files = ["episode_000000.parquet", "episode_000001.parquet"];
            let original = files.map(|file| column(&source(name).join("data/chunk-000").join(file), key)).concat();
            assert_eq!(column(&imported, key), original, "{name}, {key}");
        }
        let video = out.join("videos/observation.images.front/chunk-000/file-000.mp4");
        assert!(video.is_file(), "{name}: {}", video.display());
    }
}

/// Rows as Polars writes them: large lists, images in a large binary column; and a column that `info.json` does not list.
fn as_polars(path: &Path) {
    let batch = Table::open(path).unwrap().whole(|_| true).unwrap();
    let converted = |column: &ArrayRef| -> ArrayRef {
        if let Some(files) = image_files(column) {
            return Arc::new(LargeBinaryArray::from_iter(files));
        }
        let Some(found) = Column::of(column).filter(|found| found.width > 1) else { return Arc::clone(column) };
        let row = |row| Some(found.row(row).iter().map(|value| Some(*value as f32)).collect::<Vec<_>>());
        Arc::new(LargeListArray::from_iter_primitive::<Float32Type, _, _>((0..column.len()).map(row)))
    };
    let note: ArrayRef = Arc::new(StringArray::from(vec!["a note"; batch.num_rows()]));
    let schema = batch.schema();
    let names = schema.fields().iter().map(|field| field.name().as_str());
    let columns = names.zip(batch.columns().iter().map(converted)).chain([("note", note)]);
    let changed = RecordBatch::try_from_iter(columns).unwrap();
    let mut writer = TableWriter::new(path, changed.schema(), Purpose::Dataset).unwrap();
    writer.write(&changed).unwrap();
    std::fs::write(path, writer.finish().unwrap()).unwrap();
}

/// Tables of Polars, and metadata from an editor that adds marks and blank lines, hold the same dataset.
#[test]
fn tables_and_texts_of_other_writers_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["data_v21_plain", "data_v21_image"] {
        let copy = folder.path().join(name);
        copied(&source(name), &copy);
        for file in files_below(&copy.join("data")) {
            as_polars(&file);
        }
        for file in ["info.json", "tasks.jsonl", "episodes.jsonl", "episodes_stats.jsonl"] {
            let path = copy.join("meta").join(file);
            let text = std::fs::read_to_string(&path).unwrap().replace('\n', "\r\n");
            std::fs::write(&path, format!("\u{feff}{text}\r\n  \r\n")).unwrap();
        }
        let found = listed(&checked(&copy));
        assert!(found.lines().all(|line| line.contains("column note")), "{name}: {found}");
        let out = folder.path().join(format!("{name}_out"));
        let made = import::import(&copy, &ImportSettings::default(), &out, &mut |_| {}).unwrap();
        let note = "column note is left out, since info.json does not list it";
        assert!(made.imported.notes.iter().any(|said| said == note), "{name}: {:?}", made.imported.notes);
        let original = files_below(&source(name).join("data"));
        let mut actions: Vec<f64> = Vec::new();
        for file in ["episode_000000.parquet", "episode_000001.parquet"] {
            actions.extend(column(original.iter().find(|path| path.ends_with(file)).unwrap(), "action"));
        }
        assert_eq!(column(&out.join("data/chunk-000/file-000.parquet"), "action"), actions, "{name}");
    }
    // What stands in place of the files of a repository is named.
    let copy = folder.path().join("data_v21_plain");
    for file in files_below(&copy.join("data")) {
        std::fs::write(file, "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n").unwrap();
    }
    let error = import::import(&copy, &ImportSettings::default(), &folder.path().join("lfs"), &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("a pointer of Git LFS"), "{error}");
    assert!(error.hint().is_some_and(|hint| hint.contains("git lfs pull")), "{error}");
}

/// A value that is not finite is named by its row, once an episode; its statistics are no further findings.
#[test]
fn values_that_are_not_finite_are_named_by_row() {
    let found = listed(&checked(&source("data_m_nan")));
    assert!(found.contains("episode 0, row 3, action[") && found.contains("a finite number"), "{found}");
    assert!(found.contains("episode 1, row 3, action["), "{found}");
    assert_eq!(found.trim().lines().count(), 2, "one per episode: {found}");
    let out = tempfile::tempdir().unwrap().path().join("out");
    let error = import::import(&source("data_m_nan"), &ImportSettings::default(), &out, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("of row 3, episode 0") && error.to_string().contains("finite"), "{error}");
    assert!(!out.exists());
}

/// HDF5 as robomimic and LIBERO write it: order of demonstrations, sentences, states, images, rewards.
#[test]
fn hdf5_of_robomimic_and_libero_is_imported() {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/robomimic");
    let folder = tempfile::tempdir().unwrap();
    let imported = |name: &str| {
        let out = folder.path().join(name);
        let file = sources.join(format!("{name}.hdf5"));
        let made = import::import(&file, &ImportSettings::default(), &out, &mut |_| {}).unwrap();
        assert_eq!(listed(&checked(&out)), "", "{name}");
        (made, out.join("data/chunk-000/file-000.parquet"))
    };
    let (made, rows) = imported("libero");
    assert_eq!((made.written.episodes, made.written.frames, made.imported.fps), (3, 15, 20));
    // demo_2 comes before demo_10.
    let actions: Vec<f64> = column(&rows, "action").into_iter().step_by(7).collect();
    let wanted = (0..5).chain(200..206).chain(1000..1004).map(f64::from);
    assert_eq!(actions, wanted.collect::<Vec<_>>());
    let state = column(&rows, "observation.state");
    let row: Vec<f64> = (0..8).map(|entry| f64::from((f64::from(entry) + 0.201) as f32)).collect();
    assert_eq!(state[6 * 8..7 * 8], row);
    assert_eq!(column(&rows, "next.reward")[..5], [0.0, 0.0, 0.0, 0.0, 1.0]);
    let tasks = Table::open(&folder.path().join("libero/meta/tasks.parquet")).unwrap().whole(|_| true).unwrap();
    let sentences = format!("{tasks:?}");
    assert!(sentences.contains("put the bowl on the plate"), "{sentences}");
    let video = folder.path().join("libero/videos/observation.images.agentview_rgb/chunk-000/file-000.mp4");
    assert!(video.is_file(), "{}", video.display());
    for note in ["upside down", "`states` of the demonstrations is left out"] {
        assert!(made.imported.notes.iter().any(|said| said.contains(note)), "{note}: {:?}", made.imported.notes);
    }
    let (made, rows) = imported("lift");
    assert_eq!(column(&rows, "action"), (0..21).map(f64::from).collect::<Vec<_>>());
    assert_eq!(column(&rows, "observation.state").len(), 3 * 9);
    assert!(made.imported.notes.iter().any(|note| note.contains("there is no sentence")), "{:?}", made.imported);
    let (made, _) = imported("nested");
    let note = "`obs/camera` of the demonstrations is left out";
    assert!(made.imported.notes.iter().any(|said| said == note), "{:?}", made.imported.notes);
    // A file that is cut off is refused by name, and nothing is left.
    let cut = folder.path().join("cut.hdf5");
    std::fs::write(&cut, &std::fs::read(sources.join("lift.hdf5")).unwrap()[..6000]).unwrap();
    let out = folder.path().join("cut");
    let error = import::import(&cut, &ImportSettings::default(), &out, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("cut.hdf5") && !out.exists(), "{error}");
}

/// Links that lead nowhere or into another file are noted, in groups of every format; links that lead somewhere are read.
#[test]
fn links_of_hdf5_are_followed_or_noted() {
    let testdata = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata");
    let folder = tempfile::tempdir().unwrap();
    for (name, links) in [("links_old", 1), ("links_new", 1), ("links_many", 20)] {
        let file = testdata.join("robomimic").join(format!("{name}.hdf5"));
        let out = folder.path().join(name);
        let made = import::import(&file, &ImportSettings::default(), &out, &mut |_| {}).unwrap();
        assert_eq!((made.written.episodes, made.written.frames), (1, 3), "{name}");
        assert_eq!(column(&out.join("data/chunk-000/file-000.parquet"), "observation.alias"), [1.0; 21], "{name}");
        let left_out: Vec<&String> = made.imported.notes.iter().filter(|note| note.contains("left out")).collect();
        let gone =
            (0..links).map(|link| format!("`obs/gone_{link}` is left out: a link to `/nowhere`, which does not exist"));
        let mut wanted: Vec<String> = gone.collect();
        wanted.extend([
            "`data/demo_1` is left out: a link to `/data/demo_0` of the file `elsewhere.hdf5`".into(),
            "`obs/kind` is left out: neither a group nor a data set".into(),
            "`rewards` is left out: a link to `/rewards/gone`, which does not exist".into(),
        ]);
        wanted.sort();
        assert_eq!(left_out, wanted.iter().collect::<Vec<_>>(), "{name}");
    }
    let file = testdata.join("robomimic_refused/linked.hdf5");
    let out = folder.path().join("linked");
    let error = import::import(&file, &ImportSettings::default(), &out, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("of the file `elsewhere.hdf5`") && !out.exists(), "{error}");
}

/// Integers beyond 2^53, which no double holds, keep their values; numbers that no column can hold are named.
#[test]
fn integers_of_hdf5_are_exact_or_named() {
    let testdata = Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata");
    let folder = tempfile::tempdir().unwrap();
    let import = |name: &str| {
        let out = folder.path().join(name);
        let source = if name == "integers" { "robomimic" } else { "robomimic_refused" };
        let file = testdata.join(source).join(format!("{name}.hdf5"));
        import::import(&file, &ImportSettings::default(), &out, &mut |_| {}).map(|_| out)
    };
    let out = import("integers").unwrap();
    assert_eq!(listed(&checked(&out)), "");
    let rows = Table::open(&out.join("data/chunk-000/file-000.parquet")).unwrap().whole(|_| true).unwrap();
    let stamps = [9_007_199_254_740_993, -4_611_686_018_427_387_905, i64::MAX];
    for (key, wanted) in [
        ("stamp", stamps),
        ("unsigned", [stamps[0], 4_611_686_018_427_387_903, i64::MAX]),
        ("big_endian", stamps),
        ("short", [-300, 0, 300]),
        ("byte", [0, 127, 255]),
    ] {
        let column = rows.column_by_name(&format!("observation.{key}")).unwrap();
        let found: Vec<i64> = column.as_any().downcast_ref::<Int64Array>().unwrap().values().to_vec();
        assert_eq!(found, wanted, "{key}");
    }
    for (name, wanted) in
        [("unsigned", ["obs/stamp[1] of row 1", "2^63"]), ("double", ["obs/force[0] of row 1", "3.4e38"])]
    {
        let error = import(name).unwrap_err().to_string();
        assert!(wanted.iter().all(|part| error.contains(part)), "{name}: {error}");
        assert!(!folder.path().join(name).exists(), "{name}");
    }
}

/// A camera without a video in one episode is left out and said; a sentence is that of `task_index`.
#[test]
fn cameras_that_some_episodes_lack_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("source");
    copied(&source("data_v21_plain"), &copy);
    let videos: Vec<PathBuf> =
        files_below(&copy).into_iter().filter(|path| path.ends_with("episode_000001.mp4")).collect();
    assert!(!videos.is_empty());
    std::fs::remove_file(&videos[0]).unwrap();
    let out = folder.path().join("out");
    let made = import::import(&copy, &ImportSettings::default(), &out, &mut |_| {}).unwrap();
    let note = "is left out: 1 of 2 episodes have no video of it, first 1";
    assert!(made.imported.notes.iter().any(|said| said.contains(note)), "{:?}", made.imported.notes);
    assert_eq!((made.written.episodes, listed(&checked(&out)).as_str()), (2, ""));
    // The table of episodes says a sentence that the rows do not.
    let episodes = copy.join("meta/episodes.jsonl");
    let text = std::fs::read_to_string(&episodes).unwrap();
    let first = text.lines().next().unwrap().to_owned();
    let said: serde_json::Value = serde_json::from_str(&first).unwrap();
    let sentence = said["tasks"][0].as_str().unwrap().to_owned();
    std::fs::write(&episodes, text.replacen(&sentence, "something else", 1)).unwrap();
    let out = folder.path().join("again");
    let made = import::import(&copy, &ImportSettings::default(), &out, &mut |_| {}).unwrap();
    assert!(made.imported.notes.iter().any(|note| note.contains("those of task_index")), "{:?}", made.imported.notes);
    let tasks = Table::open(&out.join("meta/tasks.parquet")).unwrap().whole(|_| true).unwrap();
    let sentences = format!("{tasks:?}");
    assert!(sentences.contains(&sentence) && !sentences.contains("something else"), "{sentences}");
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { files_below(&path) } else { vec![path] }).collect()
}

fn copied(from: &Path, to: &Path) {
    for path in files_below(from) {
        let target = to.join(path.strip_prefix(from).unwrap());
        std::fs::create_dir_all(target.parent().unwrap()).unwrap();
        std::fs::copy(&path, &target).unwrap();
    }
}

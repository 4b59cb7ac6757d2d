//! Imported data sets hold what their source held, and the editing tools work on them.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use arrow_array::{Array, ArrayRef, BooleanArray, RecordBatch};
use genmanip_core::Seed;
use genmanip_data::lerobot::{self, LerobotDataset};
use genmanip_data::{ExportReport, LerobotSettings, Selection};
use genmanip_dataset_tools::edit::{self, By};
use genmanip_dataset_tools::import::{self, ImportSettings};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

use crate::checking::{checked, copy, listed, settings, store};
use crate::synthetic::{robot, tree};

/// A temporary folder for data sets of six episodes, the fourth of which failed.
struct Fixture {
    folder: tempfile::TempDir,
}

type Export = fn(
    &genmanip_data::EpisodeStore,
    &Selection,
    &genmanip_core::RobotModel,
    &LerobotSettings,
    &Path,
) -> Result<ExportReport, genmanip_data::DataError>;

impl Fixture {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn export(&self, name: &str, export: Export) -> PathBuf {
        let store = store(&self.at(&format!("store-{name}")));
        let dataset = self.at(name);
        export(&store, &Selection::Recorded, &robot(), &Self::settings(), &dataset).unwrap();
        dataset
    }

    fn settings() -> LerobotSettings {
        settings(genmanip_data::export::default_action())
    }

    fn import(&self, source: &Path, name: &str) -> Result<PathBuf, String> {
        let settings = ImportSettings { episodes_per_file: 3, episodes_per_depth_file: 2, ..ImportSettings::default() };
        let out = self.at(name);
        let imported = import::import(source, &settings, &out, &mut |total| assert_eq!(total, 6));
        imported.map(|report| assert_eq!(report.written.episodes, 6)).map_err(|error| {
            assert!(!out.exists() && !lerobot::depth_path(&out).exists(), "{error}");
            error.to_string()
        })?;
        Ok(out)
    }
}

/// Files of a data set with rows, images and sentences.
fn contents(dataset: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let is_content = |name: &str| {
        let kinds = ["data/", "videos/", "extras/", "meta/info.json", "meta/tasks.", "meta/subtasks."];
        kinds.iter().any(|kind| name.starts_with(kind))
    };
    tree(dataset).into_iter().filter(|(path, _)| is_content(path.to_str().unwrap())).collect()
}

fn assert_same_contents(left: &Path, right: &Path) {
    let (left, right) = (contents(left), contents(right));
    assert_eq!(left.keys().collect::<Vec<_>>(), right.keys().collect::<Vec<_>>());
    for (path, bytes) in left {
        assert!(bytes == right[&path], "{}", path.display());
    }
}

/// Rows, times, images, sentences, steps, outcomes and the native record: byte for byte those of a v3.0 export.
#[test]
fn version_2_1_becomes_3_0() {
    let fixture = Fixture::new();
    let (old, new) = (fixture.export("v21", lerobot::export_v21), fixture.export("v30", lerobot::export));
    let imported = fixture.import(&old, "imported").unwrap();
    assert_same_contents(&imported, &new);
    assert_eq!(listed(&checked(&imported)), "");
    let [left, right] = [&imported, &new].map(|dataset| LerobotDataset::open(dataset).unwrap());
    assert_eq!(left.episodes(), right.episodes());
    assert_eq!(left.contract(), right.contract());
    let again = fixture.import(&old, "again").unwrap();
    let all = |dataset: &Path| {
        let mut all = tree(dataset);
        all.remove(Path::new("README.md")); // has its name
        all
    };
    assert!(all(&imported) == all(&again), "equal bytes");
    // Converting the import, or a v3.0 export, to v2.1 gives the v2.1 export.
    for source in [&imported, &new] {
        let back = fixture.at("back");
        import::to_v21(source, &ImportSettings::default(), &back, &mut |_| {}).unwrap();
        assert_same_contents(&back, &old);
        assert_eq!(listed(&checked(&back)), "");
        let modality = |dataset: &Path| fs::read(dataset.join("meta/modality.json")).unwrap();
        assert!(modality(&back) == modality(&old));
        fs::remove_dir_all(back).unwrap();
    }
    // An episode imported twice is recognised.
    let error = edit::merge(&[imported, again], &fixture.at("both"), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("each episode only once"), "{error}");
}

fn rewrite(path: &Path, change: impl Fn(RecordBatch) -> RecordBatch) {
    let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    let batches: Vec<RecordBatch> =
        reader.with_batch_size(7).build().unwrap().map(|batch| change(batch.unwrap())).collect();
    let mut writer = ArrowWriter::try_new(File::create(path).unwrap(), batches[0].schema(), None).unwrap();
    batches.iter().for_each(|batch| writer.write(batch).unwrap());
    writer.close().unwrap();
}

/// A table without the columns that only this program writes.
fn foreign_columns(batch: RecordBatch) -> RecordBatch {
    let known = ["episode_index", "tasks", "length", "data/", "dataset_", "videos/", "meta/"];
    let schema = batch.schema();
    let kept =
        schema.fields().iter().enumerate().filter(|(_, field)| known.iter().any(|name| field.name().starts_with(name)));
    batch.project(&kept.map(|(place, _)| place).collect::<Vec<_>>()).unwrap()
}

/// A data set of version 3.0 like one of another program: one row group per file, none of our files and columns.
fn foreign(fixture: &Fixture, name: &str) -> PathBuf {
    let dataset = fixture.export(name, lerobot::export);
    for own in ["meta/genmanip.json", "meta/lerobot_settings.json", "meta/action_contract.json", "README.md"] {
        fs::remove_file(dataset.join(own)).unwrap();
    }
    fs::remove_dir_all(dataset.join("extras")).unwrap();
    fs::remove_dir_all(lerobot::depth_path(&dataset)).unwrap();
    for file in tree(&dataset).keys().map(|path| path.to_str().unwrap().to_owned()) {
        if file.starts_with("meta/episodes") {
            rewrite(&dataset.join(&file), foreign_columns);
        } else if file.starts_with("data/") {
            rewrite(&dataset.join(&file), |batch| batch);
        }
    }
    dataset
}

#[test]
fn a_data_set_of_another_program_is_imported_and_edited() {
    let fixture = Fixture::new();
    let source = foreign(&fixture, "foreign");
    let imported = fixture.import(&source, "imported").unwrap();
    assert_same_contents(&imported, &{
        let own = fixture.export("own", lerobot::export);
        fs::remove_dir_all(own.join("extras")).unwrap();
        own
    });
    let valid = checked(&imported);
    assert_eq!((listed(&valid).as_str(), valid.episodes), ("", 6));
    let names = |dataset: &Path| -> Vec<String> {
        let table = dataset.join("meta/episodes/chunk-000/file-000.parquet");
        let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(table).unwrap()).unwrap().build().unwrap();
        let batch = reader.last().unwrap().unwrap();
        let column: ArrayRef = batch.column_by_name("store_id").unwrap().clone();
        let texts = column.as_any().downcast_ref::<arrow_array::StringArray>().unwrap();
        texts.iter().map(|text| text.unwrap().to_owned()).collect()
    };
    assert_eq!(names(&imported), ["episode_000000", "episode_000001", "episode_000002"]);

    let quiet = &mut |_| {};
    let kept = edit::filter(&imported, &["success=true".parse().unwrap()], &fixture.at("kept"), quiet).unwrap();
    assert_eq!(kept.episodes, 5, "success according to the rows");
    let parts = [("train".to_owned(), 0.5), ("test".to_owned(), 0.5)];
    let parts = edit::split(&imported, &parts, By::Episode, Seed::new(1), &fixture.at("parts"), quiet).unwrap();
    let parts: Vec<PathBuf> = parts.into_iter().map(|part| part.dataset).collect();
    let whole = edit::merge(&parts, &fixture.at("whole"), quiet).unwrap();
    assert_eq!((whole.episodes, whole.frames), (6, valid.frames));
    for dataset in [&fixture.at("kept"), &parts[0], &fixture.at("whole")] {
        assert_eq!(listed(&checked(dataset)), "", "{}", dataset.display());
    }
}

/// Unsupported contents are rejected, and nothing is written.
#[test]
fn unsupported_data_sets_are_rejected() {
    let fixture = Fixture::new();
    let own = fixture.export("own", lerobot::export);
    let error = fixture.import(&own, "out").unwrap_err();
    assert!(error.contains("needs no import"), "{error}");
    let error = fixture.import(&fixture.at("nowhere"), "out").unwrap_err();
    assert!(error.contains("with episodes of the original GenManip"), "{error}");

    let cases: [(Change, &str); 8] = [
        (
            |dataset| fs::remove_file(dataset.join("videos/observation.images.wrist/chunk-000/file-001.mp4")).unwrap(),
            "file-001.mp4",
        ),
        (
            |dataset| {
                fs::write(dataset.join("videos/observation.images.wrist/chunk-000/file-000.mp4"), b"nothing").unwrap()
            },
            "no index",
        ),
        (|dataset| fs::remove_file(dataset.join("data/chunk-000/file-001.parquet")).unwrap(), "file-001.parquet"),
        (
            |dataset| {
                rewrite(&dataset.join("data/chunk-000/file-000.parquet"), |batch| batch.slice(0, batch.num_rows() / 2));
            },
            "timestamp of row 3",
        ),
        (
            |dataset| {
                let path = dataset.join("meta/info.json");
                let text = fs::read_to_string(&path).unwrap().replace("\"fps\": 15", "\"fps\": 30");
                fs::write(path, text).unwrap();
            },
            "timestamp of row 1",
        ),
        (
            |dataset| {
                let path = dataset.join("meta/info.json");
                let text =
                    fs::read_to_string(&path).unwrap().replace("\"videos/{video_key}", "\"../videos/{video_key}");
                fs::write(path, text).unwrap();
            },
            "a file of the data set",
        ),
        (
            |dataset| {
                rewrite(&dataset.join("data/chunk-000/file-000.parquet"), |batch| {
                    let unknown: ArrayRef = std::sync::Arc::new(BooleanArray::from(vec![None; batch.num_rows()]));
                    let fields: Vec<_> = batch
                        .schema()
                        .fields()
                        .iter()
                        .map(|field| {
                            let is_nullable = field.name() == "is_idle" || field.is_nullable();
                            field.as_ref().clone().with_nullable(is_nullable)
                        })
                        .collect();
                    let schema = std::sync::Arc::new(arrow_schema::Schema::new(fields));
                    let place = schema.index_of("is_idle").unwrap();
                    let mut columns = batch.columns().to_vec();
                    columns[place] = unknown;
                    RecordBatch::try_new(schema, columns).unwrap()
                });
            },
            "`is_idle` is not numeric in every row",
        ),
        (
            |dataset| {
                rewrite(&dataset.join("data/chunk-000/file-001.parquet"), |batch| {
                    let kept = |name: &String| name != "sim.grasped";
                    let names: Vec<String> = batch.schema().fields().iter().map(|field| field.name().clone()).collect();
                    let kept: Vec<usize> = (0..names.len()).filter(|place| kept(&names[*place])).collect();
                    batch.project(&kept).unwrap()
                });
            },
            "file-001.parquet: expected `sim.grasped`, according to info.json, got no such column",
        ),
    ];
    for (number, (change, expected)) in cases.into_iter().enumerate() {
        let source = foreign(&fixture, &format!("foreign-{number}"));
        assert_rejected(&fixture, &source, change, expected);
    }
}

/// Damage to a data set.
type Change = fn(&Path);

/// A damaged data set is rejected with its path and the expected contents.
fn assert_rejected(fixture: &Fixture, source: &Path, change: Change, expected: &str) {
    change(source);
    let error = fixture.import(source, "out").unwrap_err();
    let place = source.display().to_string();
    assert!(error.contains(expected) && error.contains(&place), "{expected} in {error}");
}

fn replace(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{from} in {text}");
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn unsupported_data_sets_of_version_2_1_are_rejected() {
    let fixture = Fixture::new();
    let cases: [(Change, &str); 5] = [
        (
            |dataset| fs::write(dataset.join("meta/episodes.jsonl"), "").unwrap(),
            "meta/episodes.jsonl: expected at least one, got 0",
        ),
        (
            |dataset| replace(&dataset.join("meta/episodes.jsonl"), "\"length\":", "\"length\":0,\"was\":"),
            "meta/episodes.jsonl: expected at least 1, got 0",
        ),
        (
            |dataset| replace(&dataset.join("meta/subtasks.jsonl"), "\"subtask_index\":0", "\"subtask_index\":77"),
            "data/chunk-000/episode_000000.parquet: expected a step of the episode in meta/subtasks.jsonl, got 0",
        ),
        (|dataset| replace(&dataset.join("meta/info.json"), "{", "["), "meta/info.json: expected JSON"),
        (
            |dataset| {
                rewrite(&dataset.join("data/chunk-000/episode_000001.parquet"), |batch| {
                    batch.project(&(0..batch.num_columns() - 1).collect::<Vec<_>>()).unwrap()
                });
            },
            "episode_000001.parquet: expected `",
        ),
    ];
    for (number, (change, expected)) in cases.into_iter().enumerate() {
        let source = fixture.export(&format!("v21-{number}"), lerobot::export_v21);
        assert_rejected(&fixture, &source, change, expected);
    }
}

/// A damaged record is an error; a record without an action contract is omitted, with a note.
#[test]
fn records_are_never_lost_silently() {
    let fixture = Fixture::new();
    let damaged = fixture.export("damaged", lerobot::export_v21);
    fs::write(damaged.join("extras/record/store.json"), b"{").unwrap();
    let error = fixture.import(&damaged, "out").unwrap_err();
    assert!(error.contains("store.json"), "{error}");
    fs::remove_file(damaged.join("extras/record/store.json")).unwrap();
    let error = fixture.import(&damaged, "out").unwrap_err();
    assert!(error.contains("extras/record"), "{error}");

    let silent = fixture.export("silent", lerobot::export_v21);
    fs::remove_file(silent.join("meta/action_contract.json")).unwrap();
    let report = import::import(&silent, &ImportSettings::default(), &fixture.at("out"), &mut |_| {}).unwrap();
    assert!(!report.imported.record && !fixture.at("out/extras").exists());
    assert!(report.imported.notes.iter().any(|note| note.contains("extras/record is left out")), "{report:?}");
}

/// An episode written by the original's own libraries (`testdata/make_original_episode.py`).
fn original() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata/original")
}

/// Numbers, instruction, stages and depth are exact, and images have their colours.
#[test]
fn episodes_of_the_original_are_imported() {
    let fixture = Fixture::new();
    copy(&original(), &fixture.at("demos/task/a"));
    copy(&original(), &fixture.at("demos/task/b"));
    let (settings, out) = (ImportSettings::default(), fixture.at("imported"));
    let report = import::import(&fixture.at("demos"), &settings, &out, &mut |_| {}).unwrap();
    assert_eq!((report.written.episodes, report.written.frames), (2, 10));
    let depth_dataset = lerobot::depth_path(&out);
    // Both folders hold the same episode, which is the only finding.
    let found = listed(&checked(&out));
    assert!(found.lines().count() == 1 && found.contains("a unique episode"), "{found}");
    assert_eq!(listed(&checked(&depth_dataset)), "");
    let rows = first(&out, "data");
    let column = |name: &str| -> Vec<f64> { numbers(rows.column_by_name(name).unwrap()) };
    let joints = |step: usize| (0..9).map(move |joint| joint as f64 / 8.0 + step as f64 / 16.0);
    let states: Vec<f64> = (0..5).flat_map(joints).collect();
    assert_eq!(column("observation.state")[..45], states);
    let action: Vec<f64> =
        (0..5).flat_map(|step| joints(step + 1).take(7).chain([if step < 2 { 0.04 } else { 0.0 }; 2])).collect();
    assert_eq!(column("action")[..45], action);
    assert_eq!(column("gripper_close")[..5], [-1.0, -1.0, 1.0, 1.0, 1.0]);
    assert_eq!(column("subtask_index")[..5], [0.0, 0.0, 1.0, 1.0, 2.0]);
    let poses = column("sim.object_pose");
    assert_eq!(poses[112..119], [0.75, 0.0, 0.75, 0.0, 1.0, 0.0, 0.0], "the mug in the second frame");
    assert_eq!(poses[119..126], [0.25, -0.5, 0.25, 0.0, 1.0, 0.0, 0.0], "the table, second in the order of ids");
    assert_eq!(column("camera.realsense.camera2env_pose")[16..19], [1.0, 2.0, 3.0]);
    let listed = first(&out, "meta/episodes");
    let names = listed.column_by_name("store_id").unwrap();
    let names = names.as_any().downcast_ref::<arrow_array::StringArray>().unwrap();
    assert_eq!((names.value(0), names.value(1)), ("2025-06-05_10_00_00_000001", "episode_000001"));

    let depths = first(&depth_dataset, "data");
    let pictures = depths.column_by_name("observation.images.realsense_depth").unwrap();
    let pictures = pictures.as_any().downcast_ref::<arrow_array::StructArray>().unwrap();
    let files = pictures.column_by_name("bytes").unwrap();
    let file = files.as_any().downcast_ref::<arrow_array::BinaryArray>().unwrap().value(1);
    let (width, height, mm) = genmanip_data::depth::decode_depth_png(file).unwrap();
    assert_eq!((width, height), (32, 24));
    assert_eq!(mm[..11], [0, 1, 1, 1, 1, 1, 1, 1, 2, 6554, 0]);
    assert_eq!(mm[32], 1122, "(32 * 7 + 11000) tenths");
}

fn first(dataset: &Path, table: &str) -> RecordBatch {
    let path = dataset.join(table).join("chunk-000/file-000.parquet");
    let reader = ParquetRecordBatchReaderBuilder::try_new(File::open(path).unwrap()).unwrap();
    reader.with_batch_size(1000).build().unwrap().next().unwrap().unwrap()
}

fn numbers(column: &ArrayRef) -> Vec<f64> {
    use arrow_array::cast::AsArray;
    use arrow_array::types::{Float32Type, Float64Type, Int64Type};
    if let Some(lists) = column.as_list_opt::<i32>() {
        let (from, to) = (lists.value_offsets()[0], *lists.value_offsets().last().unwrap());
        return numbers(&lists.values().slice(from as usize, (to - from) as usize));
    }
    if let Some(lists) = column.as_fixed_size_list_opt() {
        return numbers(lists.values());
    }
    if let Some(values) = column.as_primitive_opt::<Float32Type>() {
        return values.values().iter().map(|value| f64::from(*value)).collect();
    }
    if let Some(values) = column.as_primitive_opt::<Int64Type>() {
        return values.values().iter().map(|value| *value as f64).collect();
    }
    column.as_primitive::<Float64Type>().values().to_vec()
}

/// Malicious, damaged or escaping recordings give a one-line error.
#[test]
fn hostile_recordings_are_rejected() {
    let fixture = Fixture::new();
    let marker = fixture.at("executed");
    let system = format!("cos\nsystem\n(S'touch {}'\ntR.", marker.display());
    let meta = |bytes: Vec<u8>| move |folder: &Path| fs::write(folder.join("meta_info.pkl"), &bytes).unwrap();
    let data = |change: fn(&mut Vec<u8>)| {
        move |folder: &Path| {
            let path = folder.join("lmdb/data.mdb");
            let mut bytes = fs::read(&path).unwrap();
            change(&mut bytes);
            fs::write(path, bytes).unwrap();
        }
    };
    type Change = Box<dyn Fn(&Path)>;
    let cases: Vec<(Change, &str)> = vec![
        (Box::new(meta(system.into_bytes())), "got a call of os.system, which is not executed"),
        (Box::new(meta(b"}.".to_vec())), "a number under `num_steps`"),
        (
            Box::new(meta(b"(dVnum_steps\nI999999999999\nsVlanguage_instruction\nVgo\ns.".to_vec())),
            "at most 131072 under `num_steps`",
        ),
        (
            Box::new(data(|bytes| {
                let (key, outside) = (b"observation/realsense/", b"observation/../../xxx/");
                for at in 0..bytes.len() - key.len() {
                    if bytes[at..].starts_with(key) {
                        bytes[at..at + key.len()].copy_from_slice(outside);
                    }
                }
            })),
            "one within the data set",
        ),
        (Box::new(meta(vec![0; 100])), "an opcode that builds plain values"),
        (
            Box::new(data(|bytes| {
                for at in 0..bytes.len() - 4 {
                    if bytes[at..].starts_with(b"IHDR") {
                        bytes[at + 4] ^= 1;
                    }
                }
            })),
            "depth_image/0000: expected an image like the others, got ",
        ),
        (Box::new(data(|bytes| bytes.truncate(20_000))), "a page beyond the end of the file"),
        (Box::new(data(|bytes| bytes.truncate(10))), "another file format"),
        (Box::new(data(|bytes| bytes[8192..].fill(0xff))), "a damaged page"),
        (Box::new(|folder| fs::remove_file(folder.join("lmdb/data.mdb")).unwrap()), "data.mdb"),
        (
            Box::new(data(|bytes| {
                let key = b"observation/robot/qpos";
                let at = bytes.windows(key.len()).position(|window| window == key).unwrap();
                bytes[at] = b'x';
            })),
            "an entry per frame",
        ),
    ];
    for (number, (change, expected)) in cases.into_iter().enumerate() {
        let folder = fixture.at(&format!("episode-{number}"));
        copy(&original(), &folder);
        change(&folder);
        let out = fixture.at("out");
        let error = import::import(&folder, &ImportSettings::default(), &out, &mut |_| {}).unwrap_err().to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{expected} in {error}");
        assert!(!out.exists() && !marker.exists());
    }
    // Arbitrary damage of pages must not panic.
    let bytes = fs::read(original().join("lmdb/data.mdb")).unwrap();
    for number in 0..300_usize {
        let mut changed = bytes.clone();
        for at in 0..8 {
            let place = (number * 7919 + at * 104_729) % changed.len();
            changed[place] ^= 1 << (number % 8);
        }
        let folder = fixture.at("changed");
        copy(&original(), &folder);
        fs::write(folder.join("lmdb/data.mdb"), changed).unwrap();
        let out = fixture.at(&format!("changed-{number}"));
        let _ = import::import(&folder, &ImportSettings::default(), &out, &mut |_| {});
        fs::remove_dir_all(folder).unwrap();
    }
}

/// Video that is not H.264 is decoded by ffmpeg, here replaced by a program that outputs uniform images; without ffmpeg
/// it is rejected.
#[cfg(unix)]
#[test]
fn other_codecs_are_decoded_by_ffmpeg() {
    use std::os::unix::fs::PermissionsExt;
    let fixture = Fixture::new();
    let source = foreign(&fixture, "foreign");
    for path in tree(&source).keys().filter(|path| path.extension().is_some_and(|ending| ending == "mp4")) {
        fs::write(source.join(path), b"av01").unwrap();
    }
    let error = fixture.import(&source, "refused").unwrap_err();
    assert!(error.contains("no index"), "{error}");

    let frame = 96 * 64 * 3;
    let ppm = |width: usize, value: u8| {
        let mut picture = format!("P6\n{width} 64\n255\n").into_bytes();
        picture.resize(picture.len() + frame, value);
        picture
    };
    let colors: Vec<u8> = (0..60_u8).flat_map(|picture| ppm(96, 4 * picture)).collect();
    fs::write(fixture.at("colors"), colors).unwrap();
    let program = fixture.at("decoder");
    fs::write(&program, format!("#!/bin/sh\nexec cat '{}'\n", fixture.at("colors").display())).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let settings = ImportSettings { ffmpeg: Some(program.clone()), ..ImportSettings::default() };
    let report = import::import(&source, &settings, &fixture.at("decoded"), &mut |_| {}).unwrap();
    assert!(report.imported.notes.iter().any(|note| note.contains("encoded anew")), "{:?}", report.imported.notes);
    assert_eq!(listed(&checked(&fixture.at("decoded"))), "");
    // The second episode begins with frame 12 of its file, and its mean is that of frames 12 to 26.
    let listed = first(&fixture.at("decoded"), "meta/episodes");
    let means = numbers(&listed.column_by_name("stats/observation.images.wrist/mean").unwrap().slice(1, 1));
    assert!((means[0] - 4.0 * 19.0 / 255.0).abs() < 0.01, "{means:?}");

    // An image with the same number of bytes but another shape would come out scrambled.
    fs::write(fixture.at("colors"), [ppm(96, 0), ppm(48, 0)].concat()).unwrap();
    let error = import::import(&source, &settings, &fixture.at("other"), &mut |_| {}).unwrap_err().to_string();
    assert!(
        error.contains("frame 1 of") && error.contains("expected 96×64, according to info.json, got 48×64"),
        "{error}"
    );
    fs::write(fixture.at("colors"), ppm(96, 0).repeat(5)).unwrap();
    let error = import::import(&source, &settings, &fixture.at("short"), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("no frame 5 in") && error.contains("end of file"), "{error}");
    let settings = ImportSettings { ffmpeg: Some(fixture.at("nowhere")), ..settings };
    let error = import::import(&source, &settings, &fixture.at("none"), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("cannot start"), "{error}");
}

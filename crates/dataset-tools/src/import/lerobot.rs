//! Reader of LeRobot data sets, v3.0, v2.1 and v2.0, written by any program.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use arrow_array::RecordBatch;

use super::image_file;
use super::metadata::{self, ImportedMetadata};
use super::videos::{FrameRequest, VideoReader};
use super::{ImportSettings, Importer, OnEpisode, SourceInfo};
use crate::check::{self, EpisodeEntry, Metadata, Version, VideoSpan};
use genmanip_data::columns::{Column, Rows, image_files};
use genmanip_data::export::EpisodeRows;
use genmanip_data::export::features::{Feature, ImageFeature, Values, VideoFeature};
use genmanip_data::lerobot::RECORD;
use genmanip_data::lerobot::info::INFO;
use genmanip_data::table::Table;
use genmanip_data::video::{VideoEncoder, VideoSettings};
use genmanip_data::{ColorHistogram, DataError, EpisodeStore, depth};

/// Index columns, which the writer regenerates.
const INDEX_COLUMNS: [&str; 5] = ["timestamp", "frame_index", "episode_index", "index", "task_index"];
/// Supported numeric types; `float16` is widened to `float32`, all integers to `int64`.
const NUMBERS: [&str; 11] =
    ["float16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "bool"];
/// Batch size of reading tables, rows. Chosen by hand to bound memory, since rows may contain images.
const ROWS_PER_BATCH: usize = 256;
/// Tolerance of timestamps against `frame_index / fps`, s; ten times that of LeRobot's own readers.
const TIME_TOLERANCE_S: f64 = 1e-3;
/// 2^53. Integers below it are exact as `f64`, the type in which columns are read.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;

/// A LeRobot data set, open for import.
pub(super) struct Lerobot {
    metadata: Metadata,
    fps: u32,
    videos: VideoReader,
    notes: BTreeSet<String>,
    /// Episodes in this program's own format (`extras/record`), if included; `None` otherwise.
    record: Option<EpisodeStore>,
}

impl Lerobot {
    pub(super) fn open(root: &Path, settings: &ImportSettings) -> Result<Self, DataError> {
        let (mut metadata, findings, listed) = check::read_partial_metadata(root)?;
        // Invalid statistics do not matter: the import recomputes them.
        if let Some(first) = findings.iter().find(|finding| finding.check != "statistics") {
            let what = format!("{} in {}", first.place, root.join(&first.file).display());
            return Err(DataError::mismatch(what.trim_start_matches(" in "), &first.expected, &first.found));
        }
        if metadata.episodes.is_empty() {
            let what = format!("episodes in {}", root.join(metadata.episodes_file).display());
            return Err(DataError::mismatch(what, "at least one", 0));
        }
        if let Some(listed) = metadata.episodes.iter().find(|listed| listed.length < 1) {
            let what = format!("length of {} in {}", listed.place(), root.join(&listed.listed_in.0).display());
            return Err(DataError::mismatch(what, "at least 1", listed.length));
        }
        let fps = metadata.info.fps;
        if !(1.0..=240.0).contains(&fps) || fps.fract() != 0.0 {
            let what = format!("fps of {}", root.join(INFO).display());
            return Err(DataError::mismatch(what, "an integer from 1 to 240", fps));
        }
        let videos = VideoReader::new(settings.ffmpeg.clone());
        let mut notes = BTreeSet::new();
        leave_out_partial_cameras(&mut metadata, &listed, &mut notes);
        check::require_videos(&metadata, &listed)?;
        let record = root.join(RECORD);
        let record = match std::fs::symlink_metadata(&record) {
            Err(_) => None,
            Ok(_) if metadata.contract.is_none() => {
                notes.insert("extras/record is left out, since there is no meta/action_contract.json".into());
                None
            }
            // A damaged record is an error, so that no episode's record is lost silently.
            Ok(_) => Some(EpisodeStore::open(record)?),
        };
        Ok(Self { metadata, fps: fps as u32, videos, notes, record })
    }

    /// Fails if the data set was exported by this program and so needs no import.
    pub(super) fn check_foreign(&self) -> Result<(), DataError> {
        if !self.metadata.is_own || self.metadata.info.version != Version::V30 {
            return Ok(());
        }
        let expected = "a data set of another program or version";
        let got = "one of this program, which needs no import";
        Err(DataError::mismatch(self.metadata.root.display().to_string(), expected, got))
    }

    /// Columns to import from a table whose columns are `known`; adds notes on those that are left out.
    ///
    /// # Errors
    /// If `info.json` lists a column that the table lacks, other than a video.
    fn wanted(&mut self, path: &Path, known: &[String]) -> Result<Wanted, DataError> {
        let has_steps = !self.metadata.subtasks.is_empty();
        let Wanted { mut numbers, mut depths, mut colors } = Wanted::default();
        for feature in &self.metadata.info.features {
            if !known.contains(&feature.key) {
                if feature.is_video() {
                    continue;
                }
                let what = format!("columns of {}", path.display());
                return Err(DataError::mismatch(
                    what,
                    format!("`{}`, according to info.json", feature.key),
                    "no such column",
                ));
            }
            let key = &feature.key;
            let about = &self.metadata.info.json["features"][key]["info"];
            let is_depth = about["is_depth_map"] == true || about["video.is_depth_map"] == true;
            if NUMBERS.contains(&feature.dtype.as_str()) && (key != "subtask_index" || has_steps) {
                numbers.push(key.clone());
            } else if feature.is_image() && is_depth {
                depths.push(key.clone());
            } else if feature.is_image() && feature.rgb_size().is_some() {
                self.notes.insert(format!("images of {key} in tables were encoded as H.264"));
                colors.push(key.clone());
            } else if !feature.is_video() {
                let kind = if feature.dtype.is_empty() { "unstated type" } else { &feature.dtype };
                self.notes.insert(format!("column {key} of {kind} is left out"));
            }
        }
        for unlisted in
            known.iter().filter(|name| !self.metadata.info.features.iter().any(|feature| feature.key == **name))
        {
            self.notes.insert(format!("column {unlisted} is left out, since info.json does not list it"));
        }
        Ok(Wanted { numbers, depths, colors })
    }

    fn episode(
        &mut self,
        listed: &EpisodeEntry,
        rows: &Rows,
        images: Vec<ImageFeature>,
        encoded: Vec<VideoFeature>,
    ) -> Result<EpisodeRows<ImportedMetadata>, DataError> {
        let place = || format!("{} of {}", listed.place(), self.metadata.root.join(&listed.data).display());
        let frames = usize::try_from(listed.length).unwrap_or(0);
        let column = |name: &str| {
            let found = rows.get(name).filter(|column| column.width == 1);
            found.ok_or_else(|| DataError::mismatch(place(), format!("a numeric column `{name}`"), "none"))
        };
        let steady = |(row, time): (usize, &f64)| (time - row as f64 / f64::from(self.fps)).abs() <= TIME_TOLERANCE_S;
        let times = column("timestamp")?;
        if let Some(row) = (0..frames).find(|row| !steady((*row, &times.values[*row]))) {
            let what = format!("timestamp of row {row}, {}", place());
            return Err(DataError::mismatch(what, row as f64 / f64::from(self.fps), times.values[row]));
        }
        if let Some(other) = column("episode_index")?.values.iter().find(|index| **index != listed.index as f64) {
            return Err(DataError::mismatch(format!("episode_index of {}", place()), listed.index, other));
        }
        if listed.sentences > 1 {
            self.notes.insert("of several sentences of an episode only the first is kept".into());
        }
        let mut features = Vec::new();
        for feature in &self.metadata.info.features {
            let Some(column) = rows.get(&feature.key) else { continue };
            if INDEX_COLUMNS.contains(&feature.key.as_str()) || feature.key == "subtask_index" {
                continue;
            }
            if column.dtype == "int64" && column.values.iter().any(|value| value.abs() >= MAX_EXACT) {
                let what = format!("column {} of {}", feature.key, place());
                return Err(DataError::mismatch(what, "integers below 2^53", "larger ones"));
            }
            if column.width == 0 || (column.dtype == "bool" && column.width > 1) {
                let what = format!("column {} of {}", feature.key, place());
                return Err(DataError::mismatch(what, "numbers in every row, a single one if bool", column.width));
            }
            if let Some(entry) = column.values.iter().position(|value| !value.is_finite()) {
                let (row, element) = (entry / column.width, entry % column.width);
                let what = format!("{}[{element}] of row {row}, {}", feature.key, place());
                return Err(DataError::mismatch(what, "a finite number", column.values[entry]));
            }
            features.push(Feature {
                key: feature.key.clone(),
                names: names(feature, column.width),
                values: values(column),
            });
        }
        let steps = match rows.get("subtask_index") {
            Some(column) => self.steps(listed, column)?,
            None => Vec::new(),
        };
        let texts = if steps.is_empty() { Vec::new() } else { self.texts(listed) };
        let videos = listed.videos.iter().map(|span| {
            let feature = self.metadata.info.features.iter().find(|feature| feature.key == span.key);
            let Some([height, width]) = feature.and_then(check::Feature::rgb_size) else {
                return Err(DataError::mismatch(
                    format!("shape of {} in {}", span.key, self.metadata.root.join(INFO).display()),
                    "[height, width, 3] or [3, height, width]",
                    format!("{:?}", feature.map(|feature| &feature.shape)),
                ));
            };
            let first = (span.from_s * f64::from(self.fps)).round();
            if !(0.0..1e9).contains(&first) {
                let listed_in = self.metadata.root.join(&listed.listed_in.0);
                let what = format!("from_timestamp of {} in {}", listed.place(), listed_in.display());
                return Err(DataError::mismatch(what, "a time from 0 s on", span.from_s));
            }
            let path = self.metadata.root.join(&span.file);
            self.videos.take(&FrameRequest {
                key: &span.key,
                path,
                size: [height, width],
                fps: self.fps,
                from: first as usize,
                count: frames,
            })
        });
        let videos = videos.chain(encoded.into_iter().map(Ok)).collect::<Result<Vec<_>, _>>()?;
        let succeeded = rows.get("next.success").and_then(|column| column.values.last().copied());
        let index = usize::try_from(listed.index).unwrap_or(0);
        let instruction = self.sentence(listed, rows)?;
        let metadata = ImportedMetadata {
            store_id: metadata::name(listed.store_id.as_deref(), index),
            instruction,
            steps: texts,
            success: listed.success.or_else(|| succeeded.map(|value| value > 0.0)),
            failure: listed.failure.clone().unwrap_or_default(),
            seed: listed.seed,
            scenario_id: listed.scenario_id.clone().unwrap_or_default(),
            ..ImportedMetadata::default()
        };
        let mut rows = EpisodeRows { frames, features, images, videos, steps, metadata };
        rows.metadata.source_sha256 = metadata::hash(&rows);
        Ok(rows)
    }

    /// Instruction of an episode: the task that its rows refer to by `task_index`, which policies are trained on;
    /// without such a column, the one in the table of episodes.
    fn sentence(&mut self, listed: &EpisodeEntry, rows: &Rows) -> Result<String, DataError> {
        let column = rows.get("task_index").filter(|column| column.width == 1 && !self.metadata.tasks.is_empty());
        let Some(&first) = column.and_then(|column| column.values.first()) else { return Ok(listed.sentence.clone()) };
        let Some((_, sentence)) = self.metadata.tasks.iter().find(|(known, _)| *known as f64 == first) else {
            let file = self.metadata.root.join(&listed.data);
            let what = format!("task_index of {} in {}", listed.place(), file.display());
            return Err(DataError::mismatch(what, format!("an index of {}", self.metadata.tasks_file), first));
        };
        if column.is_some_and(|column| column.values.iter().any(|index| *index != first)) {
            self.notes
                .insert("where task_index changes within an episode, the sentence of its first row is kept".into());
        }
        if *sentence != listed.sentence {
            self.notes.insert("sentences are those of task_index; the table of episodes says others".into());
        }
        Ok(sentence.clone())
    }

    /// Index of each row's step (subtask) in [`Lerobot::texts`].
    fn steps(&self, listed: &EpisodeEntry, column: &Column) -> Result<Vec<usize>, DataError> {
        let texts = self.texts(listed);
        let place = |index: &f64| {
            let text = self.metadata.subtasks.iter().find(|(known, _)| *known as f64 == *index).map(|(_, text)| text);
            text.and_then(|text| texts.iter().position(|known| known == text)).ok_or_else(|| {
                let what = format!(
                    "subtask_index of {} in {}",
                    listed.place(),
                    self.metadata.root.join(&listed.data).display()
                );
                let expected = format!("a step of the episode in {}", self.metadata.subtasks_file);
                DataError::mismatch(what, expected, index)
            })
        };
        column.values.iter().map(place).collect()
    }

    /// Instructions of the steps (subtasks): those of the episode if listed, else all of the data set.
    fn texts(&self, listed: &EpisodeEntry) -> Vec<String> {
        match &listed.subtasks {
            Some(texts) if !texts.is_empty() => texts.clone(),
            _ => self.metadata.subtasks.iter().map(|(_, text)| text.clone()).collect(),
        }
    }

    /// Reads the data file `file`, which contains the rows of `episodes` in this order, and passes each episode to
    /// `take`.
    fn file(&mut self, file: &str, episodes: &[EpisodeEntry], take: OnEpisode) -> Result<(), DataError> {
        let path = self.metadata.root.join(file);
        let table = Table::open(&path)?;
        let Wanted { numbers, depths, colors } = self.wanted(&path, &table.names())?;
        let wanted: Vec<&str> = numbers.iter().chain(&depths).chain(&colors).map(String::as_str).collect();
        let mut left = episodes.iter().peekable();
        let (mut rows, mut depth_png, mut held) = (Rows::new(), BTreeMap::<String, Vec<Vec<u8>>>::new(), 0);
        let mut encoded = BTreeMap::<String, Encoded>::new();
        for batch in table.batches(&wanted, ROWS_PER_BATCH)? {
            let batch = batch?;
            let mut at = 0;
            while at < batch.num_rows() {
                let Some(listed) = left.peek() else {
                    return Err(DataError::table(&path, "rows after the last episode"));
                };
                let length = usize::try_from(listed.length).unwrap_or(0).max(1);
                let part = batch.slice(at, (length - held).min(batch.num_rows() - at));
                append(&path, &part, &numbers, &mut rows)?;
                for key in &depths {
                    depth_png.entry(key.clone()).or_default().extend(bytes(&path, &part, key)?);
                }
                for key in &colors {
                    for file in bytes(&path, &part, key)? {
                        encode(&file, self.fps, encoded.entry(key.clone()).or_default())
                            .map_err(|error| error.with_path(&path))?;
                    }
                }
                at += part.num_rows();
                held += part.num_rows();
                if held == length {
                    let images = images(std::mem::take(&mut depth_png)).map_err(|error| error.with_path(&path))?;
                    let videos = std::mem::take(&mut encoded).into_iter().filter_map(finished).collect();
                    let episode = self.episode(listed, &std::mem::take(&mut rows), images, videos)?;
                    take(&path, episode)?;
                    held = 0;
                    left.next();
                }
            }
        }
        match left.next() {
            Some(listed) => {
                let what = format!("rows of {} in {}", listed.place(), path.display());
                Err(DataError::mismatch(what, listed.length, held))
            }
            None => Ok(()),
        }
    }
}

/// Leaves out the videos of cameras that some episodes lack, since all episodes of a data set must have the same
/// columns.
fn leave_out_partial_cameras(metadata: &mut Metadata, listed: &BTreeSet<String>, notes: &mut BTreeSet<String>) {
    let mut lacking: BTreeMap<String, Vec<i64>> = BTreeMap::new();
    // In v3.0 several episodes share a video file that the table of episodes names; a missing one is an error.
    let has_own_files = metadata.info.version != Version::V30;
    for episode in &metadata.episodes {
        let is_missing = |span: &&VideoSpan| !span.from_s.is_finite() || has_own_files && !listed.contains(&span.file);
        for span in episode.videos.iter().filter(is_missing) {
            lacking.entry(span.key.clone()).or_default().push(episode.index);
        }
    }
    let all = metadata.episodes.len();
    // A camera without any video is not left out here; the check of the files reports it as an error.
    lacking.retain(|_, episodes| episodes.len() < all);
    for (key, episodes) in &lacking {
        let first = episodes.first().copied().unwrap_or_default();
        notes.insert(format!(
            "camera {key} is left out: {} of {all} episodes have no video of it, first {first}",
            episodes.len()
        ));
    }
    for episode in &mut metadata.episodes {
        episode.videos.retain(|span| !lacking.contains_key(&span.key));
    }
}

/// Columns of a table, grouped by what they are imported as.
#[derive(Default)]
struct Wanted {
    numbers: Vec<String>,
    depths: Vec<String>,
    /// Names of the RGB image columns, which become videos.
    colors: Vec<String>,
}

/// Video of one episode and camera under construction.
#[derive(Default)]
struct Encoded {
    encoder: Option<VideoEncoder>,
    colors: ColorHistogram,
}

/// Appends an image file as a frame to a video.
fn encode(file: &[u8], fps: u32, into: &mut Encoded) -> Result<(), DataError> {
    let (width, height, rgb) = image_file::decode(file)?;
    let encoder = match &mut into.encoder {
        Some(encoder) => encoder,
        none => none.insert(VideoEncoder::new(width, height, fps, &VideoSettings::default())?),
    };
    into.colors.add_image(&rgb, width as usize);
    encoder.push(&rgb)
}

fn finished((key, encoded): (String, Encoded)) -> Option<VideoFeature> {
    Some(VideoFeature { key, video: encoded.encoder?.finish(), colors: encoded.colors })
}

impl Importer for Lerobot {
    fn info(&self) -> SourceInfo {
        SourceInfo {
            format: self.metadata.info.version.name(),
            robot: self.metadata.info.robot.clone(),
            fps: self.fps,
            episodes: self.metadata.episodes.len(),
            record: self.record.clone(),
            contract: self.metadata.contract.clone(),
        }
    }

    fn each(&mut self, take: OnEpisode) -> Result<(), DataError> {
        let episodes = self.metadata.episodes.clone();
        let mut first = 0;
        while first < episodes.len() {
            let file = &episodes[first].data;
            let count = episodes[first..].iter().take_while(|episode| episode.data == *file).count();
            self.file(file, &episodes[first..first + count], take)?;
            first += count;
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        let encoded = "pictures were decoded by another program and encoded anew as H.264";
        self.notes.iter().cloned().chain(self.videos.are_encoded.then(|| encoded.to_owned())).collect()
    }
}

/// Names of the elements of a column; generated from its key where `info.json` does not name all.
fn names(feature: &check::Feature, width: usize) -> Vec<String> {
    match width {
        1 => feature.names.iter().take(1).filter(|name| **name != feature.key).cloned().collect(),
        _ if feature.names.len() == width => feature.names.clone(),
        _ => (0..width).map(|entry| format!("{}_{entry}", feature.key)).collect(),
    }
}

fn values(column: &Column) -> Values {
    match column.dtype {
        "float16" | "float32" => Values::F32(column.values.iter().map(|value| *value as f32).collect()),
        "bool" => Values::Bool(column.values.iter().map(|value| *value > 0.0).collect()),
        "float64" => Values::F64(column.values.clone()),
        _ => Values::I64(column.values.iter().map(|value| *value as i64).collect()),
    }
}

fn append(path: &Path, batch: &RecordBatch, keys: &[String], rows: &mut Rows) -> Result<(), DataError> {
    for key in keys {
        let column = batch.column_by_name(key).and_then(|column| Column::of(column));
        let column =
            column.ok_or_else(|| DataError::table(path, format!("column `{key}` is not numeric in every row")))?;
        let known = rows.entry(key.clone()).or_insert_with(|| Column { values: Vec::new(), ..column.clone() });
        if known.width != column.width {
            let what =
                format!("column `{key}` has {} numbers in some rows and {} in others", known.width, column.width);
            return Err(DataError::table(path, what));
        }
        known.values.extend(column.values);
    }
    Ok(())
}

/// Encoded image files in a column, one per row.
fn bytes(path: &Path, batch: &RecordBatch, key: &str) -> Result<Vec<Vec<u8>>, DataError> {
    let files = batch.column_by_name(key).and_then(|column| image_files(column));
    let all = files.and_then(|files| files.into_iter().map(|file| file.map(<[u8]>::to_vec)).collect());
    all.ok_or_else(|| DataError::table(path, format!("column `{key}` does not hold an image file in every row")))
}

fn images(files: BTreeMap<String, Vec<Vec<u8>>>) -> Result<Vec<ImageFeature>, DataError> {
    let image = |(key, png): (String, Vec<Vec<u8>>)| {
        let (width, height, _) = depth::decode_depth_png(png.first().map(Vec::as_slice).unwrap_or_default())?;
        Ok(ImageFeature { key, width, height, png })
    };
    files.into_iter().map(image).collect()
}

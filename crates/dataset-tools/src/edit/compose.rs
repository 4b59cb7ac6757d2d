//! Writer of a data set composed of episodes of other data sets.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use arrow_array::types::Float64Type;
use arrow_array::{ArrayRef, RecordBatch};
use genmanip_core::{Document, Scenario};
use serde_json::Value;

use super::episode_ref::EpisodeRef;
use super::source::{EpisodeEntry, OpenFiles, Source};
use genmanip_data::atomic_write::AtomicFolder;
use genmanip_data::columns::{Column, cell, text, texts};
use genmanip_data::lerobot::info::{self, FILES_PER_CHUNK, Totals};
use genmanip_data::lerobot::metadata_files::MetadataFiles;
use genmanip_data::lerobot::origin::Origin;
use genmanip_data::lerobot::stats::{Aggregated, Stats, StatsCollector};
use genmanip_data::lerobot::writer::Finished;
use genmanip_data::lerobot::{SUBTASKS, record};
use genmanip_data::table::{Columns, Purpose, TableWriter};
use genmanip_data::{DataError, EncodedVideo, video};

/// Index columns that are rewritten when an episode is copied, in rows and in statistics.
const INDEX_COLUMNS: [&str; 3] = ["episode_index", "index", "task_index"];

pub(super) struct Composer<'a> {
    staging: AtomicFolder,
    sources: &'a [Source],
    opened: (usize, OpenFiles),
    episodes_per_file: usize,
    tasks: BTreeMap<String, usize>,
    sentences: Vec<String>,
    subtasks: Vec<String>,
    stats_collector: StatsCollector,
    colors: BTreeMap<String, Aggregated>,
    episodes: usize,
    frames: usize,
    file: OpenFile,
}

/// Contents of the data and video files that are being filled.
#[derive(Default)]
struct OpenFile {
    rows: Option<TableWriter>,
    episodes: Option<TableWriter>,
    videos: Vec<(String, Vec<EncodedVideo>)>,
    frames: usize,
}

impl<'a> Composer<'a> {
    pub(super) fn new(
        staging: AtomicFolder,
        sources: &'a [Source],
        episodes_per_file: usize,
    ) -> Result<Self, DataError> {
        let stats_collector = StatsCollector::new(staging.folder());
        Ok(Self {
            staging,
            sources,
            opened: (usize::MAX, OpenFiles::default()),
            episodes_per_file: episodes_per_file.max(1),
            tasks: BTreeMap::new(),
            sentences: Vec::new(),
            subtasks: Vec::new(),
            stats_collector,
            colors: BTreeMap::new(),
            episodes: 0,
            frames: 0,
            file: OpenFile::default(),
        })
    }

    /// Appends an episode of a source, optionally under another id.
    pub(super) fn push(&mut self, pick: EpisodeRef, name: Option<&str>) -> Result<(), DataError> {
        if self.episodes > 0 && self.episodes.is_multiple_of(self.episodes_per_file) {
            self.close_file()?;
        }
        let source = &self.sources[pick.source];
        let episode = &source.episodes[pick.episode];
        if self.opened.0 != pick.source {
            self.opened = (pick.source, OpenFiles::default());
        }
        let (data, table) = (source.data(episode), source.table(episode));
        let (of_rows, of_entry) =
            (|error: DataError| error.with_path(&data), |error: DataError| error.with_path(table));
        let task = self.task_index(&episode.sentence);
        let rows = self.opened.1.rows(source, episode)?;
        let listed = self.opened.1.row(source, episode)?;
        let mut places = self.index_columns(episode.length, task);
        let steps = self.steps(source, &rows, &listed).map_err(of_rows)?;
        if let Some(steps) = &steps {
            places.i64("subtask_index", steps.iter().copied());
        }
        let rows = replaced(&rows, places).map_err(of_rows)?;
        self.collect(source, &rows).map_err(of_rows)?;
        let table = match &mut self.file.rows {
            Some(table) => table,
            none => none.insert(TableWriter::new(Path::new("data"), rows.schema(), Purpose::Dataset)?),
        };
        table.write(&rows).map_err(of_rows)?;
        self.aggregate(source, episode, &listed).map_err(of_entry)?;
        let mut entry = self.entry(source, episode, task, &listed, name).map_err(of_entry)?;
        if let Some(steps) = steps {
            let steps: Vec<f64> = steps.into_iter().map(|step| step as f64).collect();
            statistics_of(&mut entry, "subtask_index", &steps);
        }
        let listed = replaced(&listed, entry).map_err(of_entry)?;
        let table = match &mut self.file.episodes {
            Some(table) => table,
            none => none.insert(TableWriter::new(Path::new("meta/episodes"), listed.schema(), Purpose::Dataset)?),
        };
        table.add(&listed).map_err(of_entry)?;
        for (key, video) in self.opened.1.videos(source, episode)? {
            match self.file.videos.iter_mut().find(|(known, _)| *known == key) {
                Some((_, videos)) => videos.push(video),
                None => self.file.videos.push((key, vec![video])),
            }
        }
        if let Some(store) = &source.record {
            record::transfer(&self.staging, store, &episode.store_id, name)?;
        }
        self.file.frames += episode.length;
        self.episodes += 1;
        self.frames += episode.length;
        Ok(())
    }

    fn task_index(&mut self, sentence: &str) -> usize {
        if let Some(index) = self.tasks.get(sentence) {
            return *index;
        }
        let index = self.sentences.len();
        self.tasks.insert(sentence.into(), index);
        self.sentences.push(sentence.into());
        index
    }

    /// Step index of each row in the new data set; `None` if the source has no steps.
    fn steps(
        &mut self,
        source: &Source,
        rows: &RecordBatch,
        listed: &RecordBatch,
    ) -> Result<Option<Vec<i64>>, DataError> {
        let Some(column) = rows.column_by_name("subtask_index") else { return Ok(None) };
        // In the order in which the episode's entry lists them, as in an export.
        let known = texts(listed, "subtasks", 0).unwrap_or_default();
        for text in known {
            self.subtask_index(&text);
        }
        let indices = Column::of(column).map(|column| column.values).unwrap_or_default();
        let moved = |index: f64| {
            let text = if index >= 0.0 { source.subtasks.get(index as usize) } else { None };
            let found = || DataError::mismatch("subtask_index", format!("one of {SUBTASKS}"), index);
            text.ok_or_else(found).map(|text| number(self.subtask_index(text)))
        };
        indices.into_iter().map(moved).collect::<Result<Vec<_>, _>>().map(Some)
    }

    fn subtask_index(&mut self, text: &str) -> usize {
        self.subtasks.iter().position(|known| known == text).unwrap_or_else(|| {
            self.subtasks.push(text.into());
            self.subtasks.len() - 1
        })
    }

    /// New index columns of an episode's rows.
    fn index_columns(&self, rows: usize, task: usize) -> Columns {
        let mut columns = Columns::default();
        columns.i64("episode_index", std::iter::repeat_n(number(self.episodes), rows));
        columns.i64("index", (self.frames..self.frames + rows).map(number));
        columns.i64("task_index", std::iter::repeat_n(number(task), rows));
        columns
    }

    /// Adds the rows to the statistics of the data set.
    fn collect(&mut self, source: &Source, rows: &RecordBatch) -> Result<(), DataError> {
        for key in source.features(false) {
            let column = rows.column_by_name(key).and_then(|column| Column::of(column));
            let column = column.ok_or_else(|| {
                DataError::mismatch(format!("column {key}"), "numbers in every row", "something else")
            })?;
            self.stats_collector.add(key, column.width, &column.values)?;
        }
        Ok(())
    }

    fn aggregate(&mut self, source: &Source, episode: &EpisodeEntry, listed: &RecordBatch) -> Result<(), DataError> {
        for key in source.features(true) {
            let numbers = |name: &str| {
                let found = cell(listed, &format!("stats/{key}/{name}"), 0);
                let what = || format!("statistics of {key} of {}", episode.store_id);
                found
                    .filter(|found| found.len() == 3)
                    .ok_or_else(|| DataError::mismatch(what(), "three numbers", "none"))
            };
            let stats = Stats { named: Stats::named(numbers)?, count: episode.length };
            self.colors.entry(key.clone()).or_default().add(stats);
        }
        Ok(())
    }

    /// New values of the episodes table's columns that change: indices, files and statistics.
    fn entry(
        &self,
        source: &Source,
        episode: &EpisodeEntry,
        task: usize,
        listed: &RecordBatch,
        name: Option<&str>,
    ) -> Result<Columns, DataError> {
        let place = self.episodes / self.episodes_per_file;
        let (chunk, file) = (place / FILES_PER_CHUNK, place % FILES_PER_CHUNK);
        let mut columns = Columns::default();
        let mut set = |name: &str, value: usize| columns.i64(name, [number(value)]);
        set("episode_index", self.episodes);
        set("dataset_from_index", self.frames);
        set("dataset_to_index", self.frames + episode.length);
        for prefix in ["data", "meta/episodes"] {
            set(&format!("{prefix}/chunk_index"), chunk);
            set(&format!("{prefix}/file_index"), file);
        }
        let fps = f64::from(source.origin.fps());
        for key in source.features(true) {
            set(&format!("videos/{key}/chunk_index"), chunk);
            set(&format!("videos/{key}/file_index"), file);
        }
        for key in source.features(true) {
            let frames = [self.file.frames, self.file.frames + episode.length];
            for (which, frame) in ["from", "to"].iter().zip(frames) {
                columns.f64(&format!("videos/{key}/{which}_timestamp"), [frame as f64 / fps]);
            }
        }
        let [repeated, counted, tasks] = [
            vec![self.episodes as f64; episode.length],
            (self.frames..self.frames + episode.length).map(|row| row as f64).collect(),
            vec![task as f64; episode.length],
        ];
        for (key, values) in INDEX_COLUMNS.iter().zip([repeated, counted, tasks]) {
            statistics_of(&mut columns, key, &values);
        }
        if let Some(name) = name {
            let scenario = text(listed, "scenario_json", 0).map(|(text, _)| renamed(&text, name)).transpose()?;
            columns.text("store_id", [name]);
            if listed.column_by_name("scenario_id").is_some() {
                columns.text("scenario_id", [name]);
            }
            scenario.into_iter().for_each(|scenario| columns.text("scenario_json", [scenario]));
        }
        Ok(columns)
    }

    fn close_file(&mut self) -> Result<(), DataError> {
        let OpenFile { rows, episodes, videos, .. } = std::mem::take(&mut self.file);
        let place = self.episodes.saturating_sub(1) / self.episodes_per_file;
        let (chunk, file) = (place / FILES_PER_CHUNK, place % FILES_PER_CHUNK);
        let name = |ending: &str| format!("chunk-{chunk:03}/file-{file:03}.{ending}");
        if let Some(table) = rows {
            self.staging.write(&format!("data/{}", name("parquet")), &table.finish()?)?;
        }
        if let Some(table) = episodes {
            self.staging.write(&format!("meta/episodes/{}", name("parquet")), &table.finish()?)?;
        }
        for (key, videos) in videos {
            let name = format!("videos/{key}/{}", name("mp4"));
            let video = video::mux_mp4(&videos).map_err(|error| error.with_path(Path::new(&name)))?;
            self.staging.write(&name, &video)?;
        }
        Ok(())
    }

    /// Writes the metadata; also returns the number of rows.
    pub(super) fn finish(mut self, card: &str, origin: &Origin) -> Result<(Finished, usize), DataError> {
        self.close_file()?;
        let first = &self.sources[0];
        let totals = Totals { episodes: self.episodes, frames: self.frames, tasks: self.sentences.len() };
        let robot = first.info["robot_type"].as_str().unwrap_or_default();
        let (features, has_video) = (first.info["features"].clone(), first.features(true).next().is_some());
        let info = info::info(robot, &totals, origin.fps(), features, has_video);
        let mut stats: serde_json::Map<String, Value> =
            self.colors.into_iter().map(|(key, colors)| (key, colors.whole().to_json(true))).collect();
        if let Value::Object(numbers) = self.stats_collector.finish()? {
            stats.extend(numbers);
        }
        let files = MetadataFiles {
            info: &info,
            stats: &Value::Object(stats),
            statistics_note: Some(
                "numbers exact over all frames; colours from those of the episodes as LeRobot does it, quantiles being \
                 means of theirs; none for depth",
            ),
            origin,
            contract: first.contract.as_ref(),
            card,
        };
        files.write_v30(&self.staging, &self.sentences, &self.subtasks)?;
        Ok((Finished(self.staging), self.frames))
    }
}

/// Adds the statistics of a scalar column to the episodes table.
fn statistics_of(columns: &mut Columns, key: &str, values: &[f64]) {
    for (which, values) in Stats::of_vectors(values, 1).named {
        columns.lists::<Float64Type>(&format!("stats/{key}/{which}"), &[&values]);
    }
}

fn number(value: usize) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// JSON of a scenario with its id replaced by `name`.
fn renamed(scenario: &str, name: &str) -> Result<String, DataError> {
    let scenario = Scenario::from_json(scenario)
        .map_err(|error| DataError::mismatch("column scenario_json", "a scenario", error))?;
    Ok(Scenario { id: name.into(), ..scenario }.to_value().to_string())
}

/// Batch in which some columns are replaced by new ones of the same name and type.
fn replaced(batch: &RecordBatch, columns: Columns) -> Result<RecordBatch, DataError> {
    let fail = |error: &dyn std::fmt::Display| DataError::mismatch("columns", "those of an export", error);
    let new = columns.batch().map_err(|error| fail(&error))?;
    let schema = batch.schema();
    let mut arrays: Vec<ArrayRef> = batch.columns().to_vec();
    for (field, column) in new.schema().fields().iter().zip(new.columns()) {
        let place = schema.index_of(field.name()).map_err(|error| fail(&error))?;
        if schema.field(place).data_type() != column.data_type() {
            return Err(fail(&format!("`{}` of {}", field.name(), schema.field(place).data_type())));
        }
        arrays[place] = Arc::clone(column);
    }
    RecordBatch::try_new(schema, arrays).map_err(|error| fail(&error))
}

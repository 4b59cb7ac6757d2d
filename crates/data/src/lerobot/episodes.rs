//! The tables `meta/episodes` and `meta/tasks.parquet`.

use std::path::Path;

use arrow_array::types::{Float64Type, Int64Type};
use genmanip_core::{Correction, EpisodeResult};
use serde_json::json;

use super::stats::Stats;
use crate::export::metadata::{EpisodeMetadata, LanguageLabels};
use crate::table::{self, Columns, Purpose};
use crate::{DataError, Provenance};

/// Columns of the episodes table that LeRobot does not define.
pub trait EpisodeColumns: LanguageLabels + Clone {
    /// Adds the columns of all episodes listed in a file.
    fn add(columns: &mut Columns, all: &[&Self]);
}

/// One row of the episodes table.
pub struct EpisodeEntry<F = EpisodeMetadata> {
    /// Index of the episode in the data set.
    pub episode: usize,
    /// Index of the chunk folder, shared by data, videos and this row.
    pub chunk: usize,
    /// Index of the file within the chunk.
    pub file: usize,
    /// Index within the data set of the episode's first row.
    pub from: usize,
    /// Number of rows of the episode.
    pub length: usize,
    /// Span of the episode in the file of each video column.
    pub videos: Vec<VideoSpan>,
    /// Statistics of each numeric column.
    pub stats: Vec<(String, Stats)>,
    /// Format-independent metadata of the episode.
    pub metadata: F,
}

/// Time span of an episode in a video file, and its colour statistics.
pub struct VideoSpan {
    /// Name of the video column.
    pub key: String,
    /// Start in the file, seconds.
    pub from_s: f64,
    /// End in the file, seconds.
    pub to_s: f64,
    /// Colour statistics of the episode's frames.
    pub stats: Stats,
}

/// Encodes `meta/episodes/chunk-…/file-….parquet`: first the columns that LeRobot defines, then those of this program.
pub fn episodes_table<F: EpisodeColumns>(entries: &[EpisodeEntry<F>]) -> Result<Vec<u8>, DataError> {
    let mut columns = Columns::default();
    let integer = |value: fn(&EpisodeEntry<F>) -> usize| {
        entries.iter().map(move |entry| i64::try_from(value(entry)).unwrap_or(i64::MAX))
    };
    columns.i64("episode_index", integer(|entry| entry.episode));
    columns.text_lists("tasks", &entries.iter().map(|entry| [entry.metadata.instruction()]).collect::<Vec<_>>());
    columns.i64("length", integer(|entry| entry.length));
    columns.i64("data/chunk_index", integer(|entry| entry.chunk));
    columns.i64("data/file_index", integer(|entry| entry.file));
    columns.i64("dataset_from_index", integer(|entry| entry.from));
    columns.i64("dataset_to_index", integer(|entry| entry.from + entry.length));
    for (place, span) in entries.first().iter().flat_map(|entry| &entry.videos).enumerate() {
        let key = &span.key;
        let seconds = |value: fn(&VideoSpan) -> f64| entries.iter().map(move |entry| value(&entry.videos[place]));
        columns.i64(&format!("videos/{key}/chunk_index"), integer(|entry| entry.chunk));
        columns.i64(&format!("videos/{key}/file_index"), integer(|entry| entry.file));
        columns.f64(&format!("videos/{key}/from_timestamp"), seconds(|span| span.from_s));
        columns.f64(&format!("videos/{key}/to_timestamp"), seconds(|span| span.to_s));
    }
    statistics(&mut columns, entries);
    columns.i64("meta/episodes/chunk_index", integer(|entry| entry.chunk));
    columns.i64("meta/episodes/file_index", integer(|entry| entry.file));
    F::add(&mut columns, &entries.iter().map(|entry| &entry.metadata).collect::<Vec<_>>());
    table::to_parquet(Path::new("meta/episodes"), columns, Purpose::Dataset, None)
}

/// Encodes `meta/tasks.parquet`: a pandas data frame indexed by the instruction.
///
/// Without the `pandas` metadata entry, readers would use the row number as the index.
pub fn tasks_table(tasks: &[String]) -> Result<Vec<u8>, DataError> {
    sentences_table("task", tasks)
}

/// Encodes `meta/subtasks.parquet`, with the layout of `meta/tasks.parquet`.
pub fn subtasks_table(subtasks: &[String]) -> Result<Vec<u8>, DataError> {
    sentences_table("subtask", subtasks)
}

fn sentences_table(name: &str, sentences: &[String]) -> Result<Vec<u8>, DataError> {
    let index = format!("{name}_index");
    let mut columns = Columns::default();
    columns.i64(&index, (0_i64..).take(sentences.len()));
    columns.text(name, sentences);
    let text = |name| json!({"name": name, "field_name": name, "pandas_type": "unicode", "numpy_type": "object", "metadata": null});
    let pandas = json!({
        "index_columns": [name],
        "column_indexes": [{
            "name": null, "field_name": null, "pandas_type": "unicode", "numpy_type": "object",
            "metadata": {"encoding": "UTF-8"},
        }],
        "columns": [
            {"name": index, "field_name": index, "pandas_type": "int64", "numpy_type": "int64", "metadata": null},
            text(name),
        ],
        "creator": {"library": "genmanip", "version": env!("CARGO_PKG_VERSION")},
        "pandas_version": "2.2.0",
    });
    let path = format!("meta/{name}s.parquet");
    table::to_parquet(Path::new(&path), columns, Purpose::Dataset, Some(("pandas", pandas.to_string())))
}

/// Columns of seed, scenario, outcome and versions, for filtering and replay.
impl EpisodeColumns for EpisodeMetadata {
    fn add(columns: &mut Columns, all: &[&Self]) {
        let all_metadata = || all.iter().copied();
        let results = || all_metadata().map(|metadata| &metadata.result);
        columns.text("store_id", results().map(|result| &result.id));
        columns.bool("success", results().map(|result| result.success));
        columns.bool("success_once", results().map(|result| result.success_once));
        columns.f64("score", results().map(|result| result.verdict.score));
        let failure = |result: &EpisodeResult| result.failure().map_or(String::new(), |failure| failure.to_string());
        columns.text("failure", results().map(failure));
        let cause = |result: &EpisodeResult| result.failure().map_or("", |failure| failure.cause.name());
        columns.text("failure_cause", results().map(cause));
        let lists = |list: fn(&EpisodeMetadata) -> &[String]| all_metadata().map(list).collect::<Vec<_>>();
        columns.text_lists("subtasks", &lists(|metadata| &metadata.steps.texts));
        columns.text_lists("paraphrases", &lists(|metadata| &metadata.paraphrases));
        columns.text_lists("objects", &all_metadata().map(|metadata| &metadata.objects[..]).collect::<Vec<_>>());
        columns.i64("seed", results().map(|result| i64::try_from(result.seed.value()).unwrap_or(i64::MAX)));
        if all_metadata().any(|metadata| metadata.variation_seed.is_some()) {
            let seed = |metadata: &EpisodeMetadata| {
                metadata.variation_seed.map_or(-1, |seed| i64::try_from(seed.value()).unwrap_or(-1))
            };
            columns.i64("variation_seed", all_metadata().map(seed));
        }
        if all_metadata().any(|metadata| metadata.has_correction_columns) {
            let of = |result: &EpisodeResult, tell: fn(&Correction) -> String| {
                result.correction.as_ref().map_or(String::new(), tell)
            };
            columns.text("corrected_policy", results().map(|result| of(result, |it| it.policy.clone())));
            let cause = |it: &Correction| it.failures.first().map_or("", |failure| failure.cause.name()).to_owned();
            columns.text("corrected_cause", results().map(|result| of(result, cause)));
            let from = |it: &Correction| i64::try_from(it.from_step).unwrap_or(i64::MAX);
            columns.i64("corrected_from_step", results().map(|result| result.correction.as_ref().map_or(-1, from)));
        }
        columns.text("scenario_id", results().map(|result| &result.scenario_id));
        columns.text("task_id", results().map(|result| &result.task_id));
        columns.text("task_kind", all_metadata().map(|metadata| metadata.kind));
        columns.text("policy", results().map(|result| &result.policy));
        columns.text("source", results().map(|result| Provenance::of(result).name()));
        columns.bool("oracle", results().map(|result| result.oracle));
        columns.text("engine", results().map(|result| &result.engine));
        columns.text("genmanip_version", results().map(|result| &result.genmanip_version));
        columns.text("scenario_json", all_metadata().map(|metadata| &metadata.scenario_json));
        for (place, (camera, _)) in all.first().iter().flat_map(|metadata| &metadata.cameras).enumerate() {
            let k = all_metadata().flat_map(|metadata| metadata.cameras[place].1).collect();
            columns.vectors::<Float64Type>(&format!("camera.{camera}.fx_fy_cx_cy"), 4, k);
        }
    }
}

fn statistics<F>(columns: &mut Columns, entries: &[EpisodeEntry<F>]) {
    let Some(first) = entries.first() else { return };
    for (place, span) in first.videos.iter().enumerate() {
        for (which, (name, _)) in span.stats.named.iter().enumerate() {
            let rows: Vec<&[f64]> =
                entries.iter().map(|entry| entry.videos[place].stats.named[which].1.as_slice()).collect();
            columns.channel_lists(&format!("stats/{}/{name}", span.key), &rows);
        }
        counts(columns, &span.key, entries);
    }
    for (place, (key, stats)) in first.stats.iter().enumerate() {
        for (which, (name, _)) in stats.named.iter().enumerate() {
            let rows: Vec<&[f64]> =
                entries.iter().map(|entry| entry.stats[place].1.named[which].1.as_slice()).collect();
            columns.lists::<Float64Type>(&format!("stats/{key}/{name}"), &rows);
        }
        counts(columns, key, entries);
    }
}

fn counts<F>(columns: &mut Columns, key: &str, entries: &[EpisodeEntry<F>]) {
    let counts: Vec<i64> = entries.iter().map(|entry| i64::try_from(entry.length).unwrap_or(i64::MAX)).collect();
    let rows: Vec<&[i64]> = counts.chunks(1).collect();
    columns.lists::<Int64Type>(&format!("stats/{key}/count"), &rows);
}

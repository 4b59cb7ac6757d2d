//! The tables `meta/episodes` and `meta/tasks.parquet`.

use std::path::Path;

use arrow_array::types::{Float64Type, Int64Type};
use genmanip_core::{Correction, EpisodeResult};
use serde_json::json;

use super::stats::Stats;
use crate::DataError;
use crate::export::facts::{EpisodeFacts, Told};
use crate::table::{self, Columns, Purpose};

/// What an episodes table tells of its episodes beside LeRobot's own columns.
pub(crate) trait Entries: Told + Clone {
    /// Adds the columns of all episodes of a file.
    fn add(columns: &mut Columns, all: &[&Self]);
}

/// One row of the episodes table.
pub(crate) struct EpisodeEntry<F = EpisodeFacts> {
    pub(crate) episode: usize,
    /// Chunk and file of data, videos and of this row.
    pub(crate) chunk: usize,
    pub(crate) file: usize,
    /// Index of the first frame in the data set.
    pub(crate) from: usize,
    pub(crate) length: usize,
    pub(crate) videos: Vec<VideoSpan>,
    pub(crate) stats: Vec<(String, Stats)>,
    pub(crate) facts: F,
}

/// Where an episode lies in a video file, and what its colours are.
pub(crate) struct VideoSpan {
    pub(crate) key: String,
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
    pub(crate) stats: Stats,
}

/// The bytes of `meta/episodes/chunk-…/file-….parquet`; LeRobot's own columns first, ours last.
pub(crate) fn episodes_table<F: Entries>(entries: &[EpisodeEntry<F>]) -> Result<Vec<u8>, DataError> {
    let mut columns = Columns::default();
    let integer = |value: fn(&EpisodeEntry<F>) -> usize| {
        entries.iter().map(move |entry| i64::try_from(value(entry)).unwrap_or(i64::MAX))
    };
    columns.i64("episode_index", integer(|entry| entry.episode));
    columns.text_lists(
        "tasks",
        &entries.iter().map(|entry| vec![entry.facts.instruction().to_owned()]).collect::<Vec<_>>(),
    );
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
    F::add(&mut columns, &entries.iter().map(|entry| &entry.facts).collect::<Vec<_>>());
    table::to_parquet(Path::new("meta/episodes"), columns, Purpose::Dataset, None)
}

/// The bytes of `meta/tasks.parquet`: a pandas frame whose index is the sentence.
///
/// Without the `pandas` entry in the metadata, readers would take the row number for the sentence.
pub(crate) fn tasks_table(tasks: &[String]) -> Result<Vec<u8>, DataError> {
    sentences_table("task", tasks)
}

/// The bytes of `meta/subtasks.parquet`, which is made like that of the tasks.
pub(crate) fn subtasks_table(subtasks: &[String]) -> Result<Vec<u8>, DataError> {
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

/// Seed, scenario, outcome and versions of every episode, to filter by and to replay from.
impl Entries for EpisodeFacts {
    fn add(columns: &mut Columns, all: &[&Self]) {
        let facts = || all.iter().copied();
        let results = || facts().map(|facts| &facts.result);
        columns.text("store_id", results().map(|result| &result.id));
        columns.bool("success", results().map(|result| result.success));
        columns.bool("success_once", results().map(|result| result.success_once));
        columns.f64("score", results().map(|result| result.verdict.score));
        let failure = |result: &EpisodeResult| result.failure().map_or(String::new(), |failure| failure.to_string());
        columns.text("failure", results().map(failure));
        let cause = |result: &EpisodeResult| result.failure().map_or("", |failure| failure.cause.name());
        columns.text("failure_cause", results().map(cause));
        let lists =
            |list: fn(&EpisodeFacts) -> &[String]| facts().map(|facts| list(facts).to_vec()).collect::<Vec<_>>();
        columns.text_lists("subtasks", &lists(|facts| &facts.steps.texts));
        columns.text_lists("paraphrases", &lists(|facts| &facts.paraphrases));
        columns.text_lists("objects", &lists(|facts| &facts.objects));
        columns.i64("seed", results().map(|result| i64::try_from(result.seed.value()).unwrap_or(i64::MAX)));
        if facts().any(|facts| facts.variation_seed.is_some()) {
            let seed = |facts: &EpisodeFacts| {
                facts.variation_seed.map_or(-1, |seed| i64::try_from(seed.value()).unwrap_or(-1))
            };
            columns.i64("variation_seed", facts().map(seed));
        }
        if facts().any(|facts| facts.has_correction_columns) {
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
        columns.text("task_kind", facts().map(|facts| facts.kind));
        columns.text("policy", results().map(|result| &result.policy));
        columns.bool("oracle", results().map(|result| result.oracle));
        columns.text("engine", results().map(|result| &result.engine));
        columns.text("genmanip_version", results().map(|result| &result.genmanip_version));
        columns.text("scenario_json", facts().map(|facts| &facts.scenario_json));
        for (place, (camera, _)) in all.first().iter().flat_map(|facts| &facts.cameras).enumerate() {
            let k = facts().flat_map(|facts| facts.cameras[place].1).collect();
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

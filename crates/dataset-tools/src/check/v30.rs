//! Reader of LeRobotDataset v3.0 metadata.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;

use arrow_array::RecordBatch;
use serde::Deserialize;
use serde_json::Value;

use super::findings::Findings;
use super::metadata::{self, EpisodeEntry, EpisodeStats, Info, Metadata, Statistics, VideoSpan};
use genmanip_data::DataError;
use genmanip_data::columns::{cell, integer, text, texts};
use genmanip_data::lerobot::{SETTINGS, SUBTASKS};
use genmanip_data::table::Table;

const TASKS: &str = "meta/tasks.parquet";
const EPISODES: &str = "meta/episodes/";

pub(super) fn read(root: &Path, info: Info, listed: &BTreeSet<String>, findings: &mut Findings) -> Metadata {
    let stats = metadata::read_json(root, "meta/stats.json", findings);
    let contract = metadata::read_contract(root, findings);
    let tables: Vec<String> =
        listed.iter().filter(|path| path.starts_with(EPISODES) && path.ends_with(".parquet")).cloned().collect();
    if tables.is_empty() {
        findings.add("files", EPISODES, "", "at least one table of episodes", "none");
    }
    let mut episodes = Vec::new();
    for name in &tables {
        match whole(&root.join(name), |column| !column.starts_with("stats/")) {
            Ok(batch) => {
                let known = batch.schema();
                for column in ["episode_index", "tasks", "length", "dataset_from_index", "dataset_to_index"] {
                    if known.field_with_name(column).is_err() {
                        findings.add("episodes", name, "", format!("a column `{column}`"), "none");
                    }
                }
                episodes.extend((0..batch.num_rows()).map(|row| episode(&info, &batch, (name, row), findings)));
            }
            Err(error) => findings.add("files", name, "", "a readable table", error),
        }
    }
    let tasks = sentences(root, TASKS, "task", findings);
    let subtasks = sentences(root, SUBTASKS, "subtask", findings);
    let own = [TASKS].into_iter().chain(info.has_steps().then_some(SUBTASKS)).map(str::to_owned);
    let meta_files = tables.into_iter().chain(own).collect();
    Metadata {
        root: root.into(),
        info,
        tasks,
        tasks_file: TASKS,
        subtasks,
        subtasks_file: SUBTASKS,
        episodes,
        episodes_file: EPISODES,
        contract,
        is_own: listed.contains(SETTINGS) || listed.contains("meta/genmanip.json"),
        meta_files,
        stats,
        episode_stats: EpisodeStats::Tables(RefCell::default()),
    }
}

/// Instructions with their indices, from a table; a missing table is reported by the check of paths.
fn sentences(root: &Path, file: &str, name: &str, findings: &mut Findings) -> Vec<(i64, String)> {
    let index = format!("{name}_index");
    let read = |batch: RecordBatch| {
        let sentence = |row| [name, "__index_level_0__"].iter().find_map(|name| text(&batch, name, row));
        (0..batch.num_rows())
            .map(|row| (integer(&batch, &index, row).unwrap_or(-1), sentence(row).unwrap_or_default().0))
            .collect()
    };
    whole(&root.join(file), |_| true).map(read).unwrap_or_else(|error| {
        if !error.is_missing() {
            findings.add("tasks", file, "", "a readable table", error);
        }
        Vec::new()
    })
}

fn episode(info: &Info, batch: &RecordBatch, (file, row): (&str, usize), findings: &mut Findings) -> EpisodeEntry {
    let number = |name: &str| integer(batch, name, row).unwrap_or(-1);
    let word = |name: &str| text(batch, name, row).map(|(text, _)| text);
    let seconds = |name: &str| cell(batch, name, row).and_then(|cell| cell.first().copied()).unwrap_or(f64::NAN);
    let (sentence, sentences) = text(batch, "tasks", row).unwrap_or_default();
    let path = |template: &str, chunk: i64, file: i64, key: &str| {
        metadata::fill(
            info.json[template].as_str().unwrap_or_default(),
            &[("chunk_index", chunk), ("file_index", file)],
            key,
        )
    };
    let videos = info.features.iter().filter(|feature| feature.is_video()).map(|feature| {
        let key = &feature.key;
        let [chunk, file] = ["chunk_index", "file_index"].map(|name| number(&format!("videos/{key}/{name}")));
        VideoSpan {
            key: key.clone(),
            file: path("video_path", chunk, file, key),
            from_s: seconds(&format!("videos/{key}/from_timestamp")),
            to_s: seconds(&format!("videos/{key}/to_timestamp")),
        }
    });
    let scenario = word("scenario_json").map(|text| serde_json::from_str::<ScenarioSummary>(&text));
    let (scenario_id, place) = (word("scenario_id"), format!("episode {}, scenario_json", number("episode_index")));
    match &scenario {
        Some(Err(error)) => findings.add("episodes", file, place, "a scenario", error),
        Some(Ok(summary)) if Some(&summary.id) != scenario_id.as_ref() || summary.task.instruction != sentence => {
            let expected = format!("{scenario_id:?} and {sentence:?}, the values in its row");
            findings.add(
                "episodes",
                file,
                place,
                expected,
                format!("{:?} and {:?}", summary.id, summary.task.instruction),
            );
        }
        _ => {}
    }
    EpisodeEntry {
        index: number("episode_index"),
        length: number("length"),
        from: number("dataset_from_index"),
        to: number("dataset_to_index"),
        sentence,
        sentences,
        store_id: word("store_id"),
        scenario_id,
        seed: integer(batch, "seed", row),
        subtasks: texts(batch, "subtasks", row),
        success: cell(batch, "success", row).and_then(|cell| cell.first().map(|value| *value > 0.0)),
        failure: word("failure"),
        kind: word("task_kind"),
        home: scenario.and_then(Result::ok).map(|summary| summary.world.robot.home),
        data: path("data_path", number("data/chunk_index"), number("data/file_index"), ""),
        videos: videos.collect(),
        listed_in: (file.into(), row),
    }
}

/// Fields of a scenario that the check reads.
#[derive(Deserialize)]
struct ScenarioSummary {
    id: String,
    task: TaskSummary,
    world: WorldSummary,
}

#[derive(Deserialize)]
struct TaskSummary {
    instruction: String,
}

#[derive(Deserialize)]
struct WorldSummary {
    robot: RobotSummary,
}

#[derive(Deserialize)]
struct RobotSummary {
    home: Vec<f64>,
}

/// Recorded statistics of a feature in an episode; `None` if there are none.
pub(super) fn statistics(metadata: &Metadata, episode: &EpisodeEntry, key: &str, names: &[&str]) -> Option<Statistics> {
    match &metadata.episode_stats {
        EpisodeStats::Lines(lines) => {
            let line = lines.get(usize::try_from(episode.index).ok()?)?;
            Some(named(&line["stats"][key]))
        }
        EpisodeStats::Tables(kept) => {
            let (name, row) = &episode.listed_in;
            let mut kept = kept.borrow_mut();
            if kept.as_ref().is_none_or(|(kept, _)| kept != name) {
                let batch = whole(&metadata.root.join(name), |column| column.starts_with("stats/")).ok()?;
                *kept = Some((name.clone(), batch));
            }
            let (_, batch) = kept.as_ref()?;
            let value = |name: &&str| Some(((*name).to_owned(), cell(batch, &format!("stats/{key}/{name}"), *row)?));
            let statistics: Statistics = names.iter().filter_map(value).collect();
            (!statistics.is_empty()).then_some(statistics)
        }
    }
}

/// Statistics of an entry of `stats.json`, flattened.
pub(super) fn named(entry: &Value) -> Statistics {
    let mut statistics = Statistics::new();
    for (name, value) in entry.as_object().into_iter().flatten() {
        let mut flat = Vec::new();
        flatten(value, &mut flat);
        statistics.insert(name.clone(), flat);
    }
    statistics
}

fn flatten(value: &Value, into: &mut Vec<f64>) {
    match value {
        Value::Array(values) => values.iter().for_each(|value| flatten(value, into)),
        // A statistic that is not finite is stored as null and stays in its position.
        Value::Null => into.push(f64::NAN),
        value => into.extend(value.as_f64()),
    }
}

/// All rows of the selected columns of a Parquet file.
pub(super) fn whole(path: &Path, is_wanted: impl Fn(&str) -> bool) -> Result<RecordBatch, DataError> {
    Table::open(path)?.whole(is_wanted)
}

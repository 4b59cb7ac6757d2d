//! Reader of LeRobotDataset v2.1 and v2.0 metadata; v2.0 has no statistics of episodes.

use std::collections::BTreeSet;
use std::path::Path;

use genmanip_core::json::without_mark;
use genmanip_core::limits;
use serde_json::Value;

use super::findings::Findings;
use super::metadata::{self, EpisodeEntry, EpisodeStats, Info, Metadata, Version, VideoSpan};
use genmanip_data::lerobot::{RECORD, SETTINGS};
use genmanip_data::{EpisodeStore, files};

const TASKS: &str = "meta/tasks.jsonl";
const SUBTASKS: &str = "meta/subtasks.jsonl";
const EPISODES: &str = "meta/episodes.jsonl";
const STATISTICS: &str = "meta/episodes_stats.jsonl";

pub(super) fn read(root: &Path, info: Info, listed: &BTreeSet<String>, findings: &mut Findings) -> Metadata {
    let stats = metadata::read_json(root, "meta/stats.json", findings);
    let contract = metadata::read_contract(root, findings);
    let task =
        |line: Value| (line["task_index"].as_i64().unwrap_or(-1), line["task"].as_str().unwrap_or_default().to_owned());
    let tasks = lines(root, TASKS, findings).into_iter().map(task).collect();
    let step = |line: &Value| {
        (line["subtask_index"].as_i64().unwrap_or(-1), line["subtask"].as_str().unwrap_or_default().to_owned())
    };
    let subtasks = lines(root, SUBTASKS, findings).iter().map(step).collect();
    // In this version, the robot's home position is available only from the native record.
    let record = EpisodeStore::open(root.join(RECORD)).ok();
    let mut from = 0;
    let mut episodes = Vec::new();
    for (row, line) in lines(root, EPISODES, findings).iter().enumerate() {
        let mut episode = episode(&info, line, row, from);
        let scenario = record.as_ref().zip(episode.store_id.as_ref()).map(|(record, id)| record.read_scenario(id));
        episode.home = scenario.and_then(Result::ok).flatten().map(|scenario| scenario.world.robot.home);
        from = episode.to;
        episodes.push(episode);
    }
    let has_statistics = info.version == Version::V21;
    let statistics = if has_statistics { lines(root, STATISTICS, findings) } else { Vec::new() };
    for (row, line) in statistics.iter().enumerate() {
        let place = format!("line {}, episode_index", row + 1);
        let (expected, found) = (Value::from(row), &line["episode_index"]);
        if expected != *found {
            findings.add("statistics", STATISTICS, place, expected, found);
        }
    }
    if has_statistics {
        findings.require("statistics", STATISTICS, "lines", &episodes.len(), &statistics.len());
    }
    let own = [TASKS, EPISODES].into_iter().chain(has_statistics.then_some(STATISTICS));
    let own = own.chain(info.has_steps().then_some(SUBTASKS));
    let meta_files = own.map(str::to_owned).collect();
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
        episode_stats: EpisodeStats::Lines(statistics),
    }
}

fn episode(info: &Info, line: &Value, row: usize, from: i64) -> EpisodeEntry {
    let index = line["episode_index"].as_i64().unwrap_or(-1);
    let length = line["length"].as_i64().unwrap_or(-1);
    let chunk = index / info.json["chunks_size"].as_i64().unwrap_or(1000).max(1);
    let numbers = [("episode_chunk", chunk), ("episode_index", index)];
    let path =
        |template: &str, key: &str| metadata::fill(info.json[template].as_str().unwrap_or_default(), &numbers, key);
    let word = |key: &str| line[key].as_str().map(str::to_owned);
    let videos = info.features.iter().filter(|feature| feature.is_video()).map(|feature| VideoSpan {
        key: feature.key.clone(),
        file: path("video_path", &feature.key),
        from_s: 0.0,
        to_s: length as f64 / info.fps,
    });
    EpisodeEntry {
        index,
        length,
        from,
        to: from.saturating_add(length.max(0)),
        sentence: line["tasks"][0].as_str().unwrap_or_default().into(),
        sentences: line["tasks"].as_array().map_or(0, Vec::len),
        store_id: word("store_id"),
        scenario_id: word("scenario_id"),
        seed: line["seed"].as_i64(),
        subtasks: line["subtasks"]
            .as_array()
            .map(|texts| texts.iter().filter_map(|text| text.as_str().map(str::to_owned)).collect()),
        success: line["success"].as_bool(),
        // `failure` is null without a cause.
        failure: line.get("failure").map(|why| why.as_str().unwrap_or_default().to_owned()),
        kind: None,
        home: None,
        data: path("data_path", ""),
        videos: videos.collect(),
        listed_in: (EPISODES.into(), row),
    }
}

/// Parses a JSON Lines file; invalid lines become findings.
fn lines(root: &Path, name: &str, findings: &mut Findings) -> Vec<Value> {
    let bytes = match files::read(&root.join(name), limits::INDEX) {
        Ok(bytes) => bytes,
        Err(error) => {
            if !error.is_missing() {
                findings.add("files", name, "", "a readable file", error);
            }
            return Vec::new();
        }
    };
    let mut documents = Vec::new();
    let is_blank = |line: &[u8]| line.trim_ascii().is_empty();
    let lines = without_mark(&bytes).split(|byte| *byte == b'\n').enumerate();
    for (number, line) in lines.filter(|(_, line)| !is_blank(line)) {
        match serde_json::from_slice(line).or_else(|error| without_nan(line).ok_or(error)) {
            Ok(document) => documents.push(document),
            // A null keeps the line numbers of later lines.
            Err(error) => {
                findings.add("files", name, format!("line {}", number + 1), "JSON", error);
                documents.push(Value::Null);
            }
        }
    }
    documents
}

/// JSON value of a line in which Python's NaN and Infinity are replaced by null; `None` if it is still invalid.
fn without_nan(line: &[u8]) -> Option<Value> {
    let text = std::str::from_utf8(line).ok()?;
    let plain = text.replace("-Infinity", "null").replace("Infinity", "null").replace("NaN", "null");
    serde_json::from_str(&plain).ok()
}

//! LeRobotDataset v2.1 with `modality.json`, for readers of that version: GR00T, and openpi with its pinned library.
//!
//! ```text
//! meta/info.json, tasks.jsonl, subtasks.jsonl, episodes.jsonl, episodes_stats.jsonl     as LeRobot 0.3 has them
//! meta/stats.json                        statistics over all frames, quantiles included
//! meta/modality.json                     which entries of state and action are what, as GR00T wants it
//! norm_stats.json                        statistics of state and action, as openpi wants them
//! data/chunk-000/episode_000000.parquet  one file per episode
//! videos/chunk-000/KEY/episode_000000.mp4
//! ```

use std::path::Path;

use genmanip_core::{ActionContract, ActionSpace, Document, RobotModel, RotationEncoding};
use serde_json::{Value, json};

use super::info::FILES_PER_CHUNK;
use super::ledger::Ledger;
use super::made::Made;
use super::stats::Stats;
use super::{CONTRACT, LerobotSettings, begin, features, info, record};
use crate::aside::Aside;
use crate::export::facts::{EpisodeFacts, Told};
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection};
use crate::table::{Purpose, TableWriter};
use crate::{DataError, EpisodeStore, video};

/// Writes the selected episodes as a data set of version 2.1 at `dataset`; depth has no place in it.
///
/// # Errors
/// As [`super::export`].
pub fn export_v21(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &LerobotSettings,
    dataset: &Path,
) -> Result<ExportReport, DataError> {
    let rows = ExportSettings { depth: false, ..settings.export.clone() };
    let settings = LerobotSettings { export: rows, ..settings.clone() };
    let exporter = Exporter::new(store, selection, robot, &settings.export)?;
    let aside = begin(dataset, settings.run.as_deref())?;
    let mut writer = Writer::new(aside, settings.export.fps);
    let left_out = exporter.each(|source, rows| {
        writer.push(rows)?;
        if settings.record { record::copy(&writer.aside, store, &source.episode.result.id) } else { Ok(()) }
    })?;
    let frames = writer.ledger.frames;
    writer.finish(dataset, &robot.name, &Made::Exported(settings.clone()), Some(&exporter.contract()))?;
    let episodes = exporter.len() - left_out.len();
    Ok(ExportReport { dataset: dataset.into(), depth_dataset: None, episodes, frames, left_out })
}

/// What `episodes.jsonl` tells of an episode beside the format's own.
pub(crate) trait Line: Told {
    /// An object.
    fn line(&self) -> Value;
}

impl Line for EpisodeFacts {
    fn line(&self) -> Value {
        let result = &self.result;
        let mut line = json!({
            "store_id": result.id,
            "scenario_id": result.scenario_id,
            "seed": result.seed,
            "success": result.success,
            "failure": result.failure().map(|failure| failure.to_string()),
            "subtasks": self.steps.texts,
            "paraphrases": self.paraphrases,
        });
        if self.has_correction_columns {
            line["correction"] = json!(result.correction);
        }
        line
    }
}

/// A data set of version 2.1 under construction.
pub(crate) struct Writer {
    pub(crate) aside: Aside,
    pub(crate) ledger: Ledger,
    /// `episodes.jsonl` and `episodes_stats.jsonl` so far.
    episodes: String,
    statistics: String,
}

impl Writer {
    pub(crate) fn new(aside: Aside, fps: u32) -> Self {
        Self { ledger: Ledger::new(fps, aside.folder()), aside, episodes: String::new(), statistics: String::new() }
    }

    pub(crate) fn push<F: Line>(&mut self, mut rows: EpisodeRows<F>) -> Result<(), DataError> {
        self.ledger.admit(&mut rows)?;
        let episode = self.ledger.episodes;
        let chunk = episode / FILES_PER_CHUNK;
        let name = format!("data/chunk-{chunk:03}/episode_{episode:06}.parquet");
        let batch = features::batch(&rows.images, &rows.features)?;
        let mut table = TableWriter::new(Path::new(&name), batch.schema(), Purpose::Dataset)?;
        table.write(&batch)?;
        self.aside.write(&name, &table.finish()?)?;
        let mut statistics = serde_json::Map::new();
        for video in &rows.videos {
            let name = format!("videos/chunk-{chunk:03}/{}/episode_{episode:06}.mp4", video.key);
            self.aside.write(&name, &video::mux_mp4([&video.video])?)?;
            statistics.insert(video.key.clone(), without_quantiles(Stats::of_colors(&video.colors, rows.frames), true));
        }
        for feature in &rows.features {
            let stats = Stats::of_vectors(&feature.numbers(), feature.length());
            statistics.insert(feature.key.clone(), without_quantiles(stats, false));
        }
        let mut line = json!({
            "episode_index": episode,
            "tasks": [rows.facts.instruction()],
            "length": rows.frames,
        });
        if let (Value::Object(line), Value::Object(more)) = (&mut line, rows.facts.line()) {
            line.extend(more);
        }
        self.episodes += &format!("{line}\n");
        self.statistics += &format!("{}\n", json!({"episode_index": episode, "stats": statistics}));
        self.ledger.count(rows.frames);
        Ok(())
    }

    /// Writes what describes the whole and makes it visible.
    pub(crate) fn finish(
        mut self,
        dataset: &Path,
        robot: &str,
        made: &Made,
        contract: Option<&ActionContract>,
    ) -> Result<(), DataError> {
        let features = self.ledger.features.take().unwrap_or_default();
        let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stats = self.ledger.collected.finish()?;
        let modality = modality(contract, &features);
        let info = info_v21(&self.ledger, robot, features);
        let listed = |name: &str, sentences: &[String]| -> String {
            let line = |(index, sentence)| format!("{}\n", json!({(format!("{name}_index")): index, (name): sentence}));
            sentences.iter().enumerate().map(line).collect()
        };
        let (tasks, subtasks) = (listed("task", &self.ledger.tasks), listed("subtask", &self.ledger.subtasks));
        let write = |name: &str, value: &Value| self.aside.write(name, format!("{value:#}\n").as_bytes());
        write(info::INFO, &info)?;
        write("meta/stats.json", &stats)?;
        write("meta/modality.json", &modality)?;
        write("norm_stats.json", &norm_stats(&stats))?;
        self.aside.write("meta/tasks.jsonl", tasks.as_bytes())?;
        self.aside.write("meta/subtasks.jsonl", subtasks.as_bytes())?;
        self.aside.write("meta/episodes.jsonl", self.episodes.as_bytes())?;
        self.aside.write("meta/episodes_stats.jsonl", self.statistics.as_bytes())?;
        made.write(&self.aside, None)?;
        if let Some(contract) = contract {
            self.aside.write(CONTRACT, contract.to_json().as_bytes())?;
        }
        self.aside.write("README.md", info::card_with_info(&made.card(&name, "v2.1"), &info).as_bytes())?;
        self.aside.publish()
    }
}

fn info_v21(ledger: &Ledger, robot: &str, features: Value) -> Value {
    let videos = features.as_object().map_or(0, |all| all.values().filter(|entry| entry["dtype"] == "video").count());
    let video_path = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4";
    json!({
        "codebase_version": "v2.1",
        "robot_type": robot,
        "total_episodes": ledger.episodes,
        "total_frames": ledger.frames,
        "total_tasks": ledger.tasks.len(),
        "total_videos": videos * ledger.episodes,
        "total_chunks": ledger.episodes.div_ceil(FILES_PER_CHUNK),
        "chunks_size": FILES_PER_CHUNK,
        "fps": ledger.fps,
        "splits": {"train": format!("0:{}", ledger.episodes)},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": if videos > 0 { Value::from(video_path) } else { Value::Null },
        "features": features,
    })
}

/// LeRobot's own readers of that version know five statistics.
fn without_quantiles(mut stats: Stats, is_image: bool) -> Value {
    stats.named.truncate(4);
    stats.to_json(is_image)
}

/// Which entries of state and action are what; without a contract each is one part.
fn modality(contract: Option<&ActionContract>, features: &Value) -> Value {
    let length = |key: &str| features[key]["shape"][0].as_u64().and_then(|length| usize::try_from(length).ok());
    let part: Part = |start: usize, end: usize, is_absolute: bool, rotation: Option<&str>| json!({"start": start, "end": end, "absolute": is_absolute, "dtype": "float32", "rotation_type": rotation});
    let (state, action) = match contract {
        Some(contract) => parts(contract, length("observation.state").unwrap_or(1).saturating_sub(1), part),
        None => {
            let whole = |key: &str, name: &str| length(key).map(|length| json!({name: part(0, length, true, None)}));
            (whole("observation.state", "state"), whole("action", "action"))
        }
    };
    let videos = features.as_object().into_iter().flatten().filter(|(_, entry)| entry["dtype"] == "video");
    let video: serde_json::Map<String, Value> = videos
        .map(|(key, _)| {
            let name = key.trim_start_matches("observation.images.").to_owned();
            (name, json!({"original_key": key}))
        })
        .collect();
    json!({
        "state": state.unwrap_or_else(|| json!({})),
        "action": action.unwrap_or_else(|| json!({})),
        "video": video,
        "annotation": {"human.task_description": {"original_key": "task_index"}},
    })
}

/// Makes the entry of a part: first index, the one behind the last, whether it is absolute, name of its rotation.
type Part = fn(usize, usize, bool, Option<&str>) -> Value;

/// The parts of state and action of an arm with so many joints.
fn parts(contract: &ActionContract, dof: usize, part: Part) -> (Option<Value>, Option<Value>) {
    let spec = &contract.action;
    let motion = spec.motion_length(dof);
    let is_absolute = matches!(spec.space, ActionSpace::JointPosition | ActionSpace::EePose);
    let rotation = match spec.rotation {
        RotationEncoding::QuatWxyz | RotationEncoding::QuatXyzw => "quaternion",
        RotationEncoding::SixD => "rotation_6d",
        RotationEncoding::FixedXyzEuler => "euler_angles_rpy",
        RotationEncoding::AxisAngle => "axis_angle",
    };
    let mut action = serde_json::Map::new();
    if spec.space.is_joint() {
        action.insert("single_arm".into(), part(0, motion, is_absolute, None));
    } else {
        action.insert("eef_position".into(), part(0, 3, is_absolute, None));
        action.insert("eef_rotation".into(), part(3, motion, is_absolute, Some(rotation)));
    }
    action.insert("gripper".into(), part(motion, motion + 1, true, None));
    let state = json!({"single_arm": part(0, dof, true, None), "gripper": part(dof, dof + 1, true, None)});
    (Some(state), Some(Value::Object(action)))
}

/// Mean, deviation and outer quantiles of state and action.
fn norm_stats(stats: &Value) -> Value {
    let of = |key: &str| {
        let names = ["mean", "std", "q01", "q99"];
        names.map(|name| (name.to_owned(), stats[key][name].clone())).into_iter().collect::<serde_json::Map<_, _>>()
    };
    json!({"norm_stats": {"state": of("observation.state"), "actions": of("action")}})
}

//! LeRobotDataset v2.1 with `modality.json`, for readers of that version: GR00T, and openpi with its pinned library.
//!
//! ```text
//! meta/info.json, tasks.jsonl, subtasks.jsonl, episodes.jsonl, episodes_stats.jsonl     as in LeRobot 0.3
//! meta/stats.json                        statistics over all frames, quantiles included
//! meta/modality.json                     slices of state and action by name, for GR00T
//! norm_stats.json                        statistics of state and action, for openpi
//! data/chunk-000/episode_000000.parquet  one file per episode
//! videos/chunk-000/KEY/episode_000000.mp4
//! ```

use std::path::Path;

use genmanip_core::{ActionContract, RobotModel, RotationEncoding};
use serde_json::{Value, json};

use super::dataset_metadata::DatasetMetadata;
use super::info::FILES_PER_CHUNK;
use super::metadata_files::MetadataFiles;
use super::origin::Origin;
use super::stats::Stats;
use super::{LerobotSettings, begin, features, record};
use crate::atomic_write::{AtomicFolder, write_json};
use crate::export::metadata::{EpisodeMetadata, LanguageLabels};
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection};
use crate::table::{Purpose, TableWriter};
use crate::{DataError, EpisodeStore, video};

/// Exports the selected episodes to a v2.1 data set at `dataset`; the format has no depth.
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
    let staging = begin(dataset, settings.run.as_deref())?;
    let mut writer = Writer::new(staging, settings.export.fps);
    let report = exporter.each(dataset, |source, rows| {
        writer.push(rows)?;
        if settings.record { record::copy(&writer.staging, store, &source.episode.result.id) } else { Ok(()) }
    })?;
    writer.finish(dataset, &robot.name, &Origin::Exported(settings.clone()), Some(&exporter.contract()))?;
    Ok(report)
}

/// Source of the fields of `episodes.jsonl` that LeRobot does not define.
pub trait EpisodeFields: LanguageLabels {
    /// The fields as a JSON object.
    fn fields(&self) -> Value;
}

impl EpisodeFields for EpisodeMetadata {
    fn fields(&self) -> Value {
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

/// Writer of a v2.1 data set.
pub struct Writer {
    /// Data set folder under its temporary name.
    pub staging: AtomicFolder,
    /// Metadata of the data set so far.
    pub metadata: DatasetMetadata,
    /// Contents of `episodes.jsonl` and `episodes_stats.jsonl` so far.
    episodes: String,
    statistics: String,
}

impl Writer {
    /// An empty data set in the unpublished folder `staging`, with `fps` rows per second.
    pub fn new(staging: AtomicFolder, fps: u32) -> Self {
        Self {
            metadata: DatasetMetadata::new(fps, staging.folder()),
            staging,
            episodes: String::new(),
            statistics: String::new(),
        }
    }

    /// Writes an episode.
    ///
    /// # Errors
    /// If its columns differ from those of earlier episodes, or a file cannot be written.
    pub fn push<F: EpisodeFields>(&mut self, mut rows: EpisodeRows<F>) -> Result<(), DataError> {
        self.metadata.begin_episode(&mut rows)?;
        let episode = self.metadata.episodes;
        let chunk = episode / FILES_PER_CHUNK;
        let name = format!("data/chunk-{chunk:03}/episode_{episode:06}.parquet");
        let batch = features::batch(&rows.images, &rows.features)?;
        let mut table = TableWriter::new(Path::new(&name), batch.schema(), Purpose::Dataset)?;
        table.write(&batch)?;
        self.staging.write(&name, &table.finish()?)?;
        let mut statistics = serde_json::Map::new();
        for video in &rows.videos {
            let name = format!("videos/chunk-{chunk:03}/{}/episode_{episode:06}.mp4", video.key);
            self.staging.write(&name, &video::mux_mp4([&video.video])?)?;
            statistics.insert(video.key.clone(), without_quantiles(Stats::of_colors(&video.colors, rows.frames), true));
        }
        for feature in &rows.features {
            let stats = Stats::of_vectors(&feature.numbers(), feature.length());
            statistics.insert(feature.key.clone(), without_quantiles(stats, false));
        }
        let mut line = json!({
            "episode_index": episode,
            "tasks": [rows.metadata.instruction()],
            "length": rows.frames,
        });
        if let (Value::Object(line), Value::Object(more)) = (&mut line, rows.metadata.fields()) {
            line.extend(more);
        }
        self.episodes += &format!("{line}\n");
        self.statistics += &format!("{}\n", json!({"episode_index": episode, "stats": statistics}));
        self.metadata.end_episode(rows.frames);
        Ok(())
    }

    /// Writes the metadata and publishes the data set.
    pub fn finish(
        mut self,
        dataset: &Path,
        robot: &str,
        origin: &Origin,
        contract: Option<&ActionContract>,
    ) -> Result<(), DataError> {
        let features = self.metadata.features.take().unwrap_or_default();
        let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let stats = self.metadata.stats_collector.finish()?;
        let modality = modality(contract, &features);
        let info = info_v21(&self.metadata, robot, features);
        let listed = |name: &str, sentences: &[String]| -> String {
            let line = |(index, sentence)| format!("{}\n", json!({(format!("{name}_index")): index, (name): sentence}));
            sentences.iter().enumerate().map(line).collect()
        };
        let (tasks, subtasks) = (listed("task", &self.metadata.tasks), listed("subtask", &self.metadata.subtasks));
        write_json(&self.staging, "meta/modality.json", &modality)?;
        write_json(&self.staging, "norm_stats.json", &norm_stats(&stats))?;
        self.staging.write("meta/tasks.jsonl", tasks.as_bytes())?;
        self.staging.write("meta/subtasks.jsonl", subtasks.as_bytes())?;
        self.staging.write("meta/episodes.jsonl", self.episodes.as_bytes())?;
        self.staging.write("meta/episodes_stats.jsonl", self.statistics.as_bytes())?;
        let card = origin.card(&name, "v2.1");
        let files = MetadataFiles { info: &info, stats: &stats, statistics_note: None, origin, contract, card: &card };
        files.write(&self.staging)?;
        self.staging.publish()
    }
}

fn info_v21(metadata: &DatasetMetadata, robot: &str, features: Value) -> Value {
    let videos = features.as_object().map_or(0, |all| all.values().filter(|entry| entry["dtype"] == "video").count());
    let video_path = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4";
    json!({
        "codebase_version": "v2.1",
        "robot_type": robot,
        "total_episodes": metadata.episodes,
        "total_frames": metadata.frames,
        "total_tasks": metadata.tasks.len(),
        "total_videos": videos * metadata.episodes,
        "total_chunks": metadata.episodes.div_ceil(FILES_PER_CHUNK),
        "chunks_size": FILES_PER_CHUNK,
        "fps": metadata.fps,
        "splits": {"train": format!("0:{}", metadata.episodes)},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": if videos > 0 { Value::from(video_path) } else { Value::Null },
        "features": features,
    })
}

/// Statistics without quantiles, which LeRobot's own v2.1 readers do not know.
fn without_quantiles(mut stats: Stats, is_image: bool) -> Value {
    stats.named.truncate(4);
    stats.to_json(is_image)
}

/// Slices of state and action by name; without a contract, each is a single slice.
fn modality(contract: Option<&ActionContract>, features: &Value) -> Value {
    let length = |key: &str| features[key]["shape"][0].as_u64().and_then(|length| usize::try_from(length).ok());
    let entry: ModalityEntry = |start: usize, end: usize, is_absolute: bool, rotation: Option<&str>| json!({"start": start, "end": end, "absolute": is_absolute, "dtype": "float32", "rotation_type": rotation});
    let (state, action) = match contract {
        Some(contract) => parts(contract, length("observation.state").unwrap_or(1).saturating_sub(1), entry),
        None => {
            let whole = |key: &str, name: &str| length(key).map(|length| json!({name: entry(0, length, true, None)}));
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

/// Builds a modality entry from start, end (exclusive), whether it is absolute, and the rotation type.
type ModalityEntry = fn(usize, usize, bool, Option<&str>) -> Value;

/// Modality entries of state and action for an arm with `dof` joints.
fn parts(contract: &ActionContract, dof: usize, entry: ModalityEntry) -> (Option<Value>, Option<Value>) {
    let spec = &contract.action;
    let motion = spec.motion_length(dof);
    let is_absolute = spec.space.is_absolute();
    let rotation = match spec.rotation {
        RotationEncoding::QuatWxyz | RotationEncoding::QuatXyzw => "quaternion",
        RotationEncoding::SixD => "rotation_6d",
        RotationEncoding::FixedXyzEuler => "euler_angles_rpy",
        RotationEncoding::AxisAngle => "axis_angle",
    };
    let mut action = serde_json::Map::new();
    if spec.space.is_joint() {
        action.insert("single_arm".into(), entry(0, motion, is_absolute, None));
    } else {
        action.insert("eef_position".into(), entry(0, 3, is_absolute, None));
        action.insert("eef_rotation".into(), entry(3, motion, is_absolute, Some(rotation)));
    }
    action.insert("gripper".into(), entry(motion, motion + 1, true, None));
    let state = json!({"single_arm": entry(0, dof, true, None), "gripper": entry(dof, dof + 1, true, None)});
    (Some(state), Some(Value::Object(action)))
}

/// Mean, standard deviation, 1 % and 99 % quantile of state and action.
fn norm_stats(stats: &Value) -> Value {
    let of = |key: &str| {
        let names = ["mean", "std", "q01", "q99"];
        names.map(|name| (name.to_owned(), stats[key][name].clone())).into_iter().collect::<serde_json::Map<_, _>>()
    };
    json!({"norm_stats": {"state": of("observation.state"), "actions": of("action")}})
}

//! Metadata of a LeRobot data set, independent of its version.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use arrow_array::RecordBatch;
use genmanip_core::json::without_mark;
use genmanip_core::{ActionContract, Document, limits};
use serde_json::Value;

use super::findings::Findings;
use genmanip_data::lerobot::CONTRACT;
use genmanip_data::lerobot::info::INFO;
use genmanip_data::{DataError, files};

/// Version of the LeRobot format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Version {
    V30,
    V21,
    V20,
}

impl Version {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::V30 => "lerobot-v3.0",
            Self::V21 => "lerobot-v2.1",
            Self::V20 => "lerobot-v2.0",
        }
    }
}

/// Column as declared in `info.json`.
#[derive(Clone, Debug)]
pub(crate) struct Feature {
    pub(crate) key: String,
    pub(crate) dtype: String,
    pub(crate) shape: Vec<usize>,
    pub(crate) names: Vec<String>,
}

impl Feature {
    pub(crate) fn is_video(&self) -> bool {
        self.dtype == "video"
    }

    pub(crate) fn is_image(&self) -> bool {
        self.dtype == "image"
    }

    /// Height and width of an RGB image, stored channels first or last; `None` for other shapes.
    pub(crate) fn rgb_size(&self) -> Option<[usize; 2]> {
        match self.shape[..] {
            [height, width, 3] | [3, height, width] => Some([height, width]),
            _ => None,
        }
    }

    pub(crate) fn width(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Checked contents of `info.json`.
#[derive(Clone, Debug)]
pub(crate) struct Info {
    pub(crate) version: Version,
    pub(crate) robot: String,
    pub(crate) fps: f64,
    pub(crate) totals: [i64; 3],
    pub(crate) features: Vec<Feature>,
    pub(crate) json: Value,
}

impl Info {
    /// True if rows have the index of a step (subtask), as in this program's data sets.
    pub(crate) fn has_steps(&self) -> bool {
        self.features.iter().any(|feature| feature.key == "subtask_index")
    }
}

/// Time span of one episode in a video file.
#[derive(Clone, Debug)]
pub(crate) struct VideoSpan {
    pub(crate) key: String,
    pub(crate) file: String,
    pub(crate) from_s: f64,
    pub(crate) to_s: f64,
}

/// Episode as listed in the data set's metadata.
#[derive(Clone, Debug, Default)]
pub(crate) struct EpisodeEntry {
    pub(crate) index: i64,
    pub(crate) length: i64,
    pub(crate) from: i64,
    pub(crate) to: i64,
    pub(crate) sentence: String,
    pub(crate) sentences: usize,
    pub(crate) store_id: Option<String>,
    pub(crate) scenario_id: Option<String>,
    pub(crate) seed: Option<i64>,
    /// Instructions of the episode's steps (subtasks), if recorded; `None` otherwise.
    pub(crate) subtasks: Option<Vec<String>>,
    pub(crate) success: Option<bool>,
    pub(crate) failure: Option<String>,
    pub(crate) kind: Option<String>,
    /// Home joint positions of the robot according to the scenario, rad. `None` if no scenario is recorded.
    pub(crate) home: Option<Vec<f64>>,
    pub(crate) data: String,
    pub(crate) videos: Vec<VideoSpan>,
    /// File of the episode's entry, and row or line in it.
    pub(crate) listed_in: (String, usize),
}

impl EpisodeEntry {
    pub(crate) fn place(&self) -> String {
        format!("episode {}", self.index)
    }
}

/// Statistics of one feature by name.
pub(crate) type Statistics = BTreeMap<String, Vec<f64>>;

/// Source of the per-episode statistics.
pub(crate) enum EpisodeStats {
    /// Columns `stats/KEY/NAME` of the episodes tables; caches one file.
    Tables(RefCell<Option<(String, RecordBatch)>>),
    /// Lines of `episodes_stats.jsonl`.
    Lines(Vec<Value>),
}

/// All metadata of a data set.
pub(crate) struct Metadata {
    pub(crate) root: PathBuf,
    pub(crate) info: Info,
    pub(crate) tasks: Vec<(i64, String)>,
    pub(crate) tasks_file: &'static str,
    /// Index and instruction of each step (subtask).
    pub(crate) subtasks: Vec<(i64, String)>,
    pub(crate) subtasks_file: &'static str,
    pub(crate) episodes: Vec<EpisodeEntry>,
    /// File or folder with the list of episodes.
    pub(crate) episodes_file: &'static str,
    pub(crate) contract: Option<ActionContract>,
    /// True if this program exported the data set.
    pub(crate) is_own: bool,
    pub(crate) meta_files: Vec<String>,
    pub(crate) stats: Value,
    pub(crate) episode_stats: EpisodeStats,
}

/// Reads `info.json`, without which the data set cannot be checked.
pub(crate) fn read_info(root: &Path, findings: &mut Findings) -> Result<Info, DataError> {
    let path = root.join(INFO);
    let bytes = files::read(&path, limits::SETTINGS)?;
    let json: Value = serde_json::from_slice(without_mark(&bytes))
        .map_err(|error| DataError::mismatch(path.display().to_string(), "JSON", error))?;
    let version = match json["codebase_version"].as_str() {
        Some("v3.0") => Version::V30,
        Some("v2.1") => Version::V21,
        Some("v2.0") => Version::V20,
        other => {
            let got = other.unwrap_or("none");
            return Err(DataError::mismatch(
                format!("codebase_version in {}", path.display()),
                "LeRobot v3.0, v2.1 or v2.0, or zarr",
                got,
            ));
        }
    };
    let fps = json["fps"].as_f64().filter(|fps| *fps > 0.0).unwrap_or_else(|| {
        findings.add("info", INFO, "fps", "a positive number", &json["fps"]);
        0.0
    });
    let total = |key: &str, findings: &mut Findings| {
        json[key].as_i64().unwrap_or_else(|| {
            findings.add("info", INFO, key, "an integer", &json[key]);
            -1
        })
    };
    let totals = ["total_episodes", "total_frames", "total_tasks"].map(|key| total(key, findings));
    let features = json["features"].as_object().into_iter().flatten().map(|(key, about)| feature(key, about)).collect();
    let robot = json["robot_type"].as_str().unwrap_or_default().to_owned();
    Ok(Info { version, robot, fps, totals, features, json })
}

fn feature(key: &str, about: &Value) -> Feature {
    let texts = |value: &Value| -> Vec<String> {
        value.as_array().into_iter().flatten().filter_map(|name| name.as_str().map(str::to_owned)).collect()
    };
    let size = |size: &Value| size.as_u64().and_then(|size| usize::try_from(size).ok());
    Feature {
        key: key.into(),
        dtype: about["dtype"].as_str().unwrap_or_default().into(),
        shape: about["shape"].as_array().into_iter().flatten().filter_map(size).collect(),
        names: texts(&about["names"]),
    }
}

/// JSON file relative to the data set; null if it is missing or invalid, and errors become findings.
pub(crate) fn read_json(root: &Path, name: &str, findings: &mut Findings) -> Value {
    match files::read(&root.join(name), limits::EVALUATION) {
        Ok(bytes) => serde_json::from_slice(without_mark(&bytes)).unwrap_or_else(|error| {
            findings.add("info", name, "", "JSON", error);
            Value::Null
        }),
        // The check of paths reports missing files.
        Err(error) if error.is_missing() => Value::Null,
        Err(error) => {
            findings.add("files", name, "", "a readable file", error);
            Value::Null
        }
    }
}

/// Reads the action contract, if there is one. `None` if it is missing or invalid; an invalid one becomes a finding.
pub(crate) fn read_contract(root: &Path, findings: &mut Findings) -> Option<ActionContract> {
    let bytes = match files::read(&root.join(CONTRACT), limits::SETTINGS) {
        Ok(bytes) => bytes,
        Err(error) if error.is_missing() => return None,
        Err(error) => {
            findings.add("contract", CONTRACT, "", "a readable file", error);
            return None;
        }
    };
    ActionContract::from_bytes(&bytes).map_err(|error| findings.add("contract", CONTRACT, "", "a contract", error)).ok()
}

/// Path from a template of `info.json`, with its numbered placeholders and the video key filled in.
pub(crate) fn fill(template: &str, numbers: &[(&str, i64)], video_key: &str) -> String {
    let mut path = template.replace("{video_key}", video_key);
    for (name, number) in numbers {
        path = path.replace(&format!("{{{name}:03d}}"), &format!("{number:03}"));
        path = path.replace(&format!("{{{name}:06d}}"), &format!("{number:06}"));
        path = path.replace(&format!("{{{name}}}"), &number.to_string());
    }
    path
}

/// Checks that totals, tasks, episodes and contract are consistent.
pub(crate) fn check(metadata: &Metadata, findings: &mut Findings) {
    let count = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
    let [episodes, frames, tasks] = metadata.info.totals;
    findings.require("info", INFO, "total_episodes", &count(metadata.episodes.len()), &episodes);
    findings.require("info", INFO, "total_tasks", &count(metadata.tasks.len()), &tasks);
    let rows = metadata.episodes.iter().fold(0_i64, |sum, episode| sum.saturating_add(episode.length));
    findings.require("info", INFO, "total_frames", &rows, &frames);
    if metadata.is_own {
        let split = format!("0:{}", metadata.episodes.len());
        findings.require(
            "info",
            INFO,
            "splits.train",
            &Some(split.as_str()),
            &metadata.info.json["splits"]["train"].as_str(),
        );
    }
    tasks_and_sentences(metadata, findings);
    for (row, (index, _)) in metadata.subtasks.iter().enumerate() {
        let place = format!("row {row}, subtask_index");
        findings.require("tasks", metadata.subtasks_file, &place, &i64::try_from(row).unwrap_or(-1), index);
    }
    let mut from = 0;
    let mut ids = BTreeMap::new();
    for (number, episode) in metadata.episodes.iter().enumerate() {
        let (file, place) = (episode.listed_in.0.as_str(), episode.place());
        findings.require(
            "episodes",
            file,
            &format!("row {}, episode_index", episode.listed_in.1),
            &count(number),
            &episode.index,
        );
        findings.require("episodes", file, &format!("{place}, dataset_from_index"), &from, &episode.from);
        findings.require(
            "episodes",
            file,
            &format!("{place}, dataset_to_index"),
            &(from.saturating_add(episode.length)),
            &episode.to,
        );
        if episode.length < 1 {
            findings.add("episodes", file, format!("{place}, length"), "at least 1", episode.length);
        }
        from = from.saturating_add(episode.length.max(0));
        if let Some(id) = &episode.store_id
            && let Some(first) = ids.insert(id.clone(), episode.index)
        {
            findings.add(
                "episodes",
                file,
                format!("{place}, store_id"),
                "a unique id",
                format!("{id}, as episode {first}"),
            );
        }
        if metadata.is_own && episode.success == Some(false) && episode.failure.as_deref() == Some("") {
            findings.add("episodes", file, format!("{place}, failure"), "the cause of the failure", "nothing");
        }
        if metadata.is_own
            && episode.success == Some(true)
            && episode.failure.as_deref().is_some_and(|why| !why.is_empty())
        {
            let why = episode.failure.clone().unwrap_or_default();
            findings.add("episodes", file, format!("{place}, failure"), "nothing, because it succeeded", why);
        }
    }
    contract(metadata, findings);
    card(metadata, findings);
}

fn tasks_and_sentences(metadata: &Metadata, findings: &mut Findings) {
    let mut known = BTreeMap::new();
    for (row, (index, sentence)) in metadata.tasks.iter().enumerate() {
        let place = format!("row {row}");
        findings.require(
            "tasks",
            metadata.tasks_file,
            &format!("{place}, task_index"),
            &i64::try_from(row).unwrap_or(-1),
            index,
        );
        if sentence.trim().is_empty() {
            findings.add("tasks", metadata.tasks_file, place.clone(), "a sentence", format!("{sentence:?}"));
        }
        if let Some(first) = known.insert(sentence.as_str(), row) {
            findings.add(
                "tasks",
                metadata.tasks_file,
                place,
                "a unique sentence",
                format!("that of row {first}: {sentence}"),
            );
        }
    }
    for episode in &metadata.episodes {
        if episode.sentences != 1 || !known.contains_key(episode.sentence.as_str()) {
            let found = format!("{} sentences, {:?}", episode.sentences, episode.sentence);
            let place = format!("{}, tasks", episode.place());
            findings.add(
                "tasks",
                &episode.listed_in.0,
                place,
                format!("one sentence of {}", metadata.tasks_file),
                found,
            );
        }
    }
    let used: BTreeSet<&str> = metadata.episodes.iter().map(|episode| episode.sentence.as_str()).collect();
    for (sentence, row) in known {
        if !used.contains(sentence) {
            findings.add("tasks", metadata.tasks_file, format!("row {row}"), "a sentence used by an episode", sentence);
        }
    }
}

fn contract(metadata: &Metadata, findings: &mut Findings) {
    let Some(contract) = &metadata.contract else {
        let has_actions = metadata.info.features.iter().any(|feature| feature.key == "action");
        if metadata.is_own && has_actions {
            findings.add("contract", CONTRACT, "", "an action contract", "none that can be read");
        }
        return;
    };
    if (contract.rate_hz - metadata.info.fps).abs() > 1e-9 {
        findings.add("contract", CONTRACT, "rate_hz", metadata.info.fps, contract.rate_hz);
    }
    findings.require("contract", CONTRACT, "robot", &metadata.info.robot, &contract.robot);
    match metadata.info.features.iter().find(|feature| feature.key == "action") {
        Some(action) => findings.require("contract", CONTRACT, "names", &action.names, &contract.names),
        None => findings.add("contract", CONTRACT, "", "a feature `action` in info.json", "none"),
    }
    let spec = &contract.action;
    if let Err(error) = spec.check() {
        findings.add("contract", CONTRACT, error.what, error.expected, error.got);
    }
    let state = metadata.info.features.iter().find(|feature| feature.key == "observation.state");
    let dof = state.map_or(0, |state| state.width().saturating_sub(1));
    let length = if spec.space.is_joint() { dof + 1 } else { spec.length(dof) };
    if dof > 0 && contract.names.len() != length {
        let expected = format!("{length} numbers, the length of {spec}");
        findings.add("contract", CONTRACT, "names", expected, format!("{} names", contract.names.len()));
    }
    let joints: Vec<&str> = state
        .into_iter()
        .flat_map(|state| &state.names)
        .map(|name| name.strip_suffix(".pos").unwrap_or(name))
        .take(dof)
        .collect();
    if contract.names.len() == length && joints.len() == dof && spec.names(&joints) != contract.names {
        findings.require("contract", CONTRACT, "names", &spec.names(&joints), &contract.names);
    }
}

/// Checks the copy of `info.json` in the data set's `README.md`.
fn card(metadata: &Metadata, findings: &mut Findings) {
    let Some(text) =
        metadata.is_own.then(|| files::read(&metadata.root.join("README.md"), limits::SETTINGS).ok()).flatten()
    else {
        return;
    };
    let text = String::from_utf8_lossy(&text);
    let block = text.split("```json").nth(1).and_then(|rest| rest.split("```").next());
    let copy = block.and_then(|block| serde_json::from_str::<Value>(block).ok());
    match copy {
        Some(copy) if copy == metadata.info.json => {}
        Some(_) => findings.add("card", "README.md", "Structure", "a copy of meta/info.json", "another info.json"),
        None => findings.add("card", "README.md", "Structure", "a copy of meta/info.json", "no JSON"),
    }
}

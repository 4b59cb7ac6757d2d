//! A data set opened as source of episodes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use arrow_array::RecordBatch;
use genmanip_core::{ActionContract, Document, limits};
use serde_json::{Value, json};

use genmanip_data::columns::{cell, integer, text};
use genmanip_data::lerobot::imported::SOURCE_HASH;
use genmanip_data::lerobot::origin::Origin;
use genmanip_data::lerobot::{CONTRACT, RECORD, SUBTASKS, info};
use genmanip_data::mp4::Video;
use genmanip_data::table::{self, RowGroups, Table};
use genmanip_data::{DataError, EncodedVideo, EpisodeStore, files};

/// An exported or imported data set of this program.
pub(super) struct Source {
    pub(super) root: PathBuf,
    pub(super) origin: Origin,
    pub(super) contract: Option<ActionContract>,
    pub(super) info: Value,
    /// Paths of the episodes tables, in order.
    pub(super) tables: Vec<PathBuf>,
    pub(super) episodes: Vec<EpisodeEntry>,
    /// Instructions of the data set's steps (subtasks), by index; empty if it has none.
    pub(super) subtasks: Vec<String>,
    /// Native record of the episodes, if included; `None` otherwise.
    pub(super) record: Option<EpisodeStore>,
    /// Index of the first row in each data file, by chunk and file.
    firsts: BTreeMap<[i64; 2], i64>,
}

/// Metadata of an episode, kept in memory.
#[derive(Clone, Debug)]
pub(super) struct EpisodeEntry {
    pub(super) sentence: String,
    pub(super) store_id: String,
    /// Distinguishes episodes of the same name: the episode's seed, or the hash of its source if imported.
    pub(super) origin: String,
    pub(super) length: usize,
    from: i64,
    /// Chunk and file index of the episode's data file.
    data: [i64; 2],
    /// Feature, chunk and file index, and start time (s) of each video.
    videos: Vec<(String, [i64; 2], f64)>,
    /// Index of the episodes table, and row in it.
    listed_in: (usize, usize),
}

impl Source {
    pub(super) fn open(root: &Path) -> Result<Self, DataError> {
        let read = |name: &str| files::read(&root.join(name), limits::SETTINGS);
        let document = |name: &str, source| DataError::Document { path: root.join(name), source };
        let origin = Origin::read(root)?;
        let contract = match read(CONTRACT) {
            Err(error) if error.is_missing() => None,
            bytes => Some(ActionContract::from_bytes(&bytes?).map_err(|error| document(CONTRACT, error))?),
        };
        let info = info::read(root)?;
        let record = root.join(RECORD);
        let record = if origin.has_record() && contract.is_some() { Some(EpisodeStore::open(record)?) } else { None };
        let tables = table::files_below(&root.join("meta/episodes"))?;
        let mut source = Self {
            root: root.into(),
            origin,
            contract,
            info,
            tables,
            episodes: Vec::new(),
            subtasks: Vec::new(),
            record,
            firsts: BTreeMap::new(),
        };
        source.list()?;
        if source.features(false).any(|key| key == "subtask_index") {
            let table = Table::open(&root.join(SUBTASKS))?.whole(|_| true)?;
            let known = (0..table.num_rows()).filter_map(|row| text(&table, "subtask", row));
            source.subtasks = known.map(|(text, _)| text).collect();
        }
        Ok(source)
    }

    /// Path of the data file that holds an episode.
    pub(super) fn data(&self, episode: &EpisodeEntry) -> PathBuf {
        let [chunk, file] = episode.data;
        self.root.join(format!("data/chunk-{chunk:03}/file-{file:03}.parquet"))
    }

    /// Path of the episodes table that lists an episode.
    pub(super) fn table(&self, episode: &EpisodeEntry) -> &Path {
        &self.tables[episode.listed_in.0]
    }

    /// Names of the video features (`is_video`) or of the numeric ones.
    pub(super) fn features(&self, is_video: bool) -> impl Iterator<Item = &String> {
        let fits = move |entry: &Value| match entry["dtype"].as_str() {
            Some("video") => is_video,
            Some("image") => false,
            _ => !is_video,
        };
        self.info["features"]
            .as_object()
            .into_iter()
            .flatten()
            .filter(move |(_, entry)| fits(entry))
            .map(|(key, _)| key)
    }

    fn list(&mut self) -> Result<(), DataError> {
        let keys: Vec<String> = self.features(true).cloned().collect();
        for (number, path) in self.tables.iter().enumerate() {
            let is_light = |name: &str| !name.starts_with("stats/") && name != "scenario_json";
            let batch = Table::open(path)?.whole(is_light)?;
            for row in 0..batch.num_rows() {
                let missing = |name: &str| DataError::table(path, format!("no `{name}` in row {row}"));
                let integer_of = |name: &str| integer(&batch, name, row).ok_or_else(|| missing(name));
                let word = |name: &str| text(&batch, name, row).map(|(text, _)| text).ok_or_else(|| missing(name));
                let index = integer_of("episode_index")?;
                if usize::try_from(index).ok() != Some(self.episodes.len()) {
                    return Err(DataError::table(
                        path,
                        format!("expected episode {}, got {index}", self.episodes.len()),
                    ));
                }
                let mut videos = Vec::new();
                for key in &keys {
                    let place = |name: &str| format!("videos/{key}/{name}");
                    let from = place("from_timestamp");
                    let from_s = cell(&batch, &from, row).and_then(|cell| cell.first().copied());
                    let file = [integer_of(&place("chunk_index"))?, integer_of(&place("file_index"))?];
                    videos.push((key.clone(), file, from_s.ok_or_else(|| missing(&from))?));
                }
                let from = integer_of("dataset_from_index")?;
                let data = [integer_of("data/chunk_index")?, integer_of("data/file_index")?];
                let first = self.firsts.entry(data).or_insert(from);
                *first = from.min(*first);
                self.episodes.push(EpisodeEntry {
                    sentence: word("tasks")?,
                    store_id: word("store_id")?,
                    origin: match text(&batch, SOURCE_HASH, row) {
                        Some((hash, _)) => hash,
                        None => integer_of("seed")?.to_string(),
                    },
                    length: usize::try_from(integer_of("length")?).map_err(|_| missing("length"))?,
                    from,
                    data,
                    videos,
                    listed_in: (number, row),
                });
            }
        }
        if self.episodes.is_empty() {
            return Err(DataError::mismatch(
                format!("episodes in {}", self.root.join("meta/episodes").display()),
                "at least one",
                0,
            ));
        }
        Ok(())
    }

    /// Checks that two data sets can be merged; the error names the first difference.
    pub(super) fn check_fits(&self, first: &Self) -> Result<(), DataError> {
        let label = |source: &Self, what: &str| format!("{what} of {}", source.root.display());
        let fits = |what: &str, known: &Value, found: &Value| {
            if known == found {
                return Ok(());
            }
            let expected = format!("that of {}: {}", first.root.display(), shortened(known));
            Err(DataError::mismatch(label(self, what), expected, shortened(found)))
        };
        for key in ["robot_type", "fps"] {
            fits(key, &first.info[key], &self.info[key])?;
        }
        let [known, found] = [first, self].map(|source| &source.info["features"]);
        let keys = |features: &Value| features.as_object().into_iter().flatten().map(|(key, _)| key.clone()).collect();
        let (known_keys, found_keys): (Vec<String>, Vec<String>) = (keys(known), keys(found));
        fits("features", &Value::from(known_keys.clone()), &Value::from(found_keys))?;
        for key in known_keys {
            fits(&format!("feature {key}"), &known[&key], &found[&key])?;
        }
        let contract = |source: &Self| source.contract.as_ref().map_or(Value::Null, Document::to_value);
        fits("action contract", &contract(first), &contract(self))?;
        fits("export settings", &first.origin.comparable(), &self.origin.comparable())
    }
}

fn shortened(value: &Value) -> String {
    let text = value.to_string();
    let more = if text.chars().count() > 300 { "…" } else { "" };
    text.chars().take(300).collect::<String>() + more
}

/// Cache of open files: the last one of each kind.
#[derive(Default)]
pub(super) struct OpenFiles {
    rows: Option<(PathBuf, RowGroups)>,
    videos: BTreeMap<String, (PathBuf, Video)>,
    episodes: Option<(PathBuf, RecordBatch)>,
}

impl OpenFiles {
    /// Rows of an episode in its data file.
    pub(super) fn rows(&mut self, source: &Source, episode: &EpisodeEntry) -> Result<RecordBatch, DataError> {
        let path = source.data(episode);
        if self.rows.as_ref().is_none_or(|(known, _)| *known != path) {
            self.rows = Some((path.clone(), RowGroups::open(&path)?));
        }
        let first = source.firsts.get(&episode.data).copied().unwrap_or_default();
        let from = usize::try_from(episode.from - first).unwrap_or(usize::MAX);
        match &self.rows {
            Some((_, rows)) => rows.read(from, episode.length),
            None => Err(DataError::table(&path, "not opened")),
        }
    }

    /// Row of an episode in its episodes table.
    pub(super) fn row(&mut self, source: &Source, episode: &EpisodeEntry) -> Result<RecordBatch, DataError> {
        let (_, row) = episode.listed_in;
        let path = source.table(episode);
        if self.episodes.as_ref().is_none_or(|(known, _)| known != path) {
            self.episodes = Some((path.into(), Table::open(path)?.whole(|_| true)?));
        }
        match &self.episodes {
            Some((_, batch)) if row < batch.num_rows() => Ok(batch.slice(row, 1)),
            _ => Err(DataError::table(path, "truncated while it was read")),
        }
    }

    /// Video frames of an episode by feature, not re-encoded.
    pub(super) fn videos(
        &mut self,
        source: &Source,
        episode: &EpisodeEntry,
    ) -> Result<Vec<(String, EncodedVideo)>, DataError> {
        let fps = source.origin.fps();
        let mut videos = Vec::new();
        for (key, [chunk, file], from_s) in &episode.videos {
            let path = source.root.join(format!("videos/{key}/chunk-{chunk:03}/file-{file:03}.mp4"));
            if self.videos.get(key).is_none_or(|(known, _)| *known != path) {
                self.videos.insert(key.clone(), (path.clone(), Video::open(&path)?));
            }
            let Some((_, video)) = self.videos.get_mut(key) else { continue };
            let (size, found) = (&source.info["features"][key]["shape"], json!([video.height, video.width, 3]));
            if *size != found {
                let what = format!("shape of {}", path.display());
                return Err(DataError::mismatch(what, format!("{size}, according to meta/info.json"), found));
            }
            let from = (from_s * f64::from(fps)).round() as usize;
            let unreadable = |frame: usize| DataError::Video(format!("no frame {frame} in {}", path.display()));
            let frame = |frame: usize| video.frame(frame, false).ok_or_else(|| unreadable(frame));
            let frames = (from..from.saturating_add(episode.length)).map(frame).collect::<Result<Vec<_>, _>>()?;
            videos.push((key.clone(), EncodedVideo { width: video.width, height: video.height, fps, frames }));
        }
        Ok(videos)
    }
}

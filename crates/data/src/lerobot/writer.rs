//! Writes one data set, episode by episode, in constant memory but for statistics and the videos of one file.

use std::path::{Path, PathBuf};

use genmanip_core::limits;
use genmanip_core::{ActionContract, Document};
use serde_json::Value;

use super::LerobotSettings;
use super::episodes::{self, EpisodeEntry, VideoSpan};
use super::features;
use super::info::{self, FILES_PER_CHUNK};
use super::stats::{Collected, Stats};
use crate::aside::{self, Aside};
use crate::export::EpisodeRows;
use crate::export::features::{Feature, Values, VideoFeature};
use crate::table::{Purpose, TableWriter};
use crate::{DataError, EncodedVideo, EpisodeStore, files, video};

/// A data set under construction.
pub(crate) struct DatasetWriter {
    aside: Aside,
    fps: u32,
    robot: String,
    episodes_per_file: usize,
    /// `features` of `info.json`, as the first episode has them; every other must have the same.
    features: Option<Value>,
    tasks: Vec<String>,
    episodes: usize,
    frames: usize,
    collected: Collected,
    file: OpenFile,
}

/// What goes into the files of the current index.
#[derive(Default)]
struct OpenFile {
    table: Option<TableWriter>,
    videos: Vec<(String, Vec<EncodedVideo>)>,
    frames: usize,
    entries: Vec<EpisodeEntry>,
}

/// A complete data set that is not visible yet.
pub(crate) struct Finished(Aside);

impl DatasetWriter {
    pub(crate) fn new(target: &Path, episodes_per_file: usize, fps: u32, robot: &str) -> Result<Self, DataError> {
        files::sweep(aside::parent(target))?;
        Ok(Self {
            aside: Aside::replacing(target)?,
            fps,
            robot: robot.into(),
            episodes_per_file,
            features: None,
            tasks: Vec::new(),
            episodes: 0,
            frames: 0,
            collected: Collected::default(),
            file: OpenFile::default(),
        })
    }

    pub(crate) fn frames(&self) -> usize {
        self.frames
    }

    /// Appends an episode as one row group.
    pub(crate) fn push(&mut self, mut rows: EpisodeRows) -> Result<(), DataError> {
        if self.episodes > 0 && self.episodes.is_multiple_of(self.episodes_per_file) {
            self.close_file()?;
        }
        let task = self.task_index(&rows.facts.instruction);
        rows.features.extend(self.bookkeeping(rows.frames, task));
        self.check_features(&rows)?;

        let batch = features::batch(&rows.images, &rows.features)?;
        if self.file.table.is_none() {
            self.file.table = Some(TableWriter::new(Path::new("data"), batch.schema(), Purpose::Dataset)?);
        }
        if let Some(table) = &mut self.file.table {
            table.write(&batch)?;
        }
        let entry = self.entry(&rows);
        for feature in &rows.features {
            self.collected.add(feature);
        }
        for video in rows.videos {
            self.collected.add_colors(&video.key, &video.colors, rows.frames);
            match self.file.videos.iter_mut().find(|(key, _)| *key == video.key) {
                Some((_, videos)) => videos.push(video.video),
                None => self.file.videos.push((video.key, vec![video.video])),
            }
        }
        self.file.entries.push(entry);
        self.file.frames += rows.frames;
        self.frames += rows.frames;
        self.episodes += 1;
        Ok(())
    }

    /// Carries the native record of an episode along.
    pub(crate) fn copy_record(&self, store: &EpisodeStore, id: &str) -> Result<(), DataError> {
        let mark = self.aside.path("extras/record/store.json")?;
        if !mark.exists() {
            let text = files::read_own(&store.root().join("store.json"), limits::STORE_MARK)?;
            aside::write_synced(&mark, &text)?;
        }
        let folder: PathBuf = self.aside.path(&format!("extras/record/{id}"))?;
        std::fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
        store.copy_record(id, &folder)
    }

    /// Writes what describes the whole; a data set with actions has their contract.
    pub(crate) fn finish(
        mut self,
        card: &str,
        settings: &LerobotSettings,
        contract: Option<&ActionContract>,
    ) -> Result<Finished, DataError> {
        self.close_file()?;
        let features = self.features.take().unwrap_or_default();
        let has_video = features.as_object().is_some_and(|all| all.values().any(|entry| entry["dtype"] == "video"));
        let totals = info::Totals { episodes: self.episodes, frames: self.frames, tasks: self.tasks.len() };
        let info = info::info(&self.robot, &totals, self.fps, features, has_video);
        self.write_json("meta/info.json", &info)?;
        self.write_json("meta/stats.json", &self.collected.to_json())?;
        self.write_json("meta/genmanip.json", &info::meaning(settings))?;
        self.aside.write(super::SETTINGS, settings.to_json().as_bytes())?;
        if let Some(contract) = contract {
            self.aside.write(super::CONTRACT, contract.to_json().as_bytes())?;
        }
        self.aside.write("meta/tasks.parquet", &episodes::tasks_table(&self.tasks)?)?;
        self.aside.write("README.md", info::card_with_info(card, &info).as_bytes())?;
        Ok(Finished(self.aside))
    }

    fn close_file(&mut self) -> Result<(), DataError> {
        let OpenFile { table, videos, entries, .. } = std::mem::take(&mut self.file);
        let Some(first) = entries.first() else { return Ok(()) };
        let (chunk, file) = (first.chunk, first.file);
        let name = |ending: &str| format!("chunk-{chunk:03}/file-{file:03}.{ending}");
        if let Some(table) = table {
            self.aside.write(&format!("data/{}", name("parquet")), &table.finish()?)?;
        }
        for (key, videos) in videos {
            self.aside.write(&format!("videos/{key}/{}", name("mp4")), &video::mux_mp4(&videos)?)?;
        }
        self.aside.write(&format!("meta/episodes/{}", name("parquet")), &episodes::episodes_table(&entries)?)
    }

    fn entry(&self, rows: &EpisodeRows) -> EpisodeEntry {
        let number = self.episodes / self.episodes_per_file;
        let time_s = |frames: usize| frames as f64 / f64::from(self.fps);
        let span = |video: &VideoFeature| VideoSpan {
            key: video.key.clone(),
            from_s: time_s(self.file.frames),
            to_s: time_s(self.file.frames + rows.frames),
            stats: Stats::of_colors(&video.colors, rows.frames),
        };
        let stats = |feature: &Feature| (feature.key.clone(), Stats::of_vectors(&feature.numbers(), feature.length()));
        EpisodeEntry {
            episode: self.episodes,
            chunk: number / FILES_PER_CHUNK,
            file: number % FILES_PER_CHUNK,
            from: self.frames,
            length: rows.frames,
            videos: rows.videos.iter().map(span).collect(),
            stats: rows.features.iter().map(stats).collect(),
            facts: rows.facts.clone(),
        }
    }

    /// The five columns every data set has.
    fn bookkeeping(&self, frames: usize, task: usize) -> Vec<Feature> {
        let number = |value: usize| i64::try_from(value).unwrap_or(i64::MAX);
        let repeated = |value: usize| Values::I64(vec![number(value); frames]);
        let fps = f64::from(self.fps);
        vec![
            Feature::new("timestamp", &[], Values::F32((0..frames).map(|row| (row as f64 / fps) as f32).collect())),
            Feature::new("frame_index", &[], Values::I64((0..frames).map(number).collect())),
            Feature::new("episode_index", &[], repeated(self.episodes)),
            Feature::new("index", &[], Values::I64((0..frames).map(|row| number(self.frames + row)).collect())),
            Feature::new("task_index", &[], repeated(task)),
        ]
    }

    fn task_index(&mut self, instruction: &str) -> usize {
        if let Some(index) = self.tasks.iter().position(|task| task == instruction) {
            return index;
        }
        self.tasks.push(instruction.into());
        self.tasks.len() - 1
    }

    fn check_features(&mut self, rows: &EpisodeRows) -> Result<(), DataError> {
        let mut described = serde_json::Map::new();
        described.extend(rows.videos.iter().map(|video| (video.key.clone(), video.describe())));
        described.extend(rows.images.iter().map(|image| (image.key.clone(), image.describe())));
        described.extend(rows.features.iter().map(|feature| (feature.key.clone(), feature.describe())));
        let described = Value::Object(described);
        match &self.features {
            Some(first) if *first != described => {
                let what = format!("features of episode {}", rows.facts.result.id);
                Err(DataError::mismatch(what, first, described))
            }
            Some(_) => Ok(()),
            None => {
                self.features = Some(described);
                Ok(())
            }
        }
    }

    fn write_json(&self, name: &str, value: &Value) -> Result<(), DataError> {
        let text = serde_json::to_string_pretty(value)
            .map_err(|error| DataError::NotWritable { what: name.into(), why: error.to_string() })?;
        self.aside.write(name, (text + "\n").as_bytes())
    }
}

impl Finished {
    /// Makes the data set visible.
    pub(crate) fn publish(self) -> Result<(), DataError> {
        self.0.publish()
    }
}

//! Writes one data set, episode by episode, in constant memory but for the videos of one file.

use std::path::Path;

use genmanip_core::{ActionContract, Document};

use super::episodes::{self, Entries, EpisodeEntry, VideoSpan};
use super::info::{self, FILES_PER_CHUNK};
use super::ledger::Ledger;
use super::made::Made;
use super::stats::Stats;
use super::{SUBTASKS, features, record};
use crate::aside::{Aside, write_json};
use crate::export::EpisodeRows;
use crate::export::facts::EpisodeFacts;
use crate::export::features::{Feature, VideoFeature};
use crate::table::{Purpose, TableWriter};
use crate::{DataError, EncodedVideo, EpisodeStore, video};

/// A data set under construction.
pub(crate) struct DatasetWriter<F = EpisodeFacts> {
    aside: Aside,
    robot: String,
    episodes_per_file: usize,
    ledger: Ledger,
    file: OpenFile<F>,
}

/// What goes into the files of the current index.
struct OpenFile<F> {
    table: Option<TableWriter>,
    videos: Vec<(String, Vec<EncodedVideo>)>,
    frames: usize,
    entries: Vec<EpisodeEntry<F>>,
}

impl<F> Default for OpenFile<F> {
    fn default() -> Self {
        Self { table: None, videos: Vec::new(), frames: 0, entries: Vec::new() }
    }
}

/// A complete data set that is not visible yet.
pub(crate) struct Finished(pub(crate) Aside);

impl<F: Entries> DatasetWriter<F> {
    pub(crate) fn new(aside: Aside, episodes_per_file: usize, fps: u32, robot: &str) -> Self {
        Self {
            robot: robot.into(),
            episodes_per_file,
            ledger: Ledger::new(fps, aside.folder()),
            aside,
            file: OpenFile::default(),
        }
    }

    pub(crate) fn episodes(&self) -> usize {
        self.ledger.episodes
    }

    pub(crate) fn frames(&self) -> usize {
        self.ledger.frames
    }

    /// Appends an episode as one row group.
    pub(crate) fn push(&mut self, mut rows: EpisodeRows<F>) -> Result<(), DataError> {
        let episodes = self.ledger.episodes;
        if episodes > 0 && episodes.is_multiple_of(self.episodes_per_file) {
            self.close_file()?;
        }
        self.ledger.admit(&mut rows)?;
        let batch = features::batch(&rows.images, &rows.features)?;
        if self.file.table.is_none() {
            self.file.table = Some(TableWriter::new(Path::new("data"), batch.schema(), Purpose::Dataset)?);
        }
        if let Some(table) = &mut self.file.table {
            table.write(&batch)?;
        }
        let entry = self.entry(&rows);
        for video in rows.videos {
            match self.file.videos.iter_mut().find(|(key, _)| *key == video.key) {
                Some((_, videos)) => videos.push(video.video),
                None => self.file.videos.push((video.key, vec![video.video])),
            }
        }
        self.file.entries.push(entry);
        self.file.frames += rows.frames;
        self.ledger.count(rows.frames);
        Ok(())
    }

    /// Carries the native record of an episode along.
    pub(crate) fn copy_record(&self, store: &EpisodeStore, id: &str) -> Result<(), DataError> {
        record::copy(&self.aside, store, id)
    }

    /// Writes what describes the whole; a data set with actions has their contract.
    pub(crate) fn finish(
        mut self,
        card: &str,
        made: &Made,
        contract: Option<&ActionContract>,
    ) -> Result<Finished, DataError> {
        self.close_file()?;
        let features = self.ledger.features.take().unwrap_or_default();
        let has_video = features.as_object().is_some_and(|all| all.values().any(|entry| entry["dtype"] == "video"));
        let totals =
            info::Totals { episodes: self.ledger.episodes, frames: self.ledger.frames, tasks: self.ledger.tasks.len() };
        let info = info::info(&self.robot, &totals, self.ledger.fps, features, has_video);
        write_json(&self.aside, info::INFO, &info)?;
        write_json(&self.aside, "meta/stats.json", &self.ledger.collected.finish()?)?;
        made.write(&self.aside, None)?;
        if let Some(contract) = contract {
            self.aside.write(super::CONTRACT, contract.to_json().as_bytes())?;
        }
        self.aside.write("meta/tasks.parquet", &episodes::tasks_table(&self.ledger.tasks)?)?;
        if !self.ledger.subtasks.is_empty() {
            self.aside.write(SUBTASKS, &episodes::subtasks_table(&self.ledger.subtasks)?)?;
        }
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

    fn entry(&self, rows: &EpisodeRows<F>) -> EpisodeEntry<F> {
        let number = self.ledger.episodes / self.episodes_per_file;
        let time_s = |frames: usize| frames as f64 / f64::from(self.ledger.fps);
        let span = |video: &VideoFeature| VideoSpan {
            key: video.key.clone(),
            from_s: time_s(self.file.frames),
            to_s: time_s(self.file.frames + rows.frames),
            stats: Stats::of_colors(&video.colors, rows.frames),
        };
        let stats = |feature: &Feature| (feature.key.clone(), Stats::of_vectors(&feature.numbers(), feature.length()));
        EpisodeEntry {
            episode: self.ledger.episodes,
            chunk: number / FILES_PER_CHUNK,
            file: number % FILES_PER_CHUNK,
            from: self.ledger.frames,
            length: rows.frames,
            videos: rows.videos.iter().map(span).collect(),
            stats: rows.features.iter().map(stats).collect(),
            facts: rows.facts.clone(),
        }
    }
}

impl Finished {
    /// Makes the data set visible.
    pub(crate) fn publish(self) -> Result<(), DataError> {
        self.0.publish()
    }
}

//! Writer of one v3.0 data set; memory is bounded by the videos of one file.

use std::path::Path;

use genmanip_core::ActionContract;

use super::dataset_metadata::DatasetMetadata;
use super::episodes::{self, EpisodeColumns, EpisodeEntry, VideoSpan};
use super::info::{self, FILES_PER_CHUNK};
use super::metadata_files::MetadataFiles;
use super::origin::Origin;
use super::stats::Stats;
use super::{features, record};
use crate::atomic_write::AtomicFolder;
use crate::export::EpisodeRows;
use crate::export::features::{Feature, VideoFeature};
use crate::export::metadata::EpisodeMetadata;
use crate::table::{Purpose, TableWriter};
use crate::{DataError, EncodedVideo, EpisodeStore, video};

/// A data set under construction.
pub struct DatasetWriter<F = EpisodeMetadata> {
    staging: AtomicFolder,
    robot: String,
    episodes_per_file: usize,
    metadata: DatasetMetadata,
    file: OpenFile<F>,
}

/// Contents of the data and video files that are being filled.
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

/// A complete but unpublished data set.
pub struct Finished(pub AtomicFolder);

impl<F: EpisodeColumns> DatasetWriter<F> {
    /// Writer without episodes, into the unpublished folder `staging`.
    pub fn new(staging: AtomicFolder, episodes_per_file: usize, fps: u32, robot: &str) -> Self {
        Self {
            robot: robot.into(),
            episodes_per_file,
            metadata: DatasetMetadata::new(fps, staging.folder()),
            staging,
            file: OpenFile::default(),
        }
    }

    /// Number of episodes written so far.
    pub fn episodes(&self) -> usize {
        self.metadata.episodes
    }

    /// Number of rows written so far.
    pub fn frames(&self) -> usize {
        self.metadata.frames
    }

    /// Appends an episode as one row group.
    pub fn push(&mut self, mut rows: EpisodeRows<F>) -> Result<(), DataError> {
        let episodes = self.metadata.episodes;
        if episodes > 0 && episodes.is_multiple_of(self.episodes_per_file) {
            self.close_file()?;
        }
        self.metadata.begin_episode(&mut rows)?;
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
        self.metadata.end_episode(rows.frames);
        Ok(())
    }

    /// Copies the native record of an episode into the data set.
    pub fn copy_record(&self, store: &EpisodeStore, id: &str) -> Result<(), DataError> {
        record::copy(&self.staging, store, id)
    }

    /// Writes the remaining files and the metadata; `contract` describes the actions, if there are any.
    pub fn finish(
        mut self,
        card: &str,
        origin: &Origin,
        contract: Option<&ActionContract>,
    ) -> Result<Finished, DataError> {
        self.close_file()?;
        let features = self.metadata.features.take().unwrap_or_default();
        let has_video = features.as_object().is_some_and(|all| all.values().any(|entry| entry["dtype"] == "video"));
        let totals = info::Totals {
            episodes: self.metadata.episodes,
            frames: self.metadata.frames,
            tasks: self.metadata.tasks.len(),
        };
        let info = info::info(&self.robot, &totals, self.metadata.fps, features, has_video);
        let stats = self.metadata.stats_collector.finish()?;
        let files = MetadataFiles { info: &info, stats: &stats, statistics_note: None, origin, contract, card };
        files.write_v30(&self.staging, &self.metadata.tasks, &self.metadata.subtasks)?;
        Ok(Finished(self.staging))
    }

    fn close_file(&mut self) -> Result<(), DataError> {
        let OpenFile { table, videos, entries, .. } = std::mem::take(&mut self.file);
        let Some(first) = entries.first() else { return Ok(()) };
        let (chunk, file) = (first.chunk, first.file);
        let name = |ending: &str| format!("chunk-{chunk:03}/file-{file:03}.{ending}");
        if let Some(table) = table {
            self.staging.write(&format!("data/{}", name("parquet")), &table.finish()?)?;
        }
        for (key, videos) in videos {
            self.staging.write(&format!("videos/{key}/{}", name("mp4")), &video::mux_mp4(&videos)?)?;
        }
        self.staging.write(&format!("meta/episodes/{}", name("parquet")), &episodes::episodes_table(&entries)?)
    }

    fn entry(&self, rows: &EpisodeRows<F>) -> EpisodeEntry<F> {
        let number = self.metadata.episodes / self.episodes_per_file;
        let time_s = |frames: usize| frames as f64 / f64::from(self.metadata.fps);
        let span = |video: &VideoFeature| VideoSpan {
            key: video.key.clone(),
            from_s: time_s(self.file.frames),
            to_s: time_s(self.file.frames + rows.frames),
            stats: Stats::of_colors(&video.colors, rows.frames),
        };
        let stats = |feature: &Feature| (feature.key.clone(), Stats::of_vectors(&feature.numbers(), feature.length()));
        EpisodeEntry {
            episode: self.metadata.episodes,
            chunk: number / FILES_PER_CHUNK,
            file: number % FILES_PER_CHUNK,
            from: self.metadata.frames,
            length: rows.frames,
            videos: rows.videos.iter().map(span).collect(),
            stats: rows.features.iter().map(stats).collect(),
            metadata: rows.metadata.clone(),
        }
    }
}

impl Finished {
    /// Renames the folder to its final name.
    pub fn publish(self) -> Result<(), DataError> {
        self.0.publish()
    }
}

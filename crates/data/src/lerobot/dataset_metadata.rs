//! Metadata accumulated while episodes are written, common to all versions of the format: features, instructions,
//! indices and statistics.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use super::stats::StatsCollector;
use crate::DataError;
use crate::export::EpisodeRows;
use crate::export::features::{Feature, Values};
use crate::export::metadata::LanguageLabels;

/// Metadata of a data set under construction.
pub struct DatasetMetadata {
    pub fps: u32,
    /// `features` of `info.json` according to the first episode; all others must match. `None` before the first
    /// episode.
    pub features: Option<Value>,
    pub tasks: Vec<String>,
    /// Distinct instructions of steps (subtasks), in order of first use.
    pub subtasks: Vec<String>,
    /// Number of episodes and frames written so far.
    pub episodes: usize,
    pub frames: usize,
    pub stats_collector: StatsCollector,
}

impl DatasetMetadata {
    /// Empty metadata. Values are buffered in files in `folder` until their statistics are computed.
    pub fn new(fps: u32, folder: &Path) -> Self {
        Self {
            fps,
            features: None,
            tasks: Vec::new(),
            subtasks: Vec::new(),
            episodes: 0,
            frames: 0,
            stats_collector: StatsCollector::new(folder),
        }
    }

    /// Adds index columns to the rows of the next episode and accumulates their statistics.
    pub fn begin_episode<F: LanguageLabels>(&mut self, rows: &mut EpisodeRows<F>) -> Result<(), DataError> {
        let task = index_of(&mut self.tasks, rows.metadata.instruction());
        rows.features.extend(self.index_columns(rows.frames, task));
        if !rows.steps.is_empty() {
            let places: Vec<usize> =
                rows.metadata.steps().iter().map(|text| index_of(&mut self.subtasks, text)).collect();
            let indices = rows.steps.iter().map(|step| number(places.get(*step).copied().unwrap_or(0)));
            rows.features.push(Feature::new("subtask_index", &[], Values::I64(indices.collect())));
        }
        self.check_features(rows)?;
        for feature in &rows.features {
            self.stats_collector.add(&feature.key, feature.length(), &feature.numbers())?;
        }
        for video in &rows.videos {
            self.stats_collector.add_colors(&video.key, &video.colors, rows.frames);
        }
        Ok(())
    }

    /// Adds a written episode of `frames` rows to the totals.
    pub fn end_episode(&mut self, frames: usize) {
        self.episodes += 1;
        self.frames += frames;
    }

    /// LeRobot's five index columns for the next episode of `frames` rows.
    fn index_columns(&self, frames: usize, task: usize) -> Vec<Feature> {
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

    fn check_features<F: LanguageLabels>(&mut self, rows: &EpisodeRows<F>) -> Result<(), DataError> {
        let mut described = serde_json::Map::new();
        described.extend(rows.videos.iter().map(|video| (video.key.clone(), video.describe())));
        described.extend(rows.images.iter().map(|image| (image.key.clone(), image.describe())));
        described.extend(rows.features.iter().map(|feature| (feature.key.clone(), feature.describe())));
        let described = Value::Object(described);
        match &self.features {
            Some(first) if *first != described => {
                let none = serde_json::Map::new();
                let keys =
                    |features: &Value| features.as_object().unwrap_or(&none).keys().cloned().collect::<BTreeSet<_>>();
                let is_other = |key: &String| first.get(key) != described.get(key);
                let key = keys(first).union(&keys(&described)).find(|key| is_other(key)).cloned().unwrap_or_default();
                let what = format!("feature {key} of episode {}", rows.metadata.name());
                let shown = |features: &Value| features.get(&key).map_or("none".to_owned(), Value::to_string);
                let expected = format!("{}, as in the first episode", shown(first));
                Err(DataError::mismatch(what, expected, shown(&described)))
            }
            Some(_) => Ok(()),
            None => {
                self.features = Some(described);
                Ok(())
            }
        }
    }
}

/// Index of a sentence in a list; the sentence is appended if it is missing.
fn index_of(sentences: &mut Vec<String>, sentence: &str) -> usize {
    sentences.iter().position(|known| known == sentence).unwrap_or_else(|| {
        sentences.push(sentence.into());
        sentences.len() - 1
    })
}

fn number(value: usize) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

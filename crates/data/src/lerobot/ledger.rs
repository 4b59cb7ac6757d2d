//! What every version of the format keeps while episodes come in: features, sentences, indices and statistics.

use std::path::Path;

use serde_json::Value;

use super::stats::Collected;
use crate::DataError;
use crate::export::EpisodeRows;
use crate::export::facts::Told;
use crate::export::features::{Feature, Values};

/// The account of a data set under construction.
pub(crate) struct Ledger {
    pub(crate) fps: u32,
    /// `features` of `info.json`, as the first episode has them; every other must have the same.
    pub(crate) features: Option<Value>,
    pub(crate) tasks: Vec<String>,
    /// What steps are called, each once.
    pub(crate) subtasks: Vec<String>,
    /// Episodes and frames before the present one.
    pub(crate) episodes: usize,
    pub(crate) frames: usize,
    pub(crate) collected: Collected,
}

impl Ledger {
    /// Numbers are kept on the disk of `folder` until their statistics are taken.
    pub(crate) fn new(fps: u32, folder: &Path) -> Self {
        Self {
            fps,
            features: None,
            tasks: Vec::new(),
            subtasks: Vec::new(),
            episodes: 0,
            frames: 0,
            collected: Collected::new(folder),
        }
    }

    /// Gives the rows of the next episode their indices and takes their statistics.
    pub(crate) fn admit<F: Told>(&mut self, rows: &mut EpisodeRows<F>) -> Result<(), DataError> {
        let task = place_of(&mut self.tasks, rows.facts.instruction());
        rows.features.extend(self.bookkeeping(rows.frames, task));
        if !rows.steps.is_empty() {
            let places: Vec<usize> = rows.facts.steps().iter().map(|text| place_of(&mut self.subtasks, text)).collect();
            let indices = rows.steps.iter().map(|step| number(places.get(*step).copied().unwrap_or(0)));
            rows.features.push(Feature::new("subtask_index", &[], Values::I64(indices.collect())));
        }
        self.check_features(rows)?;
        for feature in &rows.features {
            self.collected.add(&feature.key, feature.length(), &feature.numbers())?;
        }
        for video in &rows.videos {
            self.collected.add_colors(&video.key, &video.colors, rows.frames);
        }
        Ok(())
    }

    /// Counts an episode that was written.
    pub(crate) fn count(&mut self, frames: usize) {
        self.episodes += 1;
        self.frames += frames;
    }

    /// The five columns every data set has.
    fn bookkeeping(&self, frames: usize, task: usize) -> Vec<Feature> {
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

    fn check_features<F: Told>(&mut self, rows: &EpisodeRows<F>) -> Result<(), DataError> {
        let mut described = serde_json::Map::new();
        described.extend(rows.videos.iter().map(|video| (video.key.clone(), video.describe())));
        described.extend(rows.images.iter().map(|image| (image.key.clone(), image.describe())));
        described.extend(rows.features.iter().map(|feature| (feature.key.clone(), feature.describe())));
        let described = Value::Object(described);
        match &self.features {
            Some(first) if *first != described => {
                let what = format!("features of episode {}", rows.facts.name());
                Err(DataError::mismatch(what, first, described))
            }
            Some(_) => Ok(()),
            None => {
                self.features = Some(described);
                Ok(())
            }
        }
    }
}

/// The place of a sentence in a list, to which it is added where it is missing.
fn place_of(sentences: &mut Vec<String>, sentence: &str) -> usize {
    sentences.iter().position(|known| known == sentence).unwrap_or_else(|| {
        sentences.push(sentence.into());
        sentences.len() - 1
    })
}

fn number(value: usize) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

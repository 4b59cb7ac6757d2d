//! Overview of a data set: task kinds and instructions with lengths and success, and the ranges of states and actions.

use std::collections::BTreeMap;

use serde::Serialize;

use super::metadata::{EpisodeEntry, Metadata};
use super::totals::Totals;

/// Episodes of one kind of task, or with one instruction if kinds are unknown.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Kind of the tasks, or the common instruction if kinds are unknown.
    pub kind: String,
    /// Number of distinct instructions in the group.
    pub sentences: usize,
    /// Number of episodes in the group.
    pub episodes: usize,
    /// Number of successful episodes; null if unknown.
    pub succeeded: Option<usize>,
    /// Minimum, median and maximum length of an episode, s.
    pub seconds: [f64; 3],
}

/// Minimum and maximum of one element of a feature.
#[derive(Clone, Debug, Serialize)]
pub struct Range {
    /// Names of feature and element, e.g. of a joint in `observation.state`.
    pub name: String,
    /// Minimum over all rows.
    pub min: f64,
    /// Maximum over all rows.
    pub max: f64,
}

/// Bin of the histogram of episode lengths.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Lower (inclusive) and upper (exclusive) bound, s.
    pub seconds: [f64; 2],
    /// Number of episodes with such a length.
    pub episodes: usize,
}

/// Number of bins of the histogram. Chosen by hand.
const BINS: usize = 10;

/// Contents of a data set.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Overview {
    /// Rate of the rows, Hz.
    pub fps: f64,
    /// Name of the robot; empty if unknown.
    pub robot: String,
    /// Short description of the action space; `None` if it is unknown.
    pub action: Option<String>,
    /// Names of the video features.
    pub videos: Vec<String>,
    /// Image features of all cameras, stored as videos or as single images.
    pub images: Vec<ImageFeature>,
    /// Groups of episodes by kind of task.
    pub groups: Vec<Group>,
    /// Groups of episodes by instruction.
    pub tasks: Vec<Group>,
    /// Histogram of the episodes' lengths.
    pub lengths: Vec<Bin>,
    /// Ranges of states and actions.
    pub ranges: Vec<Range>,
}

/// Images of one camera.
#[derive(Clone, Debug, Serialize)]
pub struct ImageFeature {
    /// Name of the feature, e.g. `observation.images.static`.
    pub key: String,
    /// Sizes along the dimensions in the order of the data set; rows, columns and channels in data sets of this
    /// program.
    pub shape: Vec<usize>,
    /// Storage of the images: `video` or `image`.
    pub stored_as: String,
}

pub(super) fn overview(metadata: &Metadata, totals: &Totals) -> Overview {
    let grouped = |name: &dyn Fn(&'_ EpisodeEntry) -> String| {
        let mut groups: BTreeMap<String, Vec<&EpisodeEntry>> = BTreeMap::new();
        for episode in &metadata.episodes {
            groups.entry(name(episode)).or_default().push(episode);
        }
        groups
    };
    let groups = grouped(&|episode| episode.kind.clone().unwrap_or_else(|| episode.sentence.clone()));
    let tasks = grouped(&|episode| episode.sentence.clone());
    let group = |(kind, episodes): (String, Vec<&EpisodeEntry>)| {
        let mut seconds: Vec<f64> = episodes.iter().map(|episode| episode.length as f64 / metadata.info.fps).collect();
        seconds.sort_by(f64::total_cmp);
        let at = |index: usize| seconds.get(index).copied().unwrap_or_default();
        let mut sentences: Vec<&str> = episodes.iter().map(|episode| episode.sentence.as_str()).collect();
        sentences.sort_unstable();
        sentences.dedup();
        let outcomes: Option<Vec<bool>> = episodes.iter().map(|episode| episode.success).collect();
        Group {
            kind,
            sentences: sentences.len(),
            episodes: episodes.len(),
            succeeded: outcomes.map(|outcomes| outcomes.into_iter().filter(|success| *success).count()),
            seconds: [at(0), at(seconds.len() / 2), at(seconds.len().saturating_sub(1))],
        }
    };
    let shown =
        metadata.info.features.iter().filter(|feature| ["observation.state", "action"].contains(&feature.key.as_str()));
    let ranges = shown.flat_map(|feature| {
        totals.range(&feature.key).into_iter().enumerate().map(|(entry, [min, max])| {
            let entry = feature.names.get(entry).cloned().unwrap_or_else(|| entry.to_string());
            Range { name: format!("{}.{entry}", feature.key), min, max }
        })
    });
    Overview {
        fps: metadata.info.fps,
        robot: metadata.info.robot.clone(),
        action: metadata.contract.as_ref().map(|contract| contract.action.to_string()),
        videos: metadata
            .info
            .features
            .iter()
            .filter(|feature| feature.is_video())
            .map(|feature| feature.key.clone())
            .collect(),
        images: metadata
            .info
            .features
            .iter()
            .filter(|feature| feature.is_video() || feature.is_image())
            .map(|feature| ImageFeature {
                key: feature.key.clone(),
                shape: feature.shape.clone(),
                stored_as: feature.dtype.clone(),
            })
            .collect(),
        groups: groups.into_iter().map(group).collect(),
        tasks: tasks.into_iter().map(group).collect(),
        lengths: lengths(metadata),
        ranges: ranges.collect(),
    }
}

/// Histogram of episode lengths; the bin width is a multiple of 0.1 s.
fn lengths(metadata: &Metadata) -> Vec<Bin> {
    let seconds: Vec<f64> = metadata.episodes.iter().map(|episode| episode.length as f64 / metadata.info.fps).collect();
    let finite = || seconds.iter().copied().filter(|length| length.is_finite());
    let (least, most) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    if least > most {
        return Vec::new();
    }
    let first = (least * 10.0).floor() / 10.0;
    let width = (((most - first) * 10.0 / BINS as f64).floor() + 1.0) / 10.0;
    let bin = |number: usize| {
        let [from, to] = [number, number + 1].map(|edge| ((first + edge as f64 * width) * 10.0).round() / 10.0);
        let place = |length: f64| ((length - first) / width).clamp(0.0, (BINS - 1) as f64) as usize;
        Bin { seconds: [from, to], episodes: finite().filter(|length| place(*length) == number).count() }
    };
    (0..BINS).map(bin).collect()
}

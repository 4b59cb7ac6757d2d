//! What is in a data set: kinds of tasks and tasks with lengths and success, and the range of states and actions.

use std::collections::BTreeMap;

use serde::Serialize;

use super::book::{Book, Listed};
use super::totals::Totals;

/// Episodes of a kind of task, or of a sentence where the data set tells no kinds.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// The kind, or the sentence.
    pub kind: String,
    /// Number of different sentences.
    pub sentences: usize,
    /// Number of episodes.
    pub episodes: usize,
    /// Of these, verified ones; null where the data set does not tell.
    pub succeeded: Option<usize>,
    /// Shortest, median and longest episode, s.
    pub seconds: [f64; 3],
}

/// Smallest and largest number of an entry of a feature.
#[derive(Clone, Debug, Serialize)]
pub struct Range {
    /// Feature and entry.
    pub name: String,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

/// Episodes of about one length.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Shortest that belongs to it, and the first that is too long for it, s.
    pub seconds: [f64; 2],
    /// Number of episodes.
    pub episodes: usize,
}

/// Bins of the histogram of lengths.
const BINS: usize = 10;

/// What is in a data set.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Overview {
    /// Rows per second.
    pub fps: f64,
    /// Robot.
    pub robot: String,
    /// What the actions mean, in a few words.
    pub action: Option<String>,
    /// Video features.
    pub videos: Vec<String>,
    /// By kind of task.
    pub groups: Vec<Group>,
    /// By sentence.
    pub tasks: Vec<Group>,
    /// How many episodes are how long.
    pub lengths: Vec<Bin>,
    /// Of states and actions.
    pub ranges: Vec<Range>,
}

pub(super) fn overview(book: &Book, totals: &Totals) -> Overview {
    let grouped = |name: &dyn Fn(&'_ Listed) -> String| {
        let mut groups: BTreeMap<String, Vec<&Listed>> = BTreeMap::new();
        for episode in &book.episodes {
            groups.entry(name(episode)).or_default().push(episode);
        }
        groups
    };
    let groups = grouped(&|episode| episode.kind.clone().unwrap_or_else(|| episode.sentence.clone()));
    let tasks = grouped(&|episode| episode.sentence.clone());
    let group = |(kind, episodes): (String, Vec<&Listed>)| {
        let mut seconds: Vec<f64> = episodes.iter().map(|episode| episode.length as f64 / book.info.fps).collect();
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
        book.info.features.iter().filter(|feature| ["observation.state", "action"].contains(&feature.key.as_str()));
    let ranges = shown.flat_map(|feature| {
        totals.range(&feature.key).into_iter().enumerate().map(|(entry, [min, max])| {
            let entry = feature.names.get(entry).cloned().unwrap_or_else(|| entry.to_string());
            Range { name: format!("{}.{entry}", feature.key), min, max }
        })
    });
    Overview {
        fps: book.info.fps,
        robot: book.info.robot.clone(),
        action: book.contract.as_ref().map(|contract| contract.action.to_string()),
        videos: book
            .info
            .features
            .iter()
            .filter(|feature| feature.is_video())
            .map(|feature| feature.key.clone())
            .collect(),
        groups: groups.into_iter().map(group).collect(),
        tasks: tasks.into_iter().map(group).collect(),
        lengths: lengths(book),
        ranges: ranges.collect(),
    }
}

/// The histogram of lengths; its bins are whole tenths of a second wide.
fn lengths(book: &Book) -> Vec<Bin> {
    let seconds: Vec<f64> = book.episodes.iter().map(|episode| episode.length as f64 / book.info.fps).collect();
    let sound = || seconds.iter().copied().filter(|length| length.is_finite());
    let (least, most) = sound().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
    if least > most {
        return Vec::new();
    }
    let first = (least * 10.0).floor() / 10.0;
    let width = (((most - first) * 10.0 / BINS as f64).floor() + 1.0) / 10.0;
    let bin = |number: usize| {
        let [from, to] = [number, number + 1].map(|edge| ((first + edge as f64 * width) * 10.0).round() / 10.0);
        let place = |length: f64| ((length - first) / width).clamp(0.0, (BINS - 1) as f64) as usize;
        Bin { seconds: [from, to], episodes: sound().filter(|length| place(*length) == number).count() }
    };
    (0..BINS).map(bin).collect()
}

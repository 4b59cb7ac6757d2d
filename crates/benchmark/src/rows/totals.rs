//! Totals over rows: success rates by group, and histograms of a quantity.

use serde::Serialize;

use super::{EpisodeRow, TaskRow};
use crate::statistics::{FailureCount, Rate, StatisticsSettings, failure_counts};

/// Success and failures of a group of episodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GroupTotal {
    /// Name of the group.
    pub name: String,
    /// Success rate of the group's episodes.
    pub rate: Rate,
    /// Failure causes of the group's episodes, most frequent first.
    pub failures: Vec<FailureCount>,
}

impl GroupTotal {
    /// Total of these episodes as a group of this name.
    pub fn of<'a>(name: &str, rows: impl IntoIterator<Item = &'a EpisodeRow>, statistics: &StatisticsSettings) -> Self {
        let rows: Vec<&EpisodeRow> = rows.into_iter().collect();
        Self {
            name: name.into(),
            rate: Rate::of(rows.iter().map(|row| row.outcome.success), statistics),
            failures: failure_counts(rows.iter().filter_map(|row| row.outcome.cause)),
        }
    }
}

/// Totals of these episodes by the groups that their tasks belong to, most failures first; a task may belong to several
/// groups.
pub fn by_group<'a, 'b>(
    tasks: &'a [TaskRow],
    rows: &[&'b EpisodeRow],
    groups: impl Fn(&'a TaskRow) -> Vec<&'a str>,
    statistics: &StatisticsSettings,
) -> Vec<GroupTotal> {
    let mut members: std::collections::BTreeMap<&str, Vec<&'b EpisodeRow>> = std::collections::BTreeMap::new();
    for row in rows {
        for group in tasks.get(row.task).map(&groups).unwrap_or_default() {
            members.entry(group).or_default().push(row);
        }
    }
    let mut totals: Vec<GroupTotal> =
        members.into_iter().map(|(name, rows)| GroupTotal::of(name, rows, statistics)).collect();
    totals.sort_by_key(|total| std::cmp::Reverse(total.rate.trials - total.rate.successes));
    totals
}

/// Histogram with bins of equal width.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Histogram {
    /// Lower end of the first bin, in the unit of the values.
    pub low: f64,
    /// Width of every bin, in the unit of the values.
    pub width: f64,
    /// Number of values per bin.
    pub counts: Vec<usize>,
    /// Median of all values.
    pub median: f64,
    /// 95th percentile of all values.
    pub p95: f64,
}

impl Histogram {
    /// Histogram of the finite values, with at most about `ranges` bins whose ends are round numbers; `None` without
    /// values.
    ///
    /// ```
    /// use genmanip_benchmark::rows::totals::Histogram;
    /// let spread = Histogram::of([1.0, 1.5, 2.5, 9.0], 10).unwrap();
    /// assert_eq!((spread.low, spread.width, spread.counts), (1.0, 1.0, vec![2, 1, 0, 0, 0, 0, 0, 0, 1]));
    /// ```
    pub fn of(figures: impl IntoIterator<Item = f64>, ranges: usize) -> Option<Self> {
        let mut figures: Vec<f64> = figures.into_iter().filter(|figure| figure.is_finite()).collect();
        figures.sort_by(f64::total_cmp);
        let (first, last) = (*figures.first()?, *figures.last()?);
        let least = ((last - first) / ranges.max(1) as f64).max(1e-3);
        let power = 10_f64.powf(least.log10().floor());
        let width = power * [1.0, 2.0, 5.0, 10.0].into_iter().find(|step| power * step >= least).unwrap_or(10.0);
        let low = (first / width).floor() * width;
        let range = |figure: f64| ((figure - low) / width).floor().max(0.0) as usize;
        let mut counts = vec![0; range(last) + 1];
        figures.iter().for_each(|&figure| counts[range(figure)] += 1);
        let at = |share: f64| figures[((figures.len() - 1) as f64 * share).round() as usize];
        Some(Self { low, width, counts, median: at(0.5), p95: at(0.95) })
    }
}

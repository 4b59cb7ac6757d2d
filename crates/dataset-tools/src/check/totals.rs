//! Streaming statistics over all rows, compared with those of the data set's metadata.

use std::collections::BTreeMap;

use serde_json::Value;

use super::findings::Findings;
use super::metadata::{Metadata, Statistics, Version};
use super::v30;
use genmanip_data::columns::{Column, Rows};

const STATS: &str = "meta/stats.json";
/// Quantiles in LeRobot's statistics: name and probability.
const QUANTILES: [(&str, f64); 5] = [("q01", 0.01), ("q10", 0.10), ("q50", 0.50), ("q90", 0.90), ("q99", 0.99)];
/// Relative tolerance of statistics: the order of summation differs.
const TOLERANCE: f64 = 1e-6;

/// Running statistics of one vector element.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) min: f64,
    pub(super) max: f64,
    sum: f64,
    /// Sum of squared differences from the recorded mean (`shift`), which avoids cancellation.
    squares: f64,
    shift: f64,
    /// For each of [`QUANTILES`]: recorded value, number of values below it, and number of values not above it.
    around: [(f64, usize, usize); 5],
}

/// Running statistics of a data set.
#[derive(Debug)]
pub(super) struct Totals {
    rows: usize,
    features: BTreeMap<String, (Vec<Entry>, Statistics)>,
}

impl Totals {
    pub(super) fn new(metadata: &Metadata) -> Self {
        let mut features = BTreeMap::new();
        for feature in metadata.info.features.iter().filter(|feature| !feature.is_video() && !feature.is_image()) {
            let recorded = v30::named(&metadata.stats[&feature.key]);
            let number = |name: &str, entry: usize| recorded.get(name).and_then(|values| values.get(entry)).copied();
            let entry = |index: usize| Entry {
                min: f64::INFINITY,
                max: f64::NEG_INFINITY,
                sum: 0.0,
                squares: 0.0,
                shift: number("mean", index).filter(|mean| mean.is_finite()).unwrap_or_default(),
                around: QUANTILES.map(|(name, _)| (number(name, index).unwrap_or(f64::NAN), 0, 0)),
            };
            let entries = (0..feature.width().min(4096)).map(entry).collect();
            features.insert(feature.key.clone(), (entries, recorded));
        }
        Self { rows: 0, features }
    }

    /// Number of rows so far.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Minimum and maximum over all rows of each element of a feature; empty for an unknown feature.
    pub(super) fn range(&self, key: &str) -> Vec<[f64; 2]> {
        let entries = self.features.get(key).map(|(entries, _)| entries.as_slice()).unwrap_or_default();
        entries.iter().map(|entry| [entry.min, entry.max]).collect()
    }

    pub(super) fn add(&mut self, rows: &Rows) {
        self.rows += rows.get("index").map_or(0, |column| column.values.len());
        for (key, column) in rows {
            let Some((entries, _)) = self.features.get_mut(key) else { continue };
            if entries.len() != column.width {
                continue;
            }
            for vector in column.values.chunks_exact(column.width) {
                for (entry, value) in entries.iter_mut().zip(vector) {
                    entry.add(*value);
                }
            }
        }
    }
}

impl Entry {
    fn add(&mut self, value: f64) {
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        self.sum += value;
        self.squares += (value - self.shift).powi(2);
        for (quantile, below, not_above) in &mut self.around {
            *below += usize::from(value < *quantile - tolerance(*quantile));
            *not_above += usize::from(value <= *quantile + tolerance(*quantile));
        }
    }
}

/// Compares `stats.json` with the rows.
pub(super) fn check(metadata: &Metadata, totals: &Totals, findings: &mut Findings) {
    // The tools of v2.0 computed statistics from samples and in single precision.
    if metadata.stats == Value::Null || totals.rows == 0 || metadata.info.version == Version::V20 {
        return;
    }
    let rows = totals.rows as f64;
    for (key, (entries, recorded)) in &totals.features {
        if recorded.is_empty() {
            findings.add("statistics", STATS, key.as_str(), "statistics", "none");
            continue;
        }
        if recorded.get("count").and_then(|count| count.first()) != Some(&rows) {
            findings.add(
                "statistics",
                STATS,
                format!("count of {key}"),
                rows,
                abbreviated(recorded.get("count").unwrap_or(&Vec::new())),
            );
        }
        // NaN and infinite values are reported by row instead.
        for (index, entry) in entries.iter().enumerate().filter(|(_, entry)| entry.sum.is_finite()) {
            let mean = entry.sum / rows;
            let variance = (entry.squares / rows - (mean - entry.shift).powi(2)).max(0.0);
            let size = entry.max.abs().max(entry.min.abs());
            for (name, expected) in [("min", entry.min), ("max", entry.max), ("mean", mean), ("std", variance.sqrt())] {
                let found = recorded.get(name).and_then(|values| values.get(index)).copied().unwrap_or(f64::NAN);
                let off = (found - expected).abs();
                if off.is_nan() || off > TOLERANCE * size.max(1e-9) {
                    findings.add("statistics", STATS, format!("{name} of {key}[{index}]"), expected, found);
                }
            }
            if metadata.is_own {
                quantiles(entry, totals.rows, &format!("{key}[{index}]"), findings);
            }
        }
    }
}

/// Checks a quantile by counting: it lies between two consecutive values of the sorted column, which bounds the number
/// of values below it and not above it.
fn quantiles(entry: &Entry, rows: usize, what: &str, findings: &mut Findings) {
    for ((name, q), (value, below, not_above)) in QUANTILES.iter().zip(&entry.around) {
        let position = q * rows.saturating_sub(1) as f64;
        let is_right = *below <= position.ceil() as usize && *not_above > position.floor() as usize;
        if !is_right {
            let expected = format!("value number {position:.1} of {rows} in sorted order");
            findings.add(
                "statistics",
                STATS,
                format!("{name} of {what}"),
                expected,
                format!("{value}, with {below} below it"),
            );
        }
    }
}

fn tolerance(value: f64) -> f64 {
    TOLERANCE * value.abs().max(1e-9)
}

/// True if statistics are equal up to rounding, relative to the largest magnitude in the column.
pub(super) fn are_equal(expected: &[f64], found: &[f64], column: &Column) -> bool {
    let size = column.values.iter().fold(1e-9_f64, |size, value| size.max(value.abs()));
    expected.len() == found.len() && expected.iter().zip(found).all(|(a, b)| (a - b).abs() <= TOLERANCE * size)
}

/// The first eight numbers, for messages.
pub(super) fn abbreviated(numbers: &[f64]) -> String {
    let shown: Vec<String> = numbers.iter().take(8).map(|number| format!("{number:.6}")).collect();
    let more = if numbers.len() > shown.len() { ", …" } else { "" };
    format!("[{}{more}]", shown.join(", "))
}

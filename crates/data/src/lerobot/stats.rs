//! Statistics of features, as `stats.json` and the episodes table hold them.

use serde_json::{Value, json};

use crate::ColorHistogram;
use crate::export::features::Feature;

/// The quantiles LeRobot keeps, with their names.
const QUANTILES: [(&str, f64); 5] = [("q01", 0.01), ("q10", 0.10), ("q50", 0.50), ("q90", 0.90), ("q99", 0.99)];

/// Statistics per entry of a vector, or per colour channel (then in 0-1).
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Stats {
    /// `min`, `max`, `mean`, `std` (of the population), then the quantiles; one number per entry.
    pub(crate) named: Vec<(&'static str, Vec<f64>)>,
    /// Number of frames.
    pub(crate) count: usize,
}

impl Stats {
    /// Exact statistics of the frames given.
    pub(crate) fn of_vectors(values: &[f64], length: usize) -> Self {
        let columns: Vec<Vec<f64>> = (0..length)
            .map(|entry| {
                let mut column: Vec<f64> = values.iter().skip(entry).step_by(length).copied().collect();
                column.sort_by(f64::total_cmp);
                column
            })
            .collect();
        let count = columns.first().map_or(0, Vec::len);
        let each = |value: &dyn Fn(&[f64]) -> f64| columns.iter().map(|column| value(column)).collect::<Vec<f64>>();
        let mut named = vec![
            ("min", each(&|column| column.first().copied().unwrap_or(0.0))),
            ("max", each(&|column| column.last().copied().unwrap_or(0.0))),
            ("mean", each(&mean)),
            ("std", each(&standard_deviation)),
        ];
        named.extend(QUANTILES.map(|(name, q)| (name, each(&|column| quantile(column, q)))));
        Self { named, count }
    }

    /// Statistics of 8-bit colours, scaled to 0-1.
    pub(crate) fn of_colors(colors: &ColorHistogram, frames: usize) -> Self {
        let each = |value: &dyn Fn(&[u64]) -> f64| {
            colors.counts.iter().map(|counts| value(counts) / 255.0).collect::<Vec<f64>>()
        };
        let mut named = vec![
            ("min", each(&|counts| counts.iter().position(|count| *count > 0).unwrap_or(0) as f64)),
            ("max", each(&|counts| counts.iter().rposition(|count| *count > 0).unwrap_or(0) as f64)),
            ("mean", each(&|counts| moments(counts).0)),
            ("std", each(&|counts| moments(counts).1)),
        ];
        named.extend(QUANTILES.map(|(name, q)| (name, each(&|counts| histogram_quantile(counts, q)))));
        Self { named, count: frames }
    }

    /// The entry in `stats.json`; channels of pictures are nested `[C][1][1]`.
    pub(crate) fn to_json(&self, is_image: bool) -> Value {
        let mut entry = serde_json::Map::new();
        for (name, values) in &self.named {
            let values = if is_image { values.iter().map(|value| json!([[value]])).collect() } else { json!(values) };
            entry.insert((*name).into(), values);
        }
        entry.insert("count".into(), json!([self.count]));
        Value::Object(entry)
    }
}

/// The numbers of a feature over all episodes.
///
/// All numbers are kept until the end (8 bytes each, about 0.6 kB per frame of the main data set), because only then
/// are the quantiles exact.
#[derive(Clone, Debug, Default)]
pub(crate) struct Collected {
    features: Vec<(String, usize, Vec<f64>)>,
    colors: Vec<(String, ColorHistogram, usize)>,
}

impl Collected {
    pub(crate) fn add(&mut self, feature: &Feature) {
        match self.features.iter_mut().find(|(key, ..)| *key == feature.key) {
            Some((_, _, values)) => values.extend(feature.numbers()),
            None => self.features.push((feature.key.clone(), feature.length(), feature.numbers())),
        }
    }

    pub(crate) fn add_colors(&mut self, key: &str, colors: &ColorHistogram, frames: usize) {
        match self.colors.iter_mut().find(|(known, ..)| known == key) {
            Some((_, all, count)) => {
                all.add(colors);
                *count += frames;
            }
            None => self.colors.push((key.into(), colors.clone(), frames)),
        }
    }

    /// The contents of `stats.json`.
    pub(crate) fn to_json(&self) -> Value {
        let mut stats = serde_json::Map::new();
        for (key, colors, frames) in &self.colors {
            stats.insert(key.clone(), Stats::of_colors(colors, *frames).to_json(true));
        }
        for (key, length, values) in &self.features {
            stats.insert(key.clone(), Stats::of_vectors(values, *length).to_json(false));
        }
        Value::Object(stats)
    }
}

fn mean(column: &[f64]) -> f64 {
    column.iter().sum::<f64>() / column.len().max(1) as f64
}

fn standard_deviation(column: &[f64]) -> f64 {
    let mean = mean(column);
    (column.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / column.len().max(1) as f64).sqrt()
}

/// Linear between the two nearest values of a sorted column, as numpy does it.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let position = q * last as f64;
    let (below, above) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    below + (above - below) * position.fract()
}

fn moments(counts: &[u64]) -> (f64, f64) {
    let total = counts.iter().sum::<u64>().max(1) as f64;
    let sum = |power: i32| counts.iter().zip(0_u32..).map(|(n, v)| *n as f64 * f64::from(v).powi(power)).sum::<f64>();
    let mean = sum(1) / total;
    (mean, (sum(2) / total - mean * mean).max(0.0).sqrt())
}

/// The smallest value that a share `q` of the counts does not exceed.
fn histogram_quantile(counts: &[u64], q: f64) -> f64 {
    let wanted = q * counts.iter().sum::<u64>() as f64;
    let mut seen = 0;
    let reached = |count: &u64| {
        seen += count;
        seen as f64 >= wanted && seen > 0
    };
    counts.iter().position(reached).unwrap_or(0) as f64
}

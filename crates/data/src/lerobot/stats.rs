//! Feature statistics of `stats.json` and the episodes table.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::{ColorHistogram, DataError};

/// Quantiles in LeRobot's statistics: name and probability.
const QUANTILES: [(&str, f64); 5] = [("q01", 0.01), ("q10", 0.10), ("q50", 0.50), ("q90", 0.90), ("q99", 0.99)];

/// Statistics per element of a vector, or per colour channel on a scale of 0 to 1.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stats {
    /// `min`, `max`, `mean`, `std` (population), then the quantiles; one number per element.
    pub named: Vec<(&'static str, Vec<f64>)>,
    /// Number of rows that the statistics cover.
    pub count: usize,
}

impl Stats {
    /// Exact statistics of row-major vectors with `length` elements each.
    pub fn of_vectors(values: &[f64], length: usize) -> Self {
        let mut stats = Self::default();
        for entry in 0..length {
            stats.add_entry(values.iter().skip(entry).step_by(length).copied().collect());
        }
        stats
    }

    /// Appends the statistics of one vector element, given by its values in all rows.
    fn add_entry(&mut self, mut column: Vec<f64>) {
        column.sort_by(f64::total_cmp);
        self.count = column.len();
        let mut all = vec![
            ("min", column.first().copied().unwrap_or(0.0)),
            ("max", column.last().copied().unwrap_or(0.0)),
            ("mean", mean(&column)),
            ("std", standard_deviation(&column)),
        ];
        all.extend(QUANTILES.map(|(name, q)| (name, quantile(&column, q))));
        if self.named.is_empty() {
            self.named = all.iter().map(|(name, _)| (*name, Vec::new())).collect();
        }
        for ((_, values), (_, value)) in self.named.iter_mut().zip(all) {
            values.push(value);
        }
    }

    /// Statistics read by name, in the standard order.
    pub fn named(
        mut value: impl FnMut(&str) -> Result<Vec<f64>, DataError>,
    ) -> Result<Vec<(&'static str, Vec<f64>)>, DataError> {
        let names = ["min", "max", "mean", "std"].into_iter().chain(QUANTILES.map(|(name, _)| name));
        names.map(|name| Ok((name, value(name)?))).collect()
    }

    /// Statistics of 8-bit colours, scaled to the range 0 to 1.
    pub fn of_colors(colors: &ColorHistogram, frames: usize) -> Self {
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

    /// Entry of `stats.json`; image channels are nested `[C][1][1]`.
    pub fn to_json(&self, is_image: bool) -> Value {
        let mut entry = serde_json::Map::new();
        for (name, values) in &self.named {
            let values = if is_image { values.iter().map(|value| json!([[value]])).collect() } else { json!(values) };
            entry.insert((*name).into(), values);
        }
        entry.insert("count".into(), json!([self.count]));
        Value::Object(entry)
    }
}

/// Aggregation by the formulas of LeRobot's `aggregate_stats`: quantiles are weighted means of the parts' quantiles.
#[derive(Clone, Debug, Default)]
pub struct Aggregated(Vec<Stats>);

impl Aggregated {
    /// Adds the statistics of an episode or data set.
    pub fn add(&mut self, part: Stats) {
        self.0.push(part);
    }

    /// Statistics over all added parts.
    pub fn whole(&self) -> Stats {
        let count: usize = self.0.iter().map(|part| part.count).sum();
        let length = self.0.first().and_then(|part| part.named.first()).map_or(0, |(_, values)| values.len());
        let of = |part: &Stats, name: &str, entry: usize| {
            let values = part.named.iter().find(|(known, _)| *known == name);
            values.and_then(|(_, values)| values.get(entry)).copied().unwrap_or(0.0)
        };
        let weighted = |value: &dyn Fn(&Stats) -> f64| {
            self.0.iter().map(|part| value(part) * part.count as f64).sum::<f64>() / count.max(1) as f64
        };
        let whole = |name: &'static str, entry: usize| match name {
            "min" => self.0.iter().map(|part| of(part, name, entry)).fold(f64::INFINITY, f64::min),
            "max" => self.0.iter().map(|part| of(part, name, entry)).fold(f64::NEG_INFINITY, f64::max),
            "std" => {
                let mean = weighted(&|part| of(part, "mean", entry));
                let variance = |part: &Stats| of(part, "std", entry).powi(2) + (of(part, "mean", entry) - mean).powi(2);
                weighted(&variance).sqrt()
            }
            name => weighted(&|part| of(part, name, entry)),
        };
        let names = self.0.first().into_iter().flat_map(|part| part.named.iter().map(|(name, _)| *name));
        let named = names.map(|name| (name, (0..length).map(|entry| whole(name, entry)).collect())).collect();
        Stats { named, count }
    }
}

/// Collects the values of all features over all episodes.
///
/// Exact quantiles need all values, 0.6 kB per frame of the main data set, so they are buffered in unnamed files on
/// disk.
#[derive(Debug)]
pub struct StatsCollector {
    folder: PathBuf,
    features: Vec<BufferedFeature>,
    colors: Vec<(String, ColorHistogram, usize)>,
}

/// Buffer of all values of a feature, in a file.
#[derive(Debug)]
struct BufferedFeature {
    key: String,
    length: usize,
    numbers: BufWriter<File>,
}

impl StatsCollector {
    /// Empty collector, which buffers values in unnamed files in `folder`.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.into(), features: Vec::new(), colors: Vec::new() }
    }

    /// Adds vectors of a feature, row-major.
    pub fn add(&mut self, key: &str, length: usize, numbers: &[f64]) -> Result<(), DataError> {
        let failed = DataError::io("write statistics in", &self.folder);
        let place = match self.features.iter().position(|buffered| buffered.key == key) {
            Some(place) => place,
            None => {
                let file = tempfile::tempfile_in(&self.folder).map_err(DataError::io("write in", &self.folder))?;
                self.features.push(BufferedFeature { key: key.into(), length, numbers: BufWriter::new(file) });
                self.features.len() - 1
            }
        };
        let buffered = &mut self.features[place];
        if buffered.length != length {
            return Err(DataError::mismatch(format!("entries of {key}"), buffered.length, length));
        }
        numbers.iter().try_for_each(|number| buffered.numbers.write_all(&number.to_le_bytes())).map_err(failed)
    }

    /// Adds the colours of a video column.
    pub fn add_colors(&mut self, key: &str, colors: &ColorHistogram, frames: usize) {
        match self.colors.iter_mut().find(|(known, ..)| known == key) {
            Some((_, all, count)) => {
                all.add(colors);
                *count += frames;
            }
            None => self.colors.push((key.into(), colors.clone(), frames)),
        }
    }

    /// Statistics over all episodes, as in `stats.json`.
    pub fn finish(&mut self) -> Result<Value, DataError> {
        let mut stats = serde_json::Map::new();
        for (key, colors, frames) in &self.colors {
            stats.insert(key.clone(), Stats::of_colors(colors, *frames).to_json(true));
        }
        for buffered in &mut self.features {
            let whole = buffered.stats().map_err(DataError::io("read statistics in", &self.folder))?;
            stats.insert(buffered.key.clone(), whole.to_json(false));
        }
        Ok(Value::Object(stats))
    }
}

impl BufferedFeature {
    /// Exact statistics; holds one vector element of all frames in memory at a time.
    fn stats(&mut self) -> std::io::Result<Stats> {
        self.numbers.flush()?;
        let file = self.numbers.get_mut();
        let mut stats = Stats::default();
        for entry in 0..self.length {
            file.rewind()?;
            let mut reader = BufReader::with_capacity(1 << 16, &mut *file);
            let mut vector = vec![0; 8 * self.length];
            let mut column = Vec::new();
            while !std::io::BufRead::fill_buf(&mut reader)?.is_empty() {
                reader.read_exact(&mut vector)?;
                let mut bytes = [0; 8];
                bytes.copy_from_slice(&vector[8 * entry..8 * entry + 8]);
                column.push(f64::from_le_bytes(bytes));
            }
            stats.add_entry(column);
        }
        Ok(stats)
    }
}

fn mean(column: &[f64]) -> f64 {
    column.iter().sum::<f64>() / column.len().max(1) as f64
}

fn standard_deviation(column: &[f64]) -> f64 {
    let mean = mean(column);
    (column.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / column.len().max(1) as f64).sqrt()
}

/// Quantile of a sorted column with linear interpolation, as in NumPy.
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

/// Smallest value whose cumulative share of the counts is at least `q`.
fn histogram_quantile(counts: &[u64], q: f64) -> f64 {
    let wanted = q * counts.iter().sum::<u64>() as f64;
    let mut seen = 0;
    let reached = |count: &u64| {
        seen += count;
        seen as f64 >= wanted && seen > 0
    };
    counts.iter().position(reached).unwrap_or(0) as f64
}

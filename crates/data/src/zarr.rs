//! zarr, version 2, as Diffusion Policy's `ReplayBuffer` reads it: all frames of all episodes one after the other.
//!
//! ```text
//! .zattrs                                contract of the actions, rate, versions, and an entry per episode
//! data/KEY/                              numbers, one row per frame; keys as in the LeRobot data set
//! data/subtask/                          index of the step in the `subtasks` of its episode's entry
//! data/observation.images.NAME/          colour as decoded from the store's video, uint8 [frames, height, width, 3]
//! data/observation.images.NAME_depth/    uint16 [frames, height, width], millimetres, 0 = nothing hit
//! meta/episode_ends                      int64: the index behind the last frame of each episode
//! ```
//!
//! Chunks are compressed by zlib: a picture each, or 1,024 rows of numbers.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use genmanip_core::RobotModel;
use serde_json::{Value, json};

use crate::aside::{self, Aside};
use crate::export::features::Values;
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection, Source};
use crate::{DataError, EpisodeStore, depth, files, video};

/// Rows of numbers in a chunk.
const ROWS_PER_CHUNK: usize = 1024;
/// Of zlib: higher levels take several times as long for a few percent.
const LEVEL: u32 = 1;

/// Writes the selected episodes as a zarr group at `target`, which must not exist.
///
/// # Errors
/// When nothing is selected, pictures are missing, episodes do not fit each other, the target exists, or the disk refuses.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &ExportSettings,
    target: &Path,
) -> Result<ExportReport, DataError> {
    let exporter = Exporter::new(store, selection, robot, settings)?;
    aside::make_parent(target)?;
    files::sweep(aside::parent(target))?;
    let mut writer =
        Writer { aside: Aside::new(target)?, arrays: Vec::new(), frames: 0, ends: Vec::new(), entries: Vec::new() };
    let left_out = exporter.each(|source, rows| writer.push(source, &rows, settings.depth))?;
    let (frames, episodes) = (writer.frames, writer.ends.len());
    writer.finish(&json!({
        "genmanip_version": env!("CARGO_PKG_VERSION"),
        "rate_hz": settings.fps,
        "action_contract": exporter.contract(),
    }))?;
    Ok(ExportReport { dataset: target.into(), depth_dataset: None, episodes, frames, left_out })
}

struct Writer {
    aside: Aside,
    arrays: Vec<Array>,
    /// Of the episodes so far.
    frames: usize,
    ends: Vec<i64>,
    /// One per episode, for `.zattrs`.
    entries: Vec<Value>,
}

/// An array that grows along its first axis.
struct Array {
    /// Path in the group, e.g. `data/action`.
    name: String,
    /// Type in numpy's notation.
    dtype: &'static str,
    /// Sizes of the other axes.
    inner: Vec<usize>,
    rows_per_chunk: usize,
    row_bytes: usize,
    rows: usize,
    /// What the present chunk holds so far.
    pending: Vec<u8>,
}

impl Writer {
    fn push(&mut self, source: &Source, rows: &EpisodeRows, with_depth: bool) -> Result<(), DataError> {
        for feature in &rows.features {
            let inner = if feature.names.is_empty() { vec![] } else { vec![feature.names.len()] };
            let (dtype, bytes) = little_endian(&feature.values);
            let (array, aside) = self.array(&feature.key, dtype, inner, ROWS_PER_CHUNK);
            array.push(aside, &bytes)?;
        }
        let steps: Vec<u8> = rows.steps.iter().flat_map(|step| (*step as u64).to_le_bytes()).collect();
        let (array, aside) = self.array("subtask", "<i8", vec![], ROWS_PER_CHUNK);
        array.push(aside, &steps)?;
        for track in &source.tracks {
            let (width, height) = (track.video.width as usize, track.video.height as usize);
            let key = format!("observation.images.{}", track.camera.name);
            let (array, aside) = self.array(&key, "|u1", vec![height, width, 3], 1);
            video::decode(&track.video, &mut |rgb| array.push(aside, rgb))?;
            if with_depth {
                let (array, aside) = self.array(&format!("{key}_depth"), "<u2", vec![height, width], 1);
                for png in &track.depth_png {
                    let (_, _, values) = depth::decode_depth_png(png)?;
                    array.push(aside, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())?;
                }
            }
        }
        self.frames += rows.frames;
        self.ends.push(i64::try_from(self.frames).unwrap_or(i64::MAX));
        let result = &rows.facts.result;
        if let Some(array) = self.arrays.iter().find(|array| array.rows != self.frames) {
            let what = format!("rows of {} after episode {}", array.name, result.id);
            return Err(DataError::mismatch(what, self.frames, array.rows));
        }
        self.entries.push(json!({
            "store_id": result.id,
            "scenario_id": result.scenario_id,
            "instruction": rows.facts.instruction,
            "success": result.success,
            "seed": result.seed,
            "failure": result.failure().map(|failure| failure.to_string()),
            "subtasks": rows.facts.steps.texts,
            "paraphrases": rows.facts.paraphrases,
        }));
        Ok(())
    }

    /// The array of a key, which the first episode begins.
    fn array(
        &mut self,
        key: &str,
        dtype: &'static str,
        inner: Vec<usize>,
        rows_per_chunk: usize,
    ) -> (&mut Array, &Aside) {
        let name = format!("data/{key}");
        let index = self.arrays.iter().position(|array| array.name == name).unwrap_or_else(|| {
            self.arrays.push(Array::new(name, dtype, inner, rows_per_chunk));
            self.arrays.len() - 1
        });
        (&mut self.arrays[index], &self.aside)
    }

    fn finish(mut self, about: &Value) -> Result<(), DataError> {
        let mut attributes = about.clone();
        attributes["episodes"] = std::mem::take(&mut self.entries).into();
        let mut ends = Array::new("meta/episode_ends".into(), "<i8", vec![], self.ends.len().max(1));
        let bytes: Vec<u8> = self.ends.iter().flat_map(|end| end.to_le_bytes()).collect();
        ends.push(&self.aside, &bytes)?;
        self.arrays.push(ends);
        for array in std::mem::take(&mut self.arrays) {
            array.finish(&self.aside)?;
        }
        let group = format!("{:#}\n", json!({"zarr_format": 2}));
        for folder in ["", "data/", "meta/"] {
            self.aside.write(&format!("{folder}.zgroup"), group.as_bytes())?;
        }
        self.aside.write(".zattrs", format!("{attributes:#}\n").as_bytes())?;
        self.aside.publish()
    }
}

impl Array {
    fn new(name: String, dtype: &'static str, inner: Vec<usize>, rows_per_chunk: usize) -> Self {
        let item_bytes = dtype[2..].parse::<usize>().unwrap_or(1);
        let row_bytes = item_bytes * inner.iter().product::<usize>();
        Self { name, dtype, inner, rows_per_chunk, row_bytes, rows: 0, pending: Vec::new() }
    }

    /// Appends rows, and writes the chunks that are full.
    fn push(&mut self, aside: &Aside, bytes: &[u8]) -> Result<(), DataError> {
        self.rows += bytes.len() / self.row_bytes;
        self.pending.extend_from_slice(bytes);
        let chunk_bytes = self.rows_per_chunk * self.row_bytes;
        while self.pending.len() >= chunk_bytes {
            let rest = self.pending.split_off(chunk_bytes);
            let chunk = std::mem::replace(&mut self.pending, rest);
            let number = (self.rows - self.pending.len() / self.row_bytes) / self.rows_per_chunk - 1;
            self.write_chunk(aside, number, &chunk)?;
        }
        Ok(())
    }

    /// Writes the last chunk, filled with zeros, and what describes the array.
    fn finish(mut self, aside: &Aside) -> Result<(), DataError> {
        if !self.pending.is_empty() {
            let mut chunk = std::mem::take(&mut self.pending);
            chunk.resize(self.rows_per_chunk * self.row_bytes, 0);
            self.write_chunk(aside, self.rows / self.rows_per_chunk, &chunk)?;
        }
        let with_rows = |rows: usize| [&[rows], &self.inner[..]].concat();
        let about = json!({
            "zarr_format": 2,
            "shape": with_rows(self.rows),
            "chunks": with_rows(self.rows_per_chunk),
            "dtype": self.dtype,
            "compressor": {"id": "zlib", "level": LEVEL},
            "fill_value": 0,
            "order": "C",
            "filters": null,
        });
        aside.write(&format!("{}/.zarray", self.name), format!("{about:#}\n").as_bytes())
    }

    fn write_chunk(&self, aside: &Aside, number: usize, bytes: &[u8]) -> Result<(), DataError> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(LEVEL));
        let name = format!("{}/{number}{}", self.name, ".0".repeat(self.inner.len()));
        let compressed = encoder.write_all(bytes).and_then(|()| encoder.finish());
        aside.write(&name, &compressed.map_err(DataError::io("compress", Path::new(&name)))?)
    }
}

/// Numbers as bytes, and their type in numpy's notation.
fn little_endian(values: &Values) -> (&'static str, Vec<u8>) {
    match values {
        Values::F32(values) => ("<f4", values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        Values::F64(values) => ("<f8", values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        Values::I64(values) => ("<i8", values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        Values::Bool(values) => ("|b1", values.iter().map(|value| u8::from(*value)).collect()),
    }
}

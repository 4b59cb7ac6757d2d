//! Zarr version 2 in the layout of Diffusion Policy's `ReplayBuffer`: the frames of all episodes concatenated.
//!
//! ```text
//! .zattrs                                action contract, rate, versions, and an entry per episode
//! data/KEY/                              numbers, one row per frame; keys as in the LeRobot data set
//! data/subtask/                          step index into `subtasks` of the episode's entry
//! data/observation.images.NAME/          colour as decoded from the store's video, uint8 [frames, height, width, 3]
//! data/observation.images.NAME_depth/    uint16 [frames, height, width], millimetres, 0 = no return
//! meta/episode_ends                      int64: exclusive end frame of each episode
//! ```
//!
//! Chunks are compressed with zlib and hold one image, or 1,024 rows of numbers.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use genmanip_core::RobotModel;
use serde_json::{Value, json};

use crate::atomic_write::AtomicFolder;
use crate::export::features::Values;
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection, Source};
use crate::{DataError, EpisodeStore, depth, video};

/// Rows per chunk of numeric arrays. Chosen by hand.
const ROWS_PER_CHUNK: usize = 1024;
/// zlib level; higher levels take several times as long for a few percent.
const LEVEL: u32 = 1;

/// Exports the selected episodes as a Zarr group at `target`, which must not exist.
///
/// # Errors
/// If no episode is selected, images are missing, episodes do not match each other, the target exists, or writing
/// fails.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &ExportSettings,
    target: &Path,
) -> Result<ExportReport, DataError> {
    let (exporter, staging) = Exporter::begin(store, selection, robot, settings, target)?;
    let mut writer = Writer { staging, arrays: Vec::new(), frames: 0, ends: Vec::new(), entries: Vec::new() };
    let report = exporter.each(target, |source, rows| writer.push(source, &rows, settings.depth))?;
    writer.finish(&json!({
        "genmanip_version": env!("CARGO_PKG_VERSION"),
        "rate_hz": settings.fps,
        "action_contract": exporter.contract(),
    }))?;
    Ok(report)
}

struct Writer {
    staging: AtomicFolder,
    arrays: Vec<Array>,
    /// Number of frames written so far.
    frames: usize,
    ends: Vec<i64>,
    /// Metadata of each episode, for `.zattrs`.
    entries: Vec<Value>,
}

/// An array under construction; grows along its first axis.
struct Array {
    /// Path in the group, e.g. `data/action`.
    name: String,
    /// NumPy dtype string, e.g. `<f4`.
    dtype: &'static str,
    /// Sizes of the axes after the first one.
    inner: Vec<usize>,
    rows_per_chunk: usize,
    row_bytes: usize,
    rows: usize,
    /// Bytes of the chunk that is not yet full.
    pending: Vec<u8>,
}

impl Writer {
    fn push(&mut self, source: &Source, rows: &EpisodeRows, with_depth: bool) -> Result<(), DataError> {
        for feature in &rows.features {
            let inner = if feature.names.is_empty() { vec![] } else { vec![feature.names.len()] };
            let (dtype, bytes) = little_endian(&feature.values);
            let (array, staging) = self.array(&feature.key, dtype, inner, ROWS_PER_CHUNK);
            array.push(staging, &bytes)?;
        }
        let steps: Vec<u8> = rows.steps.iter().flat_map(|step| (*step as u64).to_le_bytes()).collect();
        let (array, staging) = self.array("subtask", "<i8", vec![], ROWS_PER_CHUNK);
        array.push(staging, &steps)?;
        for track in &source.tracks {
            let (width, height) = (track.video.width as usize, track.video.height as usize);
            let key = format!("observation.images.{}", track.camera.name);
            let (array, staging) = self.array(&key, "|u1", vec![height, width, 3], 1);
            video::decode(&track.video, &mut |rgb| array.push(staging, rgb))?;
            if with_depth {
                let (array, staging) = self.array(&format!("{key}_depth"), "<u2", vec![height, width], 1);
                for png in &track.depth_png {
                    let (_, _, values) = depth::decode_depth_png(png)?;
                    array.push(staging, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())?;
                }
            }
        }
        self.frames += rows.frames;
        self.ends.push(i64::try_from(self.frames).unwrap_or(i64::MAX));
        let result = &rows.metadata.result;
        if let Some(array) = self.arrays.iter().find(|array| array.rows != self.frames) {
            let what = format!("rows of {} after episode {}", array.name, result.id);
            return Err(DataError::mismatch(what, self.frames, array.rows));
        }
        self.entries.push(json!({
            "store_id": result.id,
            "scenario_id": result.scenario_id,
            "instruction": rows.metadata.instruction,
            "success": result.success,
            "seed": result.seed,
            "failure": result.failure().map(|failure| failure.to_string()),
            "subtasks": rows.metadata.steps.texts,
            "paraphrases": rows.metadata.paraphrases,
        }));
        Ok(())
    }

    /// Returns the array of a key; creates it with the first episode.
    fn array(
        &mut self,
        key: &str,
        dtype: &'static str,
        inner: Vec<usize>,
        rows_per_chunk: usize,
    ) -> (&mut Array, &AtomicFolder) {
        let name = format!("data/{key}");
        let index = self.arrays.iter().position(|array| array.name == name).unwrap_or_else(|| {
            self.arrays.push(Array::new(name, dtype, inner, rows_per_chunk));
            self.arrays.len() - 1
        });
        (&mut self.arrays[index], &self.staging)
    }

    fn finish(mut self, about: &Value) -> Result<(), DataError> {
        let mut attributes = about.clone();
        attributes["episodes"] = std::mem::take(&mut self.entries).into();
        let mut ends = Array::new("meta/episode_ends".into(), "<i8", vec![], self.ends.len().max(1));
        let bytes: Vec<u8> = self.ends.iter().flat_map(|end| end.to_le_bytes()).collect();
        ends.push(&self.staging, &bytes)?;
        self.arrays.push(ends);
        for array in std::mem::take(&mut self.arrays) {
            array.finish(&self.staging)?;
        }
        let group = format!("{:#}\n", json!({"zarr_format": 2}));
        for folder in ["", "data/", "meta/"] {
            self.staging.write(&format!("{folder}.zgroup"), group.as_bytes())?;
        }
        self.staging.write(".zattrs", format!("{attributes:#}\n").as_bytes())?;
        self.staging.publish()
    }
}

impl Array {
    fn new(name: String, dtype: &'static str, inner: Vec<usize>, rows_per_chunk: usize) -> Self {
        let item_bytes = dtype[2..].parse::<usize>().unwrap_or(1);
        let row_bytes = item_bytes * inner.iter().product::<usize>();
        Self { name, dtype, inner, rows_per_chunk, row_bytes, rows: 0, pending: Vec::new() }
    }

    /// Appends rows and writes full chunks.
    fn push(&mut self, staging: &AtomicFolder, bytes: &[u8]) -> Result<(), DataError> {
        self.rows += bytes.len() / self.row_bytes;
        self.pending.extend_from_slice(bytes);
        let chunk_bytes = self.rows_per_chunk * self.row_bytes;
        while self.pending.len() >= chunk_bytes {
            let rest = self.pending.split_off(chunk_bytes);
            let chunk = std::mem::replace(&mut self.pending, rest);
            let number = (self.rows - self.pending.len() / self.row_bytes) / self.rows_per_chunk - 1;
            self.write_chunk(staging, number, &chunk)?;
        }
        Ok(())
    }

    /// Writes the last chunk, zero-padded, and the array metadata.
    fn finish(mut self, staging: &AtomicFolder) -> Result<(), DataError> {
        if !self.pending.is_empty() {
            let mut chunk = std::mem::take(&mut self.pending);
            chunk.resize(self.rows_per_chunk * self.row_bytes, 0);
            self.write_chunk(staging, self.rows / self.rows_per_chunk, &chunk)?;
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
        staging.write(&format!("{}/.zarray", self.name), format!("{about:#}\n").as_bytes())
    }

    fn write_chunk(&self, staging: &AtomicFolder, number: usize, bytes: &[u8]) -> Result<(), DataError> {
        let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(LEVEL));
        let name = format!("{}/{number}{}", self.name, ".0".repeat(self.inner.len()));
        let compressed = encoder.write_all(bytes).and_then(|()| encoder.finish());
        staging.write(&name, &compressed.map_err(DataError::io("compress", Path::new(&name)))?)
    }
}

/// Values as little-endian bytes, and their NumPy type string.
fn little_endian(values: &Values) -> (&'static str, Vec<u8>) {
    match values {
        Values::F32(values) => ("<f4", values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        Values::F64(values) => ("<f8", values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        Values::I64(values) => ("<i8", values.iter().flat_map(|value| value.to_le_bytes()).collect()),
        Values::Bool(values) => ("|b1", values.iter().map(|value| u8::from(*value)).collect()),
    }
}

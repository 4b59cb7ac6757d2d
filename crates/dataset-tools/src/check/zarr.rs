//! Check of Zarr groups: arrays, chunks and the list of episodes.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

use genmanip_core::limits;
use serde_json::Value;

use super::findings::Findings;
use super::overview::Overview;
use super::{DatasetCheck, metadata};
use genmanip_data::files;

const ATTRIBUTES: &str = ".zattrs";
const ENDS: &str = "meta/episode_ends";

/// Metadata of an array, from `.zarray`.
struct Array {
    shape: Vec<usize>,
    chunks: Vec<usize>,
    dtype: String,
}

pub(super) fn check(root: &Path, listed: &BTreeSet<String>, mut findings: Findings) -> DatasetCheck {
    let about = metadata::read_json(root, ATTRIBUTES, &mut findings);
    let entries = about["episodes"].as_array().map_or(0, Vec::len);
    let names: Vec<&str> = listed.iter().filter_map(|path| path.strip_suffix("/.zarray")).collect();
    let mut expected: BTreeSet<String> =
        [".zgroup", ATTRIBUTES, "data/.zgroup", "meta/.zgroup"].map(String::from).into();
    let mut rows = None;
    let mut ends = Vec::new();
    for name in &names {
        let file = format!("{name}/.zarray");
        expected.insert(file.clone());
        let Some(array) = array(&metadata::read_json(root, &file, &mut findings)) else {
            findings.add("info", &file, "", "shape, chunks and dtype of an array", "something else");
            continue;
        };
        let chunks =
            array.shape.first().copied().unwrap_or(0).div_ceil(array.chunks.first().copied().unwrap_or(1).max(1));
        let tail = ".0".repeat(array.shape.len().saturating_sub(1));
        expected.extend((0..chunks).map(|number| format!("{name}/{number}{tail}")));
        if *name == ENDS {
            ends = numbers(root, &format!("{name}/0"), &array, &mut findings);
        } else {
            let length = array.shape.first().copied().unwrap_or(0);
            let first = *rows.get_or_insert(length);
            findings.require("rows", &file, "shape", &first, &length);
            for number in 0..chunks {
                let chunk = format!("{name}/{number}{tail}");
                let values = numbers(root, &chunk, &array, &mut findings);
                if let Some(entry) = values.iter().position(|value| !value.is_finite()) {
                    findings.add("values", &chunk, format!("entry {entry}"), "a finite number", values[entry]);
                }
            }
        }
    }
    for missing in expected.difference(listed) {
        findings.add("files", missing, "", "a file", "nothing");
    }
    for foreign in listed.difference(&expected) {
        findings.add("files", foreign, "", "no such file, as it belongs to no array", "a file");
    }
    let rows = rows.unwrap_or(0);
    findings.require("episodes", ATTRIBUTES, "episodes", &ends.len(), &entries);
    findings.require("episodes", ENDS, "last", &Some(rows as f64), &ends.last().copied());
    if let Some(number) = (1..ends.len()).find(|&number| ends[number] <= ends[number - 1]) {
        findings.add(
            "episodes",
            ENDS,
            format!("episode {number}"),
            format!("more than {}", ends[number - 1]),
            ends[number],
        );
    }
    let (findings, further) = findings.into_parts();
    let dataset = root.display().to_string();
    DatasetCheck {
        dataset,
        format: "zarr",
        episodes: entries,
        frames: rows,
        findings,
        further,
        identities: Vec::new(),
        overview: Overview { fps: about["rate_hz"].as_f64().unwrap_or_default(), ..Overview::default() },
    }
}

fn array(about: &Value) -> Option<Array> {
    let sizes = |value: &Value| -> Option<Vec<usize>> {
        value.as_array()?.iter().map(|size| usize::try_from(size.as_u64()?).ok()).collect()
    };
    let array = Array {
        shape: sizes(&about["shape"])?,
        chunks: sizes(&about["chunks"])?,
        dtype: about["dtype"].as_str()?.into(),
    };
    (array.shape.len() == array.chunks.len() && !array.shape.is_empty()).then_some(array)
}

/// Values of a chunked numeric array; empty for images, whose chunks are only decompressed.
fn numbers(root: &Path, name: &str, array: &Array, findings: &mut Findings) -> Vec<f64> {
    let bytes = match files::read(&root.join(name), limits::CHUNK) {
        Ok(bytes) => bytes,
        Err(error) => {
            if !error.is_missing() {
                findings.add("files", name, "", "a readable file", error);
            }
            return Vec::new();
        }
    };
    let item: usize = array.dtype.get(2..).and_then(|size| size.parse().ok()).unwrap_or(1);
    let size = array.chunks.iter().fold(item, |size, side| size.saturating_mul(*side));
    let mut chunk = Vec::new();
    // One byte more than expected, to detect oversized chunks.
    let most = u64::try_from(size).unwrap_or(u64::MAX).saturating_add(1);
    let read = flate2::read::ZlibDecoder::new(bytes.as_slice()).take(most).read_to_end(&mut chunk);
    if let Err(error) = read {
        findings.add("values", name, "", "zlib", error);
        return Vec::new();
    }
    if chunk.len() != size {
        findings.add("values", name, "", format!("{size} bytes"), chunk.len());
        return Vec::new();
    }
    match array.dtype.as_str() {
        "<f4" => chunk.as_chunks::<4>().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect(),
        "<f8" => chunk.as_chunks::<8>().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect(),
        "<i8" => chunk.as_chunks::<8>().0.iter().map(|bytes| i64::from_le_bytes(*bytes) as f64).collect(),
        _ => Vec::new(),
    }
}

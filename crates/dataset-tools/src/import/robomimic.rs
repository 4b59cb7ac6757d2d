//! Reader of HDF5 demonstrations in the layout of robomimic, MimicGen and LIBERO: one file, or a folder of files.
//!
//! ```text
//! data                      attributes env_args (JSON), LIBERO also problem_info (JSON)
//! data/demo_0/actions       a row per frame
//!             rewards, dones
//!             obs/KEY       numbers, a row per frame, or images: frames × height × width × 3, 8-bit
//! ```

use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use genmanip_core::limits::ENTRIES;
use hdf5_reader::group::Group;
use hdf5_reader::{Dataset, Datatype, Hdf5File, OpenOptions, SliceInfo, SliceInfoElem};
use serde_json::Value;

use super::hdf5_members;
use super::metadata::{self, ImportedMetadata};
use super::{Importer, OnEpisode, SourceInfo};
use genmanip_data::export::EpisodeRows;
use genmanip_data::export::features::{Feature, Values, VideoFeature};
use genmanip_data::video::{VideoEncoder, VideoSettings};
use genmanip_data::{ColorHistogram, DataError, files};

/// First bytes of an HDF5 file.
const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";
/// Control rate of files that state no `control_freq`: robosuite's default, Hz.
const FPS: u32 = 20;
/// Maximum number of frames of an episode, and of numbers per row.
const MAX_FRAMES: u64 = 1_000_000;
const MAX_WIDTH: u64 = 4096;
/// Maximum size of a data set or chunk that is read at once, bytes.
const MAX_BYTES: usize = 256 << 20;
/// Number of images that are read at once, which bounds memory.
const IMAGES_AT_ONCE: u64 = 32;
/// Data sets of a demonstration that are imported besides its observations.
const USED: [&str; 3] = ["actions", "rewards", "dones"];
/// Observations that are concatenated to `observation.state`: the first list whose members all exist.
const STATES: [&[&str]; 4] = [
    &["ee_pos", "ee_ori", "gripper_states"],
    &["robot0_eef_pos", "robot0_eef_quat", "robot0_gripper_qpos"],
    &["robot0_joint_pos", "robot0_gripper_qpos"],
    &["joint_states", "gripper_states"],
];

/// HDF5 demonstrations, open for import.
pub(super) struct Robomimic {
    /// File and group name (`demo_…`) of each demonstration, in order.
    demonstrations: Vec<(PathBuf, String)>,
    fps: u32,
    robot: String,
    notes: BTreeSet<String>,
}

/// True if `source` is an HDF5 file (by its content or extension), or a folder with files that have such an extension.
pub(super) fn is_there(source: &Path) -> Result<bool, DataError> {
    Ok(!hdf5_files(source)?.is_empty())
}

fn hdf5_files(source: &Path) -> Result<Vec<PathBuf>, DataError> {
    let is_named = |path: &Path| path.extension().is_some_and(|ending| ending == "hdf5" || ending == "h5");
    if files::is_file_no_follow(source) {
        let mut start = [0; 8];
        let read = std::fs::File::open(source).and_then(|mut file| std::io::Read::read(&mut file, &mut start));
        let is_hdf5 = read.is_ok_and(|count| start[..count] == *MAGIC) || is_named(source);
        return Ok(if is_hdf5 { vec![source.to_owned()] } else { Vec::new() });
    }
    if !files::is_folder_no_follow(source) {
        return Ok(Vec::new());
    }
    let paths = files::names(source)?.into_iter().map(|name| source.join(name));
    let mut found: Vec<PathBuf> = paths.filter(|path| is_named(path) && files::is_file_no_follow(path)).collect();
    found.sort();
    Ok(found)
}

impl Robomimic {
    pub(super) fn open(source: &Path) -> Result<Self, DataError> {
        let mut notes = BTreeSet::new();
        let (mut demonstrations, mut rates, mut robots) = (Vec::new(), BTreeSet::new(), BTreeSet::new());
        for path in hdf5_files(source)? {
            let file = open(&path)?;
            let data = group(&path, &file, "data")?;
            let about = environment(&data);
            let arguments = &about["env_kwargs"];
            rates.insert(
                arguments["control_freq"].as_f64().filter(|rate| *rate >= 1.0 && *rate <= 240.0).map(f64::to_bits),
            );
            let robot = &arguments["robots"];
            robots.extend(robot.as_str().or_else(|| robot[0].as_str()).map(str::to_lowercase));
            let (groups, _) = data.member_names().map_err(|error| damaged(&path, &error))?;
            let mut names: Vec<String> = groups.into_iter().filter(|name| name.starts_with("demo")).collect();
            // Numeric order: demo_10 comes after demo_9.
            names.sort_by_key(|name| {
                (name.trim_start_matches(|c: char| !c.is_ascii_digit()).parse::<u64>().ok(), name.clone())
            });
            demonstrations.extend(names.into_iter().map(|name| (path.clone(), name)));
            note_passed_over(&path, &data, "data/", &mut notes)?;
            if file.group("mask").is_ok() {
                notes.insert("the split into training and validation (`mask`) is left out".into());
            }
            if demonstrations.len() > ENTRIES {
                let expected = format!("at most {ENTRIES} demonstrations");
                return Err(DataError::mismatch(source.display().to_string(), expected, demonstrations.len()));
            }
        }
        if demonstrations.is_empty() {
            let what = format!("groups data/demo_… in {}", source.display());
            let found = notes.into_iter().find(|note| note.starts_with("`data/demo")).unwrap_or_else(|| "none".into());
            return Err(DataError::mismatch(what, "at least one demonstration", found));
        }
        let stated: Vec<f64> = rates.iter().flatten().map(|bits| f64::from_bits(*bits)).collect();
        let fps = match stated.as_slice() {
            [rate] => rate.round() as u32,
            [] => {
                notes.insert(format!("the control rate is not stated; frames are taken to be 1/{FPS} s apart"));
                FPS
            }
            several => {
                let what = format!("control_freq of the files in {}", source.display());
                return Err(DataError::mismatch(what, "one rate", format!("{several:?}")));
            }
        };
        let robot = match robots.len() {
            1 => robots.into_iter().next().unwrap_or_default(),
            _ => "unknown".to_owned(),
        };
        notes.insert("images are encoded as H.264".into());
        Ok(Self { demonstrations, fps, robot, notes })
    }

    fn episode(
        &mut self,
        index: usize,
        path: &Path,
        file: &Hdf5File,
        name: &str,
    ) -> Result<EpisodeRows<ImportedMetadata>, DataError> {
        let data = group(path, file, "data")?;
        let demonstration = data.group(name).map_err(|error| damaged(path, &error))?;
        let place = format!("{}: data/{name}", path.display());
        let mut columns = Columns { place: place.clone(), fps: self.fps, frames: 0, notes: &mut self.notes };
        let actions = demonstration.dataset("actions").map_err(|error| damaged(path, &error))?;
        columns.frames = *actions.shape().first().unwrap_or(&0);
        if !(1..=MAX_FRAMES).contains(&columns.frames) {
            return Err(DataError::mismatch(
                format!("rows of {place}/actions"),
                format!("1 to {MAX_FRAMES}"),
                columns.frames,
            ));
        }
        let frames = columns.frames as usize;
        let mut features: Vec<Feature> = columns.numbers("action", &actions)?.into_iter().collect();
        let mut videos = Vec::new();
        let observed = match demonstration.group("obs") {
            Ok(observed) => {
                let datasets = observed.datasets().map_err(|error| damaged(path, &error))?;
                let (groups, others) = observed.member_names().map_err(|error| damaged(path, &error))?;
                // Groups, mostly.
                let is_read = |name: &String| datasets.iter().any(|dataset| dataset.name() == name.as_str());
                for name in groups.iter().chain(&others).filter(|name| !is_read(name)) {
                    columns.notes.insert(format!("`obs/{name}` of the demonstrations is left out"));
                }
                note_passed_over(path, &observed, "obs/", columns.notes)?;
                datasets
            }
            Err(_) => {
                columns
                    .notes
                    .insert("there are no observations, only actions; robomimic adds them from the states".into());
                Vec::new()
            }
        };
        let (groups, others) = demonstration.member_names().map_err(|error| damaged(path, &error))?;
        for name in
            groups.iter().filter(|name| *name != "obs").chain(others.iter().filter(|name| !USED.contains(&&***name)))
        {
            columns.notes.insert(format!("`{name}` of the demonstrations is left out"));
        }
        note_passed_over(path, &demonstration, "", columns.notes)?;
        let mut parts: Vec<Feature> = Vec::new();
        for dataset in &observed {
            let key = dataset.name().to_owned();
            if let Some(video) = columns.images(&key, dataset)? {
                videos.push(video);
            } else {
                parts.extend(columns.numbers(&format!("observation.{key}"), dataset)?);
            }
        }
        features.extend(state(&parts, frames));
        features.extend(parts);
        let mut succeeded = None;
        if let Ok(rewards) = demonstration.dataset("rewards")
            && let Some(column) = columns.numbers("next.reward", &rewards)?
        {
            // Sparse rewards mark success; shaped ones say nothing about it.
            let rewards = column.numbers();
            let is_sparse = rewards.iter().all(|reward| [0.0, 1.0].contains(reward));
            succeeded = is_sparse.then(|| rewards.contains(&1.0));
            features.push(column);
        }
        if let Ok(dones) = demonstration.dataset("dones")
            && let Some(column) = columns.numbers("next.done", &dones)?
        {
            let values = Values::Bool(column.numbers().iter().map(|done| *done > 0.0).collect());
            features.push(Feature { values, ..column });
        }
        if videos.iter().any(|video| video.key.contains("agentview_rgb") || video.key.contains("eye_in_hand_rgb")) {
            self.notes.insert("images stay as they are stored; LIBERO's are upside down".into());
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let metadata = ImportedMetadata {
            store_id: metadata::name(Some(&format!("{stem}-{name}")), index),
            instruction: self.sentence(&data, &stem),
            success: succeeded,
            ..ImportedMetadata::default()
        };
        let mut rows = EpisodeRows { frames, features, images: Vec::new(), videos, steps: Vec::new(), metadata };
        rows.metadata.source_sha256 = metadata::hash(&rows);
        Ok(rows)
    }

    /// Instruction: `language_instruction` of LIBERO's `problem_info`, or else the words of the environment's name.
    fn sentence(&mut self, data: &Group, stem: &str) -> String {
        let said = text(data, "problem_info").and_then(|text| serde_json::from_str::<Value>(&text).ok());
        let sentence = said.as_ref().map(|about| &about["language_instruction"]);
        let sentence = sentence.and_then(|value| value.as_str().or_else(|| value[0].as_str()));
        if let Some(sentence) = sentence.map(|text| text.trim().trim_matches('"')).filter(|text| !text.is_empty()) {
            return sentence.to_owned();
        }
        self.notes.insert("there is no sentence; it is made of the environment's name".into());
        let about = environment(data);
        let name = about["env_name"].as_str().unwrap_or(stem).to_owned();
        let mut words = String::new();
        for letter in name.chars() {
            if letter.is_uppercase() && words.ends_with(|c: char| c.is_lowercase()) {
                words.push(' ');
            }
            words.extend(if letter == '_' { ' ' } else { letter }.to_lowercase());
        }
        words
    }
}

impl Importer for Robomimic {
    fn info(&self) -> SourceInfo {
        SourceInfo {
            format: "robomimic",
            robot: self.robot.clone(),
            fps: self.fps,
            episodes: self.demonstrations.len(),
            contract: None,
            record: None,
        }
    }

    fn each(&mut self, take: OnEpisode) -> Result<(), DataError> {
        let mut opened: Option<(PathBuf, Hdf5File)> = None;
        for (index, (path, name)) in self.demonstrations.clone().into_iter().enumerate() {
            let file = match opened.take() {
                Some((known, file)) if known == path => file,
                _ => open(&path)?,
            };
            let episode = self.episode(index, &path, &file, &name)?;
            opened = Some((path.clone(), file));
            take(&path, episode)?;
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.notes.iter().cloned().collect()
    }
}

/// Reader of the columns of one demonstration.
struct Columns<'a> {
    place: String,
    fps: u32,
    frames: u64,
    notes: &'a mut BTreeSet<String>,
}

impl Columns<'_> {
    /// Reads a numeric data set as a column with this key; `None`, with a note, for another type or too wide rows.
    ///
    /// # Errors
    /// If the number of rows differs from that of the actions, a number is not finite, or it fits neither a signed
    /// 64-bit integer nor single precision.
    fn numbers(&mut self, key: &str, dataset: &Dataset) -> Result<Option<Feature>, DataError> {
        let folder = if key.starts_with("observation.") { "obs/" } else { "" };
        let what = format!("{}/{folder}{}", self.place, dataset.name());
        let shape = dataset.shape();
        let width = shape.iter().skip(1).product::<u64>();
        let Some(kind) = Kind::of(dataset.dtype()).filter(|_| (1..=MAX_WIDTH).contains(&width)) else {
            self.notes.insert(format!("{} is left out: {:?} of {shape:?}", dataset.name(), short(dataset.dtype())));
            return Ok(None);
        };
        if shape.first() != Some(&self.frames) {
            return Err(DataError::mismatch(format!("rows of {what}"), self.frames, format!("{shape:?}")));
        }
        let bytes = dataset.read_native_bytes().map_err(|error| DataError::mismatch(&what, "numbers", error))?;
        let count = bytes.len() / kind.size();
        if count as u64 != self.frames * width {
            return Err(DataError::mismatch(&what, format!("{} numbers", self.frames * width), count));
        }
        // An error that names a number by its place.
        let wrong = |at: usize, expected: &str, found: &dyn Display| {
            let (row, element) = (at as u64 / width, at as u64 % width);
            DataError::mismatch(format!("{what}[{element}] of row {row}"), expected, found)
        };
        let stored = bytes.chunks_exact(kind.size()).enumerate();
        let values = match kind {
            Kind::Integer { size, signed } => {
                let integer = |(at, bytes)| {
                    let value = integer(size, signed, bytes);
                    i64::try_from(value).map_err(|_| wrong(at, "an integer below 2^63", &value))
                };
                Values::I64(stored.map(integer).collect::<Result<_, _>>()?)
            }
            // Single precision, as in LeRobot's own columns and in policies.
            Kind::Float(size) => {
                if size == 8 {
                    self.notes.insert("numbers of double precision are stored in single precision".into());
                }
                let single = |(at, bytes)| match float(size, bytes) {
                    value if !value.is_finite() => Err(wrong(at, "a finite number", &value)),
                    value if (value as f32).is_infinite() => Err(wrong(at, "at most 3.4e38, single precision", &value)),
                    value => Ok(value as f32),
                };
                Values::F32(stored.map(single).collect::<Result<_, _>>()?)
            }
        };
        let names = if width == 1 { Vec::new() } else { (0..width).map(|entry| format!("{key}_{entry}")).collect() };
        Ok(Some(Feature { key: key.to_owned(), names, values }))
    }

    /// Reads a data set of 8-bit RGB images as H.264 video; `None` for any other data set.
    fn images(&mut self, key: &str, dataset: &Dataset) -> Result<Option<VideoFeature>, DataError> {
        let &[frames, height, width, 3] = dataset.shape() else { return Ok(None) };
        if !matches!(dataset.dtype(), Datatype::FixedPoint { size: 1, signed: false, .. }) {
            return Ok(None);
        }
        let what = format!("{}/obs/{key}", self.place);
        if frames != self.frames {
            return Err(DataError::mismatch(format!("images of {what}"), self.frames, frames));
        }
        let size = |value: u64| u32::try_from(value).unwrap_or(u32::MAX);
        let mut encoder = VideoEncoder::new(size(width), size(height), self.fps, &VideoSettings::default())
            .map_err(|error| DataError::mismatch(&what, "images that can be encoded", error))?;
        let mut colors = ColorHistogram::default();
        let pixels = (width * height * 3) as usize;
        for start in (0..frames).step_by(IMAGES_AT_ONCE as usize) {
            let whole = |end| SliceInfoElem::Slice { start: 0, end, step: 1 };
            let end = (start + IMAGES_AT_ONCE).min(frames);
            let rows = SliceInfoElem::Slice { start, end, step: 1 };
            let selection = SliceInfo { selections: vec![rows, whole(height), whole(width), whole(3)] };
            let read = dataset.read_slice::<u8>(&selection);
            let read = read.map_err(|error| DataError::mismatch(&what, "images", error))?;
            let (bytes, _) = read.into_raw_vec_and_offset();
            for image in bytes.chunks_exact(pixels) {
                colors.add_image(image, width as usize);
                encoder.push(image)?;
            }
        }
        Ok(Some(VideoFeature { key: format!("observation.images.{key}"), video: encoder.finish(), colors }))
    }
}

/// Column `observation.state`, concatenated from the observations in [`STATES`]; `None` if no list of them is complete.
fn state(parts: &[Feature], frames: usize) -> Option<Feature> {
    let part = |name: &&str| parts.iter().find(|part| part.key == format!("observation.{name}"));
    let used: Vec<&Feature> = STATES.iter().find_map(|names| names.iter().map(part).collect::<Option<Vec<_>>>())?;
    let names = used.iter().flat_map(|part| {
        let name = part.key.trim_start_matches("observation.");
        (0..part.length()).map(move |entry| format!("{name}_{entry}"))
    });
    let columns: Vec<(usize, Vec<f64>)> = used.iter().map(|part| (part.length(), part.numbers())).collect();
    let row = |row: usize| columns.iter().flat_map(move |(width, values)| &values[row * width..(row + 1) * width]);
    let values = (0..frames).flat_map(row).map(|value| *value as f32).collect();
    Some(Feature { key: "observation.state".into(), names: names.collect(), values: Values::F32(values) })
}

/// Type of the numbers of a data set; sizes are in bytes.
#[derive(Clone, Copy)]
enum Kind {
    Integer { size: u8, signed: bool },
    Float(u8),
}

impl Kind {
    fn of(kind: &Datatype) -> Option<Self> {
        match kind {
            Datatype::FixedPoint { size: size @ (1 | 2 | 4 | 8), signed, .. } => {
                Some(Self::Integer { size: *size, signed: *signed })
            }
            Datatype::FloatingPoint { size: size @ (2 | 4 | 8), .. } => Some(Self::Float(*size)),
            // h5py stores Booleans as an enumeration.
            Datatype::Enum { base, .. } => Self::of(base),
            _ => None,
        }
    }

    fn size(self) -> usize {
        match self {
            Self::Integer { size, .. } | Self::Float(size) => usize::from(size),
        }
    }
}

/// Integer of `size` bytes, little-endian.
fn integer(size: u8, signed: bool, bytes: &[u8]) -> i128 {
    let wide = wide(bytes);
    let unused = 64 - 8 * u32::from(size);
    if signed { i128::from(((wide << unused) as i64) >> unused) } else { i128::from(wide) }
}

/// Floating-point number of `size` bytes, little-endian.
fn float(size: u8, bytes: &[u8]) -> f64 {
    let wide = wide(bytes);
    match size {
        8 => f64::from_bits(wide),
        4 => f64::from(f32::from_bits(wide as u32)),
        _ => half(wide as u16),
    }
}

/// Up to eight bytes, little-endian, padded with zeros.
fn wide(bytes: &[u8]) -> u64 {
    let mut held = [0; 8];
    held[..bytes.len()].copy_from_slice(bytes);
    u64::from_le_bytes(held)
}

/// Value of an IEEE 754 half-precision number.
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    sign * match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2_f64.powi(exponent - 25),
    }
}

/// Name of a type for notes, without details.
fn short(kind: &Datatype) -> &'static str {
    match kind {
        Datatype::FixedPoint { .. } => "integers",
        Datatype::FloatingPoint { .. } => "floats",
        Datatype::String { .. } | Datatype::VarLen { .. } => "texts",
        Datatype::Compound { .. } => "records",
        _ => "values",
    }
}

fn open(path: &Path) -> Result<Hdf5File, DataError> {
    let options = OpenOptions::default().with_max_read_bytes(MAX_BYTES).with_max_chunk_bytes(MAX_BYTES);
    Hdf5File::open_with_options(path, options).map_err(|error| damaged(path, &error))
}

fn group(path: &Path, file: &Hdf5File, name: &str) -> Result<Group, DataError> {
    file.group(name).map_err(|_| {
        let expected = format!("a group `{name}` with demonstrations, as robomimic and LIBERO write it");
        DataError::mismatch(path.display().to_string(), expected, "none")
    })
}

/// Notes the members of a group, which is called `folder`, that are neither groups nor data sets of this file; a name
/// that several demonstrations share is noted once.
fn note_passed_over(path: &Path, group: &Group, folder: &str, notes: &mut BTreeSet<String>) -> Result<(), DataError> {
    for (name, what) in hdf5_members::passed_over(group).map_err(|error| damaged(path, &error))? {
        let start = format!("`{folder}{name}` is left out: ");
        if !notes.iter().any(|note| note.starts_with(&start)) {
            notes.insert(start + &what);
        }
    }
    Ok(())
}

fn damaged(path: &Path, error: &dyn Display) -> DataError {
    DataError::mismatch(path.display().to_string(), "a sound HDF5 file", error)
}

fn text(group: &Group, name: &str) -> Option<String> {
    group.attribute(name).ok()?.read_string().ok()
}

fn environment(data: &Group) -> Value {
    text(data, "env_args").and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default()
}

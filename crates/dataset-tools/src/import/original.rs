//! Reader of the original GenManip's episode folders, version 0.9: `meta_info.pkl`, and `lmdb/` with a pickle per key.
//!
//! ```text
//! EPISODE/meta_info.pkl                            language_instruction, num_steps, episode_name
//! EPISODE/lmdb/data.mdb
//!   arm_action, gripper_action, gripper_close      one list each, an entry per frame
//!   ee_pose_action                                 position (m), quaternion (w, x, y, z) in the robot's base frame
//!   name                                           name of the plan stage of each frame
//!   observation/robot/{qpos,qvel,ee_pose_state}
//!   observation/obj_pose/OBJECT/{position,orientation}
//!   observation/CAMERA/camera2env_pose             4x4 matrix, row-major
//!   observation/CAMERA/color_image/0000            JPEG
//!   observation/CAMERA/depth_image/0000            16-bit PNG, metres x 10,000
//! ```

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use genmanip_core::limits::{ENTRIES, Limit};

use super::image_file;
use super::lmdb::Lmdb;
use super::metadata::{self, ImportedMetadata};
use super::pickle::{Pickle, Value};
use super::{Importer, OnEpisode, SourceInfo};
use genmanip_data::depth::{decode_depth_png, encode_mm_png};
use genmanip_data::export::EpisodeRows;
use genmanip_data::export::features::{Feature, ImageFeature, Values, VideoFeature};
use genmanip_data::video::{VideoEncoder, VideoSettings};
use genmanip_data::{ColorHistogram, DataError, files};

const META: &str = "meta_info.pkl";
const META_LIMIT: Limit = Limit { what: "episode metadata", bytes: 64 << 20 };
/// Maximum folder depth searched for episodes: TASK/DATE/EPISODE.
const MAX_DEPTH: usize = 3;
/// Frame rate of the original's recordings, which do not state it, Hz.
const FPS: u32 = 30;
/// Object slots per row, as in the column `sim.object_pose` of this program's exports.
const OBJECTS: usize = 16;
/// Units of the original's depth images per millimetre: a unit is 0.1 mm.
const UNITS_PER_MM: u16 = 10;
const POSE: [&str; 7] = ["x", "y", "z", "qw", "qx", "qy", "qz"];

/// Numeric columns: name in the imported data set, keys of the original (concatenated), and prefix of the element
/// names.
const COLUMNS: [(&str, &[&str], &str); 7] = [
    ("observation.state", &["observation/robot/qpos"], "q"),
    ("observation.velocity", &["observation/robot/qvel"], "v"),
    ("action", &["arm_action", "gripper_action"], "target"),
    ("gripper_close", &["gripper_close"], ""),
    ("ee.state", &["observation/robot/ee_pose_state"], "pose"),
    ("ee.action", &["ee_pose_action"], "pose"),
    ("robot.robot2env_pose", &["observation/robot/robot2env_pose"], "matrix"),
];

/// Episode folders of the original GenManip, open for import.
pub(super) struct Original {
    folders: Vec<PathBuf>,
    taken: BTreeSet<String>,
    notes: BTreeSet<String>,
}

/// True if `root` is an episode folder or contains one, at most [`MAX_DEPTH`] levels below.
pub(super) fn is_there(root: &Path) -> Result<bool, DataError> {
    Ok(!folders(root)?.is_empty())
}

fn folders(root: &Path) -> Result<Vec<PathBuf>, DataError> {
    let (mut found, mut open, mut seen) = (Vec::new(), vec![(root.to_owned(), 0)], 0);
    while let Some((folder, depth)) = open.pop() {
        seen += 1;
        if seen > ENTRIES {
            let expected = format!("at most {ENTRIES} folders to search for episodes");
            return Err(DataError::mismatch(root.display().to_string(), expected, "more"));
        }
        if files::is_file_no_follow(&folder.join(META)) {
            found.push(folder);
            continue;
        }
        if depth < MAX_DEPTH && files::is_folder_no_follow(&folder) {
            let names = files::names(&folder)?.into_iter().map(|name| folder.join(name));
            open.extend(names.filter(|path| files::is_folder_no_follow(path)).map(|path| (path, depth + 1)));
        }
    }
    found.sort();
    Ok(found)
}

impl Original {
    pub(super) fn open(root: &Path) -> Result<Self, DataError> {
        let notes = [
            "frames are taken to be 1/30 s apart, as the original recorded them; it does not say so",
            "depth is rounded from 0.1 mm to 1 mm",
            "pictures were JPEG and are encoded anew as H.264",
            "boxes, semantic masks, traces and poses of the joints are left out",
        ];
        let notes = notes.map(str::to_owned).into();
        Ok(Self { folders: folders(root)?, taken: BTreeSet::new(), notes })
    }

    fn episode(&mut self, index: usize, folder: &Path) -> Result<Option<EpisodeRows<ImportedMetadata>>, DataError> {
        let path = folder.join(META);
        let meta = Pickle::read(&files::read(&path, META_LIMIT)?).map_err(|why| damaged(&path, &why))?;
        let meta = meta.root();
        let word = |key: &str| meta.get(key).and_then(Value::text).map(str::to_owned);
        let frames = meta.get("num_steps").and_then(Value::integer).and_then(|count| usize::try_from(count).ok());
        let frames = frames.ok_or_else(|| damaged(&path, "expected a number under `num_steps`, got none"))?;
        let instruction = word("language_instruction")
            .ok_or_else(|| damaged(&path, "expected a text under `language_instruction`, got none"))?;
        if frames == 0 {
            return Ok(None);
        }
        if frames > MAX_FRAMES {
            return Err(damaged(&path, &format!("expected at most {MAX_FRAMES} under `num_steps`, got {frames}")));
        }
        let record = Record { lmdb: Lmdb::open(&folder.join("lmdb/data.mdb"))?, folder, frames };
        let own = word("episode_name").or_else(|| folder.file_name().map(|name| name.to_string_lossy().into_owned()));
        let mut name = metadata::name(own.as_deref(), index);
        if !self.taken.insert(name.clone()) {
            name = metadata::name(None, index);
            self.taken.insert(name.clone());
        }
        let (steps, texts) = record.steps()?;
        let objects = record.objects().into_iter().collect();
        let metadata =
            ImportedMetadata { store_id: name, instruction, steps: texts, objects, ..ImportedMetadata::default() };
        let (videos, images) = (record.videos()?, record.depths()?);
        let mut rows = EpisodeRows { frames, features: record.features()?, images, videos, steps, metadata };
        rows.metadata.source_sha256 = metadata::hash(&rows);
        Ok(Some(rows))
    }
}

impl Importer for Original {
    fn info(&self) -> SourceInfo {
        SourceInfo {
            format: "genmanip-0.9",
            robot: "franka".into(),
            fps: FPS,
            episodes: self.folders.len(),
            contract: None,
            record: None,
        }
    }

    fn each(&mut self, take: OnEpisode) -> Result<(), DataError> {
        let mut empty = 0;
        for (index, folder) in self.folders.clone().iter().enumerate() {
            match self.episode(index, folder)? {
                Some(episode) => take(folder, episode)?,
                None => empty += 1,
            }
        }
        if empty > 0 {
            self.notes.insert(format!("{empty} episodes without frames are left out"));
        }
        Ok(())
    }

    fn notes(&self) -> Vec<String> {
        self.notes.iter().cloned().collect()
    }
}

fn damaged(path: &Path, why: &str) -> DataError {
    let (expected, got) = why.split_once(", got ").unwrap_or((why, "something else"));
    DataError::mismatch(path.display().to_string(), expected.trim_start_matches("expected "), got)
}

/// Maximum frames of an episode: more than an hour at 30 Hz.
const MAX_FRAMES: usize = 1 << 17;

/// Numbers of each frame, and false if double precision is needed for them (see [`Value::numbers`]).
type Frames = Vec<(Vec<f64>, bool)>;

/// Recorded frames of an episode.
struct Record<'a> {
    lmdb: Lmdb,
    folder: &'a Path,
    frames: usize,
}

impl Record<'_> {
    fn pickle(&self, key: &str) -> Result<Option<Pickle>, DataError> {
        let Some(bytes) = self.lmdb.get(key)? else { return Ok(None) };
        Pickle::read(&bytes).map(Some).map_err(|why| self.damaged(key, &why))
    }

    fn damaged(&self, key: &str, why: &str) -> DataError {
        damaged(&self.folder.join("lmdb").join(key), why)
    }

    /// Error for an image that cannot be decoded.
    fn bad_image(&self, key: &str, error: &DataError) -> DataError {
        self.damaged(key, &format!("expected an image like the others, got {error}"))
    }

    /// Numbers of a list with one entry per frame; `None` if the key does not exist.
    fn numbers(&self, key: &str) -> Result<Option<Frames>, DataError> {
        let Some(pickle) = self.pickle(key)? else { return Ok(None) };
        let entries = pickle.root().entries().unwrap_or_default();
        if entries.len() != self.frames {
            return Err(self.damaged(key, &format!("expected {} entries, got {}", self.frames, entries.len())));
        }
        let rows: Option<Vec<_>> = entries.into_iter().map(Value::numbers).collect();
        rows.map(Some).ok_or_else(|| self.damaged(key, "expected a few numbers in every entry, got something else"))
    }

    fn features(&self) -> Result<Vec<Feature>, DataError> {
        let mut features = Vec::new();
        for (ours, theirs, entry) in COLUMNS {
            let mut rows: Vec<Vec<f64>> = vec![Vec::new(); self.frames];
            let mut is_single = true;
            for key in theirs {
                let Some(part) = self.numbers(key)? else { continue };
                for (row, (values, single)) in rows.iter_mut().zip(part) {
                    row.extend(values);
                    is_single &= single;
                }
            }
            let width = rows.first().map_or(0, Vec::len);
            if width == 0 {
                if ours == "observation.state" || ours == "action" {
                    return Err(self.damaged(theirs[0], "expected a list with an entry per frame, got none"));
                }
                continue;
            }
            features.push(self.feature(ours, names(entry, width), &rows, is_single)?);
        }
        features.push(self.object_poses()?);
        for camera in self.cameras() {
            let key = format!("observation/{camera}/camera2env_pose");
            let Some(rows) = self.numbers(&key)? else { continue };
            let rows: Vec<Vec<f64>> = rows.into_iter().map(|(row, _)| row).collect();
            features.push(self.feature(
                &format!("camera.{camera}.camera2env_pose"),
                names("matrix", 16),
                &rows,
                false,
            )?);
        }
        Ok(features)
    }

    fn feature(&self, key: &str, names: Vec<String>, rows: &[Vec<f64>], is_single: bool) -> Result<Feature, DataError> {
        let width = names.len().max(1);
        if let Some(row) = rows.iter().position(|row| row.len() != width) {
            let why = format!("expected {width} numbers in frame {row}, got {}", rows[row].len());
            return Err(self.damaged(key, &why));
        }
        let flat = rows.iter().flatten();
        let values = match is_single {
            true => Values::F32(flat.map(|value| *value as f32).collect()),
            false => Values::F64(flat.copied().collect()),
        };
        Ok(Feature { key: key.into(), names, values })
    }

    /// Names of the objects that have poses, sorted.
    fn objects(&self) -> BTreeSet<String> {
        let of = |key: &str| Some(key.strip_prefix("observation/obj_pose/")?.strip_suffix("/position")?.to_owned());
        self.lmdb.keys().filter_map(of).collect()
    }

    /// Column `sim.object_pose`: position (m) and quaternion (w, x, y, z) of each object, in the order of
    /// [`Record::objects`]; zeros in unused slots.
    fn object_poses(&self) -> Result<Feature, DataError> {
        let objects = self.objects();
        if objects.len() > OBJECTS {
            let why = format!("expected at most {OBJECTS} objects, got {}", objects.len());
            return Err(self.damaged("observation/obj_pose", &why));
        }
        let mut values = vec![0.0; self.frames * OBJECTS * POSE.len()];
        for (place, object) in objects.iter().enumerate() {
            for (part, from, width) in [("position", 0, 3), ("orientation", 3, 4)] {
                let key = format!("observation/obj_pose/{object}/{part}");
                let rows = self.numbers(&key)?.unwrap_or_default();
                for (row, (numbers, _)) in rows.into_iter().enumerate() {
                    if numbers.len() != width {
                        return Err(self.damaged(&key, &format!("expected {width} numbers, got {}", numbers.len())));
                    }
                    let at = (row * OBJECTS + place) * POSE.len() + from;
                    values[at..at + width].copy_from_slice(&numbers);
                }
            }
        }
        let names = (0..OBJECTS).flat_map(|object| POSE.map(|part| format!("object_{object}.{part}"))).collect();
        Ok(Feature { key: "sim.object_pose".into(), names, values: Values::F64(values) })
    }

    /// Index of the plan stage of each frame, and the names of the stages; both empty if not every frame has a name.
    fn steps(&self) -> Result<(Vec<usize>, Vec<String>), DataError> {
        let Some(pickle) = self.pickle("name")? else { return Ok(Default::default()) };
        let entries = pickle.root().entries().unwrap_or_default();
        let names: Vec<&str> = entries.into_iter().filter_map(Value::text).collect();
        if names.len() != self.frames {
            return Ok(Default::default());
        }
        let mut texts: Vec<String> = Vec::new();
        let steps = names.into_iter().map(|name| {
            texts.iter().position(|known| known == name).unwrap_or_else(|| {
                texts.push(name.into());
                texts.len() - 1
            })
        });
        let steps = steps.collect();
        Ok((steps, texts))
    }

    fn cameras(&self) -> BTreeSet<String> {
        let of = |key: &str| Some(key.strip_prefix("observation/")?.strip_suffix("/color_image/0000")?.to_owned());
        self.lmdb.keys().filter_map(of).collect()
    }

    /// Keys and encoded image files of a camera (`kind` is `color_image` or `depth_image`), in the order of the frames;
    /// empty if the first frame has none.
    fn image_files(
        &self,
        camera: &str,
        kind: &str,
    ) -> Result<impl Iterator<Item = Result<(String, Vec<u8>), DataError>>, DataError> {
        let key = move |frame: usize| format!("observation/{camera}/{kind}/{frame:04}");
        let frames = if self.lmdb.get(&key(0))?.is_some() { self.frames } else { 0 };
        Ok((0..frames).map(move |frame| {
            let missing = || self.damaged(&key(frame), "expected an image file, got none");
            let pickle = self.pickle(&key(frame))?.ok_or_else(missing)?;
            let bytes = pickle.root().bytes().ok_or_else(missing)?;
            Ok((key(frame), bytes.to_vec()))
        }))
    }

    fn videos(&self) -> Result<Vec<VideoFeature>, DataError> {
        let video = |camera: String| {
            let mut encoder: Option<VideoEncoder> = None;
            let mut colors = ColorHistogram::default();
            for file in self.image_files(&camera, "color_image")? {
                let (key, file) = file?;
                let (width, height, rgb) = image_file::decode(&file).map_err(|error| self.bad_image(&key, &error))?;
                let encoder = match &mut encoder {
                    Some(encoder) => encoder,
                    none => {
                        let begun = VideoEncoder::new(width, height, FPS, &VideoSettings::default());
                        none.insert(begun.map_err(|error| self.bad_image(&key, &error))?)
                    }
                };
                encoder.push(&rgb).map_err(|error| self.bad_image(&key, &error))?;
                colors.add_image(&rgb, width as usize);
            }
            let encoder = encoder.ok_or_else(|| self.damaged(&camera, "expected images, got none"))?;
            Ok(VideoFeature { key: format!("observation.images.{camera}"), video: encoder.finish(), colors })
        };
        self.cameras().into_iter().map(video).collect()
    }

    fn depths(&self) -> Result<Vec<ImageFeature>, DataError> {
        let mut images = Vec::new();
        for camera in self.cameras() {
            let mut image = ImageFeature {
                key: format!("observation.images.{camera}_depth"),
                width: 0,
                height: 0,
                png: Vec::new(),
            };
            for file in self.image_files(&camera, "depth_image")? {
                let (key, file) = file?;
                let decoded = decode_depth_png(&file).map_err(|error| self.bad_image(&key, &error))?;
                let (width, height, tenths) = decoded;
                if !image.png.is_empty() && (width, height) != (image.width, image.height) {
                    return Err(self.damaged(&camera, "expected depth images of one size, got several"));
                }
                (image.width, image.height) = (width, height);
                let mm: Vec<u16> = tenths.iter().map(|tenth| millimetres(*tenth)).collect();
                image.png.push(encode_mm_png(&mm, width, height)?);
            }
            if !image.png.is_empty() {
                images.push(image);
            }
        }
        Ok(images)
    }
}

/// Depth in millimetres from tenths of millimetres, rounded; a nonzero depth never becomes 0, which means no return.
fn millimetres(tenths: u16) -> u16 {
    let rounded = tenths / UNITS_PER_MM + u16::from(tenths % UNITS_PER_MM >= UNITS_PER_MM / 2);
    rounded.max(u16::from(tenths > 0))
}

fn names(entry: &str, width: usize) -> Vec<String> {
    match (entry, width) {
        (_, 1) => Vec::new(),
        ("pose", 7) => POSE.map(str::to_owned).into(),
        ("pose", _) | ("", _) => (0..width).map(|place| format!("{place}")).collect(),
        (entry, _) => (0..width).map(|place| format!("{entry}_{place}")).collect(),
    }
}

//! Import of data sets of other programs: LeRobot v3.0, v2.1 and v2.0, the episode folders of the original GenManip,
//! and HDF5 demonstrations of robomimic, MimicGen and LIBERO.
//!
//! The result is a LeRobotDataset v3.0, with the sibling `<name>-depth` if the source has depth. Numeric columns, their
//! names and instructions are kept, though some numeric types are widened or narrowed; H.264 video is copied without
//! re-encoding. Nothing in the source is executed.

mod convert;
mod hdf5_members;
mod image_file;
mod importer;
mod lerobot;
mod lmdb;
mod metadata;
mod original;
mod pickle;
mod robomimic;
mod videos;

use std::path::{Path, PathBuf};

use serde::Serialize;

use genmanip_data::export::{EpisodeRows, ExportReport};
use genmanip_data::lerobot::info::INFO;
use genmanip_data::lerobot::origin::Origin;
use genmanip_data::lerobot::writer::DatasetWriter;
use genmanip_data::lerobot::{begin, begin_sibling, card, check_free, check_owner, depth_path};
use genmanip_data::{DataError, files};
use importer::{Importer, OnEpisode, SourceInfo};
use metadata::ImportedMetadata;

pub use convert::to_v21;
pub use genmanip_data::lerobot::imported::Imported;
pub use image_file::decode as decode_image;
pub use importer::ImportSettings;

/// Summary of an import.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// Paths and sizes of the written data set.
    #[serde(flatten)]
    pub written: ExportReport,
    /// Format of the source, and differences from it.
    pub imported: Imported,
}

/// Imports the data set at `source` to `out` (and `<out>-depth`); `on_episode` is called after each episode with the
/// total number of episodes of the source.
///
/// # Errors
/// If the format of `source` is unknown, it is damaged or holds unsupported contents, or `out` exists; `out` is then
/// not created.
pub fn import(
    source: &Path,
    settings: &ImportSettings,
    out: &Path,
    on_episode: &mut dyn FnMut(usize),
) -> Result<ImportReport, DataError> {
    let mut importer = open(source, settings)?;
    let info = importer.info();
    let mut writers = Writers::begin(info, settings, out)?;
    importer.each(&mut |from, episode| {
        writers.push(from, episode)?;
        on_episode(writers.info.episodes);
        Ok(())
    })?;
    if writers.colors.episodes() == 0 {
        let what = format!("episodes with frames in {}", source.display());
        return Err(DataError::mismatch(what, "at least one", 0));
    }
    writers.publish(importer.notes(), settings, source, out)
}

/// Importer for the format of the source.
///
/// # Errors
/// If the format is unknown, the source cannot be read, or it is a data set of this program, which needs no import.
fn open(source: &Path, settings: &ImportSettings) -> Result<Box<dyn Importer>, DataError> {
    if files::is_file_no_follow(&source.join(INFO)) {
        let dataset = lerobot::Lerobot::open(source, settings)?;
        dataset.check_foreign()?;
        return Ok(Box::new(dataset));
    }
    if files::is_folder_no_follow(source) && original::is_there(source)? {
        return Ok(Box::new(original::Original::open(source)?));
    }
    if robomimic::is_there(source)? {
        return Ok(Box::new(robomimic::Robomimic::open(source)?));
    }
    let expected = "a folder with a LeRobot data set (meta/info.json) or with episodes of the original GenManip \
                    (meta_info.pkl), or demonstrations of robomimic or LIBERO (.hdf5)";
    Err(DataError::mismatch(source.display().to_string(), expected, "none"))
}

/// Unpublished data set and its depth sibling.
struct Writers {
    info: SourceInfo,
    colors: DatasetWriter<ImportedMetadata>,
    /// Writer of the depth sibling, created with the first episode; `None` if that has no depth images.
    depths: Option<DatasetWriter<ImportedMetadata>>,
    target: PathBuf,
    episodes_per_depth_file: usize,
}

impl Writers {
    fn begin(info: SourceInfo, settings: &ImportSettings, out: &Path) -> Result<Self, DataError> {
        check_free(out)?;
        let colors = DatasetWriter::new(begin(out, None)?, settings.episodes_per_file.max(1), info.fps, &info.robot);
        let episodes_per_depth_file = settings.episodes_per_depth_file.max(1);
        Ok(Self { info, colors, depths: None, target: out.into(), episodes_per_depth_file })
    }

    fn push(&mut self, from: &Path, mut episode: EpisodeRows<ImportedMetadata>) -> Result<(), DataError> {
        let placed = |error: DataError| error.with_path(from);
        let images = std::mem::take(&mut episode.images);
        let is_first = self.colors.episodes() == 0;
        if is_first && !images.is_empty() {
            let staging = begin_sibling(&self.target)?;
            let per_file = self.episodes_per_depth_file;
            self.depths = Some(DatasetWriter::new(staging, per_file, self.info.fps, &self.info.robot));
        }
        if let Some(depths) = &mut self.depths {
            let EpisodeRows { frames, metadata, .. } = &episode;
            let (features, videos, steps) = Default::default();
            let rows = EpisodeRows { frames: *frames, features, images, videos, steps, metadata: metadata.clone() };
            depths.push(rows).map_err(placed)?;
        } else if !images.is_empty() {
            let what = format!("depth images of episode {}", episode.metadata.store_id);
            return Err(placed(DataError::mismatch(what, "none, like the first episode", images.len())));
        }
        if let Some(record) = &self.info.record {
            self.colors.copy_record(record, &episode.metadata.store_id)?;
        }
        self.colors.push(episode).map_err(placed)
    }

    fn publish(
        self,
        notes: Vec<String>,
        settings: &ImportSettings,
        source: &Path,
        out: &Path,
    ) -> Result<ImportReport, DataError> {
        let placed = |error: DataError| error.with_path(source);
        let (episodes, frames) = (self.colors.episodes(), self.colors.frames());
        if self.depths.is_none() {
            check_owner(&depth_path(out), None)?;
        }
        let imported = Imported {
            format: self.info.format.into(),
            fps: self.info.fps,
            depth: self.depths.is_some(),
            record: self.info.record.is_some(),
            episodes_per_file: settings.episodes_per_file.max(1),
            episodes_per_depth_file: self.episodes_per_depth_file,
            notes,
        };
        let origin = Origin::Imported(imported.clone());
        let name = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let depths = self.depths.map(|depths| depths.finish(&card::depth(&name), &origin, None));
        let depths = depths.transpose().map_err(placed)?;
        let colors = self.colors.finish(&origin.card(&name, "v3.0"), &origin, self.info.contract.as_ref());
        let colors = colors.map_err(placed)?;
        let depth_dataset = depths.is_some().then(|| depth_path(out));
        if let Some(depths) = depths {
            depths.publish()?;
        }
        colors.publish()?;
        let written = ExportReport { dataset: out.into(), depth_dataset, episodes, frames, left_out: Vec::new() };
        Ok(ImportReport { written, imported })
    }
}

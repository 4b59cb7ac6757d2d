//! Export to LeRobotDataset v3.0.
//!
//! Deterministic: equal stores and settings give equal bytes. Columns that a policy must not train on by accident have
//! their own prefix: `observation.*` and `action` are the native state and action, images are RGB video; simulator
//! ground truth is `sim.*`, end-effector variants `ee.*`, camera poses `camera.*`; depth and instance masks are in a
//! sibling data set, `<name>-depth`, with the same indices.

pub mod card;
mod croissant;
mod dataset_metadata;
mod depth;
pub mod episodes;
mod features;
pub mod imported;
pub mod info;
pub mod metadata_files;
pub mod origin;
mod reader;
pub mod record;
mod settings;
pub mod stats;
pub mod v21;
pub mod writer;

use std::path::{Path, PathBuf};

use genmanip_core::limits;
use genmanip_core::{ActionContract, Document, Episode, RobotModel};

use crate::atomic_write::{self, AtomicFolder};
use crate::export::rows::rows;
use crate::export::{EpisodeRows, ExportReport, ExportSettings, Exporter, Selection, Source};
use crate::{CameraTrack, DataError, EpisodeStore, files};

pub use croissant::{Card, write_card};
pub use reader::{EpisodeRow, LerobotDataset};
pub use record::RECORD;
pub use settings::{CONTRACT, LerobotSettings, SETTINGS, SUBTASKS};
pub use v21::export_v21;

impl LerobotSettings {
    /// Reads the export settings of a data set.
    ///
    /// # Errors
    /// If it is not a data set, or was imported.
    pub fn of(dataset: &Path) -> Result<Self, DataError> {
        match origin::Origin::read(dataset)? {
            origin::Origin::Exported(settings) => Ok(settings),
            origin::Origin::Imported(_) => {
                let expected = "a data set exported from this program's own episodes";
                Err(DataError::mismatch(dataset.display().to_string(), expected, "one that was imported"))
            }
        }
    }
}

/// Exports the selected episodes to a data set at `dataset` (and `<dataset>-depth`).
///
/// `robot` names the joints and gives the end-effector pose of an action. Both data sets are published atomically, the
/// depth data set first: once `dataset` exists, both are complete.
///
/// # Errors
/// If no episode is selected, images are missing or have another rate, episodes do not match each other, a target
/// exists, or writing fails; the targets are then unchanged.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &LerobotSettings,
    dataset: &Path,
) -> Result<ExportReport, DataError> {
    let exporter = Exporter::new(store, selection, robot, &settings.export)?;
    let mut writers = Writers::begin(settings, robot, dataset)?;
    let report = exporter.each(dataset, |source, rows| {
        writers.push(source, rows, &settings.export)?;
        if settings.record { writers.colors.copy_record(store, &source.episode.result.id) } else { Ok(()) }
    })?;
    let depth_dataset = writers.publish(settings, &exporter.contract(), dataset)?;
    Ok(ExportReport { depth_dataset, ..report })
}

/// Writes episodes that are not in a store, with their tracks, to a data set without native record at `dataset` (and
/// `<dataset>-depth`).
///
/// # Errors
/// As [`export`].
pub fn write(
    episodes: &mut dyn Iterator<Item = (Episode, Vec<CameraTrack>)>,
    robot: &RobotModel,
    settings: &LerobotSettings,
    dataset: &Path,
) -> Result<ExportReport, DataError> {
    let settings = LerobotSettings { record: false, ..settings.clone() };
    let mut writers = Writers::begin(&settings, robot, dataset)?;
    for (episode, tracks) in episodes {
        let source = Source { episode, tracks, masks: Vec::new() };
        writers.push(&source, rows(&source, robot, &settings.export)?, &settings.export)?;
    }
    let (episodes, frames) = (writers.colors.episodes(), writers.colors.frames());
    if episodes == 0 {
        return Err(DataError::mismatch("episodes to write", "at least one", 0));
    }
    let depth_dataset = writers.publish(&settings, &settings.export.contract(robot), dataset)?;
    Ok(ExportReport { dataset: dataset.into(), depth_dataset, episodes, frames, left_out: Vec::new() })
}

/// Unpublished data set and its depth sibling.
struct Writers {
    colors: writer::DatasetWriter,
    depths: Option<writer::DatasetWriter>,
}

impl Writers {
    fn begin(settings: &LerobotSettings, robot: &RobotModel, dataset: &Path) -> Result<Self, DataError> {
        let LerobotSettings { export, episodes_per_file, episodes_per_depth_file, .. } = settings;
        if *episodes_per_file == 0 || *episodes_per_depth_file == 0 {
            return Err(DataError::mismatch("episodes per file", "at least 1", 0));
        }
        let writer = |target: &Path, episodes_per_file| {
            let staging = begin(target, settings.run.as_deref())?;
            Ok::<_, DataError>(writer::DatasetWriter::new(staging, episodes_per_file, export.fps, &robot.name))
        };
        let colors = writer(dataset, *episodes_per_file)?;
        let depths =
            export.has_sibling().then(|| writer(&depth_path(dataset), *episodes_per_depth_file)).transpose()?;
        Ok(Self { colors, depths })
    }

    fn push(&mut self, source: &Source, rows: EpisodeRows, settings: &ExportSettings) -> Result<(), DataError> {
        if let Some(depths) = &mut self.depths {
            depths.push(depth::depth_rows(source, &rows, settings)?)?;
        }
        self.colors.push(rows)
    }

    /// Publishes both; returns the path of the depth data set.
    fn publish(
        self,
        settings: &LerobotSettings,
        contract: &ActionContract,
        dataset: &Path,
    ) -> Result<Option<PathBuf>, DataError> {
        let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let origin = origin::Origin::Exported(settings.clone());
        let depths = self.depths.map(|depths| depths.finish(&card::depth(&name), &origin, None)).transpose()?;
        let colors = self.colors.finish(&origin.card(&name, "v3.0"), &origin, Some(contract))?;
        let depth_dataset = depths.is_some().then(|| depth_path(dataset));
        if let Some(depths) = depths {
            depths.publish()?;
        }
        colors.publish()?;
        Ok(depth_dataset)
    }
}

/// Starts a data set at `target`; removes unfinished files of dead processes.
///
/// With `run`, the id of the collection run that owns it, an earlier data set of that run is replaced. Without,
/// `target` must not exist; if two programs write different data sets there at the same time, the second fails.
///
/// # Errors
/// As [`check_owner`], and if a folder cannot be created.
pub fn begin(target: &Path, run: Option<&str>) -> Result<AtomicFolder, DataError> {
    check_owner(target, run)?;
    place(target, run.is_some())
}

/// As [`begin`], for the depth sibling of a data set without a run. The sibling is published first: if it exists alone,
/// a call was killed between the two renames, and a call with the same contents resumes.
///
/// # Errors
/// As [`check_free`], and if a folder cannot be created.
pub fn begin_sibling(dataset: &Path) -> Result<AtomicFolder, DataError> {
    check_free(dataset)?;
    place(&depth_path(dataset), false)
}

fn place(target: &Path, replaces: bool) -> Result<AtomicFolder, DataError> {
    atomic_write::prepare_parent(target)?;
    if replaces { AtomicFolder::replacing(target) } else { AtomicFolder::accepting_identical(target) }
}

/// Fails if the data set exists, or if anything but a data set is at the path of its depth sibling.
///
/// # Errors
/// [`DataError::Exists`].
pub fn check_free(dataset: &Path) -> Result<(), DataError> {
    check_owner(dataset, None)?;
    let sibling = depth_path(dataset);
    match files::is_file_no_follow(&sibling.join(info::INFO)) {
        true => Ok(()),
        false => check_owner(&sibling, None),
    }
}

/// Path of the depth sibling of a data set.
pub fn depth_path(dataset: &Path) -> PathBuf {
    let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    dataset.with_file_name(format!("{name}-depth"))
}

/// Fails unless the target is free or a data set of the given run, according to its settings.
///
/// # Errors
/// [`DataError::Exists`] without a run; [`DataError::NotOurs`] if the target is not a data set of the run.
pub fn check_owner(target: &Path, run: Option<&str>) -> Result<(), DataError> {
    let Ok(about) = std::fs::symlink_metadata(target) else { return Ok(()) };
    let Some(run) = run else { return Err(DataError::Exists { path: target.into() }) };
    let mark = target.join(SETTINGS);
    let known = files::read_no_follow(&mark, limits::SETTINGS).ok();
    let known = known.and_then(|text| LerobotSettings::from_bytes(&text).ok()).and_then(|settings| settings.run);
    if about.is_dir() && known.as_deref() == Some(run) {
        Ok(())
    } else {
        Err(DataError::NotOurs { path: target.into() })
    }
}

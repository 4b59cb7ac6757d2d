//! Export to LeRobotDataset v3.0, the format that training code of the field opens directly.
//!
//! A pure function of the store: equal stores and settings give equal bytes.
//! What a policy must not see by accident is kept out of its way: `observation.*` and `action` are the native state
//! and action, pictures are RGB video, simulator truth is named `sim.*`, end-effector variants `ee.*`, camera poses
//! `camera.*`, and depth lives in a data set of its own, `<name>-depth`, with the same indices.

mod card;
mod depth;
mod episodes;
mod features;
mod info;
mod rows;
mod stats;
mod writer;

use std::path::{Path, PathBuf};

use genmanip_core::limits;
use genmanip_core::{Document, Episode, RobotModel};
use serde::{Deserialize, Serialize};

use crate::{CameraTrack, DataError, EpisodeStore, files};

/// Where a data set says how it was made.
const SETTINGS: &str = "meta/lerobot_settings.json";

/// How a data set is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LerobotSettings {
    /// Frames per second; the control rate is a whole multiple. Default 15, every fourth 60 Hz step.
    pub fps: u32,
    /// Cameras whose pictures become video. Default `static` and `wrist`.
    pub cameras: Vec<String>,
    /// Whether the sibling data set `<name>-depth` is written. Default true.
    pub depth: bool,
    /// Whether the native record of each episode is carried along in `extras/record`, itself an episode store
    /// from which the episodes can be replayed. Default true.
    pub record: bool,
    /// Episodes per data and video file; boundaries depend on the episode index alone. Default 100,
    /// which keeps video files of typical episodes under 200 MB.
    pub episodes_per_file: usize,
    /// Episodes per file of the depth data set, whose pictures are larger. Default 10.
    pub episodes_per_depth_file: usize,
    /// Whether each episode is drawn in a look of its own; its seed is then a column, `variation_seed`. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_varied: bool,
    /// The run that it is made for: only a data set of the same run is ever replaced. Default none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
}

impl Default for LerobotSettings {
    fn default() -> Self {
        Self {
            fps: 15,
            cameras: vec!["static".into(), "wrist".into()],
            depth: true,
            record: true,
            episodes_per_file: 100,
            episodes_per_depth_file: 10,
            is_varied: false,
            run: None,
        }
    }
}

impl Document for LerobotSettings {
    const SCHEMA: &'static str = "genmanip.lerobot_settings/2";
}

/// Which episodes of a store are exported; attempts without frames never are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Those that reached their goal.
    Verified,
    /// Failed ones too; `success` tells them apart.
    Recorded,
    /// These, in this order.
    Ids(Vec<String>),
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ExportReport {
    /// The data set.
    pub dataset: PathBuf,
    /// The depth data set.
    pub depth_dataset: Option<PathBuf>,
    /// Number of episodes.
    pub episodes: usize,
    /// Number of frames.
    pub frames: usize,
    /// Damaged episodes, which are not in it, with what is wrong.
    pub left_out: Vec<(String, String)>,
}

/// One episode with what its cameras saw.
pub(crate) struct Source {
    pub(crate) episode: Episode,
    pub(crate) tracks: Vec<CameraTrack>,
}

/// Writes the selected episodes as a data set at `dataset` (and `<dataset>-depth`).
///
/// `robot` names the joints and gives the end-effector pose of an action.
/// Both data sets are written aside and renamed, the depth data set first: where `dataset` is, both are whole.
///
/// # Errors
/// When nothing is selected, pictures are missing or have another rate, episodes do not fit each other,
/// a target exists, or the disk refuses; nothing is then changed.
pub fn export(
    store: &EpisodeStore,
    selection: &Selection,
    robot: &RobotModel,
    settings: &LerobotSettings,
    dataset: &Path,
) -> Result<ExportReport, DataError> {
    check(settings)?;
    let ids = selected(store, selection)?;
    if ids.is_empty() {
        return Err(DataError::mismatch("episodes to export", "at least one", 0));
    }
    let depth_dataset = settings.depth.then(|| depth_path(dataset));
    for target in [Some(dataset), depth_dataset.as_deref()].into_iter().flatten() {
        check_owner(target, settings.run.as_deref())?;
    }
    if let Some(parent) = dataset.parent().filter(|parent| !parent.as_os_str().is_empty()) {
        std::fs::create_dir_all(parent).map_err(DataError::io("create the folder", parent))?;
    }

    let mut colors = writer::DatasetWriter::new(dataset, settings.episodes_per_file, settings.fps, &robot.name)?;
    let mut depths = depth_dataset
        .as_deref()
        .map(|path| writer::DatasetWriter::new(path, settings.episodes_per_depth_file, settings.fps, &robot.name))
        .transpose()?;
    let mut left_out = Vec::new();
    for id in &ids {
        let source = match read_source(store, id, settings) {
            // Whoever names episodes wants these; of all others the sound ones are of use.
            Err(error) if error.is_damage() && !matches!(selection, Selection::Ids(_)) => {
                left_out.push((id.clone(), error.to_string()));
                continue;
            }
            source => source?,
        };
        colors.push(rows::color_rows(&source, robot, settings)?)?;
        if let Some(depths) = &mut depths {
            depths.push(depth::depth_rows(&source, settings)?)?;
        }
        if settings.record {
            colors.copy_record(store, id)?;
        }
    }
    if left_out.len() == ids.len() {
        let (id, why) = &left_out[0];
        return Err(DataError::mismatch("episodes to export", "at least one sound", format!("{id}: {why}")));
    }
    let frames = colors.frames();
    let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let depths = depths.map(|depths| depths.finish(&card::depth(&name), settings)).transpose()?;
    let colors = colors.finish(&card::color(&name, settings), settings)?;
    if let Some(depths) = depths {
        depths.publish()?;
    }
    colors.publish()?;
    let episodes = ids.len() - left_out.len();
    Ok(ExportReport { dataset: dataset.into(), depth_dataset, episodes, frames, left_out })
}

/// Number of dataset frames of an episode, and control steps per dataset frame.
///
/// Frame i shows control step `i · stride`; the last frame may stand for fewer steps. Pictures are drawn at these steps.
///
/// # Errors
/// When the control rate is not a whole multiple of `fps`.
///
/// ```
/// assert_eq!(genmanip_data::lerobot::sampling(9, 60.0, 15).unwrap(), (3, 4));
/// ```
pub fn sampling(control_steps: usize, control_rate_hz: f64, fps: u32) -> Result<(usize, usize), DataError> {
    let stride = control_rate_hz / f64::from(fps);
    if !(stride >= 1.0 && stride.fract() == 0.0 && stride < 1e6) {
        return Err(DataError::mismatch("rate of the data set", format!("a divisor of {control_rate_hz} Hz"), fps));
    }
    let stride = stride as usize;
    Ok((control_steps.div_ceil(stride), stride))
}

fn check(settings: &LerobotSettings) -> Result<(), DataError> {
    let LerobotSettings { fps, cameras, depth, episodes_per_file, episodes_per_depth_file, .. } = settings;
    if *fps == 0 || *episodes_per_file == 0 || *episodes_per_depth_file == 0 {
        return Err(DataError::mismatch("fps and episodes per file", "at least 1", 0));
    }
    if *depth && cameras.is_empty() {
        return Err(DataError::mismatch("cameras of the depth data set", "at least one", 0));
    }
    Ok(())
}

fn selected(store: &EpisodeStore, selection: &Selection) -> Result<Vec<String>, DataError> {
    let only_verified = match selection {
        Selection::Ids(ids) => return Ok(ids.clone()),
        Selection::Verified => true,
        Selection::Recorded => false,
    };
    let mut selected = Vec::new();
    for id in store.ids()? {
        match store.read_attempt(&id) {
            Ok((result, true)) if result.success || !only_verified => selected.push(id),
            // Found again, and named, when it is read.
            Err(error) if error.is_damage() => selected.push(id),
            attempt => drop(attempt?),
        }
    }
    Ok(selected)
}

fn read_source(store: &EpisodeStore, id: &str, settings: &LerobotSettings) -> Result<Source, DataError> {
    let episode = store.read(id)?;
    let (frames, _) = sampling(episode.frames.len(), episode.result.control_rate_hz, settings.fps)?;
    let mut tracks = Vec::new();
    for camera in &settings.cameras {
        let track = store.read_track(id, settings.fps, camera)?;
        if track.video.frames.len() != frames {
            let what = format!("pictures of camera {camera} in episode {id}");
            return Err(DataError::mismatch(what, frames, track.video.frames.len()));
        }
        tracks.push(track);
    }
    Ok(Source { episode, tracks })
}

/// Where the depth data set of a data set lies.
pub fn depth_path(dataset: &Path) -> PathBuf {
    let name = dataset.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    dataset.with_file_name(format!("{name}-depth"))
}

/// Refuses to replace what a run did not make itself: the settings inside a data set name its run.
///
/// # Errors
/// [`DataError::Exists`] without a run, [`DataError::NotOurs`] when something else is there than a data set of the run.
pub fn check_owner(target: &Path, run: Option<&str>) -> Result<(), DataError> {
    let Ok(about) = std::fs::symlink_metadata(target) else { return Ok(()) };
    let Some(run) = run else { return Err(DataError::Exists { path: target.into() }) };
    let mark = target.join(SETTINGS);
    let known = files::read_own(&mark, limits::SETTINGS).ok();
    let known = known.and_then(|text| LerobotSettings::from_bytes(&text).ok()).and_then(|settings| settings.run);
    if about.is_dir() && known.as_deref() == Some(run) {
        Ok(())
    } else {
        Err(DataError::NotOurs { path: target.into() })
    }
}

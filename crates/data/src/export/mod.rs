//! Format-independent part of an export: episode selection, rate, actions, columns and images.
//!
//! A format's writer receives each episode as rows and only serialises them.

mod boxes;
pub mod choice;
pub mod features;
pub mod metadata;
pub mod privileged;
pub mod rows;
pub mod steps;

use std::path::{Path, PathBuf};

use genmanip_core::{
    ActionContract, ActionSpace, ActionSpec, Episode, EpisodeResult, ExpertStyle, GripperEncoding, Interpolation,
    RobotModel,
};
use serde::{Deserialize, Serialize};

use crate::atomic_write::{self, AtomicFolder};
use crate::masks::MaskTrack;
use crate::{CameraTrack, DataError, EpisodeStore, Provenance};

/// Contents of the rows of a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExportSettings {
    /// Rows per second; the control rate is a whole multiple. Default 15, every fourth 60 Hz step.
    pub fps: u32,
    /// Encoding of the `action` column. Default [`default_action`].
    pub action: ActionSpec,
    /// Cameras whose images are exported. Default `static` and `wrist`.
    pub cameras: Vec<String>,
    /// Export depth images too. Default true.
    pub depth: bool,
    /// Optional columns to export. Default none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub columns: Vec<ExtraColumns>,
    /// True for a randomised appearance per episode; its seed is exported as `variation_seed`. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_varied: bool,
    /// True for corrected episodes, in which another policy acted before the expert. The column `is_correction` marks
    /// the expert's rows. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub has_corrections: bool,
    /// Style of the expert that made the demonstrations. Default `default`.
    #[serde(skip_serializing_if = "ExpertStyle::is_default")]
    pub expert: ExpertStyle,
    /// Index of the appearance randomisation; other indices give other appearances of the same episodes. Default 0,
    /// that of `collect`.
    #[serde(skip_serializing_if = "is_usual_look")]
    pub look: u64,
}

fn is_usual_look(look: &u64) -> bool {
    *look == 0
}

impl Default for ExportSettings {
    fn default() -> Self {
        Self {
            fps: 15,
            action: default_action(),
            cameras: vec!["static".into(), "wrist".into()],
            depth: true,
            columns: Vec::new(),
            is_varied: false,
            has_corrections: false,
            expert: ExpertStyle::Default,
            look: 0,
        }
    }
}

/// Optional columns, exported on request only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExtraColumns {
    /// Simulator ground truth of the objects, `sim.object_pose` and the like: for critics, teachers and analysis, not
    /// for policies.
    Sim,
    /// Bounding boxes of the objects in each camera's images, and their visible pixels: `sim.box.<camera>` and
    /// `sim.visible_pixels.<camera>`.
    Boxes,
    /// Instance masks as images `observation.images.<camera>_mask` in the sibling data set.
    Masks,
}

impl ExportSettings {
    /// True if instance masks are needed.
    pub fn needs_masks(&self) -> bool {
        let asks = |columns: &ExtraColumns| matches!(columns, ExtraColumns::Boxes | ExtraColumns::Masks);
        !self.cameras.is_empty() && self.columns.iter().any(asks)
    }

    /// True if there are depth or mask images, which are written to a sibling data set.
    pub fn has_sibling(&self) -> bool {
        self.depth || (self.columns.contains(&ExtraColumns::Masks) && !self.cameras.is_empty())
    }

    /// The contract of the `action` column for a robot.
    pub fn contract(&self, robot: &RobotModel) -> ActionContract {
        let joints: Vec<&str> = robot.arm_joints().map(|joint| joint.name.as_str()).collect();
        ActionContract {
            action: self.action,
            rate_hz: f64::from(self.fps),
            robot: robot.name.clone(),
            names: self.action.names(&joints),
        }
    }
}

/// Absolute joint targets and gripper opening, linearly interpolated: at any rate, a row ends with exactly the recorded
/// command.
pub fn default_action() -> ActionSpec {
    ActionSpec { between: Interpolation::Linear, ..ActionSpec::native() }
}

/// Description of an `action` column, for data set cards.
pub fn describe_action(spec: &ActionSpec) -> String {
    let rotation = spec.rotation.description();
    let motion = match spec.space {
        ActionSpace::JointPosition => "absolute arm joint targets (rad)".into(),
        ActionSpace::JointDegrees => "absolute arm joint targets (degrees)".into(),
        ActionSpace::JointDelta => "changes of the arm joint targets over the row (rad)".into(),
        ActionSpace::JointVelocity => "speeds of the arm joint targets during the row (rad/s)".into(),
        ActionSpace::EePose => format!("absolute tool pose that the joint targets lead to: position (m), {rotation}"),
        ActionSpace::EeDelta => format!(
            "change of the commanded tool pose over the row, along and about the world's axes, from the pose that the row \
             before asked for: position (m), {rotation}"
        ),
    };
    let between = match (spec.space, spec.between) {
        (ActionSpace::JointVelocity, _) | (_, Interpolation::Linear) => {
            "joint targets move evenly there during the row"
        }
        (_, Interpolation::Hold) => "commanded from the beginning of the row on",
    };
    let opening = match spec.gripper.encoding {
        GripperEncoding::OpenPercent => "opening (0 closed to 100 open)",
        _ => "opening width (m)",
    };
    format!("{motion}, and {opening}; what was in force at the end of the row's interval; {between}")
}

/// Selection of the episodes to export; attempts without recorded frames are never exported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Successful episodes only.
    Verified,
    /// Failed episodes too; the column `success` distinguishes them.
    Recorded,
    /// Episodes whose commands came from one of these, successful ones only unless `failed`.
    From {
        /// Sources of the commands.
        sources: Vec<Provenance>,
        /// Failed episodes too.
        failed: bool,
    },
    /// The given episodes, in this order.
    Ids(Vec<String>),
}

impl Selection {
    /// Episodes from some sources, or from all if none is named; successful ones only unless `failed`.
    pub fn of(sources: &[Provenance], failed: bool) -> Self {
        match (sources, failed) {
            ([], false) => Self::Verified,
            ([], true) => Self::Recorded,
            (sources, failed) => Self::From { sources: sources.to_vec(), failed },
        }
    }

    /// Ids of the selected episodes. Includes damaged ones; reading them reports the damage.
    ///
    /// # Errors
    /// If the store cannot be listed.
    pub fn ids(&self, store: &EpisodeStore) -> Result<Vec<String>, DataError> {
        let (only_verified, sources) = match self {
            Self::Ids(ids) => return Ok(ids.clone()),
            Self::Verified => (true, &[][..]),
            Self::Recorded => (false, &[][..]),
            Self::From { sources, failed } => (!failed, sources.as_slice()),
        };
        let is_wanted = |result: &EpisodeResult| {
            (result.success || !only_verified) && (sources.is_empty() || sources.contains(&Provenance::of(result)))
        };
        let mut selected = Vec::new();
        for id in store.ids()? {
            match store.read_attempt(&id) {
                Ok((result, true)) if is_wanted(&result) => selected.push(id),
                Err(error) if error.is_damage() => selected.push(id),
                attempt => drop(attempt?),
            }
        }
        Ok(selected)
    }
}

/// Summary of an export, for the user.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ExportReport {
    /// Path of the data set.
    pub dataset: PathBuf,
    /// Path of the depth data set; `None` if there is none.
    pub depth_dataset: Option<PathBuf>,
    /// Number of exported episodes.
    pub episodes: usize,
    /// Number of rows of all exported episodes.
    pub frames: usize,
    /// Omitted damaged episodes with their errors.
    pub left_out: Vec<(String, String)>,
}

/// Episode with its camera tracks.
pub struct Source {
    /// Recorded episode, as read from the store.
    pub episode: Episode,
    /// Images of each exported camera.
    pub tracks: Vec<CameraTrack>,
    /// Instance masks, one per camera track; empty if masks are not exported.
    pub masks: Vec<MaskTrack>,
}

/// One episode ready to be written, with its metadata.
pub struct EpisodeRows<F = metadata::EpisodeMetadata> {
    /// Number of rows, also of every column.
    pub frames: usize,
    /// Numeric columns, without LeRobot's index columns.
    pub features: Vec<features::Feature>,
    /// Columns of still images (depth, masks).
    pub images: Vec<features::ImageFeature>,
    /// Columns of video frames, one per camera.
    pub videos: Vec<features::VideoFeature>,
    /// Step index of each row; empty if the data set has no steps.
    pub steps: Vec<usize>,
    /// Format-independent metadata of the episode.
    pub metadata: F,
}

/// Reads the selected episodes one at a time, to bound memory.
pub struct Exporter<'a> {
    store: &'a EpisodeStore,
    ids: Vec<String>,
    /// Fail on damaged episodes instead of omitting them: set if the episodes were named explicitly.
    is_strict: bool,
    robot: &'a RobotModel,
    settings: &'a ExportSettings,
}

impl<'a> Exporter<'a> {
    /// An exporter of the selected episodes.
    ///
    /// # Errors
    /// If the settings are invalid or no episode is selected.
    pub fn new(
        store: &'a EpisodeStore,
        selection: &Selection,
        robot: &'a RobotModel,
        settings: &'a ExportSettings,
    ) -> Result<Self, DataError> {
        let ExportSettings { fps, action, cameras, depth, .. } = settings;
        if *fps == 0 {
            return Err(DataError::mismatch("rows per second", "at least 1", 0));
        }
        if *depth && cameras.is_empty() {
            return Err(DataError::mismatch("cameras of the depth data set", "at least one", 0));
        }
        action.check().map_err(|error| DataError::mismatch(error.what, error.expected, error.got))?;
        let ids = selection.ids(store)?;
        if ids.is_empty() {
            return Err(DataError::mismatch("episodes to export", "at least one", 0));
        }
        Ok(Self { store, ids, is_strict: matches!(selection, Selection::Ids(_)), robot, settings })
    }

    /// As [`Exporter::new`], with a new folder that will be published at `target`, which must not exist.
    pub fn begin(
        store: &'a EpisodeStore,
        selection: &Selection,
        robot: &'a RobotModel,
        settings: &'a ExportSettings,
        target: &Path,
    ) -> Result<(Self, AtomicFolder), DataError> {
        let exporter = Self::new(store, selection, robot, settings)?;
        atomic_write::prepare_parent(target)?;
        Ok((exporter, AtomicFolder::new(target)?))
    }

    /// The contract of the `action` column.
    pub fn contract(&self) -> ActionContract {
        self.settings.contract(self.robot)
    }

    /// Passes the rows of every readable episode to `write`; returns the summary of a data set at `target`.
    ///
    /// # Errors
    /// If no episode is readable, one is damaged that was named explicitly, or `write` fails.
    pub fn each(
        &self,
        target: &Path,
        mut write: impl FnMut(&Source, EpisodeRows) -> Result<(), DataError>,
    ) -> Result<ExportReport, DataError> {
        let (mut left_out, mut frames) = (Vec::new(), 0);
        for id in &self.ids {
            let source = match self.source(id) {
                Err(error) if error.is_damage() && !self.is_strict => {
                    left_out.push((id.clone(), error.to_string()));
                    continue;
                }
                source => source?,
            };
            let rows = rows::rows(&source, self.robot, self.settings)?;
            frames += rows.frames;
            write(&source, rows)?;
        }
        let episodes = self.ids.len() - left_out.len();
        match left_out.first() {
            Some((id, why)) if left_out.len() == self.ids.len() => {
                Err(DataError::mismatch("episodes to export", "at least one undamaged", format!("{id}: {why}")))
            }
            _ => Ok(ExportReport { dataset: target.into(), depth_dataset: None, episodes, frames, left_out }),
        }
    }

    fn source(&self, id: &str) -> Result<Source, DataError> {
        let (episode, fps) = (self.store.read(id)?, self.settings.fps);
        let (frames, _) = sampling(episode.frames.len(), episode.result.control_rate_hz, fps)?;
        let (mut tracks, mut masks) = (Vec::new(), Vec::new());
        for camera in &self.settings.cameras {
            if self.settings.needs_masks() {
                let track = self.store.read_masks(id, fps, camera)?;
                if track.png.len() != frames {
                    let what = format!("masks of camera {camera} in episode {id}");
                    return Err(DataError::mismatch(what, frames, track.png.len()));
                }
                masks.push(track);
            }
            let track = self.store.read_track(id, fps, camera)?;
            if track.video.frames.len() != frames {
                let what = format!("images of camera {camera} in episode {id}");
                return Err(DataError::mismatch(what, frames, track.video.frames.len()));
            }
            tracks.push(track);
        }
        Ok(Source { episode, tracks, masks })
    }
}

/// Number of rows of an episode, and control steps per row.
///
/// Row i corresponds to control step `i · stride`, at which its images are rendered; the last row may cover fewer
/// steps.
///
/// # Errors
/// If the control rate is not an integer multiple of `fps`.
///
/// ```
/// assert_eq!(genmanip_data::export::sampling(9, 60.0, 15).unwrap(), (3, 4));
/// ```
pub fn sampling(control_steps: usize, control_rate_hz: f64, fps: u32) -> Result<(usize, usize), DataError> {
    let stride = control_rate_hz / f64::from(fps);
    if !(stride >= 1.0 && stride.fract() == 0.0 && stride < 1e6) {
        return Err(DataError::mismatch("rate of the data set", format!("a divisor of {control_rate_hz} Hz"), fps));
    }
    let stride = stride as usize;
    Ok((control_steps.div_ceil(stride), stride))
}

//! What is exported, whatever the format: which episodes, at which rate, with which actions, columns and pictures.
//!
//! The writer of a format takes each episode as rows and files it; it chooses nothing itself.

mod boxes;
pub mod choice;
pub(crate) mod facts;
pub(crate) mod features;
pub(crate) mod privileged;
pub(crate) mod rows;
pub mod steps;

use std::path::PathBuf;

use genmanip_core::{ActionContract, ActionSpace, ActionSpec, Episode, Interpolation, RobotModel};
use serde::{Deserialize, Serialize};

use crate::masks::MaskTrack;
use crate::{CameraTrack, DataError, EpisodeStore};

/// What the rows of a data set hold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ExportSettings {
    /// Rows per second; the control rate is a whole multiple. Default 15, every fourth 60 Hz step.
    pub fps: u32,
    /// What the numbers of the `action` column mean. Default [`default_action`].
    pub action: ActionSpec,
    /// Cameras whose pictures are exported. Default `static` and `wrist`.
    pub cameras: Vec<String>,
    /// Whether depth pictures are exported too. Default true.
    pub depth: bool,
    /// Columns beside the usual ones. Default none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub columns: Vec<ExtraColumns>,
    /// Whether each episode is drawn in a look of its own; its seed is then told, `variation_seed`. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_varied: bool,
    /// Whether another policy acted first in the episodes and was corrected; which rows are the correction is then told,
    /// `is_correction`. Default false.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub has_corrections: bool,
    /// Which of its looks that is. Default 0, that of `collect`.
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
            look: 0,
        }
    }
}

/// Columns that are written on request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExtraColumns {
    /// Simulator truth of the objects, `sim.object_pose` and the like: for critics, teachers and analysis, not for
    /// policies.
    Sim,
    /// Boxes around the objects in each camera's pictures, and how many pixels show them: `sim.box.<camera>` and
    /// `sim.visible_pixels.<camera>`.
    Boxes,
    /// Which thing each pixel sees, as pictures `observation.images.<camera>_mask` in the sibling data set.
    Masks,
}

impl ExportSettings {
    /// Whether it must be known which thing each pixel sees.
    pub fn needs_masks(&self) -> bool {
        let asks = |columns: &ExtraColumns| matches!(columns, ExtraColumns::Boxes | ExtraColumns::Masks);
        !self.cameras.is_empty() && self.columns.iter().any(asks)
    }

    /// Whether there are pictures besides colour, which lie in a sibling data set.
    pub(crate) fn has_sibling(&self) -> bool {
        self.depth || (self.columns.contains(&ExtraColumns::Masks) && !self.cameras.is_empty())
    }

    /// The contract of the `action` column for a robot.
    pub(crate) fn contract(&self, robot: &RobotModel) -> ActionContract {
        let joints: Vec<&str> = robot.arm_joints().map(|joint| joint.name.as_str()).collect();
        ActionContract {
            action: self.action,
            rate_hz: f64::from(self.fps),
            robot: robot.name.clone(),
            names: self.action.names(&joints),
        }
    }
}

/// Absolute joint targets and the opening, between which the commands move evenly: so a row of any rate ends with the
/// very command that was recorded.
pub fn default_action() -> ActionSpec {
    ActionSpec { between: Interpolation::Linear, ..ActionSpec::native() }
}

/// What an `action` column means, for cards and descriptions.
pub(crate) fn action_in_words(spec: &ActionSpec) -> String {
    let rotation = spec.rotation.description();
    let motion = match spec.space {
        ActionSpace::JointPosition => "absolute arm joint targets (rad)".into(),
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
    format!("{motion}, and opening width (m); what was in force at the end of the row's interval; {between}")
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

impl Selection {
    /// The ids of the selected episodes. Damaged ones are among them: what is wrong shows when they are read.
    ///
    /// # Errors
    /// When the store cannot be listed.
    pub fn ids(&self, store: &EpisodeStore) -> Result<Vec<String>, DataError> {
        let only_verified = match self {
            Self::Ids(ids) => return Ok(ids.clone()),
            Self::Verified => true,
            Self::Recorded => false,
        };
        let mut selected = Vec::new();
        for id in store.ids()? {
            match store.read_attempt(&id) {
                Ok((result, true)) if result.success || !only_verified => selected.push(id),
                Err(error) if error.is_damage() => selected.push(id),
                attempt => drop(attempt?),
            }
        }
        Ok(selected)
    }
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
    /// As many as tracks where they are asked for.
    pub(crate) masks: Vec<MaskTrack>,
}

/// One episode, ready to be written, with what is told of it as a whole.
pub(crate) struct EpisodeRows<F = facts::EpisodeFacts> {
    pub(crate) frames: usize,
    pub(crate) features: Vec<features::Feature>,
    pub(crate) images: Vec<features::ImageFeature>,
    pub(crate) videos: Vec<features::VideoFeature>,
    /// Which step of the episode each row belongs to; empty in a data set that does not tell.
    pub(crate) steps: Vec<usize>,
    pub(crate) facts: F,
}

/// Reads the selected episodes one by one, so that none stays in memory.
pub(crate) struct Exporter<'a> {
    store: &'a EpisodeStore,
    ids: Vec<String>,
    /// Whether damaged episodes end the export: whoever names episodes wants these.
    is_strict: bool,
    robot: &'a RobotModel,
    settings: &'a ExportSettings,
}

impl<'a> Exporter<'a> {
    pub(crate) fn new(
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

    /// The contract of the `action` column.
    pub(crate) fn contract(&self) -> ActionContract {
        self.settings.contract(self.robot)
    }

    /// Hands the rows of every sound episode to a writer; returns the damaged ones with what is wrong.
    pub(crate) fn each(
        &self,
        mut write: impl FnMut(&Source, EpisodeRows) -> Result<(), DataError>,
    ) -> Result<Vec<(String, String)>, DataError> {
        let mut left_out = Vec::new();
        for id in &self.ids {
            let source = match self.source(id) {
                Err(error) if error.is_damage() && !self.is_strict => {
                    left_out.push((id.clone(), error.to_string()));
                    continue;
                }
                source => source?,
            };
            write(&source, rows::rows(&source, self.robot, self.settings)?)?;
        }
        match left_out.first() {
            Some((id, why)) if left_out.len() == self.ids.len() => {
                Err(DataError::mismatch("episodes to export", "at least one sound", format!("{id}: {why}")))
            }
            _ => Ok(left_out),
        }
    }

    /// Number of selected episodes, damaged ones included.
    pub(crate) fn len(&self) -> usize {
        self.ids.len()
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
                let what = format!("pictures of camera {camera} in episode {id}");
                return Err(DataError::mismatch(what, frames, track.video.frames.len()));
            }
            tracks.push(track);
        }
        Ok(Source { episode, tracks, masks })
    }
}

/// Number of rows of an episode, and control steps per row.
///
/// Row i shows control step `i · stride`; the last row may stand for fewer steps. Pictures are drawn at these steps.
///
/// # Errors
/// When the control rate is not a whole multiple of `fps`.
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

//! Demonstrations of a run as arrays: the same rows as in an exported dataset, with the inputs of the policy.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::glam::DVec3;
use genmanip_core::{ActionContract, Camera, Episode, Frame, Projection, RobotModel};
use genmanip_data::export::features::{Feature, Values};
use genmanip_data::export::{Source, rows, sampling};
use genmanip_data::{DataError, Provenance, Selection};
use genmanip_policy::{Demonstration, Demonstrations, Inputs, instruction_words, normalised_pixel};
use genmanip_rollout::collect::in_parallel;
use genmanip_workspace::{Progress, WorkspaceError, worlds};

use super::presets::{LABELLED_POINTS, PresetSettings};
use crate::export::only_from;
use crate::folder::RunFolder;
use crate::learned::inputs::{Moment, Observer};

/// Number of idle rows kept at the end of a demonstration, where the scene settles. With more of them, a policy learns
/// to stand still.
const LAST_IDLE_ROWS: usize = 1;

/// Demonstrations of a run, as arrays for training.
pub(super) struct RunDemonstrations {
    /// Arrays of all demonstrations, in the order of `ids`.
    pub arrays: Demonstrations,
    /// Ids of the demonstrations' episodes.
    pub ids: Vec<String>,
    /// Action contract of the rows.
    pub contract: ActionContract,
    /// Hash of the run, see [`crate::folder::Run::hash`].
    pub run: String,
    /// Folder of the run.
    pub folder: PathBuf,
    /// Index of the recorded frame of every row, by episode; the last entry is the frame at the end.
    pub frames: Vec<Vec<usize>>,
}

/// Reads all verified episodes of a run from some sources, or from all if none is named; `None` if interrupted.
///
/// # Errors
/// When there is no run, it has no verified episode, or an episode does not fit the preset's inputs.
pub(super) fn read(
    path: &Path,
    sources: &[Provenance],
    preset: &PresetSettings,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<RunDemonstrations>, WorkspaceError> {
    let settings = &preset.rows;
    let (folder, run) = RunFolder::open(path)?;
    let (store, robot) = (folder.store()?, worlds::robot(&run.settings.world)?);
    let unreadable = |error: DataError| WorkspaceError::broken("cannot read the demonstrations", error);
    let ids = Selection::of(sources, false).ids(&store).map_err(unreadable)?;
    progress.begin("reading demonstrations", ids.len());
    let read = in_parallel(&ids, workers, stop, &|id| {
        let episode = match store.read(id) {
            Err(error) if error.is_damage() => {
                progress.note(&format!("episode {id} is damaged and left out: {error}"));
                return Ok(None);
            }
            episode => episode.map_err(unreadable)?,
        };
        let (demonstration, frames) = demonstration(episode, &robot, preset)?;
        progress.advance();
        Ok::<_, WorkspaceError>(Some((id.clone(), (demonstration, frames))))
    })?;
    progress.end();
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let (ids, read): (Vec<String>, Vec<_>) = read.into_iter().flatten().unzip();
    let (episodes, frames): (Vec<Demonstration>, Vec<_>) = read.into_iter().unzip();
    if ids.is_empty() {
        let what = format!("{} has no verified demonstration{} to learn from", path.display(), only_from(sources));
        return Err(WorkspaceError::input(what)
            .with_hint("collect some first: genmanip collect TASKS --verified 300 --no-dataset --out RUN"));
    }
    let contract = settings.contract(&robot);
    let arrays = Demonstrations {
        inputs: preset.inputs.clone(),
        action: contract.names.len(),
        points: preset.model.labelled_points,
        episodes,
    };
    Ok(Some(RunDemonstrations { arrays, ids, contract, run: run.hash()?, folder: path.to_owned(), frames }))
}

fn demonstration(
    episode: Episode,
    robot: &Arc<RobotModel>,
    preset: &PresetSettings,
) -> Result<(Demonstration, Vec<usize>), WorkspaceError> {
    let (inputs, settings) = (&preset.inputs, &preset.rows);
    let id = episode.result.id.clone();
    let broken = |error: DataError| WorkspaceError::broken(format!("cannot learn from episode {id}"), error);
    let models = episode.scenario.objects.iter().map(|placed| Catalogue::builtin().instance(placed));
    let models = models.collect::<Result<Vec<_>, _>>().map_err(|error| {
        WorkspaceError::broken(format!("cannot learn from episode {id}"), error)
            .with_hint("the episode was recorded with other objects; use the version it names")
    })?;
    let observer = Observer::new(inputs, &episode.scenario, &models, robot)
        .map_err(|reason| WorkspaceError::input(format!("cannot learn from episode {id}: {reason}")))?;
    let source = Source { episode, tracks: Vec::new(), masks: Vec::new() };
    let table = rows::rows(&source, robot, settings).map_err(broken)?;
    let Source { episode, .. } = source;
    let (_, stride) = sampling(episode.frames.len(), episode.result.control_rate_hz, settings.fps).map_err(broken)?;
    let column = |key: &str| table.features.iter().find(|feature| feature.key == key);
    let (actions, width) = match column("action") {
        Some(feature @ Feature { values: Values::F32(values), .. }) => (values.as_slice(), feature.length()),
        _ => (&[][..], 1),
    };
    let is_busy = |row: &usize| match column("is_idle").map(|feature| &feature.values) {
        Some(Values::Bool(idle)) => !idle.get(*row).copied().unwrap_or(false),
        _ => true,
    };
    let end = (0..table.frames).rfind(is_busy).map_or(0, |row| row + 1 + LAST_IDLE_ROWS).min(table.frames);
    // Rows of another policy, before the expert took over to correct it, are no demonstration.
    let begin = episode.result.correction.as_ref().map_or(0, |correction| correction.from_step.div_ceil(stride));
    let begin = begin.min(end);
    let last = episode.frames.len().saturating_sub(1);
    let frames: Vec<usize> = (begin..=end).map(|row| (row * stride).min(last)).collect();
    let numbers = frames.iter().filter_map(|frame| episode.frames.get(*frame)).flat_map(|frame: &Frame| {
        observer.numbers(Moment {
            arm: &frame.joint_position,
            width_m: frame.gripper_width,
            objects: &frame.objects,
            held: frame.grasped,
        })
    });
    let labels = match preset.model.labelled_points {
        0 => Vec::new(),
        _ => labels(&episode, &frames, inputs, robot)?,
    };
    let demonstration = Demonstration {
        inputs: numbers.collect(),
        actions: actions[begin * width..end * width].to_vec(),
        words: instruction_words(&episode.scenario.task.instruction, inputs.words),
        labels,
    };
    Ok((demonstration, frames))
}

/// Labels of frames for the auxiliary loss, see [`Demonstrations::labels_width`]: positions of subject and reference of
/// the goal's first condition. For a condition on a state, both are the object; for a reference that is a support
/// surface, both are the subject.
fn labels(
    episode: &Episode,
    frames: &[usize],
    inputs: &Inputs,
    robot: &RobotModel,
) -> Result<Vec<f32>, WorkspaceError> {
    let id = &episode.result.id;
    let scenario = &episode.scenario;
    let condition = scenario.task.goal.alternatives.iter().flatten().next();
    let Some(condition) = condition else {
        return Err(WorkspaceError::input(format!("cannot learn from episode {id}: its goal is empty")));
    };
    let subject = scenario.index_of(condition.subject());
    let reference = condition.references().next().and_then(|reference| scenario.index_of(reference));
    let objects: [usize; LABELLED_POINTS] = [subject, reference.or(subject)].map(Option::unwrap_or_default);
    let mut cameras = Vec::new();
    for image in &inputs.images {
        let camera = scenario.world.cameras.iter().find(|camera| camera.name == image.camera).ok_or_else(|| {
            WorkspaceError::input(format!("cannot learn from episode {id}: it has no camera `{}`", image.camera))
        })?;
        let intrinsics = camera.intrinsics.resized(image.width as u32, image.height as u32);
        cameras.push((Camera { intrinsics, ..camera.clone() }, image));
    }
    let mut labels = Vec::new();
    for frame in frames.iter().filter_map(|frame| episode.frames.get(*frame)) {
        let links = robot.link_poses(&frame.joint_position, frame.gripper_width);
        let world_from_hand = links.get(robot.hand).copied().unwrap_or_default();
        let points = objects.map(|object| frame.objects.get(object).map_or(DVec3::ZERO, |it| it.pose.position));
        labels.extend(points.iter().flat_map(|point| point.as_vec3().to_array()));
        for (camera, image) in &cameras {
            let projection = Projection::of(camera, &world_from_hand);
            for point in points {
                let pixel = projection.pixel(point).map(|(pixel, _)| normalised_pixel(pixel.to_array(), image));
                let seen = pixel.filter(|pixel| pixel.iter().all(|at| at.abs() <= 1.0));
                labels.extend(seen.map_or([0.0; 3], |[u, v]| [u, v, 1.0]));
            }
        }
    }
    Ok(labels)
}

//! Demonstrations of a run as arrays: the rows that an export would hold, with the inputs of the policy.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{ActionContract, Episode, Frame, RobotModel};
use genmanip_data::export::features::{Feature, Values};
use genmanip_data::export::{Source, rows, sampling};
use genmanip_data::{DataError, ExportSettings, Selection};
use genmanip_policy::{Demonstration, Demonstrations};
use genmanip_rollout::collect::in_parallel;
use genmanip_workspace::{Progress, WorkspaceError, worlds};

use crate::folder::RunFolder;
use crate::learned::inputs::{self, Moment, Observer};

/// Idle rows that are kept at the end of a demonstration, during which the scene settles: from more of them a policy
/// learns to stand still.
const LAST_IDLE_ROWS: usize = 1;

/// Demonstrations of a run.
pub(super) struct RunDemonstrations {
    /// Arrays, in the order of `ids`.
    pub arrays: Demonstrations,
    /// Ids of the episodes.
    pub ids: Vec<String>,
    /// Contract of the actions.
    pub contract: ActionContract,
    /// Hash of the run.
    pub run: String,
}

/// Reads all verified episodes of a run; `None` if stopped.
///
/// # Errors
/// When there is no run, it has no verified episode, or an episode does not fit the inputs.
pub(super) fn read(
    path: &Path,
    settings: &ExportSettings,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<RunDemonstrations>, WorkspaceError> {
    let (folder, run) = RunFolder::open(path)?;
    let (store, robot) = (folder.store()?, worlds::robot(&run.settings.world)?);
    let unreadable = |error: DataError| WorkspaceError::broken("cannot read the demonstrations", error);
    let ids = Selection::Verified.ids(&store).map_err(unreadable)?;
    progress.begin("reading demonstrations", ids.len());
    let read = in_parallel(&ids, workers, stop, &|id| {
        let episode = match store.read(id) {
            Err(error) if error.is_damage() => {
                progress.note(&format!("episode {id} is damaged and left out: {error}"));
                return Ok(None);
            }
            episode => episode.map_err(unreadable)?,
        };
        let demonstration = demonstration(episode, &robot, settings)?;
        progress.advance();
        Ok::<_, WorkspaceError>(Some((id.clone(), demonstration)))
    })?;
    progress.end();
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let (ids, episodes): (Vec<String>, Vec<Demonstration>) = read.into_iter().flatten().unzip();
    if ids.is_empty() {
        return Err(WorkspaceError::input(format!("{} has no verified demonstration to learn from", path.display()))
            .with_hint("collect some first: genmanip collect TASKS --verified 300 --no-dataset --out RUN"));
    }
    let contract = settings.contract(&robot);
    let arrays = Demonstrations { inputs: inputs::layout(), action: contract.names.len(), episodes };
    Ok(Some(RunDemonstrations { arrays, ids, contract, run: run.hash()? }))
}

fn demonstration(
    episode: Episode,
    robot: &Arc<RobotModel>,
    settings: &ExportSettings,
) -> Result<Demonstration, WorkspaceError> {
    let id = episode.result.id.clone();
    let broken = |error: DataError| WorkspaceError::broken(format!("cannot learn from episode {id}"), error);
    let models = episode.scenario.objects.iter().map(|placed| Catalogue::builtin().instance(placed));
    let models = models.collect::<Result<Vec<_>, _>>().map_err(|error| {
        WorkspaceError::broken(format!("cannot learn from episode {id}"), error)
            .with_hint("the episode was recorded with other objects; use the version it names")
    })?;
    let observer = Observer::new(&episode.scenario, &models, robot)
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
    // Rows of another policy, which the expert then corrected, are no demonstration.
    let begin = episode.result.correction.as_ref().map_or(0, |correction| correction.from_step.div_ceil(stride));
    let begin = begin.min(end);
    let frame = |row: usize| episode.frames.get(row * stride).or(episode.frames.last());
    let inputs = (begin..=end).filter_map(frame).flat_map(|frame: &Frame| {
        observer.inputs(Moment {
            arm: &frame.joint_position,
            width_m: frame.gripper_width,
            objects: &frame.objects,
            held: frame.grasped,
        })
    });
    Ok(Demonstration { inputs: inputs.collect(), actions: actions[begin * width..end * width].to_vec() })
}

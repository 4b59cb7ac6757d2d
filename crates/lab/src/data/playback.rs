//! Exported actions, played back open loop through the policy interface.

use genmanip_workspace::workers;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_assets::GraspLibrary;
use genmanip_core::{ActionSpace, ActionSpec, Episode, RotationEncoding};
use genmanip_data::export::choice::{ACTIONS, RATES, ROTATIONS, action};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{EpisodeStore, ExportSettings, Selection};
use genmanip_motion::Planner;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::policies::PolicyContext;
use genmanip_rollout::collect::{PipelineSettings, in_parallel};
use genmanip_rollout::{Stage, run_episode};
use genmanip_workspace::Progress;
use serde::Serialize;

use crate::LabError;

/// Rate at which every rotation representation is played back. The other rates use the default representation only:
/// representations differ in notation, not in timing.
const RATE_OF_ROTATIONS: u32 = 15;

/// Played-back episode that did not succeed.
#[derive(Clone, Debug, Serialize)]
pub struct Missed {
    /// Action and rate, as `ACTION@RATE` (Hz).
    pub action: String,
    /// Id of the episode.
    pub episode: String,
    /// Evidence of the failure.
    pub why: String,
}

/// Plays back every action space at every rate; returns success rates, and the failed episodes.
pub(super) fn measure(
    recorded: &[(Stage, Episode)],
    store: &EpisodeStore,
    (planner, settings): (&Arc<Planner>, &PipelineSettings),
    folder: &Path,
    progress: &dyn Progress,
) -> Result<(BTreeMap<String, f64>, Vec<Missed>), LabError> {
    let (mut playback, mut missed) = (BTreeMap::new(), Vec::new());
    let choices = choices();
    progress.begin("playing back", choices.len() * recorded.len());
    for (name, spec, fps) in choices {
        let dataset = folder.join(&name);
        let rows = ExportSettings { fps, action: spec, cameras: Vec::new(), depth: false, ..ExportSettings::default() };
        let lerobot = LerobotSettings { export: rows, record: false, ..LerobotSettings::default() };
        lerobot::export(store, &Selection::Verified, planner.robot(), &lerobot, &dataset).map_err(super::broke)?;
        let policy = PolicyFactory::resolve(&format!("playback:dataset={}", dataset.display()))?;
        let play = |(stage, episode): &(Stage, Episode)| -> Result<Option<Missed>, LabError> {
            let context = PolicyContext {
                stage,
                recorded: None,
                planner,
                grasps: GraspLibrary::builtin(),
                settings,
                cores: None,
            };
            let (id, mut policy) = (&episode.result.id, policy.make(&context)?);
            let played = run_episode(stage, policy.as_mut(), id, episode.result.seed, &settings.rollout)
                .map_err(|error| LabError::broken(format!("playing {id} back broke"), error))?;
            progress.advance();
            let why = played.result.failure().map_or_else(String::new, |failure| failure.to_string());
            Ok((!played.result.success).then(|| Missed { action: name.clone(), episode: id.clone(), why }))
        };
        let failures: Vec<Missed> = in_parallel(recorded, workers::workers(None), &AtomicBool::new(false), &play)?
            .into_iter()
            .flatten()
            .collect();
        playback.insert(name.clone(), 1.0 - failures.len() as f64 / recorded.len() as f64);
        missed.extend(failures);
        fs::remove_dir_all(&dataset)
            .map_err(|error| LabError::broken(format!("cannot remove {}", dataset.display()), error))?;
    }
    progress.end();
    Ok((playback, missed))
}

/// Every action at every rate with the default rotation, and every rotation at one rate, with their names.
fn choices() -> Vec<(String, ActionSpec, u32)> {
    let usual = ROTATIONS[0].1;
    let mut choices = Vec::new();
    for (name, space) in ACTIONS {
        for fps in RATES {
            choices.push((format!("{name}@{fps}"), action(space, usual), fps));
        }
        for (rotation, encoding) in ROTATIONS.iter().filter(|(_, encoding)| has_more(space, *encoding)) {
            let name = format!("{name}-{rotation}@{RATE_OF_ROTATIONS}");
            choices.push((name, action(space, *encoding), RATE_OF_ROTATIONS));
        }
    }
    choices
}

fn has_more(space: ActionSpace, rotation: RotationEncoding) -> bool {
    !space.is_joint() && rotation != ROTATIONS[0].1
}

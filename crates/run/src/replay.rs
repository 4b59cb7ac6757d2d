//! Replaying recorded episodes: do their commands lead to the identical final state?

use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::Episode;
use genmanip_data::EpisodeStore;
use genmanip_rollout::{Stage, replay};
use serde::Serialize;

use crate::error::{Cause, RunError};
use crate::inputs;
use crate::pictures;
use crate::progress::Progress;

/// Moments of a film strip.
const STRIP_FRAMES: usize = 8;

/// How the replay of an episode ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Replayed {
    /// Id of the episode.
    pub episode: String,
    /// Control steps.
    pub frames: usize,
    /// Whether the final state is the recorded one, bit for bit.
    pub identical: bool,
    /// Largest difference between the final states, mixed units.
    pub largest_difference: f64,
}

/// Replays the recorded episodes at a path: an episode's folder, a store, or a run.
///
/// With `strip`, also draws each as a film strip into that file (with the id in its name if there are several);
/// without `check` that is all that is done.
///
/// # Errors
/// When there is no episode, one is damaged, or the physics are not those it was recorded with.
pub fn check(
    path: &Path,
    check: bool,
    strip: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Vec<Replayed>, RunError> {
    let (store, ids) = locate(path)?;
    if ids.is_empty() {
        return Err(RunError::input(format!("no recorded episode at {}", path.display()))
            .with_hint("collect episodes first; attempts without a layout are not recorded"));
    }
    let mut rows = Vec::new();
    progress.begin("replaying", ids.len());
    for id in &ids {
        let failed = |error: Cause| RunError::broken(format!("cannot replay {id}"), error);
        let (stage, episode) = open(&store, id)?;
        let changed = Catalogue::builtin().changed_looks(&episode.scenario.objects).unwrap_or_default();
        if !changed.is_empty() {
            progress.note(&format!("{id}: {} looks otherwise than when it was recorded", changed.join(", ")));
        }
        if let Some(path) = strip {
            let path = if ids.len() == 1 { path.to_owned() } else { numbered(path, id) };
            inputs::write_file(&path, &pictures::film_strip(&stage, &episode, STRIP_FRAMES)?)?;
            progress.note(&format!("wrote {}", path.display()));
        }
        if check || strip.is_none() {
            let check = replay::check(&stage, &episode).map_err(|error| failed(error.into()))?;
            rows.push(Replayed {
                episode: id.clone(),
                frames: check.frames,
                identical: check.identical,
                largest_difference: check.largest_difference,
            });
        }
        progress.advance();
    }
    progress.end();
    Ok(rows)
}

/// The recorded episodes at a path, each with its stage: an episode's folder, a store, or a run.
///
/// # Errors
/// As [`check`].
pub fn recorded(path: &Path) -> Result<Vec<(Stage, Episode)>, RunError> {
    let (store, ids) = locate(path)?;
    ids.iter().map(|id| open(&store, id)).collect()
}

fn open(store: &EpisodeStore, id: &str) -> Result<(Stage, Episode), RunError> {
    let failed = |error: Cause| RunError::broken(format!("cannot replay {id}"), error);
    let episode: Episode = store.read(id).map_err(|error| failed(error.into()))?;
    let scenario = Arc::new(episode.scenario.clone());
    let robot = inputs::robot(&scenario.world)?;
    let stage = Stage::open(scenario, Catalogue::builtin(), &robot).map_err(|error| {
        failed(error.into()).with_hint("the episode was recorded with other physics; use the version it names")
    })?;
    Ok((stage, episode))
}

/// The store and the recorded episodes meant by a path.
fn locate(path: &Path) -> Result<(EpisodeStore, Vec<String>), RunError> {
    let unusable = |error| {
        RunError::input(format!("no episodes at {}", path.display()))
            .because(error)
            .with_hint("name an episode folder, the `episodes` folder of a run, or the run itself")
    };
    let inside = path.join("episodes");
    let root: PathBuf = if inside.is_dir() { inside } else { path.to_owned() };
    if root.join("episode.json").is_file() {
        let id = root.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let parent = root.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let store = EpisodeStore::open(parent).map_err(unusable)?;
        return Ok((store, vec![id]));
    }
    let store = EpisodeStore::open(&root).map_err(unusable)?;
    let mut recorded = Vec::new();
    for id in store.ids().map_err(unusable)? {
        if store.is_recorded(&id).map_err(unusable)? {
            recorded.push(id);
        }
    }
    Ok((store, recorded))
}

fn numbered(path: &Path, id: &str) -> PathBuf {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{}-{id}.{extension}", inputs::stem(path)))
}

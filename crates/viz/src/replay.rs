//! Replay of recorded episodes: checks whether the recorded commands lead to the identical final state.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use genmanip_assets::{AssetSource, Catalogue};
use genmanip_core::{Episode, TaskKind};
use genmanip_data::{DataError, EpisodeStore, Listing};
use genmanip_rollout::collect::in_parallel_each;
use genmanip_rollout::{Stage, replay};
use genmanip_workspace::{MAX_ROWS, attention, text_table};
use serde::Serialize;

use crate::scene_images;
use genmanip_workspace::Progress;
use genmanip_workspace::documents;
use genmanip_workspace::worlds;
use genmanip_workspace::{Cause, WorkspaceError};

/// Number of images in a film strip. Chosen by hand.
const STRIP_FRAMES: usize = 8;

/// Result of replaying an episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Replayed {
    /// Id of the episode.
    pub episode: String,
    /// Kind of the episode's task; `None` if the episode cannot be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<TaskKind>,
    /// Number of recorded control steps; 0 if the episode cannot be read.
    pub frames: usize,
    /// True if the final state equals the recorded one bit for bit; `None` if not checked or not replayable.
    pub identical: Option<bool>,
    /// Largest absolute difference of a number in the two final states, mixed units; `None` if not checked or not
    /// comparable.
    pub largest_difference: Option<f64>,
    /// Reason why the episode cannot be replayed; `None` if it can.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damaged: Option<String>,
    /// Path of the film strip; `None` if none was drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub strip: Option<String>,
}

impl Replayed {
    /// True if the episode is undamaged and its final state, if checked, is identical.
    pub fn is_sound(&self) -> bool {
        self.damaged.is_none() && self.identical != Some(false)
    }

    /// Result of the replay in words.
    pub fn describe(&self) -> String {
        match (&self.damaged, self.identical, self.largest_difference) {
            (Some(why), _, _) => format!("damaged: {why}"),
            (None, Some(true), _) => "identical".into(),
            (None, Some(false), Some(0.0)) => "differs, but in no value: by the sign of a zero, or by a NaN".into(),
            (None, Some(false), difference) => format!("differs by {:e}", difference.unwrap_or(f64::NAN)),
            (None, None, _) => "not checked".into(),
        }
    }
}

/// Replays the recorded episodes at a path: an episode's folder, a store, or a run. The result has one row per episode,
/// in the order of their ids, the same for any number of workers.
///
/// With `strip`, also draws each episode as a film strip into that file (with the id in the file name if there are
/// several episodes); without `check`, nothing else is done. Among several episodes a damaged one is reported in its
/// row, and the others are replayed. `each` is called with a row as soon as that row and all before it are complete.
///
/// # Errors
/// When there is no episode, the only one is damaged, or the physics differ from those it was recorded with.
pub fn check(
    path: &Path,
    check: bool,
    strip: Option<&Path>,
    workers: usize,
    progress: &dyn Progress,
    each: &mut (dyn FnMut(&Replayed) + Send),
) -> Result<Vec<Replayed>, WorkspaceError> {
    if let Some(strip) = strip {
        check_ending(strip)?;
    }
    let LocatedEpisodes { store, ids, strangers } = locate(path)?;
    for name in &strangers {
        progress.note(&format!("{name} in the episodes is no episode; it is ignored"));
    }
    if ids.is_empty() {
        return Err(WorkspaceError::input(format!("no recorded episode at {}", path.display()))
            .with_hint("collect episodes first; attempts without a layout are not recorded"));
    }
    let replaying = Replaying { store: &store, is_only: ids.len() == 1, check, strip, progress };
    progress.begin("replaying", ids.len());
    let mut rows = Vec::new();
    let replay = |id: &String| {
        let row = replaying.one(id);
        progress.advance();
        row
    };
    in_parallel_each(&ids, workers, &AtomicBool::new(false), &replay, &mut |row| {
        each(&row);
        rows.push(row);
    })?;
    progress.end();
    Ok(rows)
}

/// Replays `count` of the recorded episodes of a store, evenly spaced by id; one row per episode, in the order of their
/// ids.
///
/// # Errors
/// When the store cannot be read, or an object is not the one an episode was recorded with.
pub fn sample(
    store: &Path,
    count: usize,
    workers: usize,
    progress: &dyn Progress,
) -> Result<Vec<Replayed>, WorkspaceError> {
    let LocatedEpisodes { store, ids, .. } = locate(store)?;
    let count = count.min(ids.len());
    let chosen: Vec<&String> = (0..count).filter_map(|place| ids.get(place * ids.len() / count)).collect();
    // A damaged episode is reported in its row even if it is the only one.
    let replaying = Replaying { store: &store, is_only: false, check: true, strip: None, progress };
    progress.begin("replaying", chosen.len());
    let replay = |id: &&String| {
        let row = replaying.one(id);
        progress.advance();
        row
    };
    let mut rows = Vec::new();
    in_parallel_each(&chosen, workers, &AtomicBool::new(false), &replay, &mut |row| rows.push(row))?;
    progress.end();
    Ok(rows)
}

/// Settings shared by all replayed episodes.
struct Replaying<'a> {
    store: &'a EpisodeStore,
    is_only: bool,
    check: bool,
    strip: Option<&'a Path>,
    progress: &'a dyn Progress,
}

impl Replaying<'_> {
    fn one(&self, id: &str) -> Result<Replayed, WorkspaceError> {
        let Self { store, is_only, check, strip, progress } = *self;
        let failed = |error: Cause| WorkspaceError::broken(format!("cannot replay {id}"), error);
        let mut row = Replayed { episode: id.to_owned(), ..Replayed::default() };
        let episode = match store.read(id) {
            Err(error) if error.is_damage() && !is_only => {
                return Ok(Replayed { damaged: Some(error.to_string()), ..row });
            }
            episode => episode.map_err(|error| unreadable(id, error))?,
        };
        let stage = stage(&episode)?;
        (row.kind, row.frames) = (Some(episode.scenario.task.kind), episode.frames.len());
        let changed = Catalogue::builtin().changed_appearance(&episode.scenario.objects).unwrap_or_default();
        if !changed.is_empty() {
            progress.note(&format!("{id}: {} looks otherwise than when it was recorded", changed.join(", ")));
        }
        if let Some(path) = strip {
            let path = if is_only { path.to_owned() } else { numbered(path, id) };
            documents::write_file(&path, &scene_images::film_strip(&stage, &episode, STRIP_FRAMES)?)?;
            progress.note(&format!("wrote {}", path.display()));
            row.strip = Some(path.display().to_string());
        }
        if check || strip.is_none() {
            let check = replay::check(&stage, &episode).map_err(|error| {
                failed(error.into())
                    .with_hint("a scenario and what was recorded on it belong together; collect it again")
            })?;
            (row.identical, row.largest_difference) = (Some(check.identical), Some(check.largest_difference));
        }
        Ok(row)
    }
}

/// Text table of the rows. With more than [`MAX_ROWS`] rows and without `each`, one row per task kind, and the episodes
/// that need attention.
pub fn table(rows: &[Replayed], each: bool) -> String {
    const HEAD: [&str; 3] = ["episode", "frames", "final state"];
    let line = |row: &Replayed| vec![row.episode.clone(), row.frames.to_string(), row.describe()];
    if each || rows.len() <= MAX_ROWS {
        let head = HEAD.map(String::from).to_vec();
        return text_table(&[head].into_iter().chain(rows.iter().map(line)).collect::<Vec<_>>());
    }
    let mut kinds =
        vec![["kind", "episodes", "identical", "differ", "damaged", "not checked"].map(String::from).to_vec()];
    let mut sum = |name: &str, is_meant: &dyn Fn(&&Replayed) -> bool| {
        let count = |wanted: &dyn Fn(&Replayed) -> bool| {
            rows.iter().filter(is_meant).filter(|row| wanted(row)).count().to_string()
        };
        let not_checked = |row: &Replayed| row.identical.is_none() && row.damaged.is_none();
        let all = count(&|_| true);
        if all != "0" {
            kinds.push(vec![
                name.to_owned(),
                all,
                count(&|row| row.identical == Some(true)),
                count(&|row| row.identical == Some(false)),
                count(&|row| row.damaged.is_some()),
                count(&not_checked),
            ]);
        }
    };
    for kind in TaskKind::ALL {
        sum(kind.name(), &|row| row.kind == Some(kind));
    }
    sum("unknown", &|row| row.kind.is_none());
    sum("all", &|_| true);
    let unsound: Vec<Vec<String>> = rows.iter().filter(|row| !row.is_sound()).map(line).collect();
    format!("{}\n{}each with --each\n", text_table(&kinds), attention(&HEAD, &unsound))
}

/// Reads the recorded episodes at a path (an episode's folder, a store, or a run), each with its stage.
///
/// # Errors
/// As [`check`].
pub fn recorded(path: &Path) -> Result<Vec<(Stage, Episode)>, WorkspaceError> {
    let LocatedEpisodes { store, ids, .. } = locate(path)?;
    ids.iter()
        .map(|id| {
            let episode = store.read(id).map_err(|error| unreadable(id, error))?;
            Ok((stage(&episode)?, episode))
        })
        .collect()
}

/// Error for a recorded episode that cannot be read.
pub fn unreadable(id: &str, error: DataError) -> WorkspaceError {
    WorkspaceError::broken(format!("cannot replay {id}"), error)
        .or_hint("collect again with --repair: it is set aside and made anew")
}

/// Stage of a recorded episode, with objects built from the catalogue.
///
/// # Errors
/// When an object is not the one it was recorded with.
pub fn stage(episode: &Episode) -> Result<Stage, WorkspaceError> {
    let failed = |error: Cause| WorkspaceError::broken(format!("cannot replay {}", episode.result.id), error);
    let scenario = Arc::new(episode.scenario.clone());
    let robot = worlds::robot(&scenario.world)?;
    Stage::open(scenario, Catalogue::builtin(), &robot).map_err(|error| {
        failed(error.into()).with_hint("the episode was recorded with other physics; use the version it names")
    })
}

/// Store of episodes, and those of its episodes that a path refers to.
pub struct LocatedEpisodes {
    /// Store that contains the episodes.
    pub store: EpisodeStore,
    /// Ids of recorded episodes, including damaged ones that are not in the index.
    pub ids: Vec<String>,
    strangers: Vec<String>,
}

/// Finds the recorded episodes at a path: a run, a store, or the folder of one episode.
pub fn locate(path: &Path) -> Result<LocatedEpisodes, WorkspaceError> {
    let unusable = |error| {
        WorkspaceError::input(format!("no episodes at {}", path.display()))
            .because(error)
            .with_hint("name an episode folder, the `episodes` folder of a run, or the run itself")
    };
    let inside = path.join("episodes");
    let root: PathBuf = if inside.is_dir() { inside } else { path.to_owned() };
    if root.join("episode.json").is_file() {
        let id = root.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let parent = root.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let store = EpisodeStore::open(parent).map_err(unusable)?;
        return Ok(LocatedEpisodes { store, ids: vec![id], strangers: vec![] });
    }
    let store = EpisodeStore::open(&root).map_err(unusable)?;
    let Listing { mut ids, foreign: strangers } = store.list().map_err(unusable)?;
    ids.retain(|id| store.is_recorded(id).unwrap_or(true));
    Ok(LocatedEpisodes { store, ids, strangers })
}

/// Rejects a file name that does not end in `.jpg` or `.jpeg`, since film strips are always JPEG.
fn check_ending(strip: &Path) -> Result<(), WorkspaceError> {
    match strip.extension().and_then(|ending| ending.to_str()) {
        Some("jpg" | "jpeg") => Ok(()),
        _ => Err(WorkspaceError::input(format!("cannot write a film strip as {}", strip.display()))
            .with_hint("a film strip is written as .jpg")),
    }
}

fn numbered(path: &Path, id: &str) -> PathBuf {
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{}-{id}.{extension}", documents::stem(path)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn how_a_replay_ended_is_said_so_that_it_makes_sense() {
        let of = |identical, largest_difference, damaged: Option<&str>| {
            let damaged = damaged.map(String::from);
            Replayed { identical, largest_difference, damaged, ..Replayed::default() }
        };
        for (row, expected, is_sound) in [
            (of(Some(true), Some(0.0), None), "identical", true),
            (of(Some(false), Some(2e-3), None), "differs by 2e-3", false),
            // The bits differ although all numbers are equal.
            (of(Some(false), Some(0.0), None), "differs, but in no value: by the sign of a zero, or by a NaN", false),
            (of(None, None, Some("cut short")), "damaged: cut short", false),
            (of(None, None, None), "not checked", true),
        ] {
            assert_eq!((row.describe().as_str(), row.is_sound()), (expected, is_sound));
        }
    }
}

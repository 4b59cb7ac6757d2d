//! Re-rendering of a dataset: images get another appearance; rows, actions and physics are unchanged.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::hexadecimal;
use genmanip_data::lerobot::{self, LerobotDataset, LerobotSettings};
use genmanip_data::{DataError, EpisodeStore, ExportReport, ExportSettings, Selection};
use genmanip_render::AppearanceFactor;
use genmanip_rollout::images::ImageSettings;
use sha2::{Digest, Sha256};

use crate::export::{check_cameras, draw_missing};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::worlds;

/// Options of [`rerender`].
#[derive(Clone, Debug)]
pub struct RerenderOptions {
    /// Index of the appearance of each episode; 0 is the one that `collect` renders with the same randomisation.
    pub look: u64,
    /// Randomised aspects of the appearance; empty for the default appearance.
    pub vary: Vec<AppearanceFactor>,
    /// Cameras to render instead of the dataset's; empty to keep those.
    pub cameras: Vec<String>,
    /// Number of rendering threads.
    pub workers: usize,
}

/// Writes a dataset with the same episodes, rows and settings as `dataset`, rendered with another appearance. `None` if
/// interrupted; the next call reuses the images rendered so far.
///
/// # Errors
/// When the dataset was not written by this program with recorded episodes, the target exists, an episode was recorded
/// with other objects, or a file cannot be written.
pub fn rerender(
    dataset: &Path,
    options: &RerenderOptions,
    out: &Path,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<ExportReport>, WorkspaceError> {
    let unfit = |error: DataError| {
        WorkspaceError::input(format!("cannot draw {} again", dataset.display())).because(error).with_hint(
            "it takes a LeRobot v3.0 dataset that `collect` or `export --to lerobot` made, with its extras/record",
        )
    };
    let settings = LerobotSettings::of(dataset).map_err(unfit)?;
    let known = LerobotDataset::open(dataset).map_err(unfit)?;
    let record = EpisodeStore::open(dataset.join(lerobot::RECORD)).map_err(unfit)?;
    for target in [lerobot::depth_path(out), out.to_owned()] {
        lerobot::check_owner(&target, None).map_err(|error| {
            WorkspaceError::input("the data set has no place").because(error).with_hint("choose another --out")
        })?;
    }
    let ids: Vec<String> = known.episodes().iter().map(|episode| episode.store_id.clone()).collect();
    let rows = ExportSettings {
        cameras: if options.cameras.is_empty() { settings.export.cameras.clone() } else { options.cameras.clone() },
        is_varied: settings.export.is_varied || !options.vary.is_empty(),
        look: options.look,
        ..settings.export.clone()
    };
    if rows.cameras.is_empty() {
        return Err(WorkspaceError::input(format!("{} has no pictures", dataset.display())).with_hint("name --cameras"));
    }
    let pictures = ImageSettings {
        cameras: rows.cameras.clone(),
        fps: rows.fps,
        vary: options.vary.clone(),
        look: options.look,
        ..ImageSettings::default()
    };
    let Some(first) = ids.first() else {
        return Err(WorkspaceError::input(format!("{} has no episode", dataset.display())));
    };
    let world = record.read(first).map_err(unfit)?.scenario.world;
    check_cameras(&record, &ids, &rows.cameras)?;
    let drawing = drawing_folder(out, &record, &ids, &pictures)?;
    let store =
        EpisodeStore::create(&drawing).map_err(|error| WorkspaceError::broken("cannot begin to draw", error))?;
    for id in &ids {
        store.take(&record, id).map_err(unfit)?;
    }
    draw_missing(&store, &ids, (&pictures, rows.needs_masks()), options.workers, progress, stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let robot = worlds::robot(&world)?;
    let settings = LerobotSettings { export: rows, run: None, ..settings };
    let written = lerobot::export(&store, &Selection::Ids(ids), &robot, &settings, out).map_err(|error| {
        WorkspaceError::broken("cannot write the dataset", error).or_hint("the pictures are kept; start again")
    })?;
    // A folder that cannot be removed is reused by the next call with the same inputs.
    let _ = fs::remove_dir_all(&drawing);
    Ok(Some(written))
}

/// Working folder for the images: hidden, beside the dataset, named by a hash of the inputs.
fn drawing_folder(
    out: &Path,
    record: &EpisodeStore,
    ids: &[String],
    pictures: &ImageSettings,
) -> Result<PathBuf, WorkspaceError> {
    let mut work = Sha256::new();
    work.update(
        serde_json::to_vec(pictures).map_err(|error| WorkspaceError::broken("cannot tell the pictures", error))?,
    );
    for id in ids {
        let hash =
            record.record_hash(id).map_err(|error| WorkspaceError::broken(format!("cannot read {id}"), error))?;
        work.update(format!("\n{id} {hash}"));
    }
    let hash = hexadecimal(&work.finalize()[..8]);
    let name = out.file_name().unwrap_or_default().to_string_lossy();
    let folder = out.with_file_name(format!(".{name}-{hash}.drawing"));
    fs::create_dir_all(&folder)
        .map_err(|error| WorkspaceError::broken("cannot make a folder for the pictures", error))?;
    Ok(folder)
}

//! Export of further datasets of a run, in addition to the one that `collect` writes: other actions, rates, cameras or
//! formats.
//!
//! Images at another rate are rendered from the recorded states and stored for the next export.

use genmanip_workspace::worlds;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::{Episode, RobotModel, named_enum};
use genmanip_data::export::ExtraColumns;
use genmanip_data::export::choice::{COLUMNS, action_name};
use genmanip_data::lerobot::{self, LerobotSettings};
use genmanip_data::{
    DataError, EpisodeStore, ExportReport, ExportSettings, Provenance, Selection, genmanip_format, hdf5, mcap, zarr,
};
use genmanip_rollout::collect::in_parallel;
use genmanip_rollout::images::{self, ImageSettings};

use crate::folder::RunFolder;
use genmanip_viz::replay;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;

named_enum! {
    /// Format of a dataset.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Format {
        /// LeRobotDataset v3.0.
        #[default]
        Lerobot = "lerobot",
        /// LeRobotDataset v2.1, with the additional files that GR00T and openpi read; without depth.
        LerobotV21 = "lerobot-v2.1",
        /// Zarr version 2, as Diffusion Policy's replay buffer reads it.
        Zarr = "zarr",
        /// HDF5 as robomimic reads it, one file per episode; without depth.
        Hdf5 = "hdf5",
        /// MCAP with Foxglove's schemas, one file per episode, for viewers.
        Mcap = "mcap",
        /// Folder layout of the recordings that the paper published, one folder per episode.
        Paper = "paper",
    }
}

impl Format {
    /// Extra columns that the format supports.
    fn columns(self) -> &'static [ExtraColumns] {
        match self {
            Self::Lerobot => &[ExtraColumns::Sim, ExtraColumns::Boxes, ExtraColumns::Masks],
            Self::LerobotV21 | Self::Zarr | Self::Hdf5 => &[ExtraColumns::Sim, ExtraColumns::Boxes],
            Self::Mcap | Self::Paper => &[ExtraColumns::Sim],
        }
    }

    /// Writes the selected episodes; their images must be in the store.
    ///
    /// # Errors
    /// As [`lerobot::export`].
    pub fn write(
        self,
        store: &EpisodeStore,
        selection: &Selection,
        robot: &RobotModel,
        settings: &LerobotSettings,
        target: &Path,
    ) -> Result<ExportReport, DataError> {
        let rows = &settings.export;
        match self {
            Self::Lerobot => lerobot::export(store, selection, robot, settings, target),
            Self::LerobotV21 => lerobot::export_v21(store, selection, robot, settings, target),
            Self::Zarr => zarr::export(store, selection, robot, rows, target),
            Self::Hdf5 => hdf5::export(store, selection, robot, rows, target),
            Self::Mcap => mcap::export(store, selection, robot, rows, target),
            Self::Paper => genmanip_format::export(store, selection, robot, rows, target),
        }
    }
}

/// Options of [`export`].
#[derive(Clone, Debug)]
pub struct ExportOptions {
    /// Format of the dataset.
    pub format: Format,
    /// Columns, rate and cameras of the rows; without cameras, no images are exported.
    pub rows: ExportSettings,
    /// True to export failed attempts as well, labelled as failed.
    pub keep_failed: bool,
    /// Only episodes whose commands came from one of these; empty for all.
    pub sources: Vec<Provenance>,
    /// Folder of the dataset; `None` for a folder in `exports/` of the run.
    pub out: Option<PathBuf>,
    /// Number of rendering threads.
    pub workers: usize,
}

/// Exports the verified episodes of a run as a dataset; `None` if interrupted.
///
/// # Errors
/// When there is no run or nothing to export, the target folder holds something else, or a file cannot be written.
pub fn export(
    path: &Path,
    options: &ExportOptions,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<ExportReport>, WorkspaceError> {
    let (folder, run) = RunFolder::open(path)?;
    let store = folder.store()?;
    let rows = ExportSettings {
        depth: options.rows.depth && !options.rows.cameras.is_empty(),
        is_varied: run.settings.is_varied(),
        has_corrections: run.settings.corrects.is_some(),
        expert: run.settings.expert.style,
        ..options.rows.clone()
    };
    let hash = run.hash()?;
    let settings = LerobotSettings { export: rows, run: Some(hash.clone()), ..LerobotSettings::default() };
    let rows = &settings.export;
    let format = options.format.name();
    let from = sources_name(&options.sources);
    let name = format!("{format}-{}-{}hz{}{from}", action_name(&rows.action), rows.fps, cameras_name(&rows.cameras));
    let target = options.out.clone().unwrap_or_else(|| folder.join("exports").join(name));
    for target in [lerobot::depth_path(&target), target.clone()] {
        lerobot::check_owner(&target, Some(&hash)).map_err(|error| {
            let hint = "choose another --out, or move what is there away";
            WorkspaceError::input("the data set has no place").because(error).with_hint(hint)
        })?;
    }
    let selection = Selection::of(&options.sources, options.keep_failed);
    let ids = selection.ids(&store).map_err(|error| WorkspaceError::broken("cannot read the episodes", error))?;
    if ids.is_empty() {
        let what = format!("{} has no episode to export{}", path.display(), only_from(&options.sources));
        return Err(WorkspaceError::input(what).with_hint(match options.sources.is_empty() {
            true => "collect some first; failed ones are exported with --keep-failed",
            false => "leave --source away to export all; failed episodes are exported with --keep-failed",
        }));
    }
    let pictures = ImageSettings {
        cameras: rows.cameras.clone(),
        fps: rows.fps,
        ..run.settings.images.clone().unwrap_or_default()
    };
    check_columns(options.format, rows)?;
    draw_missing(&store, &ids, (&pictures, rows.needs_masks()), options.workers, progress, stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(None);
    }
    let robot = worlds::robot(&run.settings.world)?;
    let exported = options.format.write(&store, &selection, &robot, &settings, &target).map_err(|error| {
        WorkspaceError::broken("cannot write the dataset", error).or_hint("the episodes are safe; start again")
    })?;
    for (id, why) in &exported.left_out {
        progress.note(&format!("episode {id} is damaged and left out: {why}"));
    }
    Ok(Some(exported))
}

/// Suffix for the name of an export: empty for all sources.
fn sources_name(sources: &[Provenance]) -> String {
    let names: Vec<&str> = sources.iter().map(|source| source.name()).collect();
    if names.is_empty() { String::new() } else { format!("-{}", names.join("+")) }
}

/// Words that name the sources that episodes are selected by; empty for all.
pub(crate) fn only_from(sources: &[Provenance]) -> String {
    let names: Vec<&str> = sources.iter().map(|source| source.name()).collect();
    if names.is_empty() { String::new() } else { format!(" from {}", names.join(" or ")) }
}

/// Suffix for the name of an export: empty for the default cameras, so that exports with other cameras do not replace
/// it.
fn cameras_name(cameras: &[String]) -> String {
    match cameras {
        usual if usual == ExportSettings::default().cameras => String::new(),
        [] => "-no_images".into(),
        others => format!("-{}", others.join("+")),
    }
}

/// Fails for columns that the format does not support.
fn check_columns(format: Format, rows: &ExportSettings) -> Result<(), WorkspaceError> {
    let unwritten = COLUMNS.into_iter().rev();
    let mut unwritten =
        unwritten.filter(|(_, columns)| rows.columns.contains(columns) && !format.columns().contains(columns));
    let Some((what, _)) = unwritten.next() else { return Ok(()) };
    let hint = "take --to lerobot; boxes also fit into lerobot-v2.1, zarr and hdf5";
    Err(WorkspaceError::input(format!("{} has no place for {what}", format.name())).with_hint(hint))
}

/// Fails for cameras that the world of an episode does not have, before anything is rendered. Damaged episodes are
/// skipped here, and reported by the export itself.
pub(crate) fn check_cameras(
    store: &EpisodeStore,
    ids: impl IntoIterator<Item = impl AsRef<str>>,
    cameras: &[String],
) -> Result<(), WorkspaceError> {
    for id in ids {
        let id = id.as_ref();
        let world = match store.read_scenario(id) {
            Ok(Some(scenario)) => scenario.world,
            Ok(None) => continue,
            Err(error) if error.is_damage() => continue,
            Err(error) => return Err(replay::unreadable(id, error)),
        };
        if let Some(unknown) = cameras.iter().find(|camera| world.camera(camera).is_none()) {
            let known: Vec<&str> = world.cameras.iter().map(|camera| camera.name.as_str()).collect();
            let error = WorkspaceError::unknown("camera", "cameras", unknown, &known);
            return Err(WorkspaceError::input(format!("episode {id} cannot be drawn")).because(error));
        }
    }
    Ok(())
}

/// Renders the images (and segmentation masks if `with_masks`) that are missing from the store, from the recorded
/// states and with the run's appearance randomisation.
pub(crate) fn draw_missing(
    store: &EpisodeStore,
    ids: &[String],
    (pictures, with_masks): (&ImageSettings, bool),
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<(), WorkspaceError> {
    let (fps, cameras) = (pictures.fps, &pictures.cameras);
    let lacks_masks = |id: &str| with_masks && !store.has_masks(id, fps, cameras);
    let is_missing = |id: &&String| !store.has_tracks(id, fps, cameras) || lacks_masks(id);
    let missing: Vec<&String> = ids.iter().filter(is_missing).collect();
    if cameras.is_empty() || missing.is_empty() {
        return Ok(());
    }
    check_cameras(store, &missing, cameras)?;
    progress.begin("drawing", missing.len());
    in_parallel(&missing, workers, stop, &|id| {
        match store.read(id) {
            // A real arm leaves no state of a simulation to draw.
            Ok(episode) if episode.initial_state.is_empty() => {
                return Err(WorkspaceError::input(format!(
                    "episode {id} was recorded on a real arm, without {fps} images per second of {}",
                    cameras.join(", ")
                ))
                .with_hint("choose --rate and --cameras as recorded, or --no-images"));
            }
            Ok(episode) => {
                if !store.has_tracks(id, fps, cameras) {
                    draw(store, &episode, pictures)?;
                }
                if lacks_masks(id) {
                    draw_masks(store, &episode, pictures)?;
                }
            }
            // The export itself reports damaged episodes.
            Err(error) if error.is_damage() => {}
            Err(error) => return Err(replay::unreadable(id, error)),
        }
        progress.advance();
        Ok::<_, WorkspaceError>(())
    })?;
    progress.end();
    Ok(())
}

fn draw_masks(store: &EpisodeStore, episode: &Episode, pictures: &ImageSettings) -> Result<(), WorkspaceError> {
    let id = &episode.result.id;
    let masks = images::render_masks(&replay::stage(episode)?, episode, pictures)
        .map_err(|error| WorkspaceError::broken(format!("cannot draw {id}"), error))?;
    let failed = |error: DataError| WorkspaceError::broken(format!("cannot keep the masks of {id}"), error);
    store.attach_masks(id, &masks).map_err(failed)
}

fn draw(store: &EpisodeStore, episode: &Episode, pictures: &ImageSettings) -> Result<(), WorkspaceError> {
    let id = &episode.result.id;
    // All cameras of a rate are rendered again, since their tracks are stored together.
    let is_wanted = |name: &&String| {
        pictures.cameras.contains(*name) || store.has_tracks(id, pictures.fps, std::slice::from_ref(*name))
    };
    let known = episode.scenario.world.cameras.iter().map(|camera| &camera.name);
    let cameras = known.filter(|name| is_wanted(name)).cloned().collect();
    let failed = |error: DataError| WorkspaceError::broken(format!("cannot keep the images of {id}"), error);
    let tracks =
        images::render_tracks(&replay::stage(episode)?, episode, &ImageSettings { cameras, ..pictures.clone() })
            .map_err(|error| WorkspaceError::broken(format!("cannot draw {id}"), error))?;
    store.attach_tracks(id, &tracks).map_err(failed)
}

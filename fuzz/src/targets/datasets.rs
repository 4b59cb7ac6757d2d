//! The episode store, and data sets of every format that is read.

use std::path::Path;

use genmanip_assets::robots;
use genmanip_core::{Camera, Intrinsics, Pose, RgbdImage};
use genmanip_data::lerobot::{self, LerobotDataset};
use genmanip_data::{
    CameraTrack, DataError, EpisodeStore, ExportReport, ExportSettings, LerobotSettings, Selection, TrackRecorder,
    VideoSettings, zarr as zarr_format,
};
use genmanip_dataset_tools::check::{DatasetCheck, check};
use genmanip_dataset_tools::import::{ImportSettings, import};
use tempfile::TempDir;

use super::{Opened, message};
use crate::Failure;
use crate::input::Input;

/// Rate of the images, Hz, and frames kept of each recorded episode: half a second.
const FPS: u32 = 10;
const FRAMES: usize = 30;

/// Two recorded episodes, cut short, with small synthetic images.
pub fn episodes(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let folder = store(repository)?;
    opened(&folder.path().join("episodes"), |folder| {
        let store = EpisodeStore::open(folder).map_err(message)?;
        for id in store.ids().map_err(message)? {
            let episode = store.read(&id).map_err(message)?;
            for camera in &episode.scenario.world.cameras {
                store.read_track(&id, FPS, &camera.name).map_err(message)?;
            }
        }
        Ok(())
    })
}

/// Those episodes as LeRobot v3.0: checked, and its actions read for playback.
pub fn lerobot(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let settings = LerobotSettings { export: export(true), record: false, ..LerobotSettings::default() };
    let folder = exported(repository, |store, target| {
        lerobot::export(store, &Selection::Recorded, &robots::panda(), &settings, target)
    })?;
    opened(folder.path(), |folder| {
        let dataset = LerobotDataset::open(&folder.join(DATASET)).map_err(message)?;
        let actions = dataset.episodes().iter().map(|episode| dataset.actions(episode).map(drop));
        let played_back = actions.collect::<Result<(), _>>();
        checked(folder)?;
        played_back.map_err(message)
    })
}

/// Those episodes as LeRobot v2.1: checked and imported.
pub fn v21(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let settings = LerobotSettings { export: export(true), record: false, ..LerobotSettings::default() };
    let folder = exported(repository, |store, target| {
        lerobot::export_v21(store, &Selection::Recorded, &robots::panda(), &settings, target)
    })?;
    opened(folder.path(), |folder| {
        let is_sound = checked(folder);
        imported(&folder.join(DATASET), &folder.join("imported"))?;
        is_sound
    })
}

/// Those episodes as Zarr, without images.
pub fn zarr(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let folder = exported(repository, |store, target| {
        zarr_format::export(store, &Selection::Recorded, &robots::panda(), &export(false), target)
    })?;
    opened(folder.path(), checked)
}

/// A recording of the original GenManip: its pickle, and pickles and JPEG images in LMDB.
pub fn original(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let source = repository.join("crates/dataset-tools/testdata/original");
    opened(&source, |folder| imported(folder, &folder.with_file_name("imported")))
}

/// Demonstrations of robomimic and LIBERO in HDF5, one file each: their features differ.
pub fn hdf5(_: &str, repository: &Path) -> Result<Opened, Failure> {
    let corpus = Input::each_of_folder(&repository.join("crates/dataset-tools/testdata/robomimic"))?;
    Ok(in_folders(corpus, |folder| imported(folder, &folder.with_file_name("imported"))))
}

/// Name of the exported data set.
const DATASET: &str = "dataset";

/// A target with one input, all files of a folder.
fn opened(corpus: &Path, read: impl Fn(&Path) -> Result<(), String> + 'static) -> Result<Opened, Failure> {
    Ok(in_folders(vec![Input::of_folder(corpus)?], read))
}

/// A target whose reader gets the files of an input in a folder of their own.
fn in_folders(corpus: Vec<Input>, read: impl Fn(&Path) -> Result<(), String> + 'static) -> Opened {
    let read = move |input: &Input| {
        let scratch = tempfile::tempdir().map_err(message)?;
        let folder = scratch.path().join("input");
        input.write(&folder).map_err(message)?;
        read(&folder)
    };
    Opened { corpus, read: Box::new(read) }
}

/// A folder with a store of the recorded episodes in `episodes`.
fn store(repository: &Path) -> Result<TempDir, Failure> {
    let recorded = EpisodeStore::open(repository.join("crates/cli/testdata/version_1/run/episodes"))?;
    let folder = tempfile::tempdir()?;
    let store = EpisodeStore::create(folder.path().join("episodes"))?;
    for id in recorded.ids()? {
        let mut episode = recorded.read(&id)?;
        episode.frames.truncate(FRAMES);
        episode.result.frames = FRAMES;
        let intrinsics = Intrinsics::from_vertical_fov(48, 32, 0.8);
        for camera in &mut episode.scenario.world.cameras {
            camera.intrinsics = intrinsics;
        }
        store.write(&episode, &[])?;
        let tracks = episode.scenario.world.cameras.iter().map(track).collect::<Result<Vec<_>, _>>()?;
        store.attach_tracks(&id, &tracks)?;
    }
    Ok(folder)
}

/// Colour and depth of a moving edge.
fn track(camera: &Camera) -> Result<CameraTrack, Failure> {
    let (width, height) = (camera.intrinsics.width as usize, camera.intrinsics.height as usize);
    let mut recorder = TrackRecorder::new(camera, FPS, &VideoSettings::default())?;
    for row in 0..FRAMES / (60 / FPS as usize) {
        let is_left = |pixel: usize| pixel % width < 10 + 3 * row;
        let rgb = (0..width * height).flat_map(|pixel| if is_left(pixel) { [200, 40, 60] } else { [90, 120, 150] });
        let depth_m = (0..width * height).map(|pixel| if is_left(pixel) { 0.5 } else { 1.25 }).collect();
        let place = camera.world_from_camera(&Pose::IDENTITY);
        recorder.push(&RgbdImage { rgb: rgb.collect(), ..RgbdImage::of_depth(camera.intrinsics, place, depth_m) })?;
    }
    Ok(recorder.finish()?)
}

/// A folder with a data set of the recorded episodes in `dataset`.
fn exported(
    repository: &Path,
    write: impl FnOnce(&EpisodeStore, &Path) -> Result<ExportReport, DataError>,
) -> Result<TempDir, Failure> {
    let (recorded, folder) = (store(repository)?, tempfile::tempdir()?);
    write(&EpisodeStore::open(recorded.path().join("episodes"))?, &folder.path().join(DATASET))?;
    Ok(folder)
}

fn export(images: bool) -> ExportSettings {
    let cameras = if images { vec!["static".into(), "wrist".into()] } else { Vec::new() };
    ExportSettings { fps: FPS, cameras, depth: images, ..ExportSettings::default() }
}

/// The first finding of the check as an error.
fn checked(folder: &Path) -> Result<(), String> {
    let DatasetCheck { findings, .. } = check(&folder.join(DATASET), &[robots::panda()]).map_err(message)?;
    findings.first().map_or(Ok(()), |finding| Err(format!("{finding:?}")))
}

fn imported(source: &Path, out: &Path) -> Result<(), String> {
    import(source, &ImportSettings::default(), out, &mut |_| {}).map(drop).map_err(message)
}

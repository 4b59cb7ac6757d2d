//! Datasets: cost of collecting and exporting, and success of exported actions played back open loop.

mod playback;
mod synthetic;

use genmanip_workspace::worlds;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use genmanip_assets::worlds::default_world;
use genmanip_core::{CameraRequest, Episode, ImageChannels, Seed, Task};
use genmanip_data::lerobot::{self, LerobotDataset, LerobotSettings};
use genmanip_data::{DataError, EpisodeStore, Selection, TrackRecorder};
use genmanip_dataset_tools::check;
use genmanip_pipeline::export::Format;
use genmanip_rollout::collect::{Attempt, PipelineSettings, Resources};
use genmanip_rollout::expert::Expert;
use genmanip_rollout::images::{Exposure, ImageSettings, StageRenderer};
use genmanip_rollout::{RolloutError, Stage, run_episode};
use genmanip_workspace::Progress;
use genmanip_workspace::text_table;
use serde::Serialize;

use crate::LabError;
use crate::clock::{cpu_clock, process_clock};
use crate::episodes::laid_out;

pub use playback::Missed;
pub use synthetic::measure as measure_synthetic;

/// Cost and playback success of the datasets of some episodes.
#[derive(Debug, Default, Serialize)]
pub struct Measured {
    /// Seed of tasks, layouts and attempts.
    pub seed: u64,
    /// Number of verified episodes, from one attempt per task, or of synthetic ones; the figures refer to these.
    pub episodes: usize,
    /// Number of 60 Hz frames of these episodes; of dataset rows if the episodes are synthetic.
    pub frames: usize,
    /// CPU time by stage, s; that of `simulate` includes failed attempts.
    pub cpu_s: CpuSeconds,
    /// Size of one pair of colour and depth image in the datasets, bytes.
    pub bytes_per_rgbd_frame: f64,
    /// CPU time of encoding, writing and exporting one pair of colour and depth image, ms.
    pub encode_and_write_ms_per_rgbd_frame: f64,
    /// CPU time of an export whose images are already rendered, by format, s.
    pub export_s: BTreeMap<&'static str, f64>,
    /// Success rate when the rows of a dataset are played back open loop through the policy interface, by
    /// `ACTION@RATE`; the rotation representation is part of the key unless it is 6d.
    pub playback: BTreeMap<String, f64>,
    /// Episodes that failed in playback.
    pub missed: Vec<Missed>,
    /// Wall time of `data check`, s.
    pub check_s: Option<f64>,
    /// Wall time to open the dataset with its episode index, s.
    pub open_s: Option<f64>,
    /// Wall time to merge the dataset from shards, s; `None` unless requested.
    pub merge_s: Option<f64>,
    /// Size of the dataset and of the separate depth dataset beside it, bytes.
    pub dataset_bytes: u64,
}

/// CPU time by stage, s.
#[derive(Debug, Default, Serialize)]
pub struct CpuSeconds {
    /// Layout, planning and physics.
    pub simulate: f64,
    /// Rendering of colour and depth.
    pub render: f64,
    /// Encoding of images.
    pub encode: f64,
    /// Writing episodes and tracks into the store.
    pub write: f64,
}

/// Collects one attempt per task into `folder`, which must not exist yet, exports the verified ones and plays them
/// back.
///
/// # Errors
/// If the folder exists, a stage fails, or a file cannot be written; failed attempts are omitted.
pub fn measure(tasks: &[Task], seed: Seed, folder: &Path, progress: &dyn Progress) -> Result<Measured, LabError> {
    fs::create_dir(folder)
        .map_err(|error| LabError::broken(format!("cannot make the folder {}", folder.display()), error))?;
    let settings = PipelineSettings::in_world((*default_world()).clone());
    let planner = worlds::planner(&settings.world, &settings.planner)?;
    let resources = Resources::builtin(&planner);
    let store = EpisodeStore::create(folder.join("episodes")).map_err(broke)?;
    let mut cpu_s = CpuSeconds::default();
    let mut recorded = Vec::new();
    progress.begin("collecting", tasks.len());
    for task in tasks {
        let stream = seed.fork("attempt").fork(&task.id);
        let mut clock = cpu_clock();
        if let Some((attempt, scenario)) = laid_out(task, resources, &settings, stream)? {
            let (stage, episode) = attempted(&attempt, Arc::new(scenario), resources, &settings)?;
            cpu_s.simulate += clock();
            if episode.result.success {
                keep(&store, &stage, &episode, &mut cpu_s)?;
                recorded.push((stage, episode));
            }
        }
        progress.advance();
    }
    progress.end();
    if recorded.is_empty() {
        return Err(LabError::input("no attempt was verified").with_hint("take more episodes, or another seed"));
    }

    let mut clock = process_clock();
    let dataset = folder.join("dataset");
    let lerobot = LerobotSettings::default();
    let exported = lerobot::export(&store, &Selection::Verified, planner.robot(), &lerobot, &dataset).map_err(broke)?;
    let mut export_s = BTreeMap::from([("lerobot", clock())]);
    for format in Format::ALL.into_iter().filter(|format| *format != Format::Lerobot) {
        let target = folder.join(format!("export-{}", format.name()));
        let mut clock = process_clock();
        format.write(&store, &Selection::Verified, planner.robot(), &lerobot, &target).map_err(broke)?;
        export_s.insert(format.name(), clock());
        fs::remove_dir_all(&target)
            .map_err(|error| LabError::broken(format!("cannot remove {}", target.display()), error))?;
    }
    let pictures = exported.frames * lerobot.export.cameras.len();
    let bytes = bytes_below(&dataset.join("videos")) + bytes_below(&lerobot::depth_path(&dataset).join("data"));
    let clock = Instant::now();
    LerobotDataset::open(&dataset).map_err(broke)?;
    let open_s = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let checked = check::check(&dataset, &[Arc::clone(planner.robot())]).map_err(broke)?;
    let check_s = clock.elapsed().as_secs_f64();
    if let Some(finding) = checked.findings.first() {
        let what = format!("the exported dataset is invalid: {finding:?}");
        return Err(LabError::input(what).with_hint("this is a defect of the program"));
    }
    let (playback, missed) = playback::measure(&recorded, &store, (&planner, &settings), folder, progress)?;
    Ok(Measured {
        seed: seed.value(),
        episodes: recorded.len(),
        frames: recorded.iter().map(|(_, episode)| episode.frames.len()).sum(),
        encode_and_write_ms_per_rgbd_frame: 1e3 * (cpu_s.encode + cpu_s.write + export_s["lerobot"]) / pictures as f64,
        cpu_s,
        bytes_per_rgbd_frame: bytes as f64 / pictures as f64,
        export_s,
        playback,
        missed,
        check_s: Some(check_s),
        open_s: Some(open_s),
        merge_s: None,
        dataset_bytes: bytes_below(&dataset) + bytes_below(&lerobot::depth_path(&dataset)),
    })
}

fn attempted(
    attempt: &Attempt,
    scenario: Arc<genmanip_core::Scenario>,
    resources: Resources,
    settings: &PipelineSettings,
) -> Result<(Stage, Episode), LabError> {
    let broke = |error: RolloutError| LabError::broken(format!("attempt {} broke", attempt.id()), error);
    let planner = resources.planner;
    let stage = Stage::open(scenario, resources.catalogue, planner.robot()).map_err(broke)?;
    let mut expert =
        Expert::new(&stage, planner, resources.grasps, settings.expert.clone()).map_err(|error| broke(error.into()))?;
    let episode = run_episode(&stage, &mut expert, &attempt.id(), attempt.seed, &settings.rollout).map_err(broke)?;
    Ok((stage, episode))
}

/// Stores an episode and its images as `collect` does; adds the CPU time of each part to `cpu_s`.
fn keep(store: &EpisodeStore, stage: &Stage, episode: &Episode, cpu_s: &mut CpuSeconds) -> Result<(), LabError> {
    let render_failed = |error: RolloutError| LabError::broken(format!("cannot render {}", episode.result.id), error);
    let mut clock = cpu_clock();
    store.write(episode, &[]).map_err(broke)?;
    cpu_s.write += clock();
    let pictures = ImageSettings::default();
    let camera = |name: &String| stage.camera(&CameraRequest::new(name, ImageChannels::RGBD));
    let cameras = pictures.cameras.iter().map(camera).collect::<Result<Vec<_>, _>>().map_err(render_failed)?;
    let recorder = |camera| TrackRecorder::new(camera, pictures.fps, &pictures.video);
    let mut tracks = cameras.iter().map(recorder).collect::<Result<Vec<_>, _>>().map_err(broke)?;
    let mut clock = cpu_clock();
    let mut painter = StageRenderer::new(stage).map_err(render_failed)?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, ImageChannels::RGBD)).collect();
    let (_, stride) =
        genmanip_data::export::sampling(episode.frames.len(), episode.result.control_rate_hz, pictures.fps)
            .map_err(broke)?;
    let mut since = 0.0;
    let mut lap = |total: &mut f64| {
        let now = clock();
        *total += now - since;
        since = now;
    };
    for (index, frame) in episode.frames.iter().enumerate().step_by(stride) {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let exposure = Exposure::of(episode, index);
        let images = painter.render_state(&frame.joint_position, frame.gripper_width, objects, &views, exposure);
        let images = images.map_err(render_failed)?;
        lap(&mut cpu_s.render);
        for (track, image) in tracks.iter_mut().zip(&images) {
            track.push(image).map_err(broke)?;
        }
        lap(&mut cpu_s.encode);
    }
    let tracks: Vec<_> = tracks.into_iter().map(TrackRecorder::finish).collect::<Result<_, _>>().map_err(broke)?;
    lap(&mut cpu_s.encode);
    store.attach_tracks(&episode.result.id, &tracks).map_err(broke)?;
    lap(&mut cpu_s.write);
    Ok(())
}

fn broke(error: DataError) -> LabError {
    LabError::broken("the data could not be stored", error).or_hint("check that the disk is not full")
}

/// Size of all files below a folder, bytes.
fn bytes_below(folder: &Path) -> u64 {
    let mut folders: Vec<PathBuf> = vec![folder.into()];
    let mut bytes = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.metadata() {
                Ok(about) if about.is_dir() => folders.push(entry.path()),
                Ok(about) => bytes += about.len(),
                Err(_) => {}
            }
        }
    }
    bytes
}

/// Text summary.
pub fn describe(measured: &Measured) -> String {
    let mut rows = vec![["what", "measured"].map(String::from).to_vec()];
    let mut row = |what: &str, measured: String| rows.push(vec![what.into(), measured]);
    row("verified episodes", measured.episodes.to_string());
    row("frames at 60 Hz", measured.frames.to_string());
    let CpuSeconds { simulate, render, encode, write } = measured.cpu_s;
    for (what, seconds) in [("simulate", simulate), ("render", render), ("encode", encode), ("write", write)] {
        row(&format!("{what}, CPU time"), format!("{seconds:.1} s"));
    }
    row("colour and depth, per frame", format!("{:.1} kB", measured.bytes_per_rgbd_frame / 1e3));
    row("encode, write and export, per frame", format!("{:.2} ms", measured.encode_and_write_ms_per_rgbd_frame));
    for (format, seconds) in &measured.export_s {
        row(&format!("export to {format}, CPU time"), format!("{seconds:.2} s"));
    }
    for (what, seconds) in [
        ("open the dataset", measured.open_s),
        ("check the dataset", measured.check_s),
        ("merge it from shards", measured.merge_s),
    ] {
        if let Some(seconds) = seconds {
            row(what, format!("{seconds:.2} s"));
        }
    }
    row("dataset", format!("{:.1} MB", measured.dataset_bytes as f64 / 1e6));
    for (action, success) in &measured.playback {
        row(&format!("played back, {action} Hz"), format!("{:.1} %", 100.0 * success));
    }
    let missed = measured.missed.iter().map(|missed| {
        let Missed { action, episode, why } = missed;
        format!("\n{action}: {episode}: {why}")
    });
    text_table(&rows) + &missed.collect::<String>()
}

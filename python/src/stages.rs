//! The stages from tasks to data sets.

use genmanip_workspace::task_files;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;
use std::path::PathBuf;
use std::time::Instant;

use genmanip_core::{Document, ImageChannels, Seed, TaskKind};
use genmanip_data::ExportSettings;
use genmanip_data::export::choice::{self, ACTIONS, RATES, ROTATIONS};
use genmanip_data::lerobot::LerobotDataset;
use genmanip_layout::LayoutSettings;
use genmanip_motion::PlannerSettings;
use genmanip_pipeline::Run;
use genmanip_pipeline::collect::CollectOptions;
use genmanip_pipeline::export::{ExportOptions, Format};
use genmanip_pipeline::layouts::{LayoutOutput, lay_out};
use genmanip_pipeline::learn::{self, Head, Length, Preset, TrainOptions};
use genmanip_pipeline::plan::{MotionRequest, Target};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::images::ImageSettings;
use genmanip_viz::render::RenderOptions;
use genmanip_workspace::designed_tasks::{Design, design_into};
use genmanip_workspace::{WorkspaceError, scenarios};
use pyo3::prelude::*;

use crate::errors::{error, json};
use crate::evaluation::interruptible;
use crate::observation::array;
use crate::progress::Reporter;

/// Tasks of files and folders, as JSON.
#[pyfunction]
pub fn tasks(py: Python, paths: Vec<PathBuf>) -> PyResult<String> {
    let tasks = py.detach(|| task_files::read_tasks(&paths)).map_err(error)?;
    json(&tasks.iter().map(Document::to_value).collect::<Vec<_>>())
}

/// Tasks by rules into a folder; rows as JSON.
#[pyfunction]
pub fn design(
    py: Python,
    out: PathBuf,
    kinds: Vec<String>,
    count: usize,
    seed: u64,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let named = kinds.iter().map(|name| task_files::task_kind(name)).collect::<Result<Vec<_>, _>>().map_err(error)?;
    let kinds = if named.is_empty() { TaskKind::ALL.to_vec() } else { named };
    let progress = Reporter::new(progress);
    let rows = py.detach(|| {
        let cards = genmanip_assets::Catalogue::builtin().cards();
        let seed = Seed::new(seed);
        design_into(
            &out,
            &Design { kinds: &kinds, count, cards, seed, settings: Default::default(), fill: false, include: None },
            &progress,
        )
    });
    json(&rows.map_err(error)?)
}

/// Scenarios of tasks into a folder; rows as JSON.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn layout(
    py: Python,
    tasks: Vec<PathBuf>,
    out: PathBuf,
    count: usize,
    seed: u64,
    world: Option<PathBuf>,
    robot: Option<String>,
    workers: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let progress = Reporter::new(progress);
    let rows = interruptible(py, |stop| {
        let tasks = task_files::read_tasks(&tasks)?;
        let world = worlds::read_world_with(world.as_deref(), robot.as_deref())?;
        let output = LayoutOutput { folder: out, explain: false };
        let (settings, seed, workers) = (LayoutSettings::default(), Seed::new(seed), workers::workers(workers));
        lay_out(&tasks, count, &world, &settings, seed, &output, workers, &progress, stop, &mut |_| {})
    })?;
    json(&rows)
}

/// Demonstrations of tasks into the folder of a run; rows as JSON.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn collect(
    py: Python,
    tasks: Vec<PathBuf>,
    out: PathBuf,
    episodes: usize,
    seed: u64,
    dataset: bool,
    keep_failed: bool,
    corrections: Option<String>,
    world: Option<PathBuf>,
    robot: Option<String>,
    workers: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let progress = Reporter::new(progress);
    let collected = interruptible(py, |stop| {
        let tasks = task_files::spool_tasks(&tasks, &out)?;
        let world = worlds::read_world_with(world.as_deref(), robot.as_deref())?;
        let images = dataset.then(ImageSettings::default);
        let settings =
            PipelineSettings { images, keep_failed, corrects: corrections, ..PipelineSettings::in_world(world) };
        let run = Run::new(tasks, episodes, settings, Seed::new(seed));
        let options = CollectOptions { workers: workers::workers(workers), ..CollectOptions::default() };
        genmanip_pipeline::collect::collect(&out, run, options, &progress, stop)
    })?;
    json(&collected.rows)
}

/// A dataset of a run; what was exported as JSON.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn export(
    py: Python,
    run: PathBuf,
    format: &str,
    action: &str,
    rotation: &str,
    rate: u32,
    cameras: Vec<String>,
    depth: bool,
    keep_failed: bool,
    out: Option<PathBuf>,
    workers: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let unknown = |what, plural, got: &str, known: &[&str]| error(WorkspaceError::unknown(what, plural, got, known));
    let formats = Format::ALL.map(Format::name);
    let named = Format::named(format).ok_or_else(|| unknown("format", "formats", format, &formats))?;
    let space = ACTIONS.iter().find(|(name, _)| *name == action);
    let space = space.ok_or_else(|| unknown("action", "actions", action, &ACTIONS.map(|(name, _)| name)))?.1;
    let turned = ROTATIONS.iter().find(|(name, _)| *name == rotation);
    let turned = turned.ok_or_else(|| unknown("rotation", "rotations", rotation, &ROTATIONS.map(|(name, _)| name)))?.1;
    if !RATES.contains(&rate) {
        let hint = format!("rates are {}", RATES.map(|rate| rate.to_string()).join(", "));
        return Err(error(WorkspaceError::input(format!("rate={rate} is not possible")).with_hint(hint)));
    }
    let rows =
        ExportSettings { fps: rate, action: choice::action(space, turned), cameras, depth, ..Default::default() };
    let workers = workers::workers(workers);
    let options = ExportOptions { format: named, rows, keep_failed, sources: Vec::new(), out, workers };
    let progress = Reporter::new(progress);
    let exported = interruptible(py, |stop| genmanip_pipeline::export::export(&run, &options, &progress, stop))?;
    json(&exported)
}

/// A policy trained on the demonstrations of a run, as JSON; `null` if it was stopped.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn train(
    py: Python,
    run: PathBuf,
    out: PathBuf,
    preset: &str,
    head: &str,
    steps: Option<u64>,
    budget_s: Option<u64>,
    seed: u64,
    labels: bool,
    workers: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    if cfg!(not(feature = "learn")) {
        let what = WorkspaceError::input("this module was built without training");
        let hint = "install the wheel that `cargo xtask wheel` builds, or from source: \
                    pip install ./python --config-settings=build-args='--features learn'";
        return Err(error(what.with_hint(hint)));
    }
    let unknown = |what, plural, got: &str, known: &[&str]| error(WorkspaceError::unknown(what, plural, got, known));
    let preset =
        Preset::named(preset).ok_or_else(|| unknown("preset", "presets", preset, &Preset::ALL.map(Preset::name)))?;
    let head = Head::named(head).ok_or_else(|| unknown("head", "heads", head, &Head::ALL.map(Head::name)))?;
    let length = match (steps, budget_s) {
        (Some(steps), None) => Length::Steps(steps),
        (None, Some(budget_s)) => Length::BudgetS(budget_s),
        _ => {
            let what = WorkspaceError::input("a training has one length");
            return Err(error(what.with_hint("give steps=…, or budget_s=… (wall-clock time)")));
        }
    };
    let options = TrainOptions {
        run,
        sources: Vec::new(),
        preset,
        head,
        length,
        seed: Seed::new(seed),
        labels,
        out,
        threads: workers::workers(workers),
    };
    let progress = Reporter::new(progress);
    json(&interruptible(py, |stop| learn::train(&options, &progress, stop))?)
}

/// Images of an episode store, a run or scenarios; rows as JSON.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn render(
    py: Python,
    source: PathBuf,
    out: PathBuf,
    cameras: Vec<String>,
    size: Option<[u32; 2]>,
    depth: bool,
    fps: u32,
    workers: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let options = RenderOptions {
        robot: None,
        cameras,
        size_px: size,
        channels: if depth { ImageChannels::RGBD } else { ImageChannels::RGB },
        boxes: false,
        clouds: false,
        overlays: Vec::new(),
        captions: false,
        turntable: None,
        fps,
        look: None,
        sensor: None,
        shutter_s: None,
        distortion: None,
        paths: None,
        workers: workers::workers(workers),
    };
    let progress = Reporter::new(progress);
    let rendered = interruptible(py, |stop| genmanip_viz::render::render(&source, &out, &options, &progress, stop))?;
    json(&rendered)
}

/// Motion of the arm in a scenario, or in an empty world; as JSON.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "the package names them all")]
pub fn plan(
    py: Python,
    scenario: Option<PathBuf>,
    object: Option<String>,
    position: Option<Vec<f64>>,
    yaw_rad: f64,
    joints: Option<Vec<f64>>,
    start: Option<Vec<f64>>,
    width_m: f64,
    robot: Option<String>,
    seed: u64,
) -> PyResult<String> {
    let target = match (object, position, joints) {
        (Some(object), None, None) => Target::Object(object),
        (None, Some(position_m), None) => Target::Point { position_m, yaw_rad },
        (None, None, Some(joints)) => Target::Joints(joints),
        _ => {
            let what = WorkspaceError::input("a motion has one target");
            return Err(error(what.with_hint("give one of object=…, position=… and joints=…")));
        }
    };
    let planned = py.detach(|| {
        let stage = match &scenario {
            Some(path) => scenarios::read_stage(path)?,
            None => scenarios::empty_stage(worlds::read_world_with(None, robot.as_deref())?)?,
        };
        worlds::check_robot(&stage.scenario.world, robot.as_deref())?;
        let planner = worlds::planner(&stage.scenario.world, &PlannerSettings::default())?;
        let gripper_width_m = width_m.min(stage.robot.gripper.max_width);
        let request = MotionRequest { target, from: start, gripper_width_m };
        let begun = Instant::now();
        genmanip_pipeline::plan::plan(&stage, &planner, &request, Seed::new(seed), &mut || {
            begun.elapsed().as_secs_f64()
        })
    });
    json(&planned.map_err(error)?)
}

/// The contract of a data set's actions, as JSON, and its episodes: index, scenario, success, first row, row behind the last.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "the package gives them names")]
pub fn dataset(py: Python, folder: PathBuf) -> PyResult<(String, Vec<(i64, String, bool, i64, i64)>)> {
    let opened = py.detach(|| LerobotDataset::open(&folder)).map_err(unreadable)?;
    let row = |row: &genmanip_data::lerobot::EpisodeRow| {
        (row.index, row.scenario_id.clone(), row.success, row.rows.start, row.rows.end)
    };
    Ok((opened.contract().to_json(), opened.episodes().iter().map(row).collect()))
}

/// The actions of an episode of a data set, row by row.
#[pyfunction]
pub fn dataset_actions(py: Python<'_>, folder: PathBuf, episode: i64) -> PyResult<Bound<'_, PyAny>> {
    let actions = py.detach(|| {
        let opened = LerobotDataset::open(&folder).map_err(unreadable)?;
        let row = opened.episodes().iter().find(|row| row.index == episode);
        let none = || error(WorkspaceError::input(format!("the data set has no episode {episode}")));
        opened.actions(row.ok_or_else(none)?).map_err(unreadable)
    })?;
    array(py, &actions.concat(), &[actions.len(), actions.first().map_or(0, Vec::len)])
}

fn unreadable(cause: genmanip_data::DataError) -> PyErr {
    error(WorkspaceError::input("the data set cannot be read").because(cause))
}

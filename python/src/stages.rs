//! The stages from tasks to data sets.

use genmanip_workspace::task_files;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;
use std::path::PathBuf;

use genmanip_core::{Document, Seed, TaskKind};
use genmanip_data::lerobot::LerobotDataset;
use genmanip_layout::LayoutSettings;
use genmanip_pipeline::Run;
use genmanip_pipeline::collect::CollectOptions;
use genmanip_pipeline::layouts::{LayoutOutput, lay_out};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::images::ImageSettings;
use genmanip_workspace::NoProgress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::designed_tasks::{Design, design_into};
use pyo3::prelude::*;

use crate::errors::{error, json};
use crate::evaluation::interruptible;
use crate::observation::array;

/// Tasks of files and folders, as JSON.
#[pyfunction]
pub fn tasks(py: Python, paths: Vec<PathBuf>) -> PyResult<String> {
    let tasks = py.detach(|| task_files::read_tasks(&paths)).map_err(error)?;
    json(&tasks.iter().map(Document::to_value).collect::<Vec<_>>())
}

/// Tasks by rules into a folder; rows as JSON.
#[pyfunction]
pub fn design(py: Python, out: PathBuf, kinds: Vec<String>, count: usize, seed: u64) -> PyResult<String> {
    let named = kinds.iter().map(|name| task_files::task_kind(name)).collect::<Result<Vec<_>, _>>().map_err(error)?;
    let kinds = if named.is_empty() { TaskKind::ALL.to_vec() } else { named };
    let rows = py.detach(|| {
        let cards = genmanip_assets::Catalogue::builtin().cards();
        let seed = Seed::new(seed);
        design_into(
            &out,
            &Design { kinds: &kinds, count, cards, seed, settings: Default::default(), fill: false, include: None },
            &NoProgress,
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
) -> PyResult<String> {
    let rows = interruptible(py, |stop| {
        let tasks = task_files::read_tasks(&tasks)?;
        let world = worlds::read_world_with(world.as_deref(), robot.as_deref())?;
        let output = LayoutOutput { folder: out, explain: false };
        let (settings, seed, workers) = (LayoutSettings::default(), Seed::new(seed), workers::workers(workers));
        lay_out(&tasks, count, &world, &settings, seed, &output, workers, &NoProgress, stop, &mut |_| {})
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
) -> PyResult<String> {
    let collected = interruptible(py, |stop| {
        let tasks = task_files::spool_tasks(&tasks, &out)?;
        let world = worlds::read_world_with(world.as_deref(), robot.as_deref())?;
        let images = dataset.then(ImageSettings::default);
        let settings =
            PipelineSettings { images, keep_failed, corrects: corrections, ..PipelineSettings::in_world(world) };
        let run = Run::new(tasks, episodes, settings, Seed::new(seed));
        let options = CollectOptions { workers: workers::workers(workers), ..CollectOptions::default() };
        genmanip_pipeline::collect::collect(&out, run, options, &NoProgress, stop)
    })?;
    json(&collected.rows)
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

//! Laying tasks out into scenario files, with drawings that explain them.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use genmanip_assets::{Catalogue, GraspLibrary};
use genmanip_bench::{MOST_ROWS, Svg, attention, text_table};
use genmanip_core::{Document, Seed, Task, World};
use genmanip_layout::LayoutSettings;
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::{Attempt, Resources, in_parallel};
use serde::Serialize;

use crate::error::RunError;
use crate::inputs;
use crate::pictures;
use crate::progress::Progress;

/// Where layouts go.
#[derive(Clone, Debug, PartialEq)]
pub struct LayoutOutput {
    /// Folder of the scenario files.
    pub folder: PathBuf,
    /// Also a drawing of each, or of why there is none.
    pub explain: bool,
}

/// One layout: where its file is, or why there is none.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LaidOut {
    /// Id of the task.
    pub task: String,
    /// File of the scenario.
    pub scenario: Option<String>,
    /// Why there is none.
    pub refused: Option<String>,
    /// File of the drawing, if one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<String>,
}

/// Lays each task out `count` times and writes the scenarios; the result does not depend on the number of workers.
///
/// # Errors
/// When a file cannot be written. A task that cannot be laid out is a row, not an error.
#[expect(clippy::too_many_arguments, reason = "input, settings and seed, and what every stage has")]
pub fn lay_out(
    tasks: &[Task],
    count: usize,
    world: &World,
    settings: &LayoutSettings,
    seed: Seed,
    output: &LayoutOutput,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Vec<LaidOut>, RunError> {
    let planner = inputs::planner(world, &PlannerSettings::default())?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner, grasps: GraspLibrary::builtin() };
    let attempts = Attempt::all(tasks, count, seed);
    progress.begin("laying out", attempts.len());
    let rows = in_parallel(&attempts, workers, stop, &|attempt| {
        let row = one(attempt, output, resources, world, settings);
        progress.advance();
        row
    })?;
    progress.end();
    Ok(rows)
}

/// One layout, written with its picture when asked.
fn one(
    attempt: &Attempt,
    output: &LayoutOutput,
    resources: Resources,
    world: &World,
    settings: &LayoutSettings,
) -> Result<LaidOut, RunError> {
    let (task, path) = (attempt.task, output.folder.join(format!("{}.json", attempt.id())));
    let draw = |drawing: &dyn Fn() -> Result<Svg, RunError>| -> Result<Option<String>, RunError> {
        let picture = path.with_extension("svg");
        if output.explain {
            inputs::write_file(&picture, drawing()?.as_str().as_bytes())?;
        }
        Ok(output.explain.then(|| picture.display().to_string()))
    };
    let id = task.id.clone();
    match attempt.scenario(resources, world, settings) {
        Ok(scenario) => {
            inputs::write_file(&path, scenario.to_json().as_bytes())?;
            let picture = draw(&|| pictures::explained(&scenario, resources.catalogue))?;
            Ok(LaidOut { task: id, scenario: Some(path.display().to_string()), refused: None, picture })
        }
        Err(error) if error.is_defect() => Err(RunError::broken(format!("laying out {} stopped", attempt.id()), error)),
        Err(error) => {
            let picture = draw(&|| pictures::explained_refusal(task, &error, world, resources.catalogue))?;
            Ok(LaidOut { task: id, scenario: None, refused: Some(error.to_string()), picture })
        }
    }
}

/// The rows as a table; above [`MOST_ROWS`], unless `each` is asked for, how many there are and those refused.
pub fn table(rows: &[LaidOut], each: bool) -> String {
    let line = |row: &LaidOut| {
        vec![row.task.clone(), row.scenario.clone().or_else(|| row.refused.clone()).unwrap_or_default()]
    };
    if each || rows.len() <= MOST_ROWS {
        let head = ["task", "scenario"].map(String::from).to_vec();
        return text_table(&[head].into_iter().chain(rows.iter().map(line)).collect::<Vec<_>>());
    }
    let refused: Vec<Vec<String>> = rows.iter().filter(|row| row.refused.is_some()).map(line).collect();
    let laid_out = rows.len() - refused.len();
    let listed = attention(&["task", "why not"], &refused);
    format!("{laid_out} of {} laid out; each with --each\n{listed}", rows.len())
}

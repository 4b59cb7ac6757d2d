//! Layouts of tasks as scenario files, with diagrams that explain them.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use genmanip_core::{Document, Seed, Task, World, hexadecimal};
use genmanip_data::files;
use genmanip_layout::LayoutSettings;
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::{Attempt, Resources, in_parallel_each};
use genmanip_viz::Svg;
use genmanip_workspace::{MAX_ROWS, attention, text_table};
use serde::Serialize;
use sha2::{Digest, Sha256};

use genmanip_viz::scene_images;
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::documents::sweep;
use genmanip_workspace::resume_ledger::{Entry, Ledger};
use genmanip_workspace::worlds;

/// Output of [`lay_out`].
#[derive(Clone, Debug, PartialEq)]
pub struct LayoutOutput {
    /// Folder of the scenario files.
    pub folder: PathBuf,
    /// True to write a diagram of each layout, or of the reason why there is none.
    pub explain: bool,
}

/// Row of one layout: its file, or the reason why there is none.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LaidOut {
    /// Id of the task.
    pub task: String,
    /// Path of the scenario file; `None` without a layout.
    pub scenario: Option<String>,
    /// Reason why there is no layout; `None` if there is one.
    pub refused: Option<String>,
    /// Path of the diagram; `None` if none was requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<String>,
}

/// Lays each task out `count` times and writes the scenarios; the result does not depend on the number of workers.
///
/// Finished layouts are listed in `layouts.jsonl` of the folder, from which an interrupted call resumes. A layout of
/// another task, world, seed or settings under the same name is reported and made again. `each` receives the rows in
/// order,
/// as soon as they are finished.
///
/// # Errors
/// When a file cannot be written. A task that cannot be laid out is a row, not an error.
#[expect(clippy::too_many_arguments, reason = "input, settings and seed, what every stage has, and who reads")]
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
    each: &mut (dyn FnMut(&LaidOut) + Send),
) -> Result<Vec<LaidOut>, WorkspaceError> {
    let planner = worlds::planner(world, &PlannerSettings::default())?;
    let resources = Resources::builtin(&planner);
    let attempts = Attempt::all(tasks, count, seed);
    sweep(&output.folder)?;
    let ledger = Ledger::open(&output.folder.join("layouts.jsonl"))?;
    let shared = serde_json::to_string(&(world, settings, env!("CARGO_PKG_VERSION"))).unwrap_or_default();
    progress.begin("laying out", attempts.len());
    let lay_out = |attempt: &Attempt| -> Result<(Entry, LaidOut), WorkspaceError> {
        let key = key(attempt, &shared);
        let known = ledger.known(&attempt.id());
        let row = match known.filter(|entry| entry.key == key).and_then(|entry| finished(attempt, output, entry)) {
            Some(row) => row,
            None => {
                if known.is_some_and(|entry| entry.key != key) {
                    let what = "is made anew: its task, seed, world or settings are not those of before";
                    progress.note(&format!("{} {what}", attempt.id()));
                }
                let row = one(attempt, output, resources, world, settings)?;
                ledger.add(&Entry { name: attempt.id(), key: key.clone(), refused: row.refused.clone() })?;
                row
            }
        };
        progress.advance();
        Ok((Entry { name: attempt.id(), key, refused: row.refused.clone() }, row))
    };
    let (mut entries, mut rows) = (Vec::new(), Vec::new());
    in_parallel_each(&attempts, workers, stop, &lay_out, &mut |(entry, row)| {
        each(&row);
        entries.push(entry);
        rows.push(row);
    })?;
    progress.end();
    ledger.close(entries, |_| true)?;
    Ok(rows)
}

/// Hash of everything that determines a layout.
fn key(attempt: &Attempt, shared: &str) -> String {
    let task = attempt.task.to_json();
    let about = format!("{}\n{}\n{task}\n{shared}", attempt.id(), attempt.seed);
    hexadecimal(&Sha256::digest(about)[..16])
}

/// Row of a layout that is finished; `None` if one of its files is missing.
fn finished(attempt: &Attempt, output: &LayoutOutput, entry: &Entry) -> Option<LaidOut> {
    let path = output.folder.join(format!("{}.json", attempt.id()));
    let picture = path.with_extension("svg");
    let is_there = |path: &PathBuf| files::is_file_no_follow(path);
    let whole = (entry.refused.is_some() || is_there(&path)) && (!output.explain || is_there(&picture));
    whole.then(|| LaidOut {
        task: attempt.task.id.clone(),
        scenario: entry.refused.is_none().then(|| path.display().to_string()),
        refused: entry.refused.clone(),
        picture: output.explain.then(|| picture.display().to_string()),
    })
}

/// Lays out one attempt and writes its scenario, with a diagram if requested.
fn one(
    attempt: &Attempt,
    output: &LayoutOutput,
    resources: Resources,
    world: &World,
    settings: &LayoutSettings,
) -> Result<LaidOut, WorkspaceError> {
    let (task, path) = (attempt.task, output.folder.join(format!("{}.json", attempt.id())));
    let draw = |drawing: &dyn Fn() -> Result<Svg, WorkspaceError>| -> Result<Option<String>, WorkspaceError> {
        let picture = path.with_extension("svg");
        if output.explain {
            documents::write_file(&picture, drawing()?.as_str().as_bytes())?;
        }
        Ok(output.explain.then(|| picture.display().to_string()))
    };
    let id = task.id.clone();
    match attempt.scenario(resources, world, settings) {
        Ok(scenario) => {
            documents::write_file(&path, scenario.to_json().as_bytes())?;
            let picture = draw(&|| scene_images::explained(&scenario, resources.catalogue))?;
            Ok(LaidOut { task: id, scenario: Some(path.display().to_string()), refused: None, picture })
        }
        Err(error) if error.is_defect() => {
            Err(WorkspaceError::broken(format!("laying out {} stopped", attempt.id()), error))
        }
        Err(error) => {
            let picture = draw(&|| scene_images::explained_refusal(task, &error, world, resources.catalogue))?;
            Ok(LaidOut { task: id, scenario: None, refused: Some(error.to_string()), picture })
        }
    }
}

/// The rows as a table. Above [`MAX_ROWS`], unless `each` is true, only their number and the refused ones.
pub fn table(rows: &[LaidOut], each: bool) -> String {
    let line = |row: &LaidOut| {
        vec![row.task.clone(), row.scenario.clone().or_else(|| row.refused.clone()).unwrap_or_default()]
    };
    if each || rows.len() <= MAX_ROWS {
        let head = ["task", "scenario"].map(String::from).to_vec();
        return text_table(&[head].into_iter().chain(rows.iter().map(line)).collect::<Vec<_>>());
    }
    let refused: Vec<Vec<String>> = rows.iter().filter(|row| row.refused.is_some()).map(line).collect();
    let laid_out = rows.len() - refused.len();
    let listed = attention(&["task", "why not"], &refused);
    format!("{laid_out} of {} laid out; each with --each\n{listed}", rows.len())
}

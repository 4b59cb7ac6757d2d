//! `genmanip layout`.

use std::sync::atomic::AtomicBool;

use genmanip_assets::Catalogue;
use genmanip_core::{Document, Seed};
use genmanip_layout::LayoutSettings;
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::{Attempt, Resources, in_parallel};
use serde::Serialize;

use crate::args::LayoutArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::pictures;
use crate::printer::{Printer, table};

#[derive(Serialize)]
struct Row {
    task: String,
    scenario: Option<String>,
    refused: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    picture: Option<String>,
}

pub fn run(arguments: &LayoutArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let tasks = inputs::read_tasks(&arguments.tasks)?;
    let planner = inputs::planner(&PlannerSettings::default())?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner };
    let settings = LayoutSettings { distractors: arguments.distractors, ..LayoutSettings::default() };
    let attempts = Attempt::all(&tasks, arguments.count, Seed::new(arguments.seed));
    let bar = printer.progress("laying out", attempts.len());
    let rows = in_parallel(&attempts, inputs::workers(arguments.workers), &AtomicBool::new(false), &|attempt| {
        let row = lay_out(attempt, arguments, resources, &settings);
        bar.inc(1);
        row
    })?;
    bar.finish_and_clear();
    let mut lines = vec![["task", "scenario"].map(String::from).to_vec()];
    for row in &rows {
        let outcome = row.scenario.clone().or_else(|| row.refused.clone()).unwrap_or_default();
        lines.push(vec![row.task.clone(), outcome]);
    }
    printer.data(&rows, &table(&lines));
    let refused = rows.iter().filter(|row| row.refused.is_some()).count();
    Ok(if refused == 0 { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// One layout, written with its picture when asked.
fn lay_out(
    attempt: &Attempt,
    arguments: &LayoutArguments,
    resources: Resources,
    settings: &LayoutSettings,
) -> Result<Row, Failed> {
    let (task, path) = (attempt.task, arguments.out.join(format!("{}.json", attempt.id())));
    let draw = |drawing: &dyn Fn() -> Result<genmanip_bench::Svg, Failed>| -> Result<Option<String>, Failed> {
        let picture = path.with_extension("svg");
        if arguments.explain {
            inputs::write_file(&picture, drawing()?.as_str().as_bytes())?;
        }
        Ok(arguments.explain.then(|| picture.display().to_string()))
    };
    let id = task.id.clone();
    match attempt.scenario(resources, settings) {
        Ok(scenario) => {
            inputs::write_file(&path, scenario.to_json().as_bytes())?;
            let picture = draw(&|| pictures::explained(&scenario, resources.catalogue))?;
            Ok(Row { task: id, scenario: Some(path.display().to_string()), refused: None, picture })
        }
        Err(error) => {
            let picture = draw(&|| pictures::explained_refusal(task, &error, resources.catalogue))?;
            Ok(Row { task: id, scenario: None, refused: Some(error.to_string()), picture })
        }
    }
}

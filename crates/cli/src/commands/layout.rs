//! `genmanip layout`.

use genmanip_assets::Catalogue;
use genmanip_bench::{graph_svg, layout_svg};
use genmanip_core::{Document, Seed};
use genmanip_layout::LayoutSettings;
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::{Attempt, Resources};
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
}

pub fn run(arguments: &LayoutArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let tasks = inputs::read_tasks(&arguments.tasks)?;
    let planner = inputs::planner(&PlannerSettings::default())?;
    let resources = Resources { catalogue: Catalogue::builtin(), planner: &planner };
    let settings = LayoutSettings::default();
    let attempts = Attempt::all(&tasks, arguments.count, Seed::new(arguments.seed));
    let bar = printer.progress("laying out", attempts.len());
    let mut rows = Vec::new();
    for attempt in &attempts {
        let path = arguments.out.join(format!("{}.json", attempt.id()));
        rows.push(match attempt.scenario(resources, &settings) {
            Ok(scenario) => {
                inputs::write_file(&path, scenario.to_json().as_bytes())?;
                if arguments.explain {
                    let layout = layout_svg(&pictures::layout_picture(&scenario, resources.catalogue)?);
                    inputs::write_file(&path.with_extension("layout.svg"), layout.as_str().as_bytes())?;
                    let graph = graph_svg(&scenario.task);
                    inputs::write_file(&path.with_extension("graph.svg"), graph.as_str().as_bytes())?;
                }
                Row { task: attempt.task.id.clone(), scenario: Some(path.display().to_string()), refused: None }
            }
            Err(error) => Row { task: attempt.task.id.clone(), scenario: None, refused: Some(error.to_string()) },
        });
        bar.inc(1);
    }
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

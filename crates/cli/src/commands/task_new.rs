//! `genmanip task new`.

use genmanip_assets::Catalogue;
use genmanip_core::{Document, Seed, Task, TaskKind};
use genmanip_scene::designer::{DesignSettings, design_each};
use serde::Serialize;

use crate::args::NewArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::{Printer, table};

#[derive(Serialize)]
struct Row {
    task: String,
    kind: &'static str,
    instruction: String,
    file: String,
}

pub fn run(arguments: &NewArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let kinds = match arguments.kind.as_str() {
        "all" => TaskKind::ALL.to_vec(),
        name => vec![inputs::task_kind(name)?],
    };
    match arguments.designer.as_str() {
        "rules" => by_rules(arguments, &kinds, printer),
        other => Err(Failed::new(format!("there is no designer `{other}`")).hint("expected rules")),
    }
}

fn by_rules(arguments: &NewArguments, kinds: &[TaskKind], printer: &Printer) -> Result<ExitStatus, Failed> {
    let cards = Catalogue::builtin().cards();
    let bar = printer.progress("designing", arguments.count);
    let settings = DesignSettings::default();
    let seed = Seed::new(arguments.seed);
    let batch = design_each(kinds, arguments.count, cards, seed, &settings, &mut |_| bar.inc(1));
    bar.finish_and_clear();
    let batch = batch.map_err(|error| Failed::because("the designer gave up", &error))?;
    let rows = batch.tasks.iter().map(|task| write(task, arguments)).collect::<Result<Vec<_>, _>>()?;
    printer.data(&rows, &in_words(&rows));
    Ok(ExitStatus::Done)
}

fn write(task: &Task, arguments: &NewArguments) -> Result<Row, Failed> {
    let path = arguments.out.join(format!("{}.json", task.id));
    inputs::write_file(&path, task.to_json().as_bytes())?;
    Ok(Row {
        task: task.id.clone(),
        kind: task.kind.name(),
        instruction: task.instruction.clone(),
        file: path.display().to_string(),
    })
}

fn in_words(rows: &[Row]) -> String {
    let mut lines = vec![["task", "instruction"].map(String::from).to_vec()];
    lines.extend(rows.iter().map(|row| vec![row.task.clone(), row.instruction.clone()]));
    table(&lines)
}

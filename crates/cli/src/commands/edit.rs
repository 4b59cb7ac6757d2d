//! `genmanip edit`: operations on a scenario, their history, its verdict and repairs.

use std::path::Path;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use genmanip_assets::Catalogue;
use genmanip_core::limits;
use genmanip_studio::edit::{Applied, Command, EditError, EditedScenario, Operation, Stamp};
use genmanip_studio::verdict::{Equipment, Inspection, Problem, Verdict, VerdictError, repair_all};
use genmanip_terminal::{ExitStatus, Failed, Printer};
use genmanip_workspace::{documents, text_table};
use serde_json::{Value, json};

use crate::args::EditArguments;

pub fn run(arguments: &EditArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let operations = arguments.op.iter().map(|text| operation(text)).collect::<Result<Vec<_>, _>>()?;
    let assets = Catalogue::all();
    let mut document = match &arguments.copy_to {
        Some(folder) => EditedScenario::copy_into(&arguments.scenario, folder, assets),
        None => EditedScenario::open(&arguments.scenario, assets),
    }
    .map_err(failed)?;
    let mut stamps = Stamps { author: &arguments.author, number: 0 };
    let mut lines = Vec::new();
    if arguments.copy_to.is_some() {
        lines.push(format!("copied to {}", document.path().display()));
    }
    for operation in operations {
        let base_revision = document.revision();
        let command = Command { operation, base_revision, stamp: stamps.next() };
        let applied = document.apply(&command).map_err(failed)?;
        lines.push(format!("revision {}: {}", applied.revision, name(&command.operation)));
    }
    let told = |applied: Applied, what: &str| format!("revision {}: {what}", applied.revision);
    if arguments.undo {
        lines.push(told(document.undo(&stamps.next()).map_err(failed)?, "undone"));
    }
    if arguments.redo {
        lines.push(told(document.redo(&stamps.next()).map_err(failed)?, "redone"));
    }
    if let Some(revision) = arguments.revert {
        let applied = document.revert(revision, &stamps.next()).map_err(failed)?;
        lines.push(told(applied, &format!("revision {revision} reverted")));
    }
    let mut repairs = Vec::new();
    if arguments.repair {
        let equipment = Equipment::of_world(&document.scenario().world)?;
        let repaired = repair_all(Arc::clone(document.scenario()), &equipment).map_err(undecided)?;
        for repair in repaired.repairs {
            let command = Command {
                operation: repair.operation.clone(),
                base_revision: document.revision(),
                stamp: stamps.next(),
            };
            let applied = document.apply(&command).map_err(failed)?;
            lines.push(told(applied, &repair.label));
            repairs.push(json!({"label": repair.label, "operation": repair.operation}));
        }
        lines.extend(repaired.left.iter().map(|problem| format!("not repaired: {}", problem.message)));
    }
    if let Some(name) = &arguments.snapshot {
        document.snapshot(name, &stamps.next()).map_err(failed)?;
        lines.push(format!("revision {} is `{name}`", document.revision()));
    }
    let mut answer = json!({"scenario": document.path(), "revision": document.revision()});
    if arguments.repair {
        answer["repairs"] = repairs.into();
    }
    if arguments.history {
        answer["history"] = json!(document.history().collect::<Vec<_>>());
        answer["snapshots"] = json!(document.snapshots());
        lines.push(history(&document));
    }
    if let Some((before, after)) = arguments.difference {
        let difference = json!(document.difference(before, after).map_err(failed)?);
        lines.push(serde_json::to_string_pretty(&difference).unwrap_or_default());
        answer["difference"] = difference;
    }
    let mut status = ExitStatus::Done;
    if arguments.verdict {
        let verdict = verdict(&document)?;
        if verdict.blocking().next().is_some() {
            status = ExitStatus::NotMet;
        }
        lines.push(problems(&verdict.problems));
        answer["verdict"] = json!(verdict);
    }
    printer.data(&answer, &lines.iter().map(|line| format!("{}\n", line.trim_end())).collect::<String>());
    Ok(status)
}

/// Operation from a JSON text, or from a file if the text begins with `@`.
fn operation(text: &str) -> Result<Operation, Failed> {
    let hint = r#"an operation is {"op": "place", "args": {…}}; docs/formats/edits.md lists them"#;
    let read = |text: &str| {
        let value: Value =
            genmanip_core::json::parse(text).map_err(|error| Failed::new(format!("--op: {error}")).hint(hint))?;
        serde_json::from_value(value).map_err(|error| Failed::new(format!("--op: {error}")).hint(hint))
    };
    match text.strip_prefix('@') {
        Some(file) => read(&documents::read_text(Path::new(file), limits::TASK)?),
        None => read(text),
    }
}

/// Generator of author, time and operation id for each command of this call.
struct Stamps<'a> {
    author: &'a str,
    number: usize,
}

impl Stamps<'_> {
    fn next(&mut self) -> Stamp {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        self.number += 1;
        Stamp {
            client_operation_id: format!("cli-{}-{}-{}", std::process::id(), now.as_nanos(), self.number),
            author: self.author.to_owned(),
            at: genmanip_terminal::rfc3339(now.as_secs()),
        }
    }
}

fn verdict(document: &EditedScenario) -> Result<Verdict, Failed> {
    let equipment = Equipment::of_world(&document.scenario().world)?;
    let mut inspection = Inspection::new(Arc::clone(document.scenario()), &equipment);
    let mut verdict = inspection.verdict(document.revision()).map_err(undecided)?;
    for problem in &mut verdict.problems {
        problem.repairs = inspection.repairs(problem).map_err(undecided)?;
    }
    Ok(verdict)
}

fn problems(problems: &[Problem]) -> String {
    if problems.is_empty() {
        return "no problems".into();
    }
    let mut text = String::new();
    for problem in problems {
        let mark = if problem.blocking { "" } else { " (not blocking)" };
        text += &format!("{}: {}{mark}\n", problem.code.name(), problem.message);
        for repair in &problem.repairs {
            text += &format!("    {}\n", repair.label);
        }
    }
    text
}

fn history(document: &EditedScenario) -> String {
    let mut rows = vec![["revision", "author", "at", "command"].map(String::from).to_vec()];
    for line in document.history() {
        let what = match (line.undoes, line.redoes) {
            (Some(revision), _) => format!("undo of {revision}"),
            (None, Some(revision)) => format!("redo of {revision}"),
            (None, None) => name(&line.operation),
        };
        rows.push(vec![line.revision.to_string(), line.stamp.author.clone(), line.stamp.at.clone(), what]);
    }
    text_table(&rows)
}

/// Name of an operation, as in files: the value of `op`.
fn name(operation: &Operation) -> String {
    let value = json!(operation);
    value["op"].as_str().unwrap_or_default().to_owned()
}

fn failed(error: EditError) -> Failed {
    let hint = error.hint();
    match error {
        EditError::File(error) => error.into(),
        EditError::Conflict(conflict) => {
            Failed::new(format!("`{}` was changed in revision {}", conflict.field, conflict.revision)).hint(hint)
        }
        EditError::ReadOnly { .. } => Failed::new(error.to_string()).hint("edit a copy: --copy-to FOLDER"),
        error if hint.is_empty() => Failed::new(error.to_string()),
        error => Failed::new(error.to_string()).hint(hint),
    }
}

fn undecided(error: VerdictError) -> Failed {
    Failed::because("the scenario cannot be judged", &error)
}

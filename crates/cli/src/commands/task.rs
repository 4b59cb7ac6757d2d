//! `genmanip task check|show`.

use genmanip_core::{Document, Task, limits};
use genmanip_run::inputs;
use genmanip_scene::answer::{AnswerReport, Verdict};
use serde::Serialize;
use serde_json::Value;

use crate::args::{CheckArguments, ShowArguments};
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

#[derive(Serialize)]
struct Checked {
    file: String,
    #[serde(flatten)]
    report: CheckedReport,
}

/// The contract of `task check --json`: flaws by their names, details beside them.
#[derive(Serialize)]
struct CheckedReport {
    verdict: &'static str,
    flaws: Vec<String>,
    repairs: Vec<String>,
    details: Vec<Detail>,
    /// A task document, as a file of its own would hold it.
    task: Option<Value>,
}

#[derive(Serialize)]
struct Detail {
    flaw: String,
    path: String,
    message: String,
    hint: String,
}

pub fn check(arguments: &CheckArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let mut checked = Vec::new();
    for file in inputs::expand(&arguments.files)? {
        let report = if arguments.objects.is_empty() {
            inputs::check_recorded(&file, &inputs::read_text(&file, limits::TASK)?)?
        } else {
            let world = arguments.world.as_deref();
            inputs::check_bare(&file, &arguments.objects, world, &arguments.kind, arguments.min_objects)?
        };
        checked.push(Checked { file: file.display().to_string(), report: CheckedReport::from(report) });
    }
    let text: String = checked.iter().map(describe).collect();
    printer.data(&checked, &text);
    let rejected = checked.iter().filter(|checked| checked.report.verdict == Verdict::Rejected.name()).count();
    if rejected > 0 {
        printer.say(format!("{rejected} of {} rejected", checked.len()));
        return Ok(ExitStatus::NotMet);
    }
    Ok(ExitStatus::Done)
}

impl From<AnswerReport> for CheckedReport {
    fn from(report: AnswerReport) -> Self {
        Self {
            verdict: report.verdict.name(),
            flaws: report.flaws.iter().map(|flaw| flaw.kind.name()).collect(),
            repairs: report.repairs.iter().map(|repair| repair.what.clone()).collect(),
            details: report
                .flaws
                .iter()
                .map(|flaw| Detail {
                    flaw: flaw.kind.name(),
                    path: flaw.path.clone(),
                    message: flaw.message.clone(),
                    hint: flaw.hint.clone(),
                })
                .collect(),
            task: report.task.as_ref().map(Document::to_value),
        }
    }
}

fn describe(checked: &Checked) -> String {
    let report = &checked.report;
    let mut text = format!("{:8}  {}\n", report.verdict, checked.file);
    for detail in &report.details {
        text += &format!("          {} at {}: {}\n", detail.flaw, detail.path, detail.message);
        if report.verdict == Verdict::Rejected.name() && !detail.hint.is_empty() {
            text += &format!("          hint: {}\n", detail.hint);
        }
    }
    for repair in &report.repairs {
        text += &format!("          repaired: {repair}\n");
    }
    text
}

pub fn show(arguments: &ShowArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let task = inputs::read_task(&arguments.file)?;
    if let Some(path) = &arguments.svg {
        inputs::write_file(path, genmanip_bench::graph_svg(&task).as_str().as_bytes())?;
        printer.say(format!("wrote {}", path.display()));
    }
    printer.data(&task.to_value(), &in_words(&task));
    Ok(ExitStatus::Done)
}

fn in_words(task: &Task) -> String {
    let name = |id: &str| task.name_of(id);
    let mut text = format!("{} ({})\n  {}\n\ngoal\n", task.id, task.kind.name(), task.instruction);
    for (index, atoms) in task.goal.alternatives.iter().enumerate() {
        let atoms: Vec<String> = atoms.iter().map(|atom| with_names(atom, &name)).collect();
        text += &format!("  {}{}\n", if index == 0 { "   " } else { "or " }, atoms.join(" and "));
    }
    text += "\nscene\n";
    for edge in &task.scene_graph.edges {
        text += &format!("  {}\n", with_names(&edge.atom(), &name));
    }
    for node in &task.scene_graph.nodes {
        let state = node.state.as_ref().map(|state| format!(", {state}")).unwrap_or_default();
        text += &format!("  {} {}{state}\n", node.id, name(&node.id));
    }
    text
}

fn with_names(atom: &genmanip_core::Atom, name: &dyn Fn(&str) -> String) -> String {
    use genmanip_core::Atom;
    match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.as_ref().map(|id| format!(" and {}", name(id))).unwrap_or_default();
            format!("{} {} {}{second}", name(subject), relation.name(), name(reference))
        }
        Atom::State { object, state } => format!("{} is {state}", name(object)),
    }
}

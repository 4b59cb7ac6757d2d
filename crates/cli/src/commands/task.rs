//! `genmanip task check|show`: validation and display of tasks.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use genmanip_core::{Document, ReferenceId, Task};
use genmanip_tasks::answer::Verdict;
use genmanip_workspace::MAX_ROWS;
use genmanip_workspace::difference::listed;
use genmanip_workspace::documents;
use genmanip_workspace::task_checks::{self, BareAnswers, FileCheck};
use genmanip_workspace::task_files;
use serde_json::Value;

use crate::args::{CheckArguments, ShowArguments};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn check(arguments: &CheckArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let bare = arguments.objects.as_deref().map(|objects| BareAnswers {
        objects,
        world: arguments.world.as_deref(),
        kind: &arguments.kind,
        min_objects: arguments.min_objects,
    });
    let mut list = printer.list();
    let (mut verdicts, mut flaws): (BTreeMap<&str, usize>, BTreeMap<String, usize>) = Default::default();
    let mut task = None;
    let (mut lines, mut ids) = (Vec::new(), BTreeMap::<String, usize>::new());
    task_checks::check_each(&arguments.files, bare, &mut |checked| {
        *verdicts.entry(checked.verdict).or_default() += 1;
        let own: BTreeSet<&String> = checked.flaws.iter().collect();
        own.into_iter().for_each(|flaw| *flaws.entry(flaw.clone()).or_default() += 1);
        lines.push((checked.verdict == Verdict::Valid.name(), describe(&checked)));
        if let Some(id) = checked.task.as_ref().and_then(|task| task["id"].as_str()) {
            *ids.entry(id.to_owned()).or_default() += 1;
        }
        list.add(&checked);
        task = checked.task;
    })?;
    let count = lines.len();
    if let Some(path) = &arguments.out {
        write_checked(path, task, count)?;
    }
    let is_long = count > MAX_ROWS && !arguments.each;
    let mut text: String =
        lines.iter().filter(|(is_valid, _)| !(is_long && *is_valid)).map(|(_, line)| &**line).collect();
    if count > 1 {
        let counts = |counts: &mut dyn Iterator<Item = (&str, usize)>| {
            counts.map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
        };
        let hidden = if is_long { "; valid ones are left out here, --each prints all" } else { "" };
        text += &format!(
            "{count} checked: {}{hidden}\n",
            counts(&mut verdicts.iter().map(|(&name, &count)| (name, count)))
        );
        if !flaws.is_empty() {
            let named = counts(&mut flaws.iter().map(|(name, &count)| (name.as_str(), count)));
            text += &format!("with each flaw: {named}\n");
        }
        text += &shared_ids(&ids);
    }
    list.end(&text);
    let rejected = verdicts.get(Verdict::Rejected.name()).copied().unwrap_or_default();
    if rejected > 0 {
        printer.say(format!("{rejected} of {count} rejected"));
        return Ok(ExitStatus::NotMet);
    }
    Ok(ExitStatus::Done)
}

/// Writes the checked task, which must be the only one; does nothing if it was rejected.
fn write_checked(path: &Path, task: Option<Value>, count: usize) -> Result<(), Failed> {
    if count != 1 {
        return Err(Failed::new(format!("--out writes one task, and {count} were checked"))
            .hint("name one answer or task document"));
    }
    let Some(task) = task else { return Ok(()) };
    let task = Task::from_value(task).map_err(|error| Failed::because("the checked task cannot be written", &error))?;
    Ok(documents::write_file(path, task.to_json().as_bytes())?)
}

/// Note on ids shared by several tasks, which other subcommands refuse; empty if all are unique.
fn shared_ids(ids: &BTreeMap<String, usize>) -> String {
    let shared = ids.iter().filter(|(_, count)| **count > 1);
    let shared: Vec<String> = shared.map(|(id, _)| format!("`{id}`")).collect();
    if shared.is_empty() {
        return String::new();
    }
    format!("note: several tasks are called {}: `collect` and `layout` refuse them together\n", listed(&shared))
}

fn describe(checked: &FileCheck) -> String {
    let mut text = format!("{:8}  {}\n", checked.verdict, checked.file);
    for detail in &checked.details {
        text += &format!("          {} at {}: {}\n", detail.flaw, detail.path, detail.message);
        if checked.is_rejected() && !detail.hint.is_empty() {
            text += &format!("          hint: {}\n", detail.hint);
        }
    }
    for repair in &checked.repairs {
        text += &format!("          repaired: {repair}\n");
    }
    text
}

pub fn show(arguments: &ShowArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let task = task_files::read_task(&arguments.file)?;
    if let Some(path) = &arguments.svg {
        documents::write_file(path, genmanip_viz::graph_svg(&task).as_str().as_bytes())?;
        printer.say(format!("wrote {}", path.display()));
    }
    printer.data(&task.to_value(), &describe_task(&task));
    Ok(ExitStatus::Done)
}

fn describe_task(task: &Task) -> String {
    let name = |id: &ReferenceId| task.name_of(id);
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

fn with_names(atom: &genmanip_core::Atom, name: &dyn Fn(&ReferenceId) -> String) -> String {
    use genmanip_core::Atom;
    match atom {
        Atom::Relation { subject, relation, reference, second_reference } => {
            let second = second_reference.as_ref().map(|id| format!(" and {}", name(id))).unwrap_or_default();
            format!("{} {} {}{second}", name(subject), relation.name(), name(reference))
        }
        Atom::State { object, state } => format!("{} is {state}", name(object)),
    }
}

//! `genmanip suite`.

use std::path::Path;

use genmanip_core::Seed;
use genmanip_run::inputs;
use genmanip_run::suites::{self, BuildOptions, PerturbOptions};

use crate::args::{SuiteBuildArguments, SuiteCommand, SuitePerturbArguments, SuiteReviewArguments};
use crate::commands::assets::catalogue;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(command: &SuiteCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        SuiteCommand::Build(arguments) => return build(arguments, printer),
        SuiteCommand::Perturb(arguments) => return perturb(arguments, printer),
        SuiteCommand::Check(arguments) => {
            let checked = suites::check(&arguments.folder)?;
            printer.data(&checked, &suites::check_in_words(&checked));
            if !checked.faults.is_empty() {
                return Ok(ExitStatus::NotMet);
            }
        }
        SuiteCommand::Review(arguments) => {
            let SuiteReviewArguments { folder, scenario, reviewer, verdict, note } = arguments;
            let file = suites::review(folder, scenario, reviewer, *verdict, note)?;
            printer.data(&file, &suites::review_in_words(&file));
        }
        SuiteCommand::Diff(arguments) => {
            let difference = suites::diff(&arguments.first, &arguments.second)?;
            printer.data(&difference, &suites::diff_in_words(&difference));
        }
        SuiteCommand::Show(arguments) => return show(&arguments.folder, printer),
    }
    Ok(ExitStatus::Done)
}

fn build(arguments: &SuiteBuildArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let options = BuildOptions {
        name: arguments.name.clone().unwrap_or_else(|| inputs::stem(&arguments.out)),
        out: arguments.out.clone(),
        per_kind: arguments.per_kind,
        candidates: arguments.candidates,
        seed: Seed::new(arguments.seed),
        catalogue: catalogue(&arguments.catalog.catalog),
        tasks: match arguments.tasks.as_slice() {
            [] => Vec::new(),
            paths => inputs::read_tasks(paths)?,
        },
        world: inputs::read_world(None)?,
        workers: inputs::workers(arguments.workers),
    };
    let stop = crate::stop::on_interrupt();
    match suites::build(&options, printer, &stop)? {
        Some(_) => show(&arguments.out, printer),
        None => Ok(ExitStatus::NotMet),
    }
}

fn perturb(arguments: &SuitePerturbArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let options = PerturbOptions {
        suite: arguments.folder.clone(),
        out: arguments.out.clone(),
        name: arguments.name.clone().unwrap_or_else(|| inputs::stem(&arguments.out)),
        axis: arguments.axis,
        dial: arguments.dial,
        seed: Seed::new(arguments.seed),
        workers: inputs::workers(arguments.workers),
    };
    let stop = crate::stop::on_interrupt();
    match suites::perturb(&options, printer, &stop)? {
        Some(_) => show(&arguments.out, printer),
        None => Ok(ExitStatus::NotMet),
    }
}

fn show(folder: &Path, printer: &Printer) -> Result<ExitStatus, Failed> {
    let shown = suites::show(folder)?;
    printer.data(&shown, &suites::show_in_words(&shown));
    Ok(ExitStatus::Done)
}

//! `genmanip suite`: build, perturb, review, check, freeze, show and compare suites, and design training tasks for
//! them.

use std::path::Path;

use genmanip_benchmark::distributions;
use genmanip_benchmark::suites::{self, TrainingOptions};
use genmanip_core::Seed;
use genmanip_pipeline::suites::{self as suite_steps, BuildOptions, PerturbOptions};
use genmanip_workspace::documents;
use genmanip_workspace::task_files;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;

use crate::args::{
    SuiteBuildArguments, SuiteCommand, SuitePerturbArguments, SuiteReviewArguments, SuiteTrainArguments,
};
use crate::commands::assets::catalogue;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(command: &SuiteCommand, printer: &Printer) -> Result<ExitStatus, Failed> {
    match command {
        SuiteCommand::Build(arguments) => return build(arguments, printer),
        SuiteCommand::Perturb(arguments) => return perturb(arguments, printer),
        SuiteCommand::Train(arguments) => return train(arguments, printer),
        SuiteCommand::Check(arguments) => {
            return check(&arguments.work.folder, arguments.all, arguments.work.workers, printer);
        }
        SuiteCommand::Review(arguments) => {
            let SuiteReviewArguments { folder, scenario, reviewer, verdict, note } = arguments;
            let file = suites::review(folder, scenario, reviewer, *verdict, note)?;
            printer.data(&file, &suites::describe_review(&file));
        }
        SuiteCommand::Diff(arguments) => {
            let difference = suites::diff(&arguments.first, &arguments.second)?;
            printer.data(&difference, &suites::describe_diff(&difference));
        }
        SuiteCommand::Freeze(arguments) => {
            let folder = &arguments.work.folder;
            let (workers, stop) = (workers::workers(arguments.work.workers), genmanip_terminal::on_interrupt());
            if distributions::is_of_distributions(folder) {
                if arguments.images {
                    return Err(Failed::new(format!("{} has no images to hash", folder.display()))
                        .hint("omit --images: of task distributions, layouts are frozen"));
                }
                return match distributions::freeze(folder, workers, printer, &stop)? {
                    Some(()) => show(folder, printer),
                    None => Ok(ExitStatus::NotMet),
                };
            }
            let freeze = if arguments.images { suites::freeze_images } else { suites::freeze };
            return match freeze(folder, workers, printer, &stop)? {
                Some(_) => show(folder, printer),
                None => Ok(ExitStatus::NotMet),
            };
        }
        SuiteCommand::Show(arguments) => return show(&arguments.folder, printer),
    }
    Ok(ExitStatus::Done)
}

fn build(arguments: &SuiteBuildArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let options = BuildOptions {
        name: arguments.name.clone().unwrap_or_else(|| documents::stem(&arguments.out)),
        out: arguments.out.clone(),
        per_kind: arguments.per_kind,
        candidates: arguments.candidates,
        seed: Seed::new(arguments.seed),
        catalogue: catalogue(&arguments.catalog.catalog),
        tasks: match arguments.tasks.as_slice() {
            [] => Vec::new(),
            paths => task_files::read_tasks(paths)?,
        },
        world: worlds::read_world(None)?,
        workers: workers::workers(arguments.workers),
    };
    let stop = genmanip_terminal::on_interrupt();
    match suite_steps::build(&options, printer, &stop)? {
        Some(_) => show(&arguments.out, printer),
        None => Ok(ExitStatus::NotMet),
    }
}

fn perturb(arguments: &SuitePerturbArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let options = PerturbOptions {
        suite: arguments.folder.clone(),
        out: arguments.out.clone(),
        name: arguments.name.clone().unwrap_or_else(|| documents::stem(&arguments.out)),
        axis: arguments.axis,
        dial: arguments.dial,
        seed: Seed::new(arguments.seed),
        workers: workers::workers(arguments.workers),
    };
    let stop = genmanip_terminal::on_interrupt();
    match suite_steps::perturb(&options, printer, &stop)? {
        Some(_) => show(&arguments.out, printer),
        None => Ok(ExitStatus::NotMet),
    }
}

fn train(arguments: &SuiteTrainArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let Some(out) = &arguments.out else {
        let shared = suites::shared(&arguments.folder, &arguments.check)?;
        let words = match shared.as_slice() {
            [] => "nothing is shared with the suite\n".to_owned(),
            lines => lines.iter().map(|line| format!("{line}\n")).collect(),
        };
        printer.data(&shared, &words);
        return Ok(if shared.is_empty() { ExitStatus::Done } else { ExitStatus::NotMet });
    };
    let options = TrainingOptions {
        suite: arguments.folder.clone(),
        out: out.clone(),
        per_kind: arguments.per_kind,
        seed: Seed::new(arguments.seed),
    };
    let training = suites::training(&options, printer)?;
    let tasks: usize = training.funnel.passed.values().sum();
    let left_out: usize = training.funnel.refused.values().sum();
    let words =
        format!("{tasks} tasks in {}, {left_out} left out; nothing is shared with {}\n", out.display(), training.suite);
    printer.data(&training, &words);
    Ok(ExitStatus::Done)
}

fn check(folder: &Path, all: bool, workers: Option<usize>, printer: &Printer) -> Result<ExitStatus, Failed> {
    let (workers, stop) = (workers::workers(workers), genmanip_terminal::on_interrupt());
    let is_sound = if distributions::is_of_distributions(folder) {
        distributions::check(folder, all, workers, printer, &stop)?.map(|checked| {
            printer.data(&checked, &distributions::describe_check(&checked));
            checked.faults.is_empty()
        })
    } else {
        suites::check(folder, workers, printer, &stop)?.map(|checked| {
            printer.data(&checked, &suites::describe_check(&checked));
            checked.faults.is_empty()
        })
    };
    Ok(if is_sound == Some(true) { ExitStatus::Done } else { ExitStatus::NotMet })
}

fn show(folder: &Path, printer: &Printer) -> Result<ExitStatus, Failed> {
    if distributions::is_of_distributions(folder) {
        let shown = distributions::show(folder)?;
        printer.data(&shown, &distributions::describe_distributions(&shown));
        return Ok(ExitStatus::Done);
    }
    let shown = suites::show(folder)?;
    printer.data(&shown, &suites::describe_suite(&shown));
    Ok(ExitStatus::Done)
}

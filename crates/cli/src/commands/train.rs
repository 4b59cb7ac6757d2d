//! `genmanip train`: a policy from demonstrations.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use genmanip_benchmark::distributions::is_of_distributions;
use genmanip_core::Seed;
use genmanip_pipeline::learn::{
    CheckOptions, Length, SuiteDemonstrations, TrainOptions, Trained, check, demonstrate, train,
};
use genmanip_workspace::workers;

use crate::args::TrainArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &TrainArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let preset = arguments.preset;
    let (workers, stop) = (workers::workers(arguments.workers), genmanip_terminal::on_interrupt());
    let Some(out) = &arguments.out else {
        let options = CheckOptions { run: arguments.source.clone(), preset, demonstrations: arguments.count, workers };
        let Some(checked) = check(&options, printer, &stop)? else { return Ok(ExitStatus::NotMet) };
        let is_met = checked.replay_success.value >= checked.expected;
        let text = format!(
            "recorded rows as a learned policy's output solve {} of their layouts; expected at least {:.0} %\n",
            checked.replay_success,
            100.0 * checked.expected
        );
        printer.data(&checked, &text);
        return Ok(if is_met { ExitStatus::Done } else { ExitStatus::NotMet });
    };
    let interrupted = || {
        printer.say("interrupted; start the same call again to continue");
        Ok(ExitStatus::NotMet)
    };
    let Some(run) = demonstrations(arguments, out, printer, &stop)? else { return interrupted() };
    let length = match (arguments.steps, arguments.budget) {
        (_, Some(budget)) => Length::BudgetS(budget),
        (steps, None) => Length::Steps(steps.unwrap_or(1) as u64),
    };
    let options = TrainOptions {
        run,
        sources: arguments.sources.names.clone(),
        preset,
        head: arguments.head,
        length,
        seed: Seed::new(arguments.seed),
        labels: !arguments.no_labels,
        out: out.clone(),
        threads: workers,
    };
    let Some(trained) = train(&options, printer, &stop)? else { return interrupted() };
    printer.data(&trained, &describe(&trained));
    Ok(ExitStatus::Done)
}

/// Folder of the run to train on. If a suite is named, missing demonstrations are collected into it first. `None` if
/// interrupted.
fn demonstrations(
    arguments: &TrainArguments,
    out: &Path,
    printer: &Printer,
    stop: &AtomicBool,
) -> Result<Option<PathBuf>, Failed> {
    let TrainArguments { source, demos, distribution, .. } = arguments;
    let name = source.file_name().unwrap_or_default().display();
    match (is_of_distributions(source), *demos) {
        (false, None) => Ok(Some(source.clone())),
        (false, Some(_)) => Err(Failed::new(format!("{name} is no suite of task distributions")).hint(
            "--demos collects demonstrations of a suite such as genmanip-learn-10; a run is learned from as it is",
        )),
        (true, None) => Err(Failed::new(format!("{name} is a suite: how many demonstrations?"))
            .hint("add --demos 300, and --distribution NAME to learn a single one")),
        (true, Some(count)) => {
            let mut run = out.file_name().unwrap_or_default().to_owned();
            run.push("-demonstrations");
            let run = out.with_file_name(run);
            let (suite, distribution) = (source.clone(), distribution.clone());
            let workers = workers::workers(arguments.workers);
            let options = SuiteDemonstrations { suite, distribution, count, run: run.clone(), workers };
            Ok(demonstrate(&options, printer, stop)?.then_some(run))
        }
    }
}

fn describe(trained: &Trained) -> String {
    let Trained { policy, demonstrations, rows, samples, steps, parameters, final_l1, .. } = trained;
    let folder = policy.display();
    let privileged = match (trained.privileged, trained.labels) {
        (true, _) => ", privileged: it reads simulator truth",
        (false, true) => ", trained with simulator labels",
        (false, false) => "",
    };
    format!(
        "{folder}: {parameters} parameters{privileged}\n\
         {demonstrations} demonstrations of {rows} rows, {steps} steps, {samples} samples; L1 {final_l1:.4}\n\
         evaluate it: genmanip evaluate SCENARIOS --policy learned:{folder}\n"
    )
}

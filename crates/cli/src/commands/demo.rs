//! `genmanip demo`: the whole loop on the recorded answers that come with the program.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use genmanip_core::Task;

use crate::args::{CollectArguments, DemoArguments, EvaluateArguments, ReportArguments};
use crate::commands::{collect, evaluate, report};
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::Printer;

pub fn run(arguments: &DemoArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let started = Instant::now();
    let stop = crate::stop::on_interrupt();
    printer.say("1/4  tasks: checking recorded language-model answers");
    let tasks = tasks(arguments)?;
    printer.say(format!("     {} valid tasks", tasks.len()));

    printer.say("2/4  layouts and demonstrations: every attempt on a layout of its own");
    let collecting = CollectArguments {
        tasks: Vec::new(),
        out: arguments.out.clone(),
        episodes: arguments.episodes,
        seed: arguments.seed,
        workers: arguments.workers,
        fps: arguments.fps,
        no_dataset: false,
        keep_failed: false,
    };
    let collected = collect::collect_run(&collecting, tasks, printer, &stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(ExitStatus::NotMet);
    }

    printer.say("3/4  evaluation on the same scenarios: expert, replay, do nothing");
    let evaluating =
        EvaluateArguments { run: arguments.out.clone(), policies: Vec::new(), workers: arguments.workers };
    let reports = evaluate::evaluate_run(&evaluating, printer, &stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(ExitStatus::NotMet);
    }

    printer.say("4/4  report");
    let page = report::write(&ReportArguments { run: arguments.out.clone(), out: None }, printer)?;

    let text = format!(
        "{}\n{}\nepisodes    {}\ndataset     {}\nevaluation  {}\nreport      {}\n\n{:.0} s in all\n",
        collected.text(),
        evaluate::summary(&reports),
        collected.folder.join("episodes").display(),
        collected.folder.join("dataset").display(),
        collected.folder.join("evaluation").display(),
        page.display(),
        started.elapsed().as_secs_f64(),
    );
    printer.data(&collected.rows, &text);
    Ok(collected.status())
}

fn tasks(arguments: &DemoArguments) -> Result<Vec<Task>, Failed> {
    if !arguments.tasks.is_empty() {
        return inputs::read_tasks(&arguments.tasks);
    }
    let examples = PathBuf::from("examples/tasks");
    if !examples.is_dir() {
        return Err(Failed::new("examples/tasks is not here")
            .hint("run the demo in the project's folder, or name tasks with --tasks"));
    }
    inputs::read_tasks(&[examples])
}

//! `genmanip demo`: all steps from recorded model answers to an evaluation, with the answers that come with the
//! program.

use genmanip_workspace::task_files;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use genmanip_core::Seed;
use genmanip_pipeline::PolicyFactory;
use genmanip_pipeline::Run;
use genmanip_pipeline::collect::CollectOptions;
use genmanip_pipeline::evaluate::{self, EvaluateOptions, Suite, evaluate};
use genmanip_rollout::collect::PipelineSettings;
use genmanip_rollout::images::ImageSettings;
use genmanip_workspace::task_spool::Tasks;

use crate::args::DemoArguments;
use crate::commands::{collect, report};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &DemoArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let (started, out) = (Instant::now(), &arguments.out);
    let stop = genmanip_terminal::on_interrupt();
    printer.say("1/4  tasks: checking recorded language-model answers");
    let tasks = tasks(arguments)?;
    printer.say(format!("     {} valid tasks", tasks.entries().len()));

    printer.say("2/4  layouts and demonstrations: every attempt on a layout of its own");
    let images = Some(ImageSettings { fps: arguments.rate, ..ImageSettings::default() });
    let settings = PipelineSettings { images, ..PipelineSettings::in_world(worlds::read_world(None)?) };
    let run = Run::new(tasks, arguments.episodes, settings, Seed::new(arguments.seed));
    let options = CollectOptions { workers: workers::workers(arguments.workers), ..CollectOptions::default() };
    let collected = collect::collect_run(out, run, options, printer, &stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(ExitStatus::NotMet);
    }

    printer.say("3/4  evaluation on the same scenarios: expert, replay, do nothing");
    let workers = workers::workers(arguments.workers);
    let options = EvaluateOptions { out: Some(out.clone()), workers, ..EvaluateOptions::default() };
    let reports = evaluate(&Suite::of_run(out)?, &PolicyFactory::all(true)?, &options, printer, &stop)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(ExitStatus::NotMet);
    }

    printer.say("4/4  report");
    let page = report::write(out, None, None, printer)?;

    let text = format!(
        "{}\n{}\nepisodes    {}\ndataset     {}\nevaluation  {}\nreport      {}\n\n{:.0} s in all\n",
        collected.table(false),
        evaluate::table(&reports),
        out.join("episodes").display(),
        out.join("dataset").display(),
        out.join("evaluation").display(),
        page.display(),
        started.elapsed().as_secs_f64(),
    );
    printer.data(&collected.rows, &text);
    Ok(collect::status(&collected))
}

fn tasks(arguments: &DemoArguments) -> Result<Tasks, Failed> {
    if !arguments.tasks.is_empty() {
        return Ok(task_files::spool_tasks(&arguments.tasks, &arguments.out)?);
    }
    let examples = PathBuf::from("examples/tasks");
    if !examples.is_dir() {
        return Err(Failed::new("examples/tasks is not here")
            .hint("run the demo in the project's folder, or name tasks with --tasks"));
    }
    Ok(task_files::spool_tasks(&[examples], &arguments.out)?)
}

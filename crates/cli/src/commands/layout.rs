//! `genmanip layout`: scenario files from tasks.

use std::sync::atomic::AtomicBool;

use genmanip_core::Seed;
use genmanip_layout::LayoutSettings;
use genmanip_pipeline::layouts::{self, LayoutOutput, lay_out};
use genmanip_workspace::task_files;
use genmanip_workspace::workers;
use genmanip_workspace::worlds;

use crate::args::LayoutArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &LayoutArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let world = worlds::read_world_with(arguments.world.as_deref(), arguments.robot.as_deref())?;
    let (tasks, seed, world) = match arguments.layouts.layouts(arguments.suite.as_deref())? {
        Some((suite, choice)) => {
            let tasks = suite.draw(&choice)?.into_iter().map(|drawn| drawn.task).collect();
            (tasks, suite.seed(), suite.judged_in(&world))
        }
        None => (task_files::read_tasks(&arguments.tasks)?, Seed::new(arguments.seed), world),
    };
    let settings = LayoutSettings { distractors: arguments.distractors, ..LayoutSettings::default() };
    let output = LayoutOutput { folder: arguments.out.clone(), explain: arguments.explain };
    let workers = workers::workers(arguments.workers);
    // Every layout takes seconds and its file is written atomically, so Ctrl-C may end the program at any moment.
    let never = AtomicBool::new(false);
    let (mut list, count) = (printer.list(), arguments.count);
    let mut each = |row: &_| list.add(row);
    let rows = lay_out(&tasks, count, &world, &settings, seed, &output, workers, printer, &never, &mut each)?;
    list.end(&layouts::table(&rows, arguments.each));
    let is_met = rows.iter().all(|row| row.refused.is_none());
    Ok(if is_met { ExitStatus::Done } else { ExitStatus::NotMet })
}

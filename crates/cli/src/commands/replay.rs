//! `genmanip replay`: recorded episodes, simulated again or rendered.

use genmanip_viz::replay::{self, Replayed};
use genmanip_workspace::workers;

use crate::args::ReplayArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &ReplayArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let workers = workers::workers(arguments.workers);
    let mut list = printer.list();
    let (path, strip) = (&arguments.episodes, arguments.strip.as_deref());
    let rows = replay::check(path, arguments.check, strip, workers, printer, &mut |row| list.add(row))?;
    list.end(&replay::table(&rows, arguments.each));
    Ok(if rows.iter().all(Replayed::is_sound) { ExitStatus::Done } else { ExitStatus::NotMet })
}

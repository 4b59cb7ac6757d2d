//! `genmanip replay`.

use genmanip_run::inputs;
use genmanip_run::replay::{self, Replayed};

use crate::args::ReplayArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(arguments: &ReplayArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let workers = inputs::workers(arguments.workers);
    let rows = replay::check(&arguments.episodes, arguments.check, arguments.strip.as_deref(), workers, printer)?;
    printer.data(&rows, &replay::table(&rows, arguments.each));
    Ok(if rows.iter().all(Replayed::is_sound) { ExitStatus::Done } else { ExitStatus::NotMet })
}

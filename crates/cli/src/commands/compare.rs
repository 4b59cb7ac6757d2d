//! `genmanip compare`: paired comparison of two evaluations.

use genmanip_benchmark::compare::{compare_files, describe};

use crate::args::CompareArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &CompareArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let comparison = compare_files(&arguments.first, &arguments.second)?;
    printer.data(&comparison, &describe(&comparison));
    Ok(ExitStatus::Done)
}

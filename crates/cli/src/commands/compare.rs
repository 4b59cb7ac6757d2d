//! `genmanip compare`.

use genmanip_benchmark::compare::{compare_files, in_words};

use crate::args::CompareArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(arguments: &CompareArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let comparison = compare_files(&arguments.first, &arguments.second)?;
    printer.data(&comparison, &in_words(&comparison));
    Ok(ExitStatus::Done)
}

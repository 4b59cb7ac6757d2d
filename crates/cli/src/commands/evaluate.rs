//! `genmanip evaluate`.

use std::sync::atomic::Ordering;

use genmanip_core::Document;
use genmanip_run::evaluate::{evaluate, table};
use genmanip_run::{PolicyFactory, inputs};

use crate::args::EvaluateArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(arguments: &EvaluateArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let named = arguments.policies.iter().map(|text| PolicyFactory::resolve(text));
    let policies =
        if arguments.policies.is_empty() { PolicyFactory::all()? } else { named.collect::<Result<_, _>>()? };
    let stop = crate::stop::on_interrupt();
    let reports = evaluate(&arguments.run, &policies, inputs::workers(arguments.workers), printer, &stop)?;
    let values: Vec<_> = reports.iter().map(Document::to_value).collect();
    printer.data(&values, &table(&reports));
    Ok(if stop.load(Ordering::Relaxed) { ExitStatus::NotMet } else { ExitStatus::Done })
}

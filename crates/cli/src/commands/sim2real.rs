//! `genmanip sim2real`: agreement of simulated and real success rates.

use genmanip_benchmark::{StatisticsSettings, sim2real};
use genmanip_core::Seed;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};
use genmanip_workspace::documents;

use crate::args::SimToRealArguments;

pub fn run(arguments: &SimToRealArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let settings = StatisticsSettings { seed: Seed::new(arguments.seed), ..StatisticsSettings::default() };
    let report = sim2real::report_file(&arguments.table, &settings)?;
    if let Some(file) = &arguments.svg {
        let Some(all) = &report.overall else {
            return Err(Failed::from(genmanip_workspace::WorkspaceError::input(
                "no task was tried with every policy in both worlds: there is nothing to draw",
            )));
        };
        documents::write_file(file, sim2real::figure(all, &report.measure).as_bytes())?;
    }
    printer.data(&report, &sim2real::describe(&report));
    Ok(ExitStatus::Done)
}

//! `genmanip report`.

use std::path::{Path, PathBuf};

use genmanip_bench::ReportSettings;
use genmanip_run::inputs;
use genmanip_run::report::report;

use crate::args::ReportArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(arguments: &ReportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let path = write(&arguments.run, arguments.out.as_deref(), printer)?;
    printer.data(&path.display().to_string(), &path.display().to_string());
    Ok(ExitStatus::Done)
}

/// Writes the report of a run and says where; also used by the demo.
pub fn write(run: &Path, out: Option<&Path>, printer: &Printer) -> Result<PathBuf, Failed> {
    let html = report(run, &ReportSettings::default(), printer)?;
    let path = out.map_or_else(|| run.join("report.html"), Path::to_owned);
    inputs::write_file(&path, html.as_bytes())?;
    Ok(path)
}

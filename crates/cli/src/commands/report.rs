//! `genmanip report`: the HTML report of a run.

use std::path::{Path, PathBuf};

use genmanip_benchmark::ReportSettings;
use genmanip_pipeline::report::{report, report_full};
use genmanip_workspace::documents;
use genmanip_workspace::workers;

use crate::args::ReportArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &ReportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    if arguments.full {
        let out = arguments.out.clone().unwrap_or_else(|| arguments.run.join("report"));
        let workers = workers::workers(arguments.workers);
        let full = report_full(&arguments.run, &out, &ReportSettings::default(), workers, printer)?;
        printer.say(format!("{} pages, {} of them made now", full.pages, full.made));
        let index = full.index.display().to_string();
        printer.data(&index, &index);
        return Ok(ExitStatus::Done);
    }
    let path = write(&arguments.run, arguments.only.as_deref(), arguments.out.as_deref(), printer)?;
    printer.data(&path.display().to_string(), &path.display().to_string());
    Ok(ExitStatus::Done)
}

/// Writes the report of a run (or of its task `only`) and returns its path; also used by `demo`.
pub fn write(run: &Path, only: Option<&str>, out: Option<&Path>, printer: &Printer) -> Result<PathBuf, Failed> {
    let html = report(run, only, &ReportSettings::default(), printer)?;
    let name = only.map_or("report.html".into(), |id| format!("report-{id}.html"));
    let path = out.map_or_else(|| run.join(name), Path::to_owned);
    documents::write_file(&path, html.as_bytes())?;
    Ok(path)
}

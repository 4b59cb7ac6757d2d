//! `genmanip leaderboard`: tables of the evaluations below a folder, one per suite.

use genmanip_benchmark::leaderboard_files::evaluations_below;
use genmanip_benchmark::{EvaluationReport, boards, leaderboard_html, leaderboard_markdown};
use genmanip_workspace::documents;

use crate::args::LeaderboardArguments;
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &LeaderboardArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    // The tables need only the summaries.
    let summary = |report| EvaluationReport { results: Vec::new(), ..report };
    let boards = boards(&evaluations_below(&arguments.folder, printer, summary)?);
    if let Some(file) = &arguments.html {
        documents::write_file(file, leaderboard_html(&boards).as_bytes())?;
    }
    printer.data(&boards, &leaderboard_markdown(&boards));
    Ok(ExitStatus::Done)
}

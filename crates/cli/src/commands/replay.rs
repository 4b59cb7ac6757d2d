//! `genmanip replay`.

use genmanip_bench::text_table;
use genmanip_run::replay;

use crate::args::ReplayArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(arguments: &ReplayArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let rows = replay::check(&arguments.episodes, arguments.check, arguments.strip.as_deref(), printer)?;
    let mut lines = vec![["episode", "frames", "final state"].map(String::from).to_vec()];
    for row in &rows {
        let state = if row.identical { "identical".into() } else { format!("differs by {:e}", row.largest_difference) };
        lines.push(vec![row.episode.clone(), row.frames.to_string(), state]);
    }
    printer.data(&rows, &text_table(&lines));
    Ok(if rows.iter().all(|row| row.identical) { ExitStatus::Done } else { ExitStatus::NotMet })
}

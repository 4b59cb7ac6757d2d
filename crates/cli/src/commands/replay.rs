//! `genmanip replay`.

use genmanip_bench::text_table;
use genmanip_run::replay::{self, Replayed};

use crate::args::ReplayArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

pub fn run(arguments: &ReplayArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let rows = replay::check(&arguments.episodes, arguments.check, arguments.strip.as_deref(), printer)?;
    let mut lines = vec![["episode", "frames", "final state"].map(String::from).to_vec()];
    for row in &rows {
        lines.push(vec![row.episode.clone(), row.frames.to_string(), row.in_words()]);
    }
    printer.data(&rows, &text_table(&lines));
    Ok(if rows.iter().all(Replayed::is_sound) { ExitStatus::Done } else { ExitStatus::NotMet })
}

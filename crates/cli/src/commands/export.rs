//! `genmanip export --mjcf`.

use crate::args::ExportArguments;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;
use genmanip_run::inputs;

pub fn run(arguments: &ExportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let stage = inputs::read_stage(&arguments.scenario)?;
    match &arguments.out {
        Some(path) => {
            inputs::write_file(path, stage.scene.mjcf().as_bytes())?;
            printer.say(format!("wrote {}", path.display()));
        }
        None => printer.data(&stage.scene.mjcf(), stage.scene.mjcf()),
    }
    Ok(ExitStatus::Done)
}

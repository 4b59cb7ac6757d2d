//! `genmanip export --mjcf`.

use std::sync::Arc;

use genmanip_assets::{Catalogue, panda};
use genmanip_core::Scenario;
use genmanip_rollout::Stage;
use genmanip_sim::SimSettings;

use crate::args::ExportArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::Printer;

pub fn run(arguments: &ExportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let scenario: Scenario = inputs::read_document(&arguments.scenario)?;
    let stage =
        Stage::open(Arc::new(scenario), Catalogue::builtin(), &panda(), &SimSettings::default()).map_err(|error| {
            Failed::because(format!("{} cannot be set up", arguments.scenario.display()), &error)
                .hint("a scenario belongs to the objects and robot it was made with; lay its task out again")
        })?;
    match &arguments.out {
        Some(path) => {
            inputs::write_file(path, stage.scene.mjcf().as_bytes())?;
            printer.say(format!("wrote {}", path.display()));
        }
        None => printer.data(&stage.scene.mjcf(), stage.scene.mjcf()),
    }
    Ok(ExitStatus::Done)
}

//! `genmanip export`: a dataset from a run, or a scenario as MJCF, glTF or OpenUSD.

use std::path::Path;

use genmanip_assets::Catalogue;
use genmanip_data::ExportSettings;
use genmanip_data::export::choice::{ACTIONS, COLUMNS, ROTATIONS, action};
use genmanip_pipeline::export::{ExportOptions, Format, export};
use genmanip_studio::scene::exported;
use genmanip_workspace::documents;
use genmanip_workspace::scenarios;
use genmanip_workspace::workers;

use super::plural;
use crate::args::{DatasetArguments, ExportArguments};
use genmanip_terminal::Printer;
use genmanip_terminal::{ExitStatus, Failed};

pub fn run(arguments: &ExportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    if arguments.mjcf {
        return mjcf(arguments, printer);
    }
    if arguments.glb {
        return glb(arguments, printer);
    }
    if arguments.usd {
        return usd(arguments, printer);
    }
    let dataset = &arguments.dataset;
    let options = ExportOptions {
        format: arguments.to.as_deref().and_then(Format::named).unwrap_or_default(),
        rows: rows(dataset)?,
        keep_failed: dataset.keep_failed,
        sources: arguments.sources.names.clone(),
        out: arguments.out.clone(),
        workers: workers::workers(dataset.workers),
    };
    let stop = genmanip_terminal::on_interrupt();
    let Some(exported) = export(&arguments.source, &options, printer, &stop)? else {
        printer.say("interrupted; pictures that were drawn are kept, start again to continue");
        return Ok(ExitStatus::NotMet);
    };
    let text =
        format!("{}: {}, {} rows\n", exported.dataset.display(), plural(exported.episodes, "episode"), exported.frames);
    printer.data(&exported, &text);
    Ok(if exported.left_out.is_empty() { ExitStatus::Done } else { ExitStatus::NotMet })
}

/// Columns, rate and cameras that the arguments select.
fn rows(arguments: &DatasetArguments) -> Result<ExportSettings, Failed> {
    let usual = ExportSettings::default();
    let name = arguments.action.as_deref().unwrap_or(ACTIONS[0].0);
    let space = ACTIONS.iter().find(|(known, _)| *known == name).map_or(ACTIONS[0].1, |(_, space)| *space);
    if let Some(rotation) = arguments.rotation.as_ref().filter(|_| space.is_joint()) {
        return Err(Failed::new(format!(
            "--rotation {rotation} does not fit --action {name}: joints have no rotation"
        ))
        .hint("leave --rotation away, or choose --action ee or ee_delta"));
    }
    let name = arguments.rotation.as_deref().unwrap_or(ROTATIONS[0].0);
    let rotation = ROTATIONS.iter().find(|(known, _)| *known == name).map_or(ROTATIONS[0].1, |(_, rotation)| *rotation);
    let cameras = match (arguments.no_images, arguments.cameras.is_empty()) {
        (true, _) => Vec::new(),
        (false, true) => usual.cameras,
        (false, false) => arguments.cameras.clone(),
    };
    Ok(ExportSettings {
        fps: arguments.rate.unwrap_or(usual.fps),
        action: action(space, rotation),
        cameras,
        depth: !arguments.no_depth,
        columns: COLUMNS
            .iter()
            .filter(|(name, _)| arguments.columns.iter().any(|asked| asked == name))
            .map(|(_, columns)| *columns)
            .collect(),
        ..usual
    })
}

fn mjcf(arguments: &ExportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let stage = scenarios::read_stage(&arguments.source)?;
    match &arguments.out {
        Some(path) => {
            documents::write_file(path, stage.scene.mjcf().as_bytes())?;
            printer.say(format!("wrote {}", path.display()));
        }
        None => printer.data(&stage.scene.mjcf(), stage.scene.mjcf()),
    }
    Ok(ExitStatus::Done)
}

fn glb(arguments: &ExportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let scenario = scenarios::read_scenario(&arguments.source)?;
    let bytes = exported::scenario_file(&scenario, Catalogue::all())?;
    // The command-line parser requires a path, so the default is never used.
    let path = arguments.out.as_deref().unwrap_or(Path::new("scenario.glb"));
    documents::write_file(path, &bytes)?;
    printer.say(format!("wrote {}, {} kB", path.display(), bytes.len().div_ceil(1000)));
    Ok(ExitStatus::Done)
}

fn usd(arguments: &ExportArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let scenario = scenarios::read_scenario(&arguments.source)?;
    // The parser demands a path.
    let path = arguments.out.as_deref().unwrap_or(Path::new("scenario.usda"));
    if path.extension().is_none_or(|ending| ending != "usda") {
        return Err(Failed::new(format!("--out {}: expected a name that ends in .usda", path.display()))
            .hint("readers of USD choose between text and binary by it"));
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let textures = format!("{stem}_textures");
    let stage = exported::scenario_stage(&scenario, Catalogue::all(), &textures)?;
    let folder = path.with_file_name(&textures);
    for (name, bytes) in &stage.textures {
        documents::write_file(&folder.join(name), bytes)?;
    }
    documents::write_file(path, stage.text.as_bytes())?;
    let kilobytes = stage.text.len().div_ceil(1000);
    printer.say(format!("wrote {}, {kilobytes} kB, and {}", path.display(), plural(stage.textures.len(), "texture")));
    Ok(ExitStatus::Done)
}

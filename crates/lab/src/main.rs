//! The `genmanip-lab` command: measurements, one per subcommand.

mod args;
mod commands;

use std::process::ExitCode;

use genmanip_terminal::{packs_folder, robots_folder};

fn main() -> ExitCode {
    let arguments: args::Arguments = match genmanip_terminal::arguments() {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    genmanip_terminal::run(arguments.json, arguments.quiet, |printer| {
        if let Some(folder) = robots_folder(arguments.robots.as_ref()) {
            genmanip_workspace::robots::open(&folder)?;
        }
        let folder = packs_folder(arguments.packs.as_ref());
        if arguments.packs.is_some() || folder.is_dir() {
            genmanip_import::packs::open(&folder)?;
        }
        commands::run(&arguments.command, printer)
    })
}

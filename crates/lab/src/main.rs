//! The `genmanip-lab` command: measurements, one per subcommand.

mod args;
mod commands;

use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: args::Arguments = match genmanip_terminal::arguments() {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    genmanip_terminal::run(&arguments.global, |printer| {
        let folder = arguments.global.packs_folder();
        if arguments.global.packs.is_some() || folder.is_dir() {
            genmanip_import::packs::open(&folder)?;
        }
        commands::run(&arguments.command, printer)
    })
}

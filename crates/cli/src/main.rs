//! The `genmanip` command: parses the arguments, calls one function of a subcommand, and prints its result.

mod args;
mod commands;
mod launch;

use std::process::ExitCode;

use genmanip_terminal::{ExitStatus, Failed, Printer};

use args::{Arguments, Command, GraspsCommand, TaskCommand};

fn main() -> ExitCode {
    let arguments: Arguments = match genmanip_terminal::arguments() {
        Ok(arguments) => arguments,
        Err(code) => return code,
    };
    genmanip_terminal::run(&arguments.global, |printer| {
        open_packs(&arguments)?;
        run(&arguments, printer)
    })
}

/// Makes imported objects available to the catalogue before a subcommand uses it. `assets import` is exempt, since it
/// reads the packs itself.
fn open_packs(arguments: &Arguments) -> Result<(), Failed> {
    let is_importing = matches!(&arguments.command, Command::Assets { command: args::AssetsCommand::Import(_) });
    let folder = arguments.global.packs_folder();
    if is_importing || (arguments.global.packs.is_none() && !folder.is_dir()) {
        return Ok(());
    }
    genmanip_import::packs::open(&folder)?;
    Ok(())
}

fn run(arguments: &Arguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let packs = arguments.global.packs_folder();
    match &arguments.command {
        Command::Demo(arguments) => commands::demo::run(arguments, printer),
        Command::Task { command: TaskCommand::New(arguments) } => commands::task_new::run(arguments, printer),
        Command::Task { command: TaskCommand::Check(arguments) } => commands::task::check(arguments, printer),
        Command::Task { command: TaskCommand::Show(arguments) } => commands::task::show(arguments, printer),
        Command::Layout(arguments) => commands::layout::run(arguments, printer),
        Command::Plan(arguments) => commands::plan::run(arguments, printer),
        Command::Collect(arguments) => commands::collect::run(arguments, printer),
        Command::Merge(arguments) => commands::collect::merge_run(arguments, printer),
        Command::Launch(arguments) => commands::launch::run(arguments, printer),
        Command::Agent { command } => commands::agent::run(command, printer),
        Command::Ablate(arguments) => commands::ablate::run(arguments, printer),
        Command::Evaluate(arguments) => commands::evaluate::run(arguments, printer),
        Command::Compare(arguments) => commands::compare::run(arguments, printer),
        Command::SimToReal(arguments) => commands::sim2real::run(arguments, printer),
        Command::Suite { command } => commands::suite::run(command, printer),
        Command::Leaderboard(arguments) => commands::leaderboard::run(arguments, printer),
        Command::Replay(arguments) => commands::replay::run(arguments, printer),
        Command::Render(arguments) => commands::render::run(arguments, printer),
        Command::Report(arguments) => commands::report::run(arguments, printer),
        Command::Export(arguments) => commands::export::run(arguments, printer),
        Command::Train(arguments) => commands::train::run(arguments, printer),
        Command::Data { command } => commands::data::run(command, printer),
        Command::Grasps { command: GraspsCommand::Bake(arguments) } => commands::grasps::bake(arguments, printer),
        Command::Grasps { command: GraspsCommand::Show(arguments) } => commands::grasps::show(arguments, printer),
        Command::Assets { command } => commands::assets::run(command, &packs, printer),
        Command::Robot { command } => commands::robot::run(command, printer),
        Command::World { command } => commands::world::run(command, printer),
        Command::Edit(arguments) => commands::edit::run(arguments, printer),
        Command::Review(arguments) => commands::review::run(arguments, printer),
        Command::Camera { command } => commands::world::run_camera(command, printer),
        Command::Calibrate(arguments) => commands::calibrate::run(arguments, printer),
        Command::Identify(arguments) => commands::identify::run(arguments, printer),
        Command::Lab { .. } => Err(Failed::misused("`genmanip lab` is the program `genmanip-lab` now")
            .hint("cargo run --release -p genmanip-lab -- SUBCOMMAND, or genmanip-lab SUBCOMMAND once installed")),
        Command::Real { command } => commands::real::run(command, printer),
        Command::Studio(arguments) => commands::studio::run(arguments, printer),
        Command::Teleop(arguments) => commands::teleop::run(arguments, printer),
        Command::Serve { command } => commands::serve::run(command, printer),
        Command::Skills { command } => commands::skills::run(command, printer),
        Command::Doctor => commands::doctor::run(printer),
    }
}

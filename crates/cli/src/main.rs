//! The `genmanip` command: parse, resolve, call one function, print.

mod args;
mod commands;
mod error;
mod launch;
#[cfg(all(target_os = "linux", target_arch = "x86_64", target_env = "gnu"))]
mod memory;
mod printer;
mod stop;

use clap::{CommandFactory, FromArgMatches};

use args::{Arguments, Command, GraspsCommand, TaskCommand};
use error::{ExitStatus, Failed};

fn main() -> std::process::ExitCode {
    let command = args::taking_negative_numbers(Arguments::command());
    let matches = command.try_get_matches().and_then(|matches| Arguments::from_arg_matches(&matches));
    let arguments = match matches {
        Ok(arguments) => arguments,
        Err(told) => return tell(&told),
    };
    let printer = printer::Printer::new(arguments.json, arguments.quiet);
    let outcome = open_packs(&arguments).and_then(|()| run(&arguments, &printer));
    match outcome.and_then(|status| printer.finish().map(|()| status)) {
        Ok(status) => status.into(),
        Err(failed) => {
            printer.error(&failed);
            failed.status().into()
        }
    }
}

/// What the environment says under a name; what is empty says nothing.
fn environment(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.is_empty())
}

/// Help, the version, or what is wrong with the command line.
fn tell(told: &clap::Error) -> std::process::ExitCode {
    use std::io::{ErrorKind, Write};
    let printed = told.print().and_then(|()| std::io::stdout().flush());
    let is_lost = printed.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe);
    match (told.use_stderr(), is_lost) {
        (true, _) => ExitStatus::NotUnderstood.into(),
        (false, true) => ExitStatus::NotMet.into(),
        (false, false) => ExitStatus::Done.into(),
    }
}

/// Makes imported objects known before anything asks for one; importing itself starts from what its own pack holds.
fn open_packs(arguments: &Arguments) -> Result<(), Failed> {
    let is_importing = matches!(&arguments.command, Command::Assets { command: args::AssetsCommand::Import(_) });
    let folder = packs_folder(arguments);
    if is_importing || (arguments.packs.is_none() && !folder.is_dir()) {
        return Ok(());
    }
    genmanip_import::packs::open(&folder)?;
    Ok(())
}

/// The folder of the packs: as named, as the environment says, or `packs` here.
fn packs_folder(arguments: &Arguments) -> std::path::PathBuf {
    let named = arguments.packs.clone().or_else(|| std::env::var_os("GENMANIP_PACKS").map(Into::into));
    named.unwrap_or_else(|| "packs".into())
}

fn run(arguments: &Arguments, printer: &printer::Printer) -> Result<ExitStatus, Failed> {
    let packs = packs_folder(arguments);
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
        Command::Suite { command } => commands::suite::run(command, printer),
        Command::Leaderboard(arguments) => commands::leaderboard::run(arguments, printer),
        Command::Replay(arguments) => commands::replay::run(arguments, printer),
        Command::Render(arguments) => commands::render::run(arguments, printer),
        Command::Report(arguments) => commands::report::run(arguments, printer),
        Command::Export(arguments) => commands::export::run(arguments, printer),
        Command::Data { command } => commands::data::run(command, printer),
        Command::Grasps { command: GraspsCommand::Bake(arguments) } => commands::grasps::bake(arguments, printer),
        Command::Grasps { command: GraspsCommand::Show(arguments) } => commands::grasps::show(arguments, printer),
        Command::Assets { command } => commands::assets::run(command, &packs, printer),
        Command::World { command } => commands::world::run(command, printer),
        Command::Camera { command } => commands::world::run_camera(command, printer),
        Command::Lab { command } => commands::lab::run(command, printer),
        Command::Serve { command } => commands::serve::run(command, printer),
        Command::Doctor => commands::doctor::run(printer),
    }
}

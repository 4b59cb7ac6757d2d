//! The `genmanip` command: parse, resolve, call one function, print.

mod args;
mod commands;
mod error;
mod printer;
mod stop;

use clap::Parser;

use args::{Arguments, Command, GraspsCommand, TaskCommand};
use error::{ExitStatus, Failed};

fn main() -> std::process::ExitCode {
    let arguments = Arguments::parse();
    let printer = printer::Printer::new(arguments.json, arguments.quiet);
    match run(&arguments.command, &printer) {
        Ok(status) => status.into(),
        Err(failed) => {
            printer.error(&failed);
            ExitStatus::NotMet.into()
        }
    }
}

fn run(command: &Command, printer: &printer::Printer) -> Result<ExitStatus, Failed> {
    match command {
        Command::Demo(arguments) => commands::demo::run(arguments, printer),
        Command::Task { command: TaskCommand::New(arguments) } => commands::task_new::run(arguments, printer),
        Command::Task { command: TaskCommand::Check(arguments) } => commands::task::check(arguments, printer),
        Command::Task { command: TaskCommand::Show(arguments) } => commands::task::show(arguments, printer),
        Command::Layout(arguments) => commands::layout::run(arguments, printer),
        Command::Plan(arguments) => commands::plan::run(arguments, printer),
        Command::Collect(arguments) => commands::collect::run(arguments, printer),
        Command::Evaluate(arguments) => commands::evaluate::run(arguments, printer),
        Command::Replay(arguments) => commands::replay::run(arguments, printer),
        Command::Report(arguments) => commands::report::run(arguments, printer),
        Command::Export(arguments) => commands::export::run(arguments, printer),
        Command::Grasps { command: GraspsCommand::Bake(arguments) } => commands::grasps::bake(arguments, printer),
        Command::Grasps { command: GraspsCommand::Show(arguments) } => commands::grasps::show(arguments, printer),
        Command::World { command } => commands::world::run(command, printer),
        Command::Camera { command } => commands::world::run_camera(command, printer),
        Command::Lab { command } => commands::lab::run(command, printer),
        Command::Serve { command } => commands::serve::run(command, printer),
        Command::Doctor => commands::doctor::run(printer),
    }
}

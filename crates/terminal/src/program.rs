//! Common frame of the programs: parses the command line, runs, prints, and exits.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, CommandFactory, FromArgMatches};

use crate::defect;
use crate::error::{ExitStatus, Failed};
use crate::printer::Printer;

/// Parses the command line of this process; prints help, the version or the error.
///
/// # Errors
/// The exit code with which the program ends immediately.
pub fn arguments<A: CommandFactory + FromArgMatches>() -> Result<A, ExitCode> {
    let command = taking_negative_numbers(A::command());
    let matches = command.try_get_matches().and_then(|matches| A::from_arg_matches(&matches));
    matches.map_err(|error| report(&error))
}

/// Options of every subcommand of the programs.
#[derive(Debug, Args)]
pub struct GlobalArguments {
    /// Print data as JSON on stdout
    #[arg(long, global = true)]
    pub json: bool,
    /// Print errors only: no progress, no log
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Folder with packs of imported objects [default: GENMANIP_PACKS, or `packs` in the current folder if it exists]
    #[arg(long, value_name = "DIR", global = true)]
    pub packs: Option<PathBuf>,
    /// Folder with your robot files [default: GENMANIP_ROBOTS, or `robots` in the current folder if it exists]
    #[arg(long, value_name = "DIR", global = true)]
    pub robots: Option<PathBuf>,
}

impl GlobalArguments {
    /// Folder of imported packs: the given one, else `GENMANIP_PACKS`, else `packs` in the current folder.
    pub fn packs_folder(&self) -> PathBuf {
        let named = self.packs.clone().or_else(|| std::env::var_os("GENMANIP_PACKS").map(Into::into));
        named.unwrap_or_else(|| "packs".into())
    }

    /// Folder of the user's robots: the given one, else `GENMANIP_ROBOTS`, else `robots` in the current folder if it
    /// exists.
    fn robots_folder(&self) -> Option<PathBuf> {
        let named = self.robots.clone().or_else(|| std::env::var_os("GENMANIP_ROBOTS").map(Into::into));
        named.or_else(|| Some(PathBuf::from("robots")).filter(|folder| folder.is_dir()))
    }
}

/// Runs a program with a printer and the user's robots, prints its error if it fails, and returns the exit code.
pub fn run(global: &GlobalArguments, body: impl FnOnce(&Printer) -> Result<ExitStatus, Failed>) -> ExitCode {
    let printer = Printer::new(global.json, global.quiet);
    let opened = global.robots_folder().map_or(Ok(()), |folder| genmanip_workspace::robots::open(&folder).map(drop));
    let outcome = opened.map_err(Failed::from).and_then(|()| defect::guarded(|| body(&printer)));
    match outcome.and_then(|status| printer.finish().map(|()| status)) {
        Ok(status) => status.into(),
        Err(failed) => {
            printer.error(&failed);
            failed.status().into()
        }
    }
}

/// Value of an environment variable; `None` if it is unset or empty.
pub fn environment(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.is_empty())
}

/// Help text of an option that takes the name of a robot, with the built-in names.
pub fn robot_help(what: &str) -> String {
    format!("{what}: {}, or one of --robots", genmanip_workspace::robots::names().join(", "))
}

/// Prints help, the version, or the error of the command line.
fn report(error: &clap::Error) -> ExitCode {
    use std::io::{ErrorKind, Write};
    let printed = error.print().and_then(|()| std::io::stdout().flush());
    let is_lost = printed.is_err_and(|error| error.kind() != ErrorKind::BrokenPipe);
    match (error.use_stderr(), is_lost) {
        (true, _) => ExitStatus::NotUnderstood.into(),
        (false, true) => ExitStatus::NotMet.into(),
        (false, false) => ExitStatus::Done.into(),
    }
}

/// Lets options with values accept negative numbers, so that the parser reports the valid range instead of an unknown
/// option.
fn taking_negative_numbers(command: clap::Command) -> clap::Command {
    let takes_value = |arg: &clap::Arg| arg.get_action().takes_values();
    let command = command.mut_args(|arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg });
    command.mut_subcommands(taking_negative_numbers)
}

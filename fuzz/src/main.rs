//! `genmanip-fuzz`: mutated inputs for every reader of untrusted bytes, on stable Rust.
//!
//! A target is a corpus of valid inputs and a reader. An input may be accepted or refused; it must not panic, abort,
//! take too long or need too much memory. Input `n` of a target is a function of the seed and `n`, so a crash is found
//! again without having stored anything before it.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is a command-line program")]

mod campaign;
mod input;
mod targets;
#[cfg(test)]
mod tests;
mod worker;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Parser;

use input::Input;
use targets::{TARGETS, Target};

/// Errors of the program itself; what a reader refuses is no error.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Read mutated inputs until one breaks the reader; without a target, list the targets
#[derive(Debug, Parser)]
#[command(name = "cargo xtask fuzz", after_help = "Exit code 1: an input broke the reader.")]
struct Arguments {
    /// Reader to be fuzzed
    #[arg(value_parser = |name: &str| targets::named(name))]
    target: Option<&'static Target>,
    /// CPU time, min
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// Seed of the mutations
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Read one saved input instead
    #[arg(long, value_name = "FOLDER", requires = "target")]
    input: Option<PathBuf>,
    /// File of the number of the current input; the process is a worker
    #[arg(long, hide = true)]
    progress: Option<PathBuf>,
    /// First input
    #[arg(long, hide = true, default_value_t = 0)]
    from: u64,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let Arguments { minutes, seed, from, .. } = *arguments;
    let Some(target) = arguments.target else {
        for Target { name, about, .. } in TARGETS {
            println!("{name:<18} {about}");
        }
        return Ok(ExitCode::SUCCESS);
    };
    if let Some(folder) = &arguments.input {
        let mut opened = (target.open)(target.name, &repository())?;
        match (opened.read)(&Input::of_folder(folder)?) {
            Ok(()) => println!("accepted"),
            Err(message) => println!("refused: {message}"),
        }
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(progress) = &arguments.progress {
        worker::run(target, minutes * 60.0, seed, from, progress)?;
        return Ok(ExitCode::SUCCESS);
    }
    let found = campaign::run(target, minutes * 60.0, seed)?;
    Ok(if found == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The folder of the repository.
fn repository() -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().unwrap_or(package).to_owned()
}

//! `cargo xtask SUBCOMMAND`: everything around the code that is not the code.
//!
//! | subcommand | does |
//! |---|---|
//! | `setup` | downloads and verifies the simulator library, makes the small Python environment of the tests |
//! | `setup web` | installs the packages that build and test the studio's page |
//! | `setup real` | installs the packages of the simulated Franka arm |
//! | `demo` | set-up, build, then `genmanip demo` |
//! | `test` | everything CI runs, with the time of each phase |
//! | `install` | puts the programs and the suites where cargo installs programs |
//! | `wheel` | builds the Python wheel, with the simulator's library inside |
//! | `docs` | runs the code blocks of README.md and the guides |
//! | `fuzz` | feeds mutated inputs to one of the readers |
//! | `tidy` | the rules of ARCHITECTURE.md that a compiler does not check |
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is a command-line program")]

mod assembler;
mod cluster;
mod command_line;
mod demo;
mod docs;
mod features;
mod fuzz;
mod install;
mod interop;
mod markdown;
mod models;
mod mujoco;
mod offline;
mod packs;
mod problem;
mod process;
mod python;
mod real;
mod s3;
mod setup;
mod sha256;
mod test;
mod tidy;
mod train;
mod web;
mod wheel;

use problem::{Problem, Result};
use process::Workspace;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::from(1)
        }
    }
}

fn run(args: &[String]) -> Result {
    let workspace = Workspace::find();
    let rest = args.get(1..).unwrap_or_default();
    match args.first().map(String::as_str) {
        Some("setup") if rest == ["web"] => web::set_up(&workspace),
        Some("setup") if rest == ["real"] => real::set_up(&workspace),
        Some("setup") => setup::run(&workspace),
        Some("demo") => demo::run(&workspace, rest),
        Some("test") if rest == ["--packs"] => packs::run(&workspace),
        Some("test") if rest == ["--cluster"] => cluster::run(&workspace),
        Some("test") if rest == ["--s3"] => s3::run(&workspace),
        Some("test") if rest == ["--train"] => train::run(&workspace),
        Some("test") if rest == ["--models"] => models::run(&workspace),
        Some("test") if rest == ["--interop"] => interop::run(&workspace),
        Some("test") if rest.starts_with(&["web".into(), "--long".into()]) => web::long(&workspace, &rest[2..]),
        Some("test") => test::run(&workspace, rest),
        Some("tidy") => tidy::run(&workspace.root, rest),
        Some("install") => install::run(&workspace, rest),
        Some("wheel") => wheel::run(&workspace, rest),
        Some("fuzz") => fuzz::run(&workspace, rest),
        Some("docs") => {
            let (options, pages): (Vec<String>, Vec<String>) = rest.iter().cloned().partition(|arg| arg == "--interop");
            let blocks = if options.is_empty() { docs::Blocks::Usual } else { docs::Blocks::Interop };
            docs::run(&workspace, &pages, blocks).map(|said| println!("{said}"))
        }
        Some("help" | "--help" | "-h") => {
            println!("{}", command_line::USAGE);
            Ok(())
        }
        other => Err(Problem {
            what: other.map_or("no subcommand given".into(), |name| format!("there is no subcommand `{name}`")),
            expected: command_line::SUBCOMMANDS.join(", "),
            hint: "`cargo xtask help` says what each does".into(),
        }),
    }
}

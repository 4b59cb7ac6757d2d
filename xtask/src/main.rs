//! `cargo xtask <verb>`: everything around the code that is not the code.
//!
//! | verb | does |
//! |---|---|
//! | `setup` | downloads and verifies the simulator library, makes the small Python environment of the tests |
//! | `demo` | set-up, build, then `genmanip demo` |
//! | `test` | everything CI runs, with the time of each phase |
//! | `tidy` | the rules of ARCHITECTURE.md that a compiler does not check |
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "this is a command-line program")]

mod assembler;
mod cluster;
mod demo;
mod interop;
mod mujoco;
mod offline;
mod packs;
mod problem;
mod process;
mod python;
mod s3;
mod setup;
mod sha256;
mod test;
mod tidy;
mod wheel;

use problem::{Problem, Result};
use process::Workspace;
use std::process::ExitCode;

const USAGE: &str = "\
Usage: cargo xtask <verb>

  setup            download and verify the simulator library, make the Python environment of the tests
  demo [ARGS…]     set-up, build, and run `genmanip demo` (ARGS are passed on; default: --out out/demo)
  test [PHASE…]    everything CI runs, or only the named phases
  test --packs     import objects of published packages (downloads 320 MB, takes minutes; not part of CI)
  test --interop   let published packages of other projects ask, answer and read us (downloads 3 GB; not part of CI)
  test --cluster   collect on a Slurm of two nodes on this machine and lose one (needs its packages; not part of CI)
  test --s3        push and pull a folder through a real S3 server that fails (builds one; not part of CI)
  tidy             check the rules that the compiler does not know

Example: cargo xtask test fmt clippy";

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
        Some("setup") => setup::run(&workspace),
        Some("demo") => demo::run(&workspace, rest),
        Some("test") if rest == ["--packs"] => packs::run(&workspace),
        Some("test") if rest == ["--cluster"] => cluster::run(&workspace),
        Some("test") if rest == ["--s3"] => s3::run(&workspace),
        Some("test") if rest == ["--interop"] => interop::run(&workspace),
        Some("test") => test::run(&workspace, rest),
        Some("tidy") => tidy::run(&workspace.root),
        Some("help" | "--help" | "-h") => {
            println!("{USAGE}");
            Ok(())
        }
        other => Err(Problem {
            what: other.map_or("no verb given".into(), |verb| format!("there is no verb `{verb}`")),
            expected: "setup, demo, test or tidy".into(),
            hint: "`cargo xtask help` says what each does".into(),
        }),
    }
}

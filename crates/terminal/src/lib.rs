//! Terminal interface: printer, exit codes, messages, Ctrl-C, command-line parsing, and the memory allocator of the
//! programs.
//!
//! Used by the programs `genmanip` and `genmanip-lab`; no other crate prints.

mod defect;
mod error;
#[cfg(all(target_os = "linux", target_arch = "x86_64", target_env = "gnu"))]
mod memory;
pub mod parse;
mod printer;
mod program;
mod stop;
mod time;
mod urdf;

pub use error::{ExitStatus, Failed};
pub use printer::{List, Printer};
pub use program::{GlobalArguments, arguments, environment, robot_help, run};
pub use stop::on_interrupt;
pub use time::rfc3339;
pub use urdf::UrdfArguments;

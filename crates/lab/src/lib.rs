//! Measurements of the parts on cases that the project has not seen.
//!
//! One module per measurement: a function from arguments to values that serialise, and those values in words.
//! Figures are of one thread and in processor time; nothing is printed.

pub mod agent;
mod agent_page;
pub mod answers;
pub mod assets;
pub mod batch;
pub mod blame;
pub mod calibration;
mod clock;
pub mod data;
pub mod design;
pub mod environment;
mod episodes;
pub mod expert;
pub mod fit;
pub mod grasp;
pub mod hostile;
pub mod layout;
pub mod motion;
mod program;
pub mod readers;
pub mod relations;
pub mod render;
pub mod rendered;
pub mod scale;
pub mod segment;
pub mod statistics;
pub mod suite;

pub use clock::cpu_clock;
/// Why a measurement could not be made.
pub use genmanip_workspace::RunError as LabError;
pub use program::program;

//! Verdict on a scenario, in stages, with repairs.

mod equipment;
mod inspection;
mod problem;

pub use equipment::{Equipment, VerdictError};
pub use inspection::Inspection;
pub use problem::{Problem, ProblemCode, Repair, Stage, Verdict};

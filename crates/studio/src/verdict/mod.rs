//! Verdict on a scenario, in stages, with repairs.

mod equipment;
mod inspection;
mod places;
mod problem;
mod repair;
mod reword;
mod support;
mod wording;

pub use equipment::{Equipment, EquipmentCache, VerdictError};
pub use inspection::Inspection;
pub use problem::{Problem, ProblemCode, Repair, Stage, Verdict};
pub use repair::{RepairedScenario, edge_between, repair_all};

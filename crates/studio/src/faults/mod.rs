//! Faults planted in sound scenarios, to measure the verdict, and reviewers who do not know which scenarios have one.

mod blocked;
mod fault;
mod for_reviewers;
mod site;

pub use fault::Fault;
pub use for_reviewers::{FaultyScenario, plant, write};
pub use site::Planted;

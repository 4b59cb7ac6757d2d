//! Balance of a collection of scenarios: its distribution over axes and pairs of them against targets, the candidates
//! that help most, and a choice in which every candidate keeps its reason.

mod axes;
mod choice;
mod difficulty;
mod distribution;
#[cfg(test)]
mod tests;

pub use axes::{Axes, axes};
pub use choice::{Choice, Offered, Reasoned, candidate, choice, helpful};
pub use difficulty::{Successes, difficulty, successes};
pub use distribution::{AxisBalance, Balance, PairBalance, ValueShare, balance};

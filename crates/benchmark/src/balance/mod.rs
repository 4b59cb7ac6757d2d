//! Balance of a collection of scenarios: distribution over axes and pairs of axes compared with targets, candidates
//! that improve it most, and choice of a suite in which every candidate keeps its reason.

mod axes;
mod choice;
mod difficulty;
mod distribution;
#[cfg(test)]
mod tests;

pub use axes::{Axes, axes};
pub use choice::{Choice, Offered, Reasoned, candidate, choice, helpful};
pub use difficulty::{MeasuredContent, MeasuredContents, measured_contents};
pub use distribution::{AxisBalance, Balance, PairBalance, ValueShare, balance};

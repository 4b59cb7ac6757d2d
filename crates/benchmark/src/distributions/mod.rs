//! Suites of task distributions: layouts to learn from and to be tested on, as functions of one document.
//!
//! ```text
//! NAME/suite.json          the distributions
//! NAME/layouts/*.txt       frozen hashes of the layouts, a file per distribution
//! ```
//!
//! Layout `k` of a split of a distribution is drawn from the stream `fork(distribution).fork(split).fork_index(k)` of the
//! document's seed, and made as the first attempt of its task. If it cannot be made, the next attempt at the same `k`
//! takes its place.

mod check;
mod draw;
mod format;
mod freeze;
mod frozen;
mod show;
mod suite;
#[cfg(test)]
mod tests;

pub use check::{DistributionsCheck, check, describe as describe_check};
pub use format::{BySplit, Distractors, Distribution, DistributionsFile, GoalTemplate, Role, Split};
pub use freeze::freeze;
pub use frozen::{FrozenLayout, layout_hash};
pub use show::{DistributionsOverview, describe as describe_distributions, show};
pub use suite::{Distributions, DrawnTask, SplitChoice, choose, is_of_distributions};

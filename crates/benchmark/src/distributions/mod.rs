//! Suites of task distributions: layouts for training and testing, all determined by one document.
//!
//! ```text
//! NAME/suite.json          the distributions
//! NAME/layouts/*.txt       frozen hashes of the layouts, a file per distribution
//! ```
//!
//! Layout `k` of a split of a distribution is drawn from the random stream
//! `fork(distribution).fork(split).fork_index(k)` of the document's seed, and laid out as the first attempt of its
//! task. If no layout is found, the next attempt at the same `k` replaces it.

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
pub use format::{BySplit, Distractors, Distribution, DistributionsFile, GoalTemplate, Role, RoleAtom, Split};
pub use freeze::freeze;
pub use frozen::{FrozenLayout, layout_hash};
pub use show::{DistributionsOverview, describe as describe_distributions, show};
pub use suite::{Distributions, DrawnTask, SplitChoice, choose, is_of_distributions};

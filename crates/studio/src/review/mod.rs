//! Reviews of scenarios: who said what about which content, and what follows from it.
//!
//! A review is bound to the hash of what was reviewed, so that any edit voids it. Two reviewers judge independently,
//! criterion by criterion; a third one decides where they differ.

mod planted;
mod queue;
mod reviewed;
mod standing;

pub use planted::{Detection, detections};
pub use queue::{next_for, visible_to};
pub use reviewed::{Criterion, Decision, Reason, Review, Reviewer, ReviewerKind};
pub use standing::{REVIEWS, Standing, current, standing};

#[cfg(test)]
mod tests;

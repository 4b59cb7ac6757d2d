//! Reviews of scenarios: log, agreement, standing and queue, and a balanced suite of the approved scenarios.
//!
//! A review is bound to the hash of the reviewed content, so that any edit voids it. Two reviewers judge independently,
//! criterion by criterion; a third one adjudicates where they differ.
//!
//! [`ReviewDesk`] holds the scenarios and the [`ReviewLog`]; all other functions are pure.

mod agreement;
mod build;
mod content;
mod desk;
mod inputs;
mod likeness;
mod log;
mod older;
mod planted;
mod queue;
mod reading;
mod reviewed;
mod standing;

pub use agreement::{Agreement, agreement};
pub use build::{Built, WrittenSuite, build_suite, written_suites};
pub use content::content_sha256;
pub use desk::{
    Dashboard, Helpful, LeftOutEpisodes, MeasuredScenario, QueueRow, ReferencePolicy, ReviewDesk, ReviewQueue,
    ReviewState, Reviewable,
};
pub use inputs::{LeftOut, ReviewInputs, TARGETS_HINT, check_targets};
pub use likeness::groups;
pub use log::{ExpertTrials, ImportedReviews, ReviewError, ReviewHeader, ReviewLine, ReviewLog, SCHEMA};
pub use older::take_from_suites;
pub use planted::{Detection, detections};
pub use queue::{Work, next_for, visible_to, work_for};
pub use reading::{certify, read_desk, read_item};
pub use reviewed::{Criterion, Decision, Reason, Review, Reviewer, ReviewerKind};
pub use standing::{REVIEWS, Standing, current, standing};

#[cfg(test)]
mod log_tests;
#[cfg(test)]
mod tests;

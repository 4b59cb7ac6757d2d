//! Planted faulty items among the scenarios, which measure how well reviewers detect faults.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::reviewed::{Decision, Review};

/// Detection of planted faults by one reviewer.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Detection {
    /// Number of planted faulty items that the reviewer judged.
    pub planted: usize,
    /// Number of planted faulty items that the reviewer did not approve.
    pub detected: usize,
    /// Number of sound items that the reviewer judged.
    pub sound: usize,
    /// Number of sound items that the reviewer did not approve.
    pub false_alarms: usize,
}

/// Detections by reviewer, from one review per reviewer and scenario; `planted` holds the ids of the faulty scenarios.
pub fn detections(words: &[&Review], planted: &BTreeSet<String>) -> BTreeMap<String, Detection> {
    let mut measured = BTreeMap::<String, Detection>::new();
    for review in words.iter().filter(|review| !review.adjudicates) {
        let detection = measured.entry(review.reviewer.name.clone()).or_default();
        let is_refused = usize::from(review.decision != Decision::Approve);
        if planted.contains(&review.scenario) {
            detection.planted += 1;
            detection.detected += is_refused;
        } else {
            detection.sound += 1;
            detection.false_alarms += is_refused;
        }
    }
    measured
}

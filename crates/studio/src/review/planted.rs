//! Faulty items planted among the scenarios, which measure reviewers.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::reviewed::{Decision, Review};

/// A reviewer measured on planted faults.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Detection {
    /// Planted faulty items that they reviewed.
    pub planted: usize,
    /// Those that they did not approve.
    pub detected: usize,
    /// Sound items that they reviewed.
    pub sound: usize,
    /// Those that they did not approve.
    pub false_alarms: usize,
}

/// Detections by reviewer, of one word per reviewer and scenario; `planted` names the faulty ones.
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

//! Queue of a reviewer, and visibility of reviews.

use serde::Serialize;

use super::reviewed::Review;
use super::standing::{Standing, current, standing};

/// Work that a scenario offers to a reviewer, in order of priority: pairs of reviews are completed first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Work {
    /// The second review of a scenario.
    Second,
    /// The first review of a scenario.
    First,
    /// The decision between two reviews that differ.
    Adjudicate,
}

/// Work that a scenario with these current reviews offers to a reviewer; `None` if there is none. Nobody reviews a
/// scenario twice, and nobody adjudicates between own and other reviews.
pub fn work_for(reviewer: &str, current: &[&Review]) -> Option<Work> {
    if current.iter().any(|review| review.reviewer.name == reviewer) {
        return None;
    }
    match standing(current, true) {
        Standing::Open { missing: 1 } => Some(Work::Second),
        Standing::Open { .. } => Some(Work::First),
        Standing::Adjudication => Some(Work::Adjudicate),
        Standing::SentBack | Standing::Uncertified | Standing::Approved | Standing::Rejected => None,
    }
}

/// Index of the scenario that a reviewer should see next, among pairs (id, hash of the content) in the order of the
/// collection; `None` if nothing is left to do.
pub fn next_for(reviewer: &str, scenarios: &[(String, String)], reviews: &[Review]) -> Option<usize> {
    let work = |(id, content): &(String, String)| work_for(reviewer, &current(reviews, id, content));
    let ranked = scenarios.iter().enumerate().filter_map(|(index, scenario)| Some((work(scenario)?, index)));
    ranked.min().map(|(_, index)| index)
}

/// Current reviews of a scenario that a reviewer may see: all once the reviewer has reviewed it or it is no longer
/// open, as for an adjudication; none before.
pub fn visible_to<'a>(reviewer: &str, current: &[&'a Review]) -> Vec<&'a Review> {
    let has_said = current.iter().any(|review| review.reviewer.name == reviewer);
    let is_open = matches!(standing(current, true), Standing::Open { .. });
    if has_said || !is_open { current.to_vec() } else { Vec::new() }
}

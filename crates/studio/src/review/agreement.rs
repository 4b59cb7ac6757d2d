//! Agreement of the reviewers over all reviews.

use std::collections::{BTreeMap, BTreeSet};

use genmanip_benchmark::statistics::{ReviewerAgreement, reviewer_agreement};
use serde::Serialize;

use super::planted::{Detection, detections};
use super::reviewed::{Criterion, Decision, Review};
use super::standing::REVIEWS;

/// Agreement on all contents that two reviewers judged independently, those voided by later edits included.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Agreement {
    /// Agreement on approval or not; `None` before the first pair of reviews.
    pub decision: Option<ReviewerAgreement>,
    /// Agreement by criterion, over the pairs in which both judged it.
    pub criteria: BTreeMap<Criterion, ReviewerAgreement>,
    /// Detection of planted faulty items by reviewer; empty if no items are named.
    pub planted: BTreeMap<String, Detection>,
}

/// Agreement over all reviews; `planted` holds the ids of the scenarios with planted faults.
pub fn agreement(reviews: &[Review], planted: &BTreeSet<String>) -> Agreement {
    let judged = independent(reviews);
    let pairs: Vec<[&Review; 2]> =
        judged.iter().filter_map(|words| <[&Review; 2]>::try_from(words.clone()).ok()).collect();
    let is_approval = |review: &Review| review.decision == Decision::Approve;
    let decisions: Vec<(bool, bool)> = pairs.iter().map(|[a, b]| (is_approval(a), is_approval(b))).collect();
    let of_criterion = |criterion: Criterion| {
        let both = |[a, b]: &[&Review; 2]| Some((*a.criteria.get(&criterion)?, *b.criteria.get(&criterion)?));
        let judged: Vec<(bool, bool)> = pairs.iter().filter_map(both).collect();
        Some((criterion, reviewer_agreement(&judged, 2)?))
    };
    let words: Vec<&Review> = judged.iter().flatten().copied().collect();
    Agreement {
        decision: reviewer_agreement(&decisions, 2),
        criteria: Criterion::ALL.into_iter().filter_map(of_criterion).collect(),
        planted: if planted.is_empty() { BTreeMap::new() } else { detections(&words, planted) },
    }
}

/// Independent reviews of each content, ordered by the reviewers' names: the latest one of each of the first two
/// reviewers, up to the moment when the second has reviewed. Later reviews are excluded, since their authors could see
/// those of others.
fn independent(reviews: &[Review]) -> Vec<Vec<&Review>> {
    let mut contents = BTreeMap::<(&str, &str), BTreeMap<&str, &Review>>::new();
    for review in reviews.iter().filter(|review| !review.adjudicates) {
        let words = contents.entry((review.scenario.as_str(), review.content_sha256.as_str())).or_default();
        if words.len() >= REVIEWS {
            continue;
        }
        match review.decision {
            Decision::TakeBack => words.remove(review.reviewer.name.as_str()),
            _ => words.insert(&review.reviewer.name, review),
        };
    }
    contents.into_values().map(|words| words.into_values().collect()).collect()
}

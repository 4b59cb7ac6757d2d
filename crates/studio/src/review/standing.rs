//! Standing of a scenario, which follows from its reviews.

use std::collections::BTreeMap;

use serde::Serialize;

use super::reviewed::{Decision, Review};

/// Number of independent reviews that a scenario needs.
pub const REVIEWS: usize = 2;

/// Standing of a scenario in the review.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "standing")]
pub enum Standing {
    /// Independent reviews are missing.
    Open {
        /// Number of missing reviews.
        missing: usize,
    },
    /// A reviewer sent the scenario back for a change.
    SentBack,
    /// The two reviews differ in their decision or in a criterion, and nobody has adjudicated yet.
    Adjudication,
    /// Approved by the reviews, but the expert has not solved this content.
    Uncertified,
    /// Approved by the reviews, and solved by the expert.
    Approved,
    /// Rejected by the reviews.
    Rejected,
}

impl Standing {
    /// Name of the standing in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open { .. } => "open",
            Self::SentBack => "sent_back",
            Self::Adjudication => "adjudication",
            Self::Uncertified => "uncertified",
            Self::Approved => "approved",
            Self::Rejected => "rejected",
        }
    }
}

/// Reviews of this content that count, in the given order: the latest of each reviewer, without withdrawn ones.
pub fn current<'a>(reviews: &'a [Review], scenario: &str, content_sha256: &str) -> Vec<&'a Review> {
    let of_this = reviews
        .iter()
        .enumerate()
        .filter(|(_, review)| review.scenario == scenario && review.content_sha256 == content_sha256);
    let last: BTreeMap<&str, (usize, &Review)> =
        of_this.map(|(index, review)| (review.reviewer.name.as_str(), (index, review))).collect();
    let mut last: Vec<_> = last.into_values().collect();
    last.sort_by_key(|(index, _)| *index);
    last.into_iter().map(|(_, review)| review).filter(|review| review.decision != Decision::TakeBack).collect()
}

/// Standing of a scenario from its current reviews; `is_certified` is true if the expert solved this content.
pub fn standing(current: &[&Review], is_certified: bool) -> Standing {
    if current.iter().any(|review| review.decision == Decision::SendBack) {
        return Standing::SentBack;
    }
    let independent: Vec<&&Review> = current.iter().filter(|review| !review.adjudicates).collect();
    let Some((first, others)) = independent.split_first().filter(|(_, others)| others.len() + 1 >= REVIEWS) else {
        return Standing::Open { missing: REVIEWS - independent.len() };
    };
    let is_agreed = others.iter().all(|other| {
        is_approval(other) == is_approval(first)
            && other
                .criteria
                .iter()
                .all(|(criterion, holds)| first.criteria.get(criterion).is_none_or(|is| is == holds))
    });
    let decided = match is_agreed {
        true => Some(is_approval(first)),
        false => current.iter().rev().find(|review| review.adjudicates).map(|review| is_approval(review)),
    };
    match decided {
        None => Standing::Adjudication,
        Some(false) => Standing::Rejected,
        Some(true) if is_certified => Standing::Approved,
        Some(true) => Standing::Uncertified,
    }
}

fn is_approval(review: &Review) -> bool {
    review.decision == Decision::Approve
}

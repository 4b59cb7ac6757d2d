//! Human reviews of the scenarios of a suite.

use genmanip_core::Document;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::SuiteFile;

/// Document `review.json` of a suite's folder; it is not part of the frozen suite.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ReviewFile {
    /// Reviews, one per scenario and reviewer, ordered by both.
    pub reviews: Vec<Review>,
}

impl Document for ReviewFile {
    const SCHEMA: &'static str = "genmanip.suite_review/1";
}

/// One person's review of one scenario.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Review {
    /// Id of the scenario.
    pub scenario: String,
    /// Name of the reviewer.
    pub reviewer: String,
    /// SHA-256 of the reviewed scenario's file.
    pub sha256: String,
    /// Verdict of the reviewer.
    pub verdict: ReviewVerdict,
    /// Reason for the verdict; may be empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub note: String,
}

/// Verdict of a review.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReviewVerdict {
    /// Sentence, image and goal agree.
    Sound,
    /// The sentence could mean something else in this scene.
    Ambiguous,
    /// The scene, the sentence or the goal is wrong.
    Flawed,
}

impl ReviewVerdict {
    /// All verdicts, in the order of the variants.
    pub const ALL: [Self; 3] = [Self::Sound, Self::Ambiguous, Self::Flawed];

    /// The name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sound => "sound",
            Self::Ambiguous => "ambiguous",
            Self::Flawed => "flawed",
        }
    }
}

impl ReviewFile {
    /// Adds a review, replacing the same person's earlier review of the scenario.
    pub fn add(&mut self, review: Review) {
        let is_same = |other: &Review| (&other.scenario, &other.reviewer) == (&review.scenario, &review.reviewer);
        self.reviews.retain(|other| !is_same(other));
        self.reviews.push(review);
        self.reviews.sort();
    }

    /// Reviews of scenarios that are no longer in the suite, or have changed since the review.
    pub fn stale<'a>(&'a self, suite: &'a SuiteFile) -> impl Iterator<Item = &'a Review> {
        let is_current = |review: &Review| {
            suite.scenarios.iter().any(|entry| entry.id == review.scenario && entry.sha256 == review.sha256)
        };
        self.reviews.iter().filter(move |review| !is_current(review))
    }

    /// Number of reviews with a verdict.
    pub fn count(&self, verdict: ReviewVerdict) -> usize {
        self.reviews.iter().filter(|review| review.verdict == verdict).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_word_of_a_person_counts() {
        let said = |scenario: &str, verdict| Review {
            scenario: scenario.into(),
            reviewer: "ada".into(),
            sha256: "0".into(),
            verdict,
            note: String::new(),
        };
        let mut file = ReviewFile::default();
        for (scenario, verdict) in
            [("b", ReviewVerdict::Sound), ("a", ReviewVerdict::Flawed), ("b", ReviewVerdict::Ambiguous)]
        {
            file.add(said(scenario, verdict));
        }
        assert_eq!(file.reviews, [said("a", ReviewVerdict::Flawed), said("b", ReviewVerdict::Ambiguous)]);
        assert_eq!(ReviewVerdict::ALL.map(|verdict| file.count(verdict)), [0, 1, 1]);
        assert_eq!(ReviewFile::from_json(&file.to_json()).unwrap(), file);
    }
}

//! Reasons why a sentence is no task.

use std::collections::BTreeMap;

use super::counted;

/// Reason why a sentence is no task, as a question to its author.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SentenceError {
    /// The sentence is outside the grammar of requests.
    #[error("the sentence is not understood: `{sentence}`: {why}")]
    Unreadable {
        /// The whole sentence, verbatim.
        sentence: String,
        /// Words that were not understood, or the reason why they state no goal.
        why: String,
    },
    /// A phrase fits no object of the catalogue.
    #[error("no object of the catalogue is `{phrase}`{}", listed(.candidates))]
    NoObject {
        /// The phrase without a matching object.
        phrase: String,
        /// Names of objects that share a word with the phrase.
        candidates: Vec<String>,
    },
    /// The phrase fits objects, but none of them can have its part in the request.
    #[error("`{phrase}` {why}{}", listed(.candidates))]
    Unsuitable {
        /// The phrase without a suitable object.
        phrase: String,
        /// Reason why the objects are unsuitable.
        why: &'static str,
        /// Names of objects that fit the phrase.
        candidates: Vec<String>,
    },
    /// No scene was found in which the sentence states one goal.
    #[error("no scene was found for the sentence in {draws} designs: {}", counted(.rejections))]
    NoScene {
        /// Number of designs tried.
        draws: usize,
        /// Number of rejections by reason.
        rejections: BTreeMap<String, usize>,
    },
}

fn listed(candidates: &[String]) -> String {
    if candidates.is_empty() { String::new() } else { format!("; candidates: {}", candidates.join(", ")) }
}

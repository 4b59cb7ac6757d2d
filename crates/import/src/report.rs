//! What was guessed about an object, and why.

use serde::{Deserialize, Serialize};

/// Something that the files do not say.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guess {
    /// Which quantity, e.g. `unit`.
    pub what: String,
    /// What was taken.
    pub value: String,
    /// Why.
    pub because: String,
}

impl Guess {
    /// A guess.
    pub fn new(what: impl Into<String>, value: impl Into<String>, because: impl Into<String>) -> Self {
        Self { what: what.into(), value: value.into(), because: because.into() }
    }
}

/// How an object came in.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Everything that was guessed.
    pub guesses: Vec<Guess>,
    /// What was mended, scaled down or left out.
    pub repairs: Vec<String>,
}

//! Import report: guesses and repairs.

use serde::{Deserialize, Serialize};

/// A guessed property that the files do not specify.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guess {
    /// Property, e.g. `unit`.
    pub what: String,
    /// Value that was chosen, with its unit.
    pub value: String,
    /// Reason for the choice.
    pub because: String,
}

impl Guess {
    /// A guess with its reason.
    pub fn new(what: impl Into<String>, value: impl Into<String>, because: impl Into<String>) -> Self {
        Self { what: what.into(), value: value.into(), because: because.into() }
    }
}

/// Guesses and repairs of an import.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Report {
    /// Guessed properties.
    pub guesses: Vec<Guess>,
    /// Repairs, downscaled textures and omissions.
    pub repairs: Vec<String>,
}

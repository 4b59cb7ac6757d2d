//! Verdicts that explain themselves.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Atom;

/// The judgement of a goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GoalVerdict {
    /// Fraction of atoms that hold in the best alternative, 0-1.
    pub score: f64,
    /// Whether every atom of some alternative holds.
    pub success: bool,
    /// One list of judged atoms per alternative.
    pub alternatives: Vec<Vec<AtomVerdict>>,
}

/// The judgement of one condition.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AtomVerdict {
    /// The condition.
    pub atom: Atom,
    /// Whether it holds.
    pub holds: bool,
    /// How far the deciding quantity is from flipping the verdict, in that quantity's unit; negative when the
    /// condition does not hold.
    pub margin: f64,
    /// What was measured, the deciding quantity first.
    pub measurements: Vec<Measurement>,
    /// The verdict in words, e.g. `left: gap 0.042 m ≤ 0.150 m`.
    pub explanation: String,
}

/// One measured quantity with its threshold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Measurement {
    /// What was measured, e.g. `gap in the plane`.
    pub quantity: String,
    /// The value.
    pub value: f64,
    /// What it is compared with.
    pub threshold: f64,
    /// Unit, e.g. `m`, `1`, `rad`.
    pub unit: String,
    /// Whether this part of the condition is met.
    pub met: bool,
    /// Distance to the threshold, positive when met.
    pub margin: f64,
}

impl GoalVerdict {
    /// From judged alternatives.
    pub fn from_alternatives(alternatives: Vec<Vec<AtomVerdict>>) -> Self {
        let score = alternatives
            .iter()
            .filter(|atoms| !atoms.is_empty())
            .map(|atoms| atoms.iter().filter(|atom| atom.holds).count() as f64 / atoms.len() as f64)
            .fold(0.0, f64::max);
        Self { score, success: score >= 1.0, alternatives }
    }

    /// The alternative with the largest fraction of true atoms, the first of equals.
    pub fn best(&self) -> Option<&[AtomVerdict]> {
        let fraction =
            |atoms: &[AtomVerdict]| atoms.iter().filter(|atom| atom.holds).count() as f64 / atoms.len().max(1) as f64;
        self.alternatives.iter().map(Vec::as_slice).reduce(
            |best, next| {
                if fraction(next) > fraction(best) { next } else { best }
            },
        )
    }
}

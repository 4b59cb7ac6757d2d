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
    /// condition does not hold. Verdicts are compared by [`Self::normalised_margin`].
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
    /// Unit of value, threshold and margin.
    pub unit: Unit,
    /// Whether this part of the condition is met.
    pub met: bool,
    /// Distance to the threshold, positive when met. Measurements are compared by [`Self::normalised_margin`].
    pub margin: f64,
}

/// Unit of a measured quantity, and the scale by which margins of different units are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// Metres.
    #[serde(rename = "m")]
    Metre,
    /// Radians.
    #[serde(rename = "rad")]
    Radian,
    /// A share, 0-1. Files written before [`Unit::Fact`] existed use it for facts, too.
    #[serde(rename = "1")]
    Share,
    /// True (1) or false (0), nothing between.
    #[serde(rename = "fact")]
    Fact,
}

impl Unit {
    /// A margin in this unit without its unit, comparable with margins of any other unit.
    ///
    /// ```
    /// use genmanip_core::Unit;
    /// // Three centimetres inside the limit are less than a bend of 40 degrees inside it.
    /// assert!(Unit::Metre.normalise(0.03) < Unit::Radian.normalise(0.7));
    /// ```
    pub fn normalise(self, margin: f64) -> f64 {
        margin / self.scale()
    }

    /// The margin that is 1 when normalised, in this unit.
    pub fn scale(self) -> f64 {
        match self {
            // Chosen: the usual distance between neighbours on the table; a thing moved by it stands elsewhere.
            Self::Metre => 0.1,
            // Chosen: a turn by it moves a neighbour at that distance by that distance.
            Self::Radian => 1.0,
            // Chosen: the whole object.
            Self::Share => 1.0,
            // Chosen: a fact outweighs every measured margin, since distances on the table are below a metre.
            Self::Fact => 0.1,
        }
    }

    /// How it is written, e.g. `m`.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Radian => "rad",
            Self::Share => "1",
            Self::Fact => "fact",
        }
    }
}

impl Measurement {
    /// The margin over the scale of its unit, without a unit; positive when met.
    pub fn normalised_margin(&self) -> f64 {
        self.unit.normalise(self.margin)
    }
}

impl AtomVerdict {
    /// The normalised margin of the deciding quantity, by which verdicts are compared; 0 when nothing was measured.
    pub fn normalised_margin(&self) -> f64 {
        self.measurements.first().map_or(0.0, Measurement::normalised_margin)
    }
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

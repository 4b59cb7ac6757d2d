//! Verdicts with the measurements that explain them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Atom;

/// Verdict on a goal, with the verdicts on its conditions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GoalVerdict {
    /// Fraction of atoms that hold in the best alternative, 0-1.
    pub score: f64,
    /// True if every atom of some alternative holds.
    pub success: bool,
    /// Verdicts on the atoms of each alternative.
    pub alternatives: Vec<Vec<AtomVerdict>>,
}

/// Verdict on one condition, with the measurements behind it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AtomVerdict {
    /// The condition that was judged.
    pub atom: Atom,
    /// True if the condition holds.
    pub holds: bool,
    /// Distance of the deciding quantity from its threshold, in that quantity's unit; negative if the condition does
    /// not hold. Compare verdicts by [`Self::normalised_margin`].
    pub margin: f64,
    /// Measurements that decide the condition, the deciding quantity first.
    pub measurements: Vec<Measurement>,
    /// Measurements of readings of the relation that do not count in this world, such as *between* in space.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub other_readings: Vec<Measurement>,
    /// Explanation in words and numbers, e.g. `left: gap 0.042 m ≤ 0.150 m`.
    pub explanation: String,
}

/// A measured quantity with its threshold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Measurement {
    /// Name of the quantity, e.g. `gap in the plane`.
    pub quantity: String,
    /// Measured value, in `unit`.
    pub value: f64,
    /// Threshold of the value, in `unit`.
    pub threshold: f64,
    /// Unit of value, threshold and margin.
    pub unit: Unit,
    /// True if this part of the condition is met.
    pub met: bool,
    /// Distance to the threshold, positive if met. Compare measurements by [`Self::normalised_margin`].
    pub margin: f64,
}

/// Unit of a measured quantity, with the scale for comparing margins across units.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Unit {
    /// Metres.
    #[serde(rename = "m")]
    Metre,
    /// Radians.
    #[serde(rename = "rad")]
    Radian,
    /// A fraction, 0-1. Files written before [`Unit::Fact`] existed also use it for facts.
    #[serde(rename = "1")]
    Share,
    /// Boolean: true (1) or false (0).
    #[serde(rename = "fact")]
    Fact,
}

impl Unit {
    /// Converts a margin in this unit to a dimensionless one that is comparable across units.
    ///
    /// ```
    /// use genmanip_core::Unit;
    /// // 3 cm within a limit is less than 40 degrees within another.
    /// assert!(Unit::Metre.normalise(0.03) < Unit::Radian.normalise(0.7));
    /// ```
    pub fn normalise(self, margin: f64) -> f64 {
        margin / self.scale()
    }

    /// Margin in this unit that normalises to 1.
    pub fn scale(self) -> f64 {
        match self {
            // Chosen: typical distance between neighbours on the table.
            Self::Metre => 0.1,
            // Chosen: a rotation that moves a neighbour at that distance by that distance.
            Self::Radian => 1.0,
            // Chosen: the whole range from 0 to 1.
            Self::Share => 1.0,
            // Chosen: a fact (margin 1) counts as 10, which outweighs every measured margin, because distances on the
            // table are below a metre.
            Self::Fact => 0.1,
        }
    }

    /// Unit symbol, e.g. `m`.
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
    /// Dimensionless margin; positive if met.
    pub fn normalised_margin(&self) -> f64 {
        self.unit.normalise(self.margin)
    }
}

impl AtomVerdict {
    /// Dimensionless margin of the deciding quantity, for comparing verdicts; 0 without measurements.
    pub fn normalised_margin(&self) -> f64 {
        self.measurements.first().map_or(0.0, Measurement::normalised_margin)
    }
}

impl GoalVerdict {
    /// Goal verdict of judged alternatives.
    pub fn from_alternatives(alternatives: Vec<Vec<AtomVerdict>>) -> Self {
        let score = alternatives
            .iter()
            .filter(|atoms| !atoms.is_empty())
            .map(|atoms| atoms.iter().filter(|atom| atom.holds).count() as f64 / atoms.len() as f64)
            .fold(0.0, f64::max);
        Self { score, success: score >= 1.0, alternatives }
    }

    /// The alternative with the largest fraction of true atoms, the first on a tie; `None` without alternatives.
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

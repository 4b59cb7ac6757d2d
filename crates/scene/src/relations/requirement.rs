//! Verdicts from requirements: what has to be true, how far it is from being otherwise, in words.

use genmanip_core::{Atom, AtomVerdict, Measurement};

/// Metres that one unit is worth when requirements are compared with each other: a radian at the usual spacing of
/// neighbours is about a decimetre, and so is a whole object.
fn metres_per(unit: &str) -> f64 {
    if unit == "m" { 1.0 } else { 0.1 }
}

/// The quantity of a contact that has sunk in.
pub(super) const SINKING: &str = "sinking";

/// One thing that has to be true for a condition to hold.
#[derive(Clone, Debug)]
pub(super) struct Requirement {
    quantity: &'static str,
    value: f64,
    threshold: f64,
    unit: &'static str,
    comparison: &'static str,
    met: bool,
    margin: f64,
    /// Metres that one unit of the quantity is worth when requirements are compared with each other.
    metres_per_unit: f64,
}

impl Requirement {
    /// A length that must not exceed a threshold.
    pub fn at_most(quantity: &'static str, value: f64, threshold: f64) -> Self {
        let margin = threshold - value;
        Self {
            quantity,
            value,
            threshold,
            unit: "m",
            comparison: "≤",
            met: margin >= 0.0,
            margin,
            metres_per_unit: 1.0,
        }
    }

    /// A length that must reach a threshold.
    pub fn at_least(quantity: &'static str, value: f64, threshold: f64) -> Self {
        let margin = value - threshold;
        Self {
            quantity,
            value,
            threshold,
            unit: "m",
            comparison: "≥",
            met: margin >= 0.0,
            margin,
            metres_per_unit: 1.0,
        }
    }

    /// A length that must exceed a threshold.
    pub fn above(quantity: &'static str, value: f64, threshold: f64) -> Self {
        let margin = value - threshold;
        Self { quantity, value, threshold, unit: "m", comparison: ">", met: margin > 0.0, margin, metres_per_unit: 1.0 }
    }

    /// The same quantity in a unit.
    pub fn in_unit(self, unit: &'static str) -> Self {
        Self { unit, metres_per_unit: metres_per(unit), ..self }
    }

    /// A requirement without a measure: 1 of 1 when met.
    pub fn fact(quantity: &'static str, met: bool) -> Self {
        let value = if met { 1.0 } else { 0.0 };
        let margin = if met { 1.0 } else { -1.0 };
        Self { quantity, value, threshold: 1.0, unit: "1", comparison: "=", met, margin, metres_per_unit: 1.0 }
    }

    /// Whether it is met.
    pub fn met(&self) -> bool {
        self.met
    }

    /// Margin in metres, also of what is not a length.
    pub fn weight(&self) -> f64 {
        self.margin * self.metres_per_unit
    }
}

/// The smallest margin in metres; negative when something is not met.
pub(super) fn margin(requirements: &[Requirement]) -> f64 {
    // What is met at a margin of zero must not pass for more than what is not met.
    let signed = |requirement: &Requirement| {
        if requirement.met { requirement.weight().max(0.0) } else { requirement.weight().min(-f64::MIN_POSITIVE) }
    };
    requirements.iter().map(signed).fold(f64::INFINITY, f64::min)
}

/// Whether every measured quantity is farther from its threshold than a margin in metres, so that another way of
/// measuring should come to the same verdict; a tenth of a share and a tenth of a radian count as a centimetre.
///
/// How deep a contact has sunk in is left out where it is allowed: between solid bodies it is never far from its limit.
pub fn is_clear(verdict: &AtomVerdict, margin_m: f64) -> bool {
    verdict.measurements.iter().all(|measured| {
        measured.margin.abs() * metres_per(&measured.unit) > margin_m || (measured.quantity == SINKING && measured.met)
    })
}

/// The verdict of a condition that holds when every requirement is met.
pub(super) fn verdict(atom: &Atom, word: &str, mut requirements: Vec<Requirement>) -> AtomVerdict {
    // The deciding one first: the one to change for the verdict to change.
    requirements.sort_by(|a, b| a.met.cmp(&b.met).then(a.weight().total_cmp(&b.weight())));
    let holds = requirements.iter().all(Requirement::met);
    let named = |requirement: &Requirement| {
        let Requirement { quantity, value, threshold, unit, comparison, met, .. } = requirement;
        match (*unit, met) {
            ("1", true) if *comparison == "=" => (*quantity).to_owned(),
            ("1", false) if *comparison == "=" => format!("not {quantity}"),
            ("1", true) => format!("{quantity} {value:.3} {comparison} {threshold:.3}"),
            ("1", false) => format!("{quantity} {value:.3}, not {comparison} {threshold:.3}"),
            (_, true) => format!("{quantity} {value:.3} {unit} {comparison} {threshold:.3} {unit}"),
            (_, false) => format!("{quantity} {value:.3} {unit}, not {comparison} {threshold:.3} {unit}"),
        }
    };
    let told: Vec<String> = requirements.iter().filter(|requirement| holds || !requirement.met).map(named).collect();
    let not = if holds { "" } else { "not " };
    AtomVerdict {
        atom: atom.clone(),
        holds,
        margin: requirements.first().map_or(0.0, |first| first.margin),
        explanation: format!("{not}{word}: {}", told.join("; ")),
        measurements: requirements
            .into_iter()
            .map(|requirement| Measurement {
                quantity: requirement.quantity.into(),
                value: requirement.value,
                threshold: requirement.threshold,
                unit: requirement.unit.into(),
                met: requirement.met,
                margin: requirement.margin,
            })
            .collect(),
    }
}

//! Combines requirements into verdicts with values, distances from the thresholds and an explanation.

use std::cmp::Ordering;

use genmanip_core::{Atom, AtomVerdict, Measurement, Unit};

/// Name of the quantity that measures the penetration of a contact.
pub(super) const SINKING: &str = "sinking";

/// One necessary part of a condition.
#[derive(Clone, Debug)]
pub(super) struct Requirement {
    quantity: &'static str,
    value: f64,
    threshold: f64,
    unit: Unit,
    comparison: &'static str,
    met: bool,
    margin: f64,
}

impl Requirement {
    /// Requirement that a length (m) does not exceed a threshold.
    pub fn at_most(quantity: &'static str, value: f64, threshold: f64) -> Self {
        let margin = threshold - value;
        Self { quantity, value, threshold, unit: Unit::Metre, comparison: "≤", met: margin >= 0.0, margin }
    }

    /// Requirement that a length (m) reaches a threshold.
    pub fn at_least(quantity: &'static str, value: f64, threshold: f64) -> Self {
        let margin = value - threshold;
        Self { quantity, value, threshold, unit: Unit::Metre, comparison: "≥", met: margin >= 0.0, margin }
    }

    /// Requirement that a length (m) exceeds a threshold.
    pub fn above(quantity: &'static str, value: f64, threshold: f64) -> Self {
        let margin = value - threshold;
        Self { quantity, value, threshold, unit: Unit::Metre, comparison: ">", met: margin > 0.0, margin }
    }

    /// The same requirement with the quantity in another unit.
    pub fn in_unit(self, unit: Unit) -> Self {
        Self { unit, ..self }
    }

    /// Requirement without a measured quantity: value 1 if met, otherwise 0, with threshold 1.
    pub fn fact(quantity: &'static str, met: bool) -> Self {
        let (value, margin) = if met { (1.0, 1.0) } else { (0.0, -1.0) };
        Self { quantity, value, threshold: 1.0, unit: Unit::Fact, comparison: "=", met, margin }
    }

    /// The negation of a set of requirements, measured by the one that decides it. `what` must not be empty.
    pub fn clear_of(quantity: &'static str, what: &[Self]) -> Self {
        let Some(deciding) = what.iter().min_by(|a, b| a.order(b)) else { return Self::fact(quantity, false) };
        let margin = -deciding.margin;
        Self {
            quantity,
            value: margin,
            threshold: 0.0,
            unit: deciding.unit,
            comparison: ">",
            met: !deciding.met,
            margin,
        }
    }

    /// Measurement with value, threshold and margin, without the comparison sign.
    pub fn measurement(self) -> Measurement {
        let Self { quantity, value, threshold, unit, comparison: _, met, margin } = self;
        Measurement { quantity: quantity.into(), value, threshold, unit, met, margin }
    }

    /// True if the requirement is met.
    pub fn met(&self) -> bool {
        self.met
    }

    /// Orders unmet requirements first, then by distance to the threshold; among unmet ones the farthest comes first.
    fn order(&self, other: &Self) -> Ordering {
        self.met.cmp(&other.met).then(self.normalised_margin().total_cmp(&other.normalised_margin()))
    }

    fn normalised_margin(&self) -> f64 {
        self.unit.normalise(self.margin)
    }
}

/// The alternative way to meet a condition that is closer to being met, or farther from failing; the first if equal.
pub(super) fn better(one: Vec<Requirement>, other: Vec<Requirement>) -> Vec<Requirement> {
    let deciding = |requirements: &[Requirement]| requirements.iter().min_by(|a, b| a.order(b)).cloned();
    match (deciding(&one), deciding(&other)) {
        (Some(a), Some(b)) if a.order(&b).is_lt() => other,
        _ => one,
    }
}

/// True if every measured quantity is farther from its threshold than a margin in metres, so that another measurement
/// should give the same verdict. Other units are converted, see [`Unit::normalise`].
///
/// Permitted penetration of contacts is ignored: between solid bodies it is always close to its limit.
pub fn is_clear(verdict: &AtomVerdict, margin_m: f64) -> bool {
    verdict.measurements.iter().all(|measured| {
        measured.normalised_margin().abs() > Unit::Metre.normalise(margin_m)
            || (measured.quantity == SINKING && measured.met)
    })
}

/// The verdict of a condition that holds if every requirement is met.
pub(super) fn verdict(atom: &Atom, word: &str, mut requirements: Vec<Requirement>) -> AtomVerdict {
    // The deciding requirement comes first: the one that has to change for the verdict to change.
    requirements.sort_by(Requirement::order);
    let holds = requirements.iter().all(Requirement::met);
    let named = |requirement: &Requirement| {
        let Requirement { quantity, value, threshold, unit, comparison, met, .. } = requirement;
        let (not, unit) = (if *met { "" } else { "not " }, unit.symbol());
        match requirement.unit {
            Unit::Fact => format!("{not}{quantity}"),
            Unit::Share if *met => format!("{quantity} {value:.3} {comparison} {threshold:.3}"),
            Unit::Share => format!("{quantity} {value:.3}, not {comparison} {threshold:.3}"),
            Unit::Metre | Unit::Radian if *met => {
                format!("{quantity} {value:.3} {unit} {comparison} {threshold:.3} {unit}")
            }
            Unit::Metre | Unit::Radian => {
                format!("{quantity} {value:.3} {unit}, not {comparison} {threshold:.3} {unit}")
            }
        }
    };
    let told: Vec<String> = requirements.iter().filter(|requirement| holds || !requirement.met).map(named).collect();
    let not = if holds { "" } else { "not " };
    AtomVerdict {
        atom: atom.clone(),
        holds,
        margin: requirements.first().map_or(0.0, |first| first.margin),
        explanation: format!("{not}{word}: {}", told.join("; ")),
        measurements: requirements.into_iter().map(Requirement::measurement).collect(),
        other_readings: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(margin: f64) -> Requirement {
        Requirement::at_least("share", margin, 0.0).in_unit(Unit::Share)
    }

    fn length(margin: f64) -> Requirement {
        Requirement::at_least("length", margin, 0.0)
    }

    /// Checks that the deciding requirement is the one nearest to its threshold, whatever the units and order.
    #[test]
    fn the_deciding_requirement_is_the_one_nearest_to_its_threshold() {
        let atom = Atom::State { object: "057".parse().unwrap(), state: "open".into() };
        for (name, requirements, deciding) in [
            ("a few millimetres before a third of a share", vec![share(0.3), length(0.02)], ("length", 0.02)),
            ("a twentieth of a share before some centimetres", vec![length(0.02), share(0.05)], ("share", 0.05)),
            ("what fails before what holds", vec![length(0.001), share(-0.5)], ("share", -0.5)),
            ("what fails by more", vec![share(-0.5), length(-0.2)], ("length", -0.2)),
            ("a fact before all", vec![length(-0.2), Requirement::fact("at rest", false)], ("at rest", -1.0)),
        ] {
            for requirements in [requirements.clone(), requirements.into_iter().rev().collect()] {
                let verdict = verdict(&atom, "open", requirements);
                assert_eq!((verdict.measurements[0].quantity.as_str(), verdict.margin), deciding, "{name}");
                assert_eq!(verdict.holds, verdict.normalised_margin() >= 0.0, "{name}");
            }
        }
    }

    #[test]
    fn of_two_ways_the_better_one_is_told() {
        let told = |one: &[Requirement], other: &[Requirement]| better(one.to_vec(), other.to_vec())[0].margin;
        assert_eq!(told(&[share(0.3)], &[length(0.02)]), 0.3);
        assert_eq!(told(&[share(-0.3)], &[length(-0.02)]), -0.02);
        assert_eq!(told(&[share(0.0)], &[length(0.0)]), 0.0);
        assert_eq!(told(&[length(-0.0001)], &[share(0.0)]), 0.0);
    }

    #[test]
    fn to_be_clear_of_something_is_measured_in_its_unit() {
        let clear = Requirement::clear_of("clear", &[length(0.04), share(-0.45)]);
        assert_eq!((clear.value, clear.unit, clear.met), (0.45, Unit::Share, true));
        assert!(!Requirement::clear_of("clear", &[length(0.0), share(0.2)]).met, "what holds at its border holds");
    }
}

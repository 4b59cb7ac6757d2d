//! Cutting of takes into segments by joint position, object motion and contact.

use std::ops::Range;

use crate::{SkillError, skill::Segments};

/// Share of the travel that counts as motion of the joint or object: below it at the start and at the end, it is at
/// rest. Larger than play and settling, smaller than what separates two states.
const MOVED: f64 = 0.03;
/// Longest gap in a contact, control steps: pads that slide along a handle lose it for an instant.
const GAP: usize = 12;

/// Segments of an episode from the travel of what was moved (0 at the start, 1 at the end) and the contact with it, one
/// value each per control step.
///
/// The manipulation is the last motion from rest to the end of the travel; the contact is the one during which it
/// began, and the release ends with the contact in which it ended.
///
/// # Errors
/// If nothing moved, or without contact.
pub fn segments(travel: &[f64], contact: &[bool]) -> Result<Segments, SkillError> {
    let count = travel.len().min(contact.len());
    let end = travel[..count].iter().position(|share| *share >= 1.0 - MOVED);
    let end = end.ok_or(SkillError::NothingMoved)?;
    let begin = travel[..end].iter().rposition(|share| *share <= MOVED).map_or(0, |rest| rest + 1);
    let runs = runs(&contact[..count]);
    let run_at = |step: usize| runs.iter().find(|run| run.start <= step && step <= run.end + GAP);
    let (first, last) = run_at(begin).zip(run_at(end)).ok_or(SkillError::NoContact { step: begin })?;
    if first != last {
        return Err(SkillError::Released { step: first.end });
    }
    let touched = first.start.min(begin);
    let left = first.end.max(end);
    Ok(Segments {
        approach: [0, touched],
        contact: [touched, begin],
        manipulate: [begin, end],
        release: [end, left],
        retreat: [left, count],
    })
}

/// Intervals of contact, those with short gaps joined.
fn runs(contact: &[bool]) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (step, _) in contact.iter().enumerate().filter(|(_, touches)| **touches) {
        match runs.last_mut() {
            Some(run) if step <= run.end + GAP => run.end = step + 1,
            _ => runs.push(step..step + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contact at the given steps, travel as a ramp between two steps.
    fn check(count: usize, touching: &[Range<usize>], ramp: Range<usize>, expected: Result<Segments, &str>) {
        let contact: Vec<bool> = (0..count).map(|step| touching.iter().any(|run| run.contains(&step))).collect();
        let share = |step: usize| (step as f64 - ramp.start as f64) / ramp.len() as f64;
        let travel: Vec<f64> = (0..count).map(|step| share(step).clamp(0.0, 1.0)).collect();
        let got = segments(&travel, &contact);
        match expected {
            Ok(expected) => assert_eq!(got.unwrap(), expected),
            Err(text) => assert!(got.unwrap_err().to_string().contains(text)),
        }
    }

    #[test]
    fn segments_follow_contact_and_travel() {
        let whole = |a, b, c, d| Segments {
            approach: [0, a],
            contact: [a, b],
            manipulate: [b, c],
            release: [c, d],
            retreat: [d, 200],
        };
        let whole_contact = std::slice::from_ref(&(40..120));
        check(200, whole_contact, 50..100, Ok(whole(40, 52, 99, 120)));
        // A touch on the way that ended long before does not count, nor does an instant without contact.
        check(200, &[10..15, 40..70, 75..120], 50..100, Ok(whole(40, 52, 99, 120)));
        check(200, &[], 50..100, Err("contact"));
        check(200, &[40..60, 80..120], 50..100, Err("released the object"));
        check(200, whole_contact, 150..400, Err("moved"));
    }
}

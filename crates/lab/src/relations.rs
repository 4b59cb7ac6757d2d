//! Verdicts of a relation profile on recorded point clouds, compared with recorded verdicts.

use std::path::Path;

use genmanip_relations::clouds::Profile;
use genmanip_relations::clouds::cases::{Comparison, compare, compare_seed};

use crate::LabError;
use crate::clock::cpu_clock;
use genmanip_core::limits;
use genmanip_workspace::documents;

/// Maximum number of disagreements in the text summary; the JSON has all.
const SHOWN: usize = 20;

/// Judges recorded cases, whose clouds are in the `.npz` archive beside the file, with a profile: `genmanip-0.9`,
/// `suite-0.2.3`, or `seed` for the relations of this project.
///
/// # Errors
/// If the profile does not exist, or the files cannot be read or are invalid.
pub fn measure(cases: &Path, profile: &str) -> Result<Comparison, LabError> {
    let judge = if profile == "seed" { None } else { Some(compatibility(profile)?) };
    let text = documents::read_text(cases, limits::CASES)?;
    let archive = documents::read_bytes(&cases.with_extension("npz"), limits::CLOUDS)
        .map_err(|error| error.with_hint("the clouds of the cases are expected beside them, with the ending .npz"))?;
    let comparison = match judge {
        Some(profile) => compare(&text, &archive, profile, &mut cpu_clock()),
        None => compare_seed(&text, &archive, &mut cpu_clock()),
    };
    comparison.map_err(|error| {
        LabError::broken(format!("cannot compare {}", cases.display()), error)
            .with_hint("expected recorded cases as JSON, and their clouds in the .npz beside it")
    })
}

fn compatibility(profile: &str) -> Result<Profile, LabError> {
    serde_json::from_value(profile.into()).map_err(|_| {
        LabError::input(format!("there is no profile `{profile}`"))
            .with_hint("expected genmanip-0.9, suite-0.2.3 or seed")
    })
}

/// Text summary.
pub fn describe(comparison: &Comparison) -> String {
    let mut text = format!(
        "cases         {} of {} agree, {} excluded\ngoals         {} of {} agree\narticulation  {} of {} agree\n\
         speed         {:.0} calls per CPU second\n",
        comparison.agreed,
        comparison.compared,
        comparison.excluded,
        comparison.dnf_agreed,
        comparison.dnf_compared,
        comparison.articulation_agreed,
        comparison.articulation_compared,
        comparison.calls_per_cpu_s,
    );
    for disagreement in comparison.disagreements.iter().take(SHOWN) {
        text += &format!("  {disagreement}\n");
    }
    let hidden = comparison.disagreements.len().saturating_sub(SHOWN);
    if hidden > 0 {
        text += &format!("  and {hidden} more; --json lists all\n");
    }
    text
}

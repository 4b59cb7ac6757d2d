//! `genmanip lab relations`.

use std::fs;
use std::io::Read;

use genmanip_scene::clouds::Profile;
use genmanip_scene::clouds::cases::{Comparison, compare, compare_seed};

use super::{cpu_clock, rendered};
use crate::args::RelationsArguments;
use crate::error::{ExitStatus, Failed};
use crate::inputs;
use crate::printer::Printer;

/// Largest file of cases or clouds, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Disagreements that are printed for people; the JSON has all.
const SHOWN: usize = 20;

pub fn run(arguments: &RelationsArguments, printer: &Printer) -> Result<ExitStatus, Failed> {
    let (Some(cases), Some(profile)) = (&arguments.cases, &arguments.profile) else {
        return rendered::run(&arguments.tasks, arguments.seed, arguments.count, printer);
    };
    let judge = if profile == "seed" { None } else { Some(compatibility(profile)?) };
    let text = inputs::read_text(cases, MAX_BYTES)?;
    let archive = read_bytes(&cases.with_extension("npz"))?;
    let comparison = match judge {
        Some(profile) => compare(&text, &archive, profile, &mut cpu_clock()),
        None => compare_seed(&text, &archive, &mut cpu_clock()),
    };
    let comparison = comparison.map_err(|error| {
        Failed::because(format!("cannot compare {}", cases.display()), &error)
            .hint("expected recorded cases as JSON, and their clouds in the .npz beside it")
    })?;
    printer.data(&comparison, &in_words(&comparison));
    Ok(ExitStatus::Done)
}

fn compatibility(profile: &str) -> Result<Profile, Failed> {
    serde_json::from_value(profile.into()).map_err(|_| {
        Failed::new(format!("there is no profile `{profile}`")).hint("expected genmanip-0.9, suite-0.2.3 or seed")
    })
}

fn read_bytes(path: &std::path::Path) -> Result<Vec<u8>, Failed> {
    let unreadable = |error: &std::io::Error| {
        Failed::because(format!("cannot read {}", path.display()), error)
            .hint("the clouds of the cases are expected beside them, with the ending .npz")
    };
    let file = fs::File::open(path).map_err(|error| unreadable(&error))?;
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1).read_to_end(&mut bytes).map_err(|error| unreadable(&error))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Failed::new(format!("{} is larger than {} MiB", path.display(), MAX_BYTES >> 20)));
    }
    Ok(bytes)
}

fn in_words(comparison: &Comparison) -> String {
    let mut text = format!(
        "cases         {} of {} agree, {} excluded\ngoals         {} of {} agree\narticulation  {} of {} agree\n\
         speed         {:.0} calls per processor second\n",
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

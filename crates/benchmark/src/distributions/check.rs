//! Integrity check of a suite of task distributions.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::worlds::default_world;
use genmanip_motion::PlannerSettings;
use genmanip_rollout::collect::{Resources, in_parallel};
use genmanip_tasks::references;
use genmanip_workspace::{Progress, WorkspaceError, worlds};
use serde::Serialize;

use super::format::{Distribution, Split};
use super::frozen::layout_hash;
use super::suite::{Distributions, DrawnTask};

/// Number of layouts of each split of a distribution that are checked unless all are.
const SAMPLE: u64 = 2;

/// Result of the integrity check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DistributionsCheck {
    /// Name of the suite.
    pub name: String,
    /// Number of frozen layouts, all of which are compared with each other.
    pub frozen: usize,
    /// Number of layouts that were made again and compared with their frozen hash.
    pub checked: usize,
    /// Notes that are no faults, one per line: sentences that the rule-based reader cannot parse.
    pub notes: Vec<String>,
    /// Faults, one per line; empty for an intact suite.
    pub faults: Vec<String>,
}

/// Checks that no two frozen layouts are equal. For a sample of every split, or for all layouts, also checks that the
/// sentence means the goal, and that the layout made again has the frozen hash. `None` if interrupted.
///
/// # Errors
/// If a file of the suite cannot be read.
pub fn check(
    folder: &Path,
    all: bool,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<DistributionsCheck>, WorkspaceError> {
    let suite = Distributions::open(folder)?;
    let (frozen, mut faults) = compare(&suite);
    let sampled = sample(&suite, all);
    let world = suite.judged_in(&default_world());
    let planner = worlds::planner(&world, &PlannerSettings::default())?;
    let resources = Resources::builtin(&planner);
    progress.begin("checking layouts", sampled.len());
    let one = |drawn: &DrawnTask| -> Result<Finding, WorkspaceError> {
        let mut finding = Finding::default();
        let DrawnTask { task, hash, .. } = drawn;
        if let Err(mismatch) = references::check(task) {
            let said = format!("{}: \"{}\": {mismatch}", task.id, task.instruction);
            let is_note = references::is_beyond_the_reader(task, &mismatch);
            if is_note { &mut finding.notes } else { &mut finding.faults }.push(said);
        }
        match suite.lay_out(task, resources, &world) {
            Ok(scenario) => {
                let today = layout_hash(&scenario);
                if let Some(hash) = hash.as_ref().filter(|hash| **hash != today) {
                    finding.faults.push(format!("{}: its layout is {today}, not {hash} as it was frozen", task.id));
                }
            }
            Err(error) => finding.faults.push(error.to_string()),
        }
        progress.advance();
        Ok(finding)
    };
    let findings = in_parallel(&sampled, workers, stop, &one)?;
    progress.end();
    let checked = findings.len();
    let mut notes = Vec::new();
    for finding in findings {
        faults.extend(finding.faults);
        notes.extend(finding.notes);
    }
    let name = suite.file.name;
    // An interrupted check does not prove integrity.
    Ok((!stop.load(Ordering::Relaxed)).then_some(DistributionsCheck { name, frozen, checked, notes, faults }))
}

#[derive(Default)]
struct Finding {
    notes: Vec<String>,
    faults: Vec<String>,
}

/// Number of frozen layouts, and faults: missing layouts, and equal ones.
pub(super) fn compare(suite: &Distributions) -> (usize, Vec<String>) {
    let (mut places, mut faults) = (BTreeMap::new(), Vec::new());
    let mut frozen = 0;
    for (Distribution { name, .. }, split) in pairs(suite) {
        let layouts = suite.frozen_layouts(name, split);
        let size = suite.file.size(split);
        if layouts.len() as u64 != size {
            faults.push(format!("{name} {}: {} of {size} layouts are frozen", split.name(), layouts.len()));
        }
        for (number, layout) in layouts.iter().enumerate() {
            frozen += 1;
            let place = format!("{name}-{}-{number:04}", split.name());
            if let Some(other) = places.insert(layout.hash.as_str(), place.clone()) {
                faults.push(format!("{place} is the layout of {other}"));
            }
        }
    }
    (frozen, faults)
}

/// Layouts to make again: all, or [`SAMPLE`] of every split, evenly spread.
fn sample(suite: &Distributions, all: bool) -> Vec<DrawnTask> {
    let mut sampled = Vec::new();
    for (distribution, split) in pairs(suite) {
        let size = suite.file.size(split);
        let count = if all { size } else { SAMPLE.min(size) };
        sampled.extend((0..count).map(|place| suite.layout(distribution, split, place * size / count)));
    }
    sampled
}

fn pairs(suite: &Distributions) -> impl Iterator<Item = (&Distribution, Split)> {
    suite.file.distributions.iter().flat_map(|one| Split::ALL.into_iter().map(move |split| (one, split)))
}

/// Text summary.
pub fn describe(checked: &DistributionsCheck) -> String {
    let DistributionsCheck { name, frozen, checked, notes, faults } = checked;
    let mut text = format!("{name}: {frozen} frozen layouts, {checked} of them made anew\n");
    for note in notes {
        text += &format!("  note: {note}\n");
    }
    for fault in faults {
        text += &format!("  {fault}\n");
    }
    if faults.is_empty() {
        text += "no two layouts are equal, and each that was made anew is as it was frozen\n";
    }
    text
}

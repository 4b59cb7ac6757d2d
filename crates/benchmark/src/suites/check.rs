//! Integrity check of a suite.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::suite_format::{Marginal, SuiteFile, marginals, sha256, template};
use crate::suite_hash;
use genmanip_assets::{AssetSource, Catalogue, FrozenAsset};
use genmanip_core::{Scenario, limits};
use genmanip_rollout::Stage;
use genmanip_tasks::references::{self, Clue, is_needless};
use serde::Serialize;

use super::pictures::draw;
use super::{SuiteAssets, open, scenario_file};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::scenarios;
use genmanip_workspace::worlds;

/// Maximum number of differing JSON paths named per object.
const MAX_PLACES: usize = 3;

/// Result of the integrity check.
#[derive(Clone, Debug, Serialize)]
pub struct SuiteCheck {
    /// Name of the suite.
    pub name: String,
    /// Number of scenarios read.
    pub scenarios: usize,
    /// Largest relative deviation of a trait value from its even share.
    pub worst_marginal: f64,
    /// Share of scenarios with the most frequent sentence template, 0 to 1.
    pub template_share: f64,
    /// Notes that are no faults, one per line: frozen objects that the catalogue now generates differently, and
    /// recorded
    /// sentences that the rule-based reader cannot parse.
    pub notes: Vec<String>,
    /// Faults, one per line; empty for an intact suite.
    pub faults: Vec<String>,
}

/// Checks every scenario of a suite: hash of its file, objects, agreement of sentence and goal, and that the goal is
/// unclear without the property that defines the kind. `None` if interrupted.
///
/// # Errors
/// If the suite's file cannot be read; an unreadable scenario is a fault.
pub fn check(
    folder: &Path,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteCheck>, WorkspaceError> {
    let suite = open(folder)?;
    let mut notes = Vec::new();
    let mut faults =
        strangers(folder, "scenarios", &suite.scenarios.iter().map(|it| format!("{}.json", it.id)).collect())?;
    if !suite.assets.is_empty() {
        faults.extend(strangers(folder, "assets", &suite.assets.iter().map(|it| it.file.clone()).collect())?);
    }
    let own = SuiteAssets::of(folder, &suite);
    let source: &dyn AssetSource = own.as_ref().map_or(Catalogue::builtin(), |own| own);
    let mut scenarios = Vec::new();
    for entry in &suite.scenarios {
        let mut fault = |what: String| faults.push(format!("{}: {what}", entry.id));
        let path = scenario_file(folder, &entry.id);
        let sha256 = match documents::read_bytes(&path, limits::SCENARIO) {
            Ok(bytes) => sha256(&bytes),
            Err(error) => {
                fault(error.to_string());
                continue;
            }
        };
        if sha256 != entry.sha256 {
            fault(format!("is not as it was frozen: its SHA-256 begins with {:.12}, not {:.12}", sha256, entry.sha256));
        }
        let scenario = match scenarios::read_scenario(&path) {
            Ok(scenario) => scenario,
            Err(error) => {
                fault(error.to_string());
                continue;
            }
        };
        if scenario.id != entry.id {
            fault(format!("calls itself {}", scenario.id));
        }
        match references::check(&scenario.task) {
            Ok(()) => {}
            // The rule-based reader may fail to parse sentences of people or language models.
            Err(mismatch) if references::is_beyond_the_reader(&scenario.task, &mismatch) => {
                notes.push(format!("{}: the reader does not follow: {mismatch}", entry.id));
            }
            Err(mismatch) => fault(format!("its sentence does not mean its goal: {mismatch}")),
        }
        // The alternative request is a pick_and_place task, whose kind has no defining property.
        if Clue::of(scenario.task.kind).is_some_and(|clue| is_needless(&scenario.task, clue)) {
            fault("its goal is clear without what its kind is about".into());
        }
        if entry.certificate.verified < entry.certificate.episodes || entry.certificate.episodes == 0 {
            fault("has no certificate".into());
        }
        // Opening the stage fails if the hash of an object's physics differs from the one in the scenario.
        let robot = worlds::robot(&scenario.world)?;
        if let Err(error) = Stage::open(Arc::new(scenario.clone()), source, &robot) {
            fault(error.to_string());
        }
        scenarios.push(scenario);
    }
    if suite_hash(&scenarios) != suite.suite_hash {
        faults.push(format!("the scenarios together are not those of suite {}", suite.suite_hash));
    }
    for review in super::reviews(folder)?.stale(&suite) {
        faults.push(format!("{}: {} looked at another one of this name", review.scenario, review.reviewer));
    }
    let differences = match &own {
        Some(own) => differences(folder, &suite, own, &scenarios, workers, progress, stop)?,
        None => Differences::default(),
    };
    faults.extend(differences.faults);
    let spread = marginals(suite.scenarios.iter().map(|entry| &entry.traits));
    let worst = spread.iter().map(Marginal::deviation).fold(0.0, f64::max);
    let template_share = template_share(&scenarios);
    notes.extend(differences.notes);
    let name = suite.name;
    // An interrupted check does not prove integrity.
    let checked = SuiteCheck { name, scenarios: scenarios.len(), worst_marginal: worst, template_share, notes, faults };
    Ok((!stop.load(Ordering::Relaxed)).then_some(checked))
}

/// Differences from the frozen state (faults) and from the current catalogue (notes), one text each.
#[derive(Default)]
struct Differences {
    faults: Vec<String>,
    notes: Vec<String>,
}

/// Compares the frozen objects with their files and with the catalogue, and the image hashes with those of newly
/// rendered images.
fn differences(
    folder: &Path,
    suite: &SuiteFile,
    source: &SuiteAssets,
    scenarios: &[Scenario],
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Differences, WorkspaceError> {
    let mut found = Differences::default();
    for file in &suite.assets {
        let frozen = match SuiteAssets::read(folder, file) {
            Ok(frozen) => frozen,
            Err(fault) => {
                found.faults.push(fault);
                continue;
            }
        };
        if let Err(error) = source.model(&file.asset) {
            found.faults.push(error.to_string());
        }
        match FrozenAsset::of(&file.asset, Catalogue::builtin()) {
            Ok(mut today) => {
                // Suites that were frozen with full-resolution meshes are compared with the catalogue's full-resolution
                // model.
                if Catalogue::builtin().full_mesh_model(&file.asset).is_ok_and(|(_, looks)| looks == frozen.looks_hash)
                {
                    today.looks_hash.clone_from(&frozen.looks_hash);
                }
                let places = frozen.differences(&today, MAX_PLACES);
                if !places.is_empty() {
                    found.notes.push(format!("assets/{}: the catalogue has another {}", file.file, places.join(", ")));
                }
            }
            Err(error) => found.notes.push(format!("assets/{}: {error}", file.file)),
        }
    }
    if found.faults.is_empty()
        && let Some(pictures) = draw(scenarios, source, workers, progress, stop)?
    {
        for (scenario, pictures) in scenarios.iter().zip(pictures) {
            let Some(entry) = suite.scenarios.iter().find(|entry| entry.id == scenario.id) else { continue };
            // Cameras of both, so that one that is missing on either side is a difference.
            let all = pictures.keys().chain(entry.pictures.keys()).collect::<BTreeSet<_>>();
            let other = all.into_iter().filter(|camera| pictures.get(*camera) != entry.pictures.get(*camera));
            let cameras: Vec<&str> = other.map(String::as_str).collect();
            if !cameras.is_empty() {
                found.faults.push(format!("{}: looks otherwise through {}", scenario.id, cameras.join(", ")));
            }
        }
    }
    Ok(found)
}

fn template_share(scenarios: &[Scenario]) -> f64 {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for scenario in scenarios {
        *counts.entry(template(&scenario.task.instruction)).or_default() += 1;
    }
    counts.values().max().map_or(0.0, |&most| most as f64 / scenarios.len() as f64)
}

/// Faults for files in a folder of the suite that `suite.json` does not list.
fn strangers(folder: &Path, inside: &str, wanted: &BTreeSet<String>) -> Result<Vec<String>, WorkspaceError> {
    let path = folder.join(inside);
    let entries = fs::read_dir(&path).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
    let entries = entries.map_err(|error| WorkspaceError::file("list", &path, error))?;
    let mut faults = Vec::new();
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !wanted.contains(&name) {
            faults.push(format!("{inside}/{name} belongs to no scenario of the suite"));
        }
    }
    faults.sort();
    Ok(faults)
}

/// Text summary.
pub fn describe(checked: &SuiteCheck) -> String {
    let mut text = format!(
        "{}: {} scenarios, worst marginal {:.0} % of its share, most frequent sentence {:.1} %\n",
        checked.name,
        checked.scenarios,
        100.0 * checked.worst_marginal,
        100.0 * checked.template_share
    );
    for note in &checked.notes {
        text += &format!("  note: {note}\n");
    }
    for fault in &checked.faults {
        text += &format!("  {fault}\n");
    }
    if checked.faults.is_empty() {
        text += "every scenario is as it was frozen\n";
    }
    text
}

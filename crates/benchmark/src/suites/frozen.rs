//! Writing of a suite, shared by building and perturbing: trials by scenario, certificates.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::suite_format::{BuildStep, Certificate, Perturbation, SuiteEntry, SuiteFile};
use crate::suite_hash;
use genmanip_core::{Document, EpisodeResult, Scenario, Seed};

use super::scenario_file;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;

/// Content of `suite.json` apart from its scenarios.
pub struct SuiteHeader {
    /// Name of the suite.
    pub name: String,
    /// Seed it was built from.
    pub seed: Seed,
    /// Scenarios of each kind.
    pub per_kind: usize,
    /// Perturbation of the suite it was made from, if any.
    pub perturbation: Option<Perturbation>,
    /// Candidates that passed each build step.
    pub funnel: Vec<BuildStep>,
}

/// Rejects a folder that already holds a suite.
///
/// # Errors
/// If `suite.json` exists.
pub fn refuse_another(folder: &Path) -> Result<(), WorkspaceError> {
    let file = folder.join("suite.json");
    match file.exists() {
        true => Err(WorkspaceError::input(format!("{} exists", file.display()))
            .with_hint("a suite is frozen: choose another --out folder")),
        false => Ok(()),
    }
}

/// Results by the id of their scenario.
pub fn by_scenario(results: Vec<EpisodeResult>) -> BTreeMap<String, Vec<EpisodeResult>> {
    let mut grouped: BTreeMap<String, Vec<EpisodeResult>> = BTreeMap::new();
    for result in results {
        grouped.entry(result.scenario_id.clone()).or_default().push(result);
    }
    grouped
}

/// Certificate of a scenario: shortest path (m) and time (s) of the expert's verified trials.
pub fn certificate(trials: &[EpisodeResult]) -> Certificate {
    let verified = || trials.iter().filter(|trial| trial.success);
    let least = |value: fn(&EpisodeResult) -> f64| verified().map(value).fold(f64::INFINITY, f64::min);
    Certificate {
        episodes: trials.len(),
        verified: verified().count(),
        shortest_path_m: least(|trial| trial.tcp_path_m),
        shortest_s: least(|trial| trial.duration_s),
    }
}

/// Writes the scenarios first and `suite.json` last, as a mark of completeness. Removes the folder `work`, if there
/// is one.
///
/// # Errors
/// If a file cannot be written.
pub fn write(folder: &Path, head: SuiteHeader, kept: Vec<(Scenario, SuiteEntry)>) -> Result<SuiteFile, WorkspaceError> {
    let (scenarios, entries): (Vec<Scenario>, Vec<SuiteEntry>) = kept.into_iter().unzip();
    for scenario in &scenarios {
        documents::write_file(&scenario_file(folder, &scenario.id), scenario.to_json().as_bytes())?;
    }
    let suite = SuiteFile {
        name: head.name,
        seed: head.seed,
        per_kind: head.per_kind,
        genmanip_version: env!("CARGO_PKG_VERSION").into(),
        engine: genmanip_sim::engine_version(),
        suite_hash: suite_hash(&scenarios),
        perturbation: head.perturbation,
        funnel: head.funnel,
        scenarios: entries,
        assets: Vec::new(),
    };
    documents::write_file(&folder.join("suite.json"), suite.to_json().as_bytes())?;
    let work = folder.join("work");
    match fs::remove_dir_all(&work) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(WorkspaceError::file("write", &work, error)),
        _ => Ok(suite),
    }
}

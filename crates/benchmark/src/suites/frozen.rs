//! Writing of a suite, shared by building and perturbing: certificates from trials, and the files.

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
    /// Seed that the suite was built from.
    pub seed: Seed,
    /// Number of scenarios requested per kind of task.
    pub per_kind: usize,
    /// Change of the original suite; `None` for a built suite.
    pub perturbation: Option<Perturbation>,
    /// Selection steps, with the number of candidates that passed each.
    pub funnel: Vec<BuildStep>,
}

/// Fails for a folder that already holds a suite.
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

/// Groups results by the id of their scenario.
pub fn by_scenario(results: Vec<EpisodeResult>) -> BTreeMap<String, Vec<EpisodeResult>> {
    let mut grouped: BTreeMap<String, Vec<EpisodeResult>> = BTreeMap::new();
    for result in results {
        grouped.entry(result.scenario_id.clone()).or_default().push(result);
    }
    grouped
}

/// Certificate of a scenario from the expert's trials: numbers, shortest path (m) and shortest time (s) of verified
/// ones.
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

/// Writes the scenarios first and `suite.json` last, so that its existence marks a complete suite. Then removes the
/// folder `work` of the build, if there is one.
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

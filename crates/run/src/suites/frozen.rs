//! Writing a suite, and what the two ways to make one share: trials by scenario, certificates.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use genmanip_bench::suite::{Certificate, Perturbation, Stage, SuiteEntry, SuiteFile};
use genmanip_bench::suite_hash;
use genmanip_core::{Document, EpisodeResult, Scenario, Seed};

use super::scenario_file;
use crate::error::RunError;
use crate::inputs;

/// What `suite.json` says of a suite besides its scenarios.
pub(super) struct Head {
    pub name: String,
    pub seed: Seed,
    pub per_kind: usize,
    pub perturbation: Option<Perturbation>,
    pub funnel: Vec<Stage>,
}

/// Refuses a folder that holds a suite already.
pub(super) fn refuse_another(folder: &Path) -> Result<(), RunError> {
    let file = folder.join("suite.json");
    match file.exists() {
        true => Err(RunError::input(format!("{} exists", file.display()))
            .with_hint("a suite is frozen: choose another --out folder")),
        false => Ok(()),
    }
}

/// Results by the id of their scenario.
pub(super) fn by_scenario(results: Vec<EpisodeResult>) -> BTreeMap<String, Vec<EpisodeResult>> {
    let mut grouped: BTreeMap<String, Vec<EpisodeResult>> = BTreeMap::new();
    for result in results {
        grouped.entry(result.scenario_id.clone()).or_default().push(result);
    }
    grouped
}

/// What the expert needed in its trials of one scenario.
pub(super) fn certificate(trials: &[EpisodeResult]) -> Certificate {
    let verified = || trials.iter().filter(|trial| trial.success);
    let least = |value: fn(&EpisodeResult) -> f64| verified().map(value).fold(f64::INFINITY, f64::min);
    Certificate {
        episodes: trials.len(),
        verified: verified().count(),
        shortest_path_m: least(|trial| trial.tcp_path_m),
        shortest_s: least(|trial| trial.duration_s),
    }
}

/// Writes the scenarios first and `suite.json` last: where it is, all is there. Removes the folder `work`.
pub(super) fn write(folder: &Path, head: Head, kept: Vec<(Scenario, SuiteEntry)>) -> Result<SuiteFile, RunError> {
    let (scenarios, entries): (Vec<Scenario>, Vec<SuiteEntry>) = kept.into_iter().unzip();
    for scenario in &scenarios {
        inputs::write_file(&scenario_file(folder, &scenario.id), scenario.to_json().as_bytes())?;
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
    inputs::write_file(&folder.join("suite.json"), suite.to_json().as_bytes())?;
    let work = folder.join("work");
    fs::remove_dir_all(&work).map_err(|error| RunError::file("write", &work, error))?;
    Ok(suite)
}

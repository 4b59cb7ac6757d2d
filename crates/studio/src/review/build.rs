//! Building of a balanced suite from approved scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use genmanip_assets::Catalogue;
use genmanip_benchmark::balance::{Choice, Offered, choice};
use genmanip_benchmark::suite_format::{BuildStep, SuiteEntry, SuiteFile, Targets, sha256};
use genmanip_benchmark::suites::candidates::traits;
use genmanip_benchmark::suites::frozen::{self, SuiteHeader};
use genmanip_core::{Document, Scenario, Seed, limits};
use genmanip_workspace::{WorkspaceError, documents, scenarios};
use serde::Serialize;

use super::content::content_sha256;
use super::desk::{ReviewDesk, Reviewable};
use super::standing::Standing;

/// A suite that was built.
#[derive(Clone, Debug, Serialize)]
pub struct Built {
    /// Content of its `suite.json`.
    pub suite: SuiteFile,
    /// Reason why each scenario was chosen or not, as in its `choice.json`.
    pub choice: Choice,
}

/// A suite in the studio's folder.
#[derive(Clone, Debug, Serialize)]
pub struct WrittenSuite {
    /// Name.
    pub name: String,
    /// Ids of its scenarios.
    pub scenarios: Vec<String>,
}

/// Suites in the folders directly below `folder`, by name of the folder. Folders without a readable suite are left out.
pub fn written_suites(folder: &Path) -> Vec<WrittenSuite> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path().join("suite.json")).collect();
    files.sort();
    let read = |file: &PathBuf| documents::read_document::<SuiteFile>(file, limits::SUITE).ok();
    let written = |suite: SuiteFile| WrittenSuite {
        name: suite.name,
        scenarios: suite.scenarios.into_iter().map(|entry| entry.id).collect(),
    };
    files.iter().filter_map(read).map(written).collect()
}

/// Writes a suite of approved scenarios with `per_kind` scenarios of each kind; if `None`, as many as the rarest kind
/// has. Files are `suite.json` and `scenarios/` in the form that `suite freeze` needs, and `choice.json` with the
/// reason for every scenario.
///
/// # Errors
/// When the folder holds a suite, too few scenarios are approved, one was changed since it was read, or a file cannot be
/// written.
pub fn build_suite(
    desk: &ReviewDesk,
    folder: &Path,
    name: &str,
    per_kind: Option<usize>,
    targets: &Targets,
) -> Result<Built, WorkspaceError> {
    frozen::refuse_another(folder)?;
    let (standings, mut offered): (Vec<Standing>, Vec<Offered>) = desk.offered().into_iter().unzip();
    let mut ids = BTreeSet::new();
    for one in offered.iter_mut().filter(|one| one.refused.is_none()) {
        if !ids.insert(one.scenario.clone()) {
            one.refused = Some("another scenario has the same id".into());
        }
    }
    let mut approved = BTreeMap::<&str, usize>::new();
    for one in offered.iter().filter(|one| one.refused.is_none()) {
        *approved.entry(&one.candidate.kind).or_default() += 1;
    }
    let Some(fewest) = approved.values().min().copied() else {
        return Err(WorkspaceError::input("no scenario is approved")
            .with_hint("two reviewers approve, and the expert solves the scenario: see `genmanip review --queue`"));
    };
    let per_kind = per_kind.unwrap_or(fewest);
    if let Some((kind, count)) = approved.iter().find(|(_, count)| **count < per_kind) {
        return Err(WorkspaceError::input(format!("{count} of {per_kind} scenarios of kind {kind} are approved"))
            .with_hint("review more of them, or lower --per-kind"));
    }
    let made = choice(&offered, per_kind, targets);
    let chosen: BTreeSet<&str> = made.chosen.iter().map(|one| one.scenario.as_str()).collect();
    let mut reviewed = BuildStep::new("were approved by two reviewers");
    let mut solved = BuildStep::new("are solved by the expert");
    let mut kept = Vec::new();
    for ((item, standing), one) in desk.items().zip(standings).zip(&offered) {
        match (standing, &one.refused) {
            (Standing::Approved, None) => {
                reviewed.pass(item.kind);
                solved.pass(item.kind);
                if chosen.contains(item.id.as_str()) {
                    kept.push(entry(desk, item)?);
                }
            }
            (Standing::Uncertified, Some(reason)) => {
                reviewed.pass(item.kind);
                solved.refuse(reason.clone());
            }
            (_, Some(reason)) => reviewed.refuse(reason.clone()),
            (_, None) => {}
        }
    }
    kept.sort_by(|a, b| a.0.id.cmp(&b.0.id));
    documents::write_file(&folder.join("choice.json"), made.to_json().as_bytes())?;
    // The seed is unused: nothing of this choice is random.
    let seed = Seed::new(0);
    let funnel = vec![reviewed, solved];
    let head = SuiteHeader { name: name.into(), seed, per_kind, perturbation: None, funnel };
    Ok(Built { suite: frozen::write(folder, head, kept)?, choice: made })
}

fn entry(desk: &ReviewDesk, item: &Reviewable) -> Result<(Scenario, SuiteEntry), WorkspaceError> {
    let changed = || {
        WorkspaceError::input(format!("scenario {} has changed since it was read", item.id))
            .with_hint("an edit voids its reviews: it has to be reviewed again")
    };
    let scenario = scenarios::read_scenario(&item.path)?;
    if content_sha256(&scenario) != item.content_sha256 {
        return Err(changed());
    }
    let trials = desk.trials(item).and_then(|trials| Some((trials.horizon_s, trials.certificate()?)));
    let (horizon_s, certificate) = trials.ok_or_else(changed)?;
    let entry = SuiteEntry {
        id: scenario.id.clone(),
        sha256: sha256(scenario.to_json().as_bytes()),
        kind: scenario.task.kind,
        source: scenario.task.source.clone(),
        traits: traits(&scenario.task, Catalogue::all()),
        horizon_s,
        certificate,
        pictures: BTreeMap::new(),
    };
    Ok((scenario, entry))
}

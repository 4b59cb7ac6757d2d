//! Freezing of a suite: copies of its objects, and hashes of its initial camera images.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use crate::suite_format::{FrozenFile, SuiteEntry, SuiteFile, sha256};
use genmanip_assets::{AssetSource, Catalogue, FrozenAsset};
use genmanip_core::{Document, Scenario};

use super::assets::{SuiteAssets, distinct, path, to_bytes};
use super::pictures::draw;
use super::{open, scenario_file};
use genmanip_workspace::Progress;
use genmanip_workspace::WorkspaceError;
use genmanip_workspace::documents;
use genmanip_workspace::scenarios;

/// Stores the objects of a suite's scenarios and the hashes of its images in its folder; `None` if interrupted.
///
/// A frozen suite is evaluated with the stored objects, even if the catalogue later generates others under their names.
///
/// # Errors
/// If the suite is already frozen or has changed since it was built, an object cannot be stored, or a file cannot be
/// written.
pub fn freeze(
    folder: &Path,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteFile>, WorkspaceError> {
    let mut suite = open(folder)?;
    if !suite.assets.is_empty() {
        return Err(WorkspaceError::input(format!("{} holds its objects and pictures already", folder.display()))
            .with_hint("a suite is frozen once; `genmanip suite check` says whether it still is what it was"));
    }
    let Some(checked) = super::check(folder, workers, progress, stop)? else { return Ok(None) };
    if let Some(fault) = checked.faults.first() {
        return Err(WorkspaceError::input(format!("{} is not a sound suite", folder.display())).because(fault.clone()));
    }
    let scenarios = scenarios_of(folder, &suite)?;
    let catalogue = Catalogue::builtin();
    let cannot = |error| WorkspaceError::broken("an object cannot be frozen", error);
    let placed = scenarios.iter().flat_map(|scenario| &scenario.objects).map(|object| &object.asset);
    let uid = |asset: &_| catalogue.model(asset).map(|model| model.card.uid.clone());
    for (file, asset) in distinct(placed, uid).map_err(cannot)? {
        let bytes = to_bytes(&FrozenAsset::of(&asset, catalogue).map_err(cannot)?)
            .map_err(|error| WorkspaceError::broken("an object cannot be packed", error))?;
        let frozen = FrozenFile { asset, file, sha256: sha256(&bytes) };
        documents::write_file(&path(folder, &frozen), &bytes)?;
        suite.assets.push(frozen);
    }
    hash_images(folder, suite, &scenarios, workers, progress, stop)
}

/// Hashes the images of a frozen suite anew, with its stored objects; `None` if interrupted.
///
/// # Errors
/// If the suite is not frozen, or a file cannot be read or written.
pub fn freeze_images(
    folder: &Path,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteFile>, WorkspaceError> {
    let suite = open(folder)?;
    if suite.assets.is_empty() {
        return Err(WorkspaceError::input(format!("{} is not frozen", folder.display()))
            .with_hint("freeze it without --images, which stores its objects too"));
    }
    let scenarios = scenarios_of(folder, &suite)?;
    hash_images(folder, suite, &scenarios, workers, progress, stop)
}

fn scenarios_of(folder: &Path, suite: &SuiteFile) -> Result<Vec<Scenario>, WorkspaceError> {
    let read = |entry: &SuiteEntry| scenarios::read_scenario(&scenario_file(folder, &entry.id));
    suite.scenarios.iter().map(read).collect()
}

/// Renders the images of all scenarios with the stored objects and writes their hashes into `suite.json`.
fn hash_images(
    folder: &Path,
    mut suite: SuiteFile,
    scenarios: &[Scenario],
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteFile>, WorkspaceError> {
    let Some(source) = SuiteAssets::of(folder, &suite) else { return Ok(Some(suite)) };
    let Some(images) = draw(scenarios, &source, workers, progress, stop)? else { return Ok(None) };
    for (entry, images) in suite.scenarios.iter_mut().zip(images) {
        entry.pictures = images;
    }
    documents::write_file(&folder.join("suite.json"), suite.to_json().as_bytes())?;
    Ok(Some(suite))
}

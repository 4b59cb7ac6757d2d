//! Freezing what a suite's scenarios are made of: objects, and hashes of what its cameras see.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_assets::{AssetSource, Catalogue, FrozenAsset};
use genmanip_bench::suite::{FrozenFile, SuiteFile, sha256};
use genmanip_core::{Document, Scenario};
use genmanip_rollout::collect::in_parallel;

use super::assets::{SuiteAssets, distinct, path};
use super::{open, scenario_file};
use crate::error::RunError;
use crate::inputs;
use crate::progress::Progress;
use crate::views;
use crate::worlds::Setting;

/// SHA-256 of the colours that each camera sees at the start of a scenario, by the camera's name.
type Pictures = BTreeMap<String, String>;

/// Most places that are named of one object.
const MOST_PLACES: usize = 3;

/// Puts the objects of a suite's scenarios and hashes of its pictures beside them; `None` when it was stopped.
///
/// From then on the suite is evaluated on with these objects, whatever the catalogue makes of their names.
///
/// # Errors
/// When the suite is frozen so already or is not as it was built, an object cannot be kept, or a file cannot be written.
pub fn freeze(
    folder: &Path,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<SuiteFile>, RunError> {
    let mut suite = open(folder)?;
    if !suite.assets.is_empty() {
        return Err(RunError::input(format!("{} holds its objects and pictures already", folder.display()))
            .with_hint("a suite is frozen once; `genmanip suite check` says whether it still is what it was"));
    }
    let checked = super::check(folder, workers, progress, stop)?;
    if let Some(fault) = checked.faults.first() {
        return Err(RunError::input(format!("{} is not a sound suite", folder.display())).because(fault.clone()));
    }
    let read = |entry: &genmanip_bench::suite::SuiteEntry| inputs::read_scenario(&scenario_file(folder, &entry.id));
    let scenarios: Vec<Scenario> = suite.scenarios.iter().map(read).collect::<Result<_, _>>()?;
    let catalogue = Catalogue::builtin();
    let cannot = |error| RunError::broken("an object cannot be frozen", error);
    let placed = scenarios.iter().flat_map(|scenario| &scenario.objects).map(|object| &object.asset);
    let uid = |asset: &_| catalogue.model(asset).map(|model| model.card.uid.clone());
    for (file, asset) in distinct(placed, uid).map_err(cannot)? {
        let text = to_line(&FrozenAsset::of(&asset, catalogue).map_err(cannot)?);
        let frozen = FrozenFile { asset, file, sha256: sha256(text.as_bytes()) };
        inputs::write_file(&path(folder, &frozen), text.as_bytes())?;
        suite.assets.push(frozen);
    }
    let Some(source) = SuiteAssets::of(folder, &suite) else { return Ok(Some(suite)) };
    let Some(pictures) = draw(&scenarios, &source, workers, progress, stop)? else { return Ok(None) };
    for (entry, pictures) in suite.scenarios.iter_mut().zip(pictures) {
        entry.pictures = pictures;
    }
    inputs::write_file(&folder.join("suite.json"), suite.to_json().as_bytes())?;
    Ok(Some(suite))
}

/// What is not as it was frozen, and what the catalogue makes otherwise by now, which is no fault.
#[derive(Default)]
pub(super) struct Differences {
    pub faults: Vec<String>,
    pub notes: Vec<String>,
}

/// Compares the frozen objects with their files and with the catalogue, and the pictures with those drawn now.
pub(super) fn differences(
    folder: &Path,
    suite: &SuiteFile,
    scenarios: &[Scenario],
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Differences, RunError> {
    let mut found = Differences::default();
    let Some(source) = SuiteAssets::of(folder, suite) else { return Ok(found) };
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
            Ok(today) => {
                let places = frozen.differences(&today, MOST_PLACES);
                if !places.is_empty() {
                    found.notes.push(format!("assets/{}: the catalogue has another {}", file.file, places.join(", ")));
                }
            }
            Err(error) => found.notes.push(format!("assets/{}: {error}", file.file)),
        }
    }
    if found.faults.is_empty()
        && let Some(pictures) = draw(scenarios, &source, workers, progress, stop)?
    {
        for (scenario, pictures) in scenarios.iter().zip(pictures) {
            let Some(entry) = suite.scenarios.iter().find(|entry| entry.id == scenario.id) else { continue };
            let other = entry.pictures.iter().filter(|(camera, hash)| pictures.get(*camera) != Some(hash));
            let cameras: Vec<&str> = other.map(|(camera, _)| camera.as_str()).collect();
            if !cameras.is_empty() {
                found.faults.push(format!("{}: looks otherwise through {}", scenario.id, cameras.join(", ")));
            }
        }
    }
    Ok(found)
}

/// What the cameras of scenarios see; `None` when it was stopped.
fn draw(
    scenarios: &[Scenario],
    source: &SuiteAssets,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Vec<Pictures>>, RunError> {
    progress.begin("drawing", scenarios.len());
    let one = |scenario: &Scenario| -> Result<Pictures, RunError> {
        let cameras = &scenario.world.cameras;
        let drawn = views::draw(&Setting::Scenario(Box::new(scenario.clone())), cameras, source)?;
        progress.advance();
        Ok(cameras.iter().zip(drawn).map(|(camera, picture)| (camera.name.clone(), sha256(&picture.rgb))).collect())
    };
    let drawn = in_parallel(scenarios, workers, stop, &one)?;
    progress.end();
    Ok((!stop.load(Ordering::Relaxed)).then_some(drawn))
}

/// A frozen object as one line: its numbers would be a line each otherwise.
fn to_line(frozen: &FrozenAsset) -> String {
    format!("{}\n", frozen.to_value())
}

//! Faulty scenarios among those that people review: the share that a reviewer refuses measures the reviewer.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use genmanip_core::{Document, InstanceId, Scenario, Seed};
use genmanip_workspace::{Progress, WorkspaceError, documents};
use rand::seq::SliceRandom;

use super::fault::Fault;
use super::site::Planted;
use crate::verdict::EquipmentCache;

/// A scenario with a planted fault; its id is that of the sound scenario.
#[derive(Clone, Debug)]
pub struct FaultyScenario {
    /// The scenario with the fault.
    pub scenario: Arc<Scenario>,
    /// Kind of the fault.
    pub fault: Fault,
    /// Ids of the objects that have the fault.
    pub objects: Vec<InstanceId>,
}

/// Plants `count` faults, the eight kinds in turn, each in another scenario of the pool. Not every scene has room for
/// every fault, so that a pool should have a few times as many scenarios.
///
/// Returns `None` if interrupted.
///
/// # Errors
/// When the pool has too few scenarios, or none with room for a fault; when a robot cannot be loaded.
pub fn plant(
    pool: &[Arc<Scenario>],
    count: usize,
    seed: Seed,
    progress: &dyn Progress,
    stop: &AtomicBool,
) -> Result<Option<Vec<FaultyScenario>>, WorkspaceError> {
    let more = "name more scenarios: not every scene has room for every fault";
    if pool.len() < count {
        let message = format!("{count} faults need as many scenarios; these are {}", pool.len());
        return Err(WorkspaceError::input(message).with_hint(more));
    }
    let mut free: Vec<&Arc<Scenario>> = pool.iter().collect();
    free.shuffle(&mut seed.fork("pool").rng());
    let equipment = EquipmentCache::default();
    let mut faulty = Vec::with_capacity(count);
    progress.begin("planting faults", count);
    for number in 0..count {
        let fault = Fault::ALL[number % Fault::ALL.len()];
        let mut place = 0;
        let found = loop {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let Some(scenario) = free.get(place) else {
                let message = format!("no scenario of those left has room for the fault `{}`", fault.name());
                return Err(WorkspaceError::input(message).with_hint(more));
            };
            let seed = seed.fork(fault.name()).fork(&scenario.id);
            if let Some(found) = fault.plant(scenario, &*equipment.get(&scenario.world)?, seed) {
                break found;
            }
            place += 1;
        };
        free.remove(place);
        let Planted { scenario, objects, .. } = found;
        faulty.push(FaultyScenario { scenario, fault, objects });
        progress.advance();
    }
    progress.end();
    Ok(Some(faulty))
}

/// Writes the scenarios into a new folder, and beside it `FOLDER.txt`, which reviewers must not see: per line the id of
/// a scenario, the kind of its fault, and the ids of the objects that have it. Returns the path of that file.
///
/// # Errors
/// When the folder or the file exists, or cannot be written.
pub fn write(faulty: &[FaultyScenario], folder: &Path) -> Result<PathBuf, WorkspaceError> {
    let list = folder.with_file_name(format!("{}.txt", documents::stem(folder)));
    if let Some(path) = [folder, &list].into_iter().find(|path| path.exists()) {
        return Err(WorkspaceError::input(format!("{} exists", path.display())).with_hint("name a new folder"));
    }
    fs::create_dir_all(folder).map_err(|error| WorkspaceError::file("create", folder, error))?;
    // Sorted by id, so that the order of the list says nothing about the kinds.
    let mut lines = BTreeMap::new();
    for FaultyScenario { scenario, fault, objects } in faulty {
        documents::write_file(&folder.join(format!("{}.json", scenario.id)), scenario.to_json().as_bytes())?;
        let objects: Vec<&str> = objects.iter().map(|id| id.as_str()).collect();
        lines.insert(&scenario.id, format!("{} {} {}\n", scenario.id, fault.name(), objects.join(" ")));
    }
    documents::write_file(&list, lines.into_values().collect::<String>().as_bytes())?;
    Ok(list)
}

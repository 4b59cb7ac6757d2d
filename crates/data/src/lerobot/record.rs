//! Native records of the episodes in `extras/record`, itself an episode store.

use std::path::PathBuf;

use genmanip_core::limits;

use crate::atomic_write::{self, AtomicFolder};
use crate::{DataError, EpisodeStore, files};

/// Folder of the native record in a data set, an episode store.
pub const RECORD: &str = "extras/record";

/// Copies the record of an episode into a data set under construction.
pub fn copy(dataset: &AtomicFolder, store: &EpisodeStore, id: &str) -> Result<(), DataError> {
    store.copy_record(id, &create_folder(dataset, store, id)?)
}

/// Transfers the record of an episode from another data set, optionally under another id.
pub fn transfer(dataset: &AtomicFolder, store: &EpisodeStore, id: &str, name: Option<&str>) -> Result<(), DataError> {
    let Some(name) = name else { return store.link_record(id, &create_folder(dataset, store, id)?) };
    write_store_mark(dataset, store)?;
    let own = EpisodeStore::open(dataset.path(&format!("{RECORD}/store.json"))?.with_file_name(""))?;
    store.copy_as(id, &own, name).map(drop)
}

/// Creates the folder for the record of an episode.
fn create_folder(dataset: &AtomicFolder, store: &EpisodeStore, id: &str) -> Result<PathBuf, DataError> {
    write_store_mark(dataset, store)?;
    let folder = dataset.path(&format!("{RECORD}/{id}"))?;
    std::fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
    Ok(folder)
}

/// Writes `store.json`, which marks the folder as an episode store, if it is missing.
fn write_store_mark(dataset: &AtomicFolder, store: &EpisodeStore) -> Result<(), DataError> {
    let mark = dataset.path(&format!("{RECORD}/store.json"))?;
    if !mark.exists() {
        let text = files::read_no_follow(&store.root().join("store.json"), limits::STORE_MARK)?;
        atomic_write::write_synced(&mark, &text)?;
    }
    Ok(())
}

//! The native record of the episodes, carried along in `extras/record`, itself an episode store.

use std::path::PathBuf;

use genmanip_core::limits;

use crate::aside::{self, Aside};
use crate::{DataError, EpisodeStore, files};

/// Where a data set keeps what was recorded, an episode store.
pub const RECORD: &str = "extras/record";

/// Copies the record of an episode into a data set under construction.
pub(crate) fn copy(dataset: &Aside, store: &EpisodeStore, id: &str) -> Result<(), DataError> {
    store.copy_record(id, &place(dataset, store, id)?)
}

/// Takes the record of an episode of another data set, under another name if one is given.
pub(crate) fn take(dataset: &Aside, store: &EpisodeStore, id: &str, name: Option<&str>) -> Result<(), DataError> {
    let Some(name) = name else { return store.link_record(id, &place(dataset, store, id)?) };
    mark(dataset, store)?;
    let own = EpisodeStore::open(dataset.path(&format!("{RECORD}/store.json"))?.with_file_name(""))?;
    store.copy_as(id, &own, name).map(drop)
}

/// A new folder for the record of an episode.
fn place(dataset: &Aside, store: &EpisodeStore, id: &str) -> Result<PathBuf, DataError> {
    mark(dataset, store)?;
    let folder = dataset.path(&format!("{RECORD}/{id}"))?;
    std::fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
    Ok(folder)
}

/// Marks the records as an episode store, if that was not done yet.
fn mark(dataset: &Aside, store: &EpisodeStore) -> Result<(), DataError> {
    let mark = dataset.path(&format!("{RECORD}/store.json"))?;
    if !mark.exists() {
        let text = files::read_own(&store.root().join("store.json"), limits::STORE_MARK)?;
        aside::write_synced(&mark, &text)?;
    }
    Ok(())
}

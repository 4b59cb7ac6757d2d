//! The native record of the episodes, carried along in `extras/record`, itself an episode store.

use genmanip_core::limits;

use crate::aside::{self, Aside};
use crate::{DataError, EpisodeStore, files};

/// Copies the record of an episode into a data set under construction.
pub(crate) fn copy(dataset: &Aside, store: &EpisodeStore, id: &str) -> Result<(), DataError> {
    let mark = dataset.path("extras/record/store.json")?;
    if !mark.exists() {
        let text = files::read_own(&store.root().join("store.json"), limits::STORE_MARK)?;
        aside::write_synced(&mark, &text)?;
    }
    let folder = dataset.path(&format!("extras/record/{id}"))?;
    std::fs::create_dir(&folder).map_err(DataError::io("create the folder", &folder))?;
    store.copy_record(id, &folder)
}

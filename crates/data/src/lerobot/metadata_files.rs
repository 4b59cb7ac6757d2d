//! Metadata files of a complete data set: common to both format versions and to data sets composed of others.

use genmanip_core::{ActionContract, Document};
use serde_json::Value;

use super::episodes::{subtasks_table, tasks_table};
use super::origin::Origin;
use super::{CONTRACT, SUBTASKS, info};
use crate::DataError;
use crate::atomic_write::{AtomicFolder, write_json};

/// Contents of the metadata files that do not depend on the format version.
pub struct MetadataFiles<'a> {
    /// Contents of `meta/info.json`.
    pub info: &'a Value,
    /// Contents of `meta/stats.json`.
    pub stats: &'a Value,
    /// Description of how the statistics were computed; `None` if from all rows and images.
    pub statistics_note: Option<&'a str>,
    /// Origin of the data set.
    pub origin: &'a Origin,
    /// Contract of the `action` column, if known; `None` otherwise.
    pub contract: Option<&'a ActionContract>,
    /// Contents of `README.md`, the data set card.
    pub card: &'a str,
}

impl MetadataFiles<'_> {
    /// Writes the metadata files that both format versions have.
    pub fn write(&self, staging: &AtomicFolder) -> Result<(), DataError> {
        write_json(staging, info::INFO, self.info)?;
        write_json(staging, "meta/stats.json", self.stats)?;
        self.origin.write(staging, self.statistics_note)?;
        if let Some(contract) = self.contract {
            staging.write(CONTRACT, contract.to_json().as_bytes())?;
        }
        staging.write("README.md", info::card_with_info(self.card, self.info).as_bytes())
    }

    /// Writes the files of [`Self::write`], and the tables of tasks and subtasks of v3.0.
    pub fn write_v30(&self, staging: &AtomicFolder, tasks: &[String], subtasks: &[String]) -> Result<(), DataError> {
        self.write(staging)?;
        staging.write("meta/tasks.parquet", &tasks_table(tasks)?)?;
        match subtasks {
            [] => Ok(()),
            _ => staging.write(SUBTASKS, &subtasks_table(subtasks)?),
        }
    }
}

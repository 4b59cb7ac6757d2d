//! Linking and copying attempts between stores.

use std::fs;
use std::path::Path;

use genmanip_core::limits;
use genmanip_core::{Document, Scenario};

use super::{EPISODE, EpisodeStore, SCENARIO, check_name, check_size, document_bytes, read_checked};
use crate::DataError;
use crate::atomic_write::{self, AtomicFolder};
use crate::files;
use crate::manifest::FileHash;

impl EpisodeStore {
    /// Links or copies an attempt of another store, with its groups: by hard links if both stores are on one file
    /// system that supports them. Only files of the attempt are transferred.
    ///
    /// # Errors
    /// If it is missing, damaged or unfinished, or a different attempt of that id exists here; the store is then
    /// unchanged.
    pub fn take(&self, from: &Self, id: &str) -> Result<(), DataError> {
        let (source, target) = (from.root.join(id), self.root.join(id));
        let is_same = || Ok(self.record_hash(id)? == from.record_hash(id)?);
        if self.contains(id) && is_same()? {
            return Ok(());
        }
        let inventory = from.inspect(id)?.inventory.ok_or_else(|| {
            let why = "it contains unfinished files".to_owned();
            DataError::NotWritable { what: format!("episode {}", source.display()), why }
        })?;
        let staging = AtomicFolder::new(&target)?;
        for name in inventory.files.keys() {
            files::link_or_copy(&source.join(name), &staging.path(name)?)?;
        }
        match staging.publish() {
            // A concurrent process may have transferred the same attempt.
            Err(DataError::Exists { .. }) if is_same()? => Ok(()),
            published => published,
        }
    }

    /// Copies the files of an attempt, without its groups, into a folder.
    pub fn copy_record(&self, id: &str, into: &Path) -> Result<(), DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        for file in &record.files {
            let bytes = read_checked(&folder, &record.files, &file.name, limits::ATTACHMENT)?;
            atomic_write::write_synced(&into.join(&file.name), &bytes)?;
        }
        atomic_write::write_synced(&into.join(EPISODE), record.to_json().as_bytes())
    }

    /// Links or copies the files of an attempt, without its groups, into a folder; checks their sizes.
    pub fn link_record(&self, id: &str, into: &Path) -> Result<(), DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        for file in &record.files {
            check_size(&folder, file)?;
        }
        let mut names = record.files.iter().map(|file| file.name.as_str()).chain([EPISODE]);
        names.try_for_each(|name| files::link_or_copy(&folder.join(name), &into.join(name)))
    }

    /// Copies an attempt, without its groups, into another store under another id, also used as its scenario id;
    /// returns its initial scenario. For measurements: files are not synced.
    ///
    /// # Errors
    /// If the attempt is missing or damaged, the id exists or is invalid, or writing fails.
    pub fn copy_as(&self, id: &str, into: &Self, name: &str) -> Result<Option<Scenario>, DataError> {
        check_name(name)?;
        let mut record = self.record(id)?;
        let (from, target) = (self.root.join(id), into.root.join(name));
        fs::create_dir(&target).map_err(DataError::io("create the folder", &target))?;
        let write = |file: &str, bytes: &[u8]| {
            let path = target.join(file);
            fs::write(&path, bytes).map_err(DataError::io("write", &path))
        };
        let scenario = self.read_scenario(id)?.map(|scenario| Scenario { id: name.into(), ..scenario });
        let listed = record.files.clone();
        for file in &mut record.files {
            let bytes = match &scenario {
                Some(scenario) if file.name == SCENARIO => document_bytes(scenario, "scenario")?,
                _ => read_checked(&from, &listed, &file.name, limits::ATTACHMENT)?,
            };
            *file = FileHash::of(&file.name, &bytes);
            write(&file.name, &bytes)?;
        }
        record.result.id = name.into();
        if scenario.is_some() {
            record.result.scenario_id = name.into();
        }
        write(EPISODE, record.to_json().as_bytes())?;
        Ok(scenario)
    }
}

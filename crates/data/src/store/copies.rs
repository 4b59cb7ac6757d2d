//! Attempts taken or copied from one store into another.

use std::fs;
use std::path::Path;

use genmanip_core::limits;
use genmanip_core::{Document, Scenario};

use super::{EPISODE, EpisodeStore, SCENARIO, check_name, check_size, checked, document_bytes};
use crate::DataError;
use crate::aside::{self, Aside};
use crate::files;
use crate::manifest::FileHash;

impl EpisodeStore {
    /// Takes an attempt of another store, with its groups: linked where both lie on one disk that knows links, else
    /// copied. Only what belongs to it comes along.
    ///
    /// # Errors
    /// When it is not there, damaged or unfinished, or another one of that name is here; the store is then unchanged.
    pub fn take(&self, from: &Self, id: &str) -> Result<(), DataError> {
        let (source, target) = (from.root.join(id), self.root.join(id));
        let is_same = || Ok(self.record_hash(id)? == from.record_hash(id)?);
        if self.contains(id) && is_same()? {
            return Ok(());
        }
        let parts = from.look_at(id)?.parts.ok_or_else(|| {
            let why = "something unfinished lies among it".to_owned();
            DataError::NotWritable { what: format!("episode {}", source.display()), why }
        })?;
        let aside = Aside::new(&target)?;
        for name in parts.files.keys() {
            files::link_or_copy(&source.join(name), &aside.path(name)?)?;
        }
        match aside.publish() {
            // Another program that merges the same was quicker.
            Err(DataError::Exists { .. }) if is_same()? => Ok(()),
            published => published,
        }
    }

    /// Copies the files of an attempt, without its groups, into another store.
    pub(crate) fn copy_record(&self, id: &str, into: &Path) -> Result<(), DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        for file in &record.files {
            let bytes = checked(&folder, &record.files, &file.name, limits::ATTACHMENT)?;
            aside::write_synced(&into.join(&file.name), &bytes)?;
        }
        aside::write_synced(&into.join(EPISODE), record.to_json().as_bytes())
    }

    /// Links or copies the files of an attempt, without its groups, into a folder; their sizes are checked.
    pub(crate) fn link_record(&self, id: &str, into: &Path) -> Result<(), DataError> {
        let record = self.record(id)?;
        let folder = self.root.join(id);
        for file in &record.files {
            check_size(&folder, file)?;
        }
        let mut names = record.files.iter().map(|file| file.name.as_str()).chain([EPISODE]);
        names.try_for_each(|name| files::link_or_copy(&folder.join(name), &into.join(name)))
    }

    /// Copies an attempt, without its groups, into another store under another id, which its scenario takes too, and
    /// says what it started from. For measurements: nothing is synced.
    ///
    /// # Errors
    /// When the attempt is not there or is damaged, the id is taken or unfit, or the disk refuses.
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
                _ => checked(&from, &listed, &file.name, limits::ATTACHMENT)?,
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

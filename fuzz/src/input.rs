//! Inputs: named files, mutated, saved and written for readers of folders.

use std::fs;
use std::path::{Path, PathBuf};

use genmanip_core::Seed;
use genmanip_lab::hostile::{listing, mutate};
use rand::RngExt;

use crate::Failure;
use crate::targets::Target;

/// The files of one call of a reader, by path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// Relative paths and contents.
    pub files: Vec<(String, Vec<u8>)>,
}

impl Input {
    /// One file.
    pub fn file(name: &str, bytes: impl Into<Vec<u8>>) -> Self {
        Self { files: vec![(name.to_owned(), bytes.into())] }
    }

    /// All files below a folder.
    ///
    /// # Errors
    /// If there are none.
    pub fn of_folder(folder: &Path) -> Result<Self, Failure> {
        let files: Vec<_> = listing(folder).into_iter().filter(|(name, _)| !name.ends_with('/')).collect();
        if files.is_empty() {
            Err(format!("there is nothing in {}", folder.display()).into())
        } else {
            Ok(Self { files })
        }
    }

    /// One input for each file of a folder.
    ///
    /// # Errors
    /// If there are none.
    pub fn each_of_folder(folder: &Path) -> Result<Vec<Self>, Failure> {
        Ok(Self::of_folder(folder)?.files.into_iter().map(|file| Self { files: vec![file] }).collect())
    }

    /// Input number `index` of a target: a valid one, mutated in one or more places.
    pub fn mutated(target: &Target, corpus: &[Self], seed: u64, index: u64) -> Self {
        let mut rng = Seed::new(seed).fork("fuzz").fork(target.name).fork_index(index).rng();
        let mut input = corpus[rng.random_range(0..corpus.len())].clone();
        for _ in 0..mutate::CHANGES[rng.random_range(0..mutate::CHANGES.len())] {
            let place = rng.random_range(0..input.files.len());
            let (name, bytes) = &mut input.files[place];
            mutate::file(name, bytes, &mut rng);
            // Else every mutation of an episode's files would end at the comparison of their hashes.
            if rng.random_bool(0.6) {
                input.hash_again(place);
            }
        }
        input
    }

    fn hash_again(&mut self, place: usize) {
        let (path, bytes) = self.files[place].clone();
        let Some((folder, name)) = path.rsplit_once('/') else { return };
        for record in ["episode.json", "files.json"].map(|record| format!("{folder}/{record}")) {
            if let Some((_, text)) = self.files.iter_mut().find(|(known, _)| *known == record) {
                mutate::hash_again(text, name, &bytes);
            }
        }
    }

    /// Writes the files into a folder.
    ///
    /// # Errors
    /// If the disk refuses one; names that leave the folder cannot occur.
    pub fn write(&self, folder: &Path) -> Result<(), Failure> {
        for (name, bytes) in &self.files {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap_or(folder))?;
            fs::write(path, bytes)?;
        }
        Ok(())
    }

    /// Saves an input that broke a reader; returns its folder.
    ///
    /// # Errors
    /// If the disk refuses it.
    pub fn save(&self, target: &Target, seed: u64, index: u64) -> Result<PathBuf, Failure> {
        let folder = PathBuf::from(format!("fuzz/artifacts/{}/{seed}-{index}", target.name));
        self.write(&crate::repository().join(&folder))?;
        Ok(folder)
    }
}

//! Integration tests: the check finds every corruption, edited datasets equal exports, imported ones hold their source.

#![allow(clippy::unwrap_used)] // The exemption for tests does not reach helpers of an integration test.

mod checking;
mod editing;
mod importing;
mod masking;
#[path = "../../../data/tests/synthetic/mod.rs"]
mod synthetic;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Contents of all files below a folder.
fn tree(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.strip_prefix(root).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    files
}

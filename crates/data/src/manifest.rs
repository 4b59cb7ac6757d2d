//! File manifests: sizes and hashes, checked on every read.

use std::path::Path;

use genmanip_core::{Document, hexadecimal};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::DataError;

/// Size and SHA-256 of one file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHash {
    pub name: String,
    pub bytes: usize,
    pub sha256: String,
}

/// Contents of `files.json` in the folder of a group: its files with sizes and hashes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    pub files: Vec<FileHash>,
}

impl Document for Manifest {
    const SCHEMA: &'static str = "genmanip.files/1";
}

impl FileHash {
    pub fn of(name: &str, bytes: &[u8]) -> Self {
        let sha256 = hexadecimal(&Sha256::digest(bytes));
        Self { name: name.into(), bytes: bytes.len(), sha256 }
    }
}

/// Returns the bytes if they match the recorded size and hash.
pub fn check_bytes(path: &Path, expected: &FileHash, bytes: Vec<u8>) -> Result<Vec<u8>, DataError> {
    let got = FileHash::of(&expected.name, &bytes);
    if got == *expected {
        return Ok(bytes);
    }
    let describe = |file: &FileHash| format!("{} bytes, sha256 {}", file.bytes, file.sha256);
    Err(DataError::Damaged { path: path.into(), expected: describe(expected), got: describe(&got) })
}

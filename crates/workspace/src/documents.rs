//! Files and versioned documents that the user names: size-limited reads and atomic writes.

use std::path::{Path, PathBuf};

use genmanip_core::limits::Limit;
use genmanip_core::{Document, DocumentError};
use genmanip_data::{DataError, files};

use crate::error::WorkspaceError;

/// Reads a UTF-8 text file; rejects files that are too large, not regular or not text.
///
/// # Errors
/// [`WorkspaceError::File`], [`WorkspaceError::TooLarge`] and [`WorkspaceError::Input`].
pub fn read_text(path: &Path, limit: Limit) -> Result<String, WorkspaceError> {
    text_of(path, read_bytes(path, limit)?)
}

/// Reads a file; rejects files that are too large or not regular, without blocking on pipes or devices.
///
/// # Errors
/// [`WorkspaceError::File`], [`WorkspaceError::TooLarge`] and [`WorkspaceError::Input`].
pub fn read_bytes(path: &Path, limit: Limit) -> Result<Vec<u8>, WorkspaceError> {
    files::read(path, limit).map_err(|error| unreadable(path, error))
}

/// Reads a versioned document.
///
/// # Errors
/// As [`read_text`], and [`WorkspaceError::Document`].
pub fn read_document<T: Document>(path: &Path, limit: Limit) -> Result<T, WorkspaceError> {
    document(path, &read_bytes(path, limit)?)
}

/// Reads a document that a run wrote; rejects symbolic links.
///
/// # Errors
/// As [`read_document`].
pub fn read_document_no_follow<T: Document>(path: &Path, limit: Limit) -> Result<T, WorkspaceError> {
    document(path, &files::read_no_follow(path, limit).map_err(|error| unreadable(path, error))?)
}

/// Writes a file atomically: to a temporary file, which is then renamed into place.
///
/// # Errors
/// [`WorkspaceError::File`].
pub fn write_file(path: &Path, bytes: &[u8]) -> Result<(), WorkspaceError> {
    files::write(path, bytes).map_err(|error| unwritable(path, error))
}

/// File name without its extension.
pub fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Absolute path of a folder or, if it does not exist, of its nearest existing ancestor; `None` if there is none.
pub fn nearest_folder(path: &Path) -> Option<PathBuf> {
    let whole = std::path::absolute(path).ok()?;
    whole.ancestors().find(|ancestor| ancestor.is_dir()).map(Path::to_owned)
}

/// [`WorkspaceError`] of a file that cannot be read, with a hint on relative paths.
pub fn unreadable(path: &Path, error: DataError) -> WorkspaceError {
    let help = "check the path; relative paths start at the current folder";
    match WorkspaceError::of_file("read", path, error) {
        error @ WorkspaceError::File { .. } => error.with_hint(help),
        error => error,
    }
}

pub(crate) fn document<T: Document>(path: &Path, bytes: &[u8]) -> Result<T, WorkspaceError> {
    T::from_bytes(bytes).map_err(|error| not_a_document::<T>(path, error))
}

pub(crate) fn not_a_document<T: Document>(path: &Path, source: DocumentError) -> WorkspaceError {
    WorkspaceError::Document { path: path.to_owned(), schema: T::SCHEMA, source }
}

pub(crate) fn text_of(path: &Path, bytes: Vec<u8>) -> Result<String, WorkspaceError> {
    let is_utf16 = bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]);
    let hint = if is_utf16 { "the file is UTF-16; save it as UTF-8" } else { "expected a text file in UTF-8" };
    String::from_utf8(bytes).map_err(|error| WorkspaceError::file("read", path, error.utf8_error()).with_hint(hint))
}

/// Removes temporary files of killed processes from a folder; does nothing if the folder does not exist.
///
/// # Errors
/// When a file cannot be removed.
pub fn sweep(folder: &Path) -> Result<(), WorkspaceError> {
    if folder.is_dir() {
        files::sweep(folder).map_err(|error| unwritable(folder, error))?;
    }
    Ok(())
}

/// [`WorkspaceError`] of a file or folder that cannot be written, with a hint.
pub fn unwritable(path: &Path, error: DataError) -> WorkspaceError {
    match WorkspaceError::of_file("write", path, error) {
        error @ WorkspaceError::File { .. } => {
            error.with_hint("check that the folder exists, is writable and the disk is not full")
        }
        error => error,
    }
}

//! Errors of reading, writing and exporting recorded data.

use std::path::{Path, PathBuf};

use genmanip_core::DocumentError;
use genmanip_core::limits::Limit;

/// A failed read, write or export, with the file it concerns.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// A failed call of the operating system.
    #[error("cannot {action}: {source}: {}", path.display())]
    Io {
        /// The attempted action, e.g. `write`.
        action: &'static str,
        /// File or folder of the attempted action.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// Not a regular file: reading it might never end, or follow a link elsewhere.
    #[error("expected a file, found {found}: {}", path.display())]
    NotAFile {
        /// Path of the special file.
        path: PathBuf,
        /// File type found, e.g. `folder` or `pipe`.
        found: &'static str,
    },
    /// A file larger than the limit of its kind.
    #[error("file too large: {} may be {} at most: {}", limit.what, limit.human_readable(), path.display())]
    TooLarge {
        /// File that is too large.
        path: PathBuf,
        /// Kind of the file, with its maximum size.
        limit: Limit,
    },
    /// An existing data set that is not of this collection run; it is not replaced.
    #[error("a data set that this run did not write is already there: {}", path.display())]
    NotOurs {
        /// Folder of the existing data set.
        path: PathBuf,
    },
    /// A folder that is not an episode store.
    #[error("not an episode store (no store.json in it): {}", path.display())]
    NotAStore {
        /// Folder that was expected to be a store.
        path: PathBuf,
    },
    /// An invalid file name.
    #[error(
        "\"{name}\" cannot be a file name: expected 1 to 200 letters, digits or any of `-_.+=@`, not starting with a dot"
    )]
    BadName {
        /// Name that was given.
        name: String,
    },
    /// A path that exists and is not overwritten.
    #[error("already exists: {}", path.display())]
    Exists {
        /// Path that exists already.
        path: PathBuf,
    },
    /// An episode that the store does not contain.
    #[error("no episode \"{id}\"{}: {}", near_misses(near), root.display())]
    UnknownEpisode {
        /// Id that was requested.
        id: String,
        /// Root folder of the store.
        root: PathBuf,
        /// Up to three similar ids of the store, for the hint.
        near: Vec<String>,
    },
    /// An episode stored without frames.
    #[error("only the result of this attempt was stored, not its frames: {}", path.display())]
    NotRecorded {
        /// Folder of the episode without frames.
        path: PathBuf,
    },
    /// A missing attachment of an episode.
    #[error("the episode has no {name}: {}", path.display())]
    NoAttachment {
        /// Name of the attachment, e.g. `images_15hz/static.h264`.
        name: String,
        /// Folder of the episode without the attachment.
        path: PathBuf,
    },
    /// A file whose size or hash differs from the manifest.
    #[error("damaged file: expected {expected}, got {got}: {}", path.display())]
    Damaged {
        /// Damaged file.
        path: PathBuf,
        /// Size and SHA-256 in the manifest.
        expected: String,
        /// Size and SHA-256 of the file as it is.
        got: String,
    },
    /// An invalid JSON file.
    #[error("{source}: {}", path.display())]
    Document {
        /// File that is not valid.
        path: PathBuf,
        /// Parse error with its position in the file.
        source: DocumentError,
    },
    /// A value that does not survive a round trip through JSON, e.g. a NaN in a verdict.
    #[error("{what} cannot be stored without loss: {why}")]
    NotWritable {
        /// Value that was to be written, in words.
        what: String,
        /// Difference found after the round trip.
        why: String,
    },
    /// A table that cannot be read or written.
    #[error("table {}: {source}", path.display())]
    Table {
        /// Path of the Parquet file.
        path: PathBuf,
        /// Error of the Parquet library, or what is missing.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// A value that contradicts another one.
    #[error("{what}: expected {expected}, got {got}")]
    Mismatch {
        /// The compared quantity, e.g. `objects in frame 3 of episode 017`.
        what: String,
        /// Value that the other quantity requires.
        expected: String,
        /// Value found.
        got: String,
    },
    /// An error of the video encoder or muxer.
    #[error("video: {0}")]
    Video(String),
    /// An error of the PNG encoder or decoder.
    #[error("png: {0}")]
    Png(String),
}

/// Placeholder of a large file that a repository holds elsewhere.
pub const LFS: &str = "a pointer of Git LFS";

impl DataError {
    /// Advice on how to fix the error; `None` where the message says all.
    pub fn hint(&self) -> Option<String> {
        Some(match self {
            Self::Io { source, .. } => match source.kind() {
                std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem => {
                    "choose a folder you may write to".into()
                }
                std::io::ErrorKind::NotFound => "check the path".into(),
                _ => return None,
            },
            Self::NotAFile { found: LFS, .. } => "fetch the file itself: `git lfs pull` in its repository".into(),
            Self::NotAFile { .. } => "links, pipes and devices are not read; give a regular file".into(),
            Self::TooLarge { limit, .. } => format!("expected {}; is this the right file?", limit.what),
            Self::NotOurs { .. } => "move it elsewhere; the run writes its own data set to this path".into(),
            Self::NotAStore { .. } => "give the episode folder of a `genmanip collect` run".into(),
            Self::Exists { .. } => "choose another name, or remove it first".into(),
            Self::NotRecorded { .. } => "collect again and keep failed episodes".into(),
            Self::NoAttachment { .. } => {
                "render the images of these episodes first, at the rate of the data set".into()
            }
            Self::Table { source, .. } if source.to_string().contains("Disabled feature") => {
                "tables are read uncompressed or with Snappy; write it again, in Python: pyarrow.parquet.write_table(\
                 pyarrow.parquet.read_table(FILE), FILE)"
                    .into()
            }
            Self::Damaged { path, .. } => {
                let episode = path.parent().unwrap_or(path);
                format!("collect again with --repair: {} is set aside and collected again", episode.display())
            }
            _ => return None,
        })
    }

    /// True if the file or folder that an operating-system call was to read does not exist.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound)
    }

    /// True if the error concerns one damaged episode, so that others may still be readable.
    pub fn is_damage(&self) -> bool {
        self.is_missing()
            || matches!(
                self,
                Self::Damaged { .. }
                    | Self::Document { .. }
                    | Self::Table { .. }
                    | Self::Mismatch { .. }
                    | Self::NotAFile { .. }
                    | Self::TooLarge { .. }
                    | Self::BadName { .. }
                    | Self::Png(_)
            )
    }

    /// Adds the path to errors that lack it; a table error gets this path instead of the temporary one.
    pub fn with_path(self, path: &Path) -> Self {
        let shown = path.display();
        match self {
            Self::Mismatch { what, expected, got } => Self::mismatch(format!("{what} in {shown}"), expected, got),
            Self::Table { source, .. } => Self::table(path, source),
            Self::Video(why) => Self::Video(format!("{why}: {shown}")),
            Self::Png(why) => Self::Png(format!("{why}: {shown}")),
            other => other,
        }
    }

    /// An operating-system error while trying to `action` the path.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// An error in a Parquet table.
    pub fn table(path: &Path, error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self::Table { path: path.to_owned(), source: error.into() }
    }

    /// A quantity that differs from the expected one.
    pub fn mismatch(what: impl Into<String>, expected: impl ToString, got: impl ToString) -> Self {
        Self::Mismatch { what: what.into(), expected: expected.to_string(), got: got.to_string() }
    }
}

fn near_misses(near: &[String]) -> String {
    if near.is_empty() { String::new() } else { format!(" (near: {})", near.join(", ")) }
}

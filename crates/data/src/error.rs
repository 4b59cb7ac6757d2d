//! Why reading, writing or exporting recorded data fails.

use std::path::{Path, PathBuf};

use genmanip_core::DocumentError;
use genmanip_core::limits::Limit;

/// What went wrong, with the file it concerns.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// The operating system refused.
    #[error("cannot {action}: {source}: {}", path.display())]
    Io {
        /// What was tried, e.g. `write`.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Something else than a file: reading it might never end, or lead somewhere else.
    #[error("expected a file, found {found}: {}", path.display())]
    NotAFile {
        /// What should be a file.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// A file that is larger than anything of its kind.
    #[error("larger than {} may be, {}: {}", limit.what, limit.human_readable(), path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its kind and bound.
        limit: Limit,
    },
    /// A data set that would be replaced, but that another made.
    #[error("there is a data set already that this run did not make: {}", path.display())]
    NotOurs {
        /// The data set.
        path: PathBuf,
    },
    /// A folder that is not an episode store.
    #[error("not an episode store (no store.json in it): {}", path.display())]
    NotAStore {
        /// The folder.
        path: PathBuf,
    },
    /// A name that cannot be a folder's name.
    #[error(
        "\"{name}\" cannot be a file name: expected 1 to 200 letters, digits or any of `-_.+=@`, not starting with a dot"
    )]
    BadName {
        /// The name.
        name: String,
    },
    /// Something that would be overwritten.
    #[error("already exists: {}", path.display())]
    Exists {
        /// What exists.
        path: PathBuf,
    },
    /// An episode that is not in the store.
    #[error("no episode \"{id}\"{}: {}", near_misses(near), root.display())]
    UnknownEpisode {
        /// The id asked for.
        id: String,
        /// The store.
        root: PathBuf,
        /// Ids that look alike.
        near: Vec<String>,
    },
    /// An episode of which only the result was kept.
    #[error("only the result of this attempt was kept, it has no frames: {}", path.display())]
    NotRecorded {
        /// The episode's folder.
        path: PathBuf,
    },
    /// An attachment nobody made.
    #[error("the episode has no {name}: {}", path.display())]
    NoAttachment {
        /// Name, e.g. `images_15hz/static.h264`.
        name: String,
        /// The episode's folder.
        path: PathBuf,
    },
    /// A file whose contents are not those that were written.
    #[error("damaged file: expected {expected}, got {got}: {}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Size and sha256 when it was written.
        expected: String,
        /// Size and sha256 now.
        got: String,
    },
    /// A JSON file that cannot be understood.
    #[error("{source}: {}", path.display())]
    Document {
        /// The file.
        path: PathBuf,
        /// What is wrong and where.
        source: DocumentError,
    },
    /// A value that would not survive being written and read, e.g. a NaN in a verdict.
    #[error("{what} would not be read back as it is: {why}")]
    NotWritable {
        /// The value.
        what: String,
        /// Why.
        why: String,
    },
    /// A table that cannot be read or written.
    #[error("table {}: {message}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// What the parquet library says, or what is missing.
        message: String,
    },
    /// Two things that should agree do not.
    #[error("{what}: expected {expected}, got {got}")]
    Mismatch {
        /// What was compared, e.g. `objects in frame 3 of episode 017`.
        what: String,
        /// What fits.
        expected: String,
        /// What was found.
        got: String,
    },
    /// The video encoder or the muxer failed.
    #[error("video: {0}")]
    Video(String),
    /// A PNG image could not be written or read.
    #[error("png: {0}")]
    Png(String),
}

impl DataError {
    /// What a person can do about it.
    pub fn hint(&self) -> Option<String> {
        Some(match self {
            Self::Io { source, .. } => match source.kind() {
                std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
                    "free some space and start again; finished episodes are kept".into()
                }
                std::io::ErrorKind::PermissionDenied | std::io::ErrorKind::ReadOnlyFilesystem => {
                    "choose a folder you may write to".into()
                }
                std::io::ErrorKind::NotFound => "check the path".into(),
                _ => return None,
            },
            Self::NotAFile { .. } => "links, pipes and devices are not read; name a file, or put one there".into(),
            Self::TooLarge { limit, .. } => format!("expected {}; is this the right file?", limit.what),
            Self::NotOurs { .. } => "move it away; the run makes its own there".into(),
            Self::NotAStore { .. } => "give the folder that `genmanip collect` wrote its episodes to".into(),
            Self::Exists { .. } => "choose another name, or remove it first".into(),
            Self::NotRecorded { .. } => "collect again and keep failed episodes".into(),
            Self::NoAttachment { .. } => "draw the images of these episodes first, at the rate of the dataset".into(),
            Self::Damaged { path, .. } => {
                let episode = path.parent().unwrap_or(path);
                format!("collect again with --repair: {} is set aside and made anew", episode.display())
            }
            _ => return None,
        })
    }

    /// Whether what was to be read is not there.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound)
    }

    /// Whether an episode is damaged, so that others may still be sound.
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

    /// The same, of what was read from a place that the error does not name; a table that is written names only itself.
    pub(crate) fn placed(self, place: &Path) -> Self {
        let shown = place.display();
        match self {
            Self::Mismatch { what, expected, got } => Self::mismatch(format!("{what} in {shown}"), expected, got),
            Self::Table { message, .. } => Self::table(place, message),
            Self::Video(why) => Self::Video(format!("{why}: {shown}")),
            Self::Png(why) => Self::Png(format!("{why}: {shown}")),
            other => other,
        }
    }

    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    pub(crate) fn table(path: &Path, error: impl ToString) -> Self {
        Self::Table { path: path.to_owned(), message: error.to_string() }
    }

    pub(crate) fn mismatch(what: impl Into<String>, expected: impl ToString, got: impl ToString) -> Self {
        Self::Mismatch { what: what.into(), expected: expected.to_string(), got: got.to_string() }
    }
}

fn near_misses(near: &[String]) -> String {
    if near.is_empty() { String::new() } else { format!(" (near: {})", near.join(", ")) }
}

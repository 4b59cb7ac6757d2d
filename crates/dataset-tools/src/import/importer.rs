//! Data sets to import, and settings of an import.

use std::path::{Path, PathBuf};

use genmanip_core::ActionContract;
use genmanip_data::export::EpisodeRows;
use genmanip_data::{DataError, EpisodeStore};

use super::metadata::ImportedMetadata;

/// Settings of the import of a data set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportSettings {
    /// Path of ffmpeg, which decodes video that cannot be copied (codecs other than H.264, B-frames, or an episode that
    /// does not begin at a key frame); the frames are re-encoded as H.264. If `None` (the default), such video is an
    /// error.
    pub ffmpeg: Option<PathBuf>,
    /// Episodes per data and video file. Default 100.
    pub episodes_per_file: usize,
    /// Episodes per file of the depth data set. Default 10.
    pub episodes_per_depth_file: usize,
}

impl Default for ImportSettings {
    fn default() -> Self {
        Self { ffmpeg: None, episodes_per_file: 100, episodes_per_depth_file: 10 }
    }
}

/// A data set to import.
pub(super) trait Importer {
    fn info(&self) -> SourceInfo;

    /// Reads every episode in order and passes it to `take`; stops at the first error, also of `take`.
    fn each(&mut self, take: OnEpisode) -> Result<(), DataError>;

    /// Differences from the source; complete after [`Importer::each`].
    fn notes(&self) -> Vec<String>;
}

/// Receives an episode and the file or folder it was read from; its `images` are depth images.
pub(super) type OnEpisode<'a> = &'a mut dyn FnMut(&Path, EpisodeRows<ImportedMetadata>) -> Result<(), DataError>;

/// Metadata of a data set to import.
pub(super) struct SourceInfo {
    /// Format of the source, as in [`Imported::format`].
    pub(super) format: &'static str,
    pub(super) robot: String,
    pub(super) fps: u32,
    pub(super) episodes: usize,
    /// Action contract of the data set (`meta/action_contract.json`); `None` if it has none.
    pub(super) contract: Option<ActionContract>,
    /// Episodes in this program's own format, if the data set contains them; `None` otherwise.
    pub(super) record: Option<EpisodeStore>,
}

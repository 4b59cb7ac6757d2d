//! Data sets of other programs as data sets that the tools of this one read: LeRobot v3.0 and v2.1, and the episode
//! folders of the original GenManip.
//!
//! What is made is a LeRobotDataset v3.0, with the sibling `<name>-depth` where the source has depth. Numbers, names and
//! sentences are those of the source; H.264 pictures are copied as they are. Nothing of the source is executed.

mod convert;
mod facts;
mod jpeg;
mod lerobot;
mod lmdb;
mod original;
mod pickle;
mod pictures;

use std::path::{Path, PathBuf};

use genmanip_core::ActionContract;
use serde::Serialize;

use crate::export::{EpisodeRows, ExportReport};
use crate::lerobot::info::INFO;
use crate::lerobot::made::Made;
use crate::lerobot::writer::DatasetWriter;
use crate::lerobot::{begin, begin_sibling, card, check_free, check_owner, depth_path};
use crate::{DataError, EpisodeStore, files};
use facts::ImportedFacts;

pub use crate::lerobot::imported::Imported;
pub use convert::to_v21;

/// How a data set is imported.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImportSettings {
    /// The program that decodes video of other codecs than H.264, which is then encoded anew. Default none.
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

/// What was imported.
#[derive(Clone, Debug, Serialize)]
pub struct ImportReport {
    /// What was written.
    #[serde(flatten)]
    pub written: ExportReport,
    /// Format of the source and what differs from it.
    pub imported: Imported,
}

/// Writes the data set at `source` anew at `out` (and `<out>-depth`); `heard` is told of each episode, with how many
/// there are.
///
/// # Errors
/// When `source` is of no known format, is damaged or holds what cannot be kept, or `out` exists; nothing is then left
/// there.
pub fn import(
    source: &Path,
    settings: &ImportSettings,
    out: &Path,
    heard: &mut dyn FnMut(usize),
) -> Result<ImportReport, DataError> {
    let mut incoming = open(source, settings)?;
    let about = incoming.about();
    let mut writers = Writers::begin(about, settings, out)?;
    incoming.each(&mut |from, episode| {
        writers.push(from, episode)?;
        heard(writers.about.episodes);
        Ok(())
    })?;
    if writers.colors.episodes() == 0 {
        let what = format!("episodes with frames in {}", source.display());
        return Err(DataError::mismatch(what, "at least one", 0));
    }
    writers.publish(incoming.notes(), settings, source, out)
}

/// Whatever it is that lies there.
fn open(source: &Path, settings: &ImportSettings) -> Result<Box<dyn Incoming>, DataError> {
    if files::is_own_file(&source.join(INFO)) {
        let dataset = lerobot::Lerobot::open(source, settings)?;
        dataset.check_foreign()?;
        return Ok(Box::new(dataset));
    }
    if original::is_there(source)? {
        return Ok(Box::new(original::Original::open(source)?));
    }
    let expected =
        "the folder of a LeRobot data set (with meta/info.json) or of episodes of GenManip (with meta_info.pkl)";
    Err(DataError::mismatch(source.display().to_string(), expected, "none"))
}

/// A data set that comes in.
trait Incoming {
    fn about(&self) -> About;

    /// Hands on every episode, in order.
    fn each(&mut self, take: Take) -> Result<(), DataError>;

    /// What was changed or left out; known when all episodes were handed on.
    fn notes(&self) -> Vec<String>;
}

/// Takes an episode and the file or folder it was read from; its `images` are depth pictures.
type Take<'a> = &'a mut dyn FnMut(&Path, EpisodeRows<ImportedFacts>) -> Result<(), DataError>;

/// A data set as a whole.
struct About {
    /// As in [`Imported::format`].
    format: &'static str,
    robot: String,
    fps: u32,
    episodes: usize,
    /// Where it says what its actions mean as data sets of this program do.
    contract: Option<ActionContract>,
    /// The native record of its episodes, if it carries one.
    record: Option<EpisodeStore>,
}

/// A data set and its depth sibling under construction.
struct Writers {
    about: About,
    colors: DatasetWriter<ImportedFacts>,
    depths: Option<DatasetWriter<ImportedFacts>>,
    target: PathBuf,
    episodes_per_depth_file: usize,
}

impl Writers {
    fn begin(about: About, settings: &ImportSettings, out: &Path) -> Result<Self, DataError> {
        check_free(out)?;
        let colors = DatasetWriter::new(begin(out, None)?, settings.episodes_per_file.max(1), about.fps, &about.robot);
        let episodes_per_depth_file = settings.episodes_per_depth_file.max(1);
        Ok(Self { about, colors, depths: None, target: out.into(), episodes_per_depth_file })
    }

    fn push(&mut self, from: &Path, mut episode: EpisodeRows<ImportedFacts>) -> Result<(), DataError> {
        let placed = |error: DataError| error.placed(from);
        let images = std::mem::take(&mut episode.images);
        let is_first = self.colors.episodes() == 0;
        if is_first && !images.is_empty() {
            let aside = begin_sibling(&self.target)?;
            let per_file = self.episodes_per_depth_file;
            self.depths = Some(DatasetWriter::new(aside, per_file, self.about.fps, &self.about.robot));
        }
        if let Some(depths) = &mut self.depths {
            let EpisodeRows { frames, facts, .. } = &episode;
            let (features, videos, steps) = Default::default();
            let rows = EpisodeRows { frames: *frames, features, images, videos, steps, facts: facts.clone() };
            depths.push(rows).map_err(placed)?;
        } else if !images.is_empty() {
            let what = format!("depth pictures of episode {}", episode.facts.store_id);
            return Err(placed(DataError::mismatch(what, "none, as in the first episode", images.len())));
        }
        if let Some(record) = &self.about.record {
            self.colors.copy_record(record, &episode.facts.store_id)?;
        }
        self.colors.push(episode).map_err(placed)
    }

    fn publish(
        self,
        notes: Vec<String>,
        settings: &ImportSettings,
        source: &Path,
        out: &Path,
    ) -> Result<ImportReport, DataError> {
        let placed = |error: DataError| error.placed(source);
        let (episodes, frames) = (self.colors.episodes(), self.colors.frames());
        if self.depths.is_none() {
            check_owner(&depth_path(out), None)?;
        }
        let imported = Imported {
            format: self.about.format.into(),
            fps: self.about.fps,
            depth: self.depths.is_some(),
            record: self.about.record.is_some(),
            episodes_per_file: settings.episodes_per_file.max(1),
            episodes_per_depth_file: self.episodes_per_depth_file,
            notes,
        };
        let made = Made::Imported(imported.clone());
        let name = out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let depths = self.depths.map(|depths| depths.finish(&card::depth(&name), &made, None));
        let depths = depths.transpose().map_err(placed)?;
        let colors = self.colors.finish(&made.card(&name, "v3.0"), &made, self.about.contract.as_ref());
        let colors = colors.map_err(placed)?;
        let depth_dataset = depths.is_some().then(|| depth_path(out));
        if let Some(depths) = depths {
            depths.publish()?;
        }
        colors.publish()?;
        let written = ExportReport { dataset: out.into(), depth_dataset, episodes, frames, left_out: Vec::new() };
        Ok(ImportReport { written, imported })
    }
}

//! Checks a data set against its format, its own metadata and its native record.
//!
//! Data sets are untrusted input: missing, oversized or mistyped contents give a [`Finding`], not an error. Data sets
//! of other programs are checked against the format only, those of this program also against their own metadata.

mod consistency;
mod contact_sheet;
mod depth;
mod findings;
mod images;
mod leaks;
mod metadata;
mod overview;
mod paths;
mod record;
mod rows;
mod totals;
mod v21;
mod v30;
mod videos;
mod zarr;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use genmanip_core::RobotModel;
use serde::Serialize;

use findings::Findings;
use genmanip_data::DataError;

pub(crate) use metadata::{EpisodeEntry, Feature, Metadata, Version, VideoSpan};

pub use contact_sheet::{Strip, contact_sheet};
pub use findings::Finding;
pub use leaks::{Identity, leaks};
pub use overview::{Bin, Group, ImageFeature, Overview, Range};

/// Result of the check of a data set.
#[derive(Debug, Serialize)]
pub struct DatasetCheck {
    /// Path of the data set as given.
    pub dataset: String,
    /// `lerobot-v3.0`, `lerobot-v2.1`, `lerobot-v2.0` or `zarr`.
    pub format: &'static str,
    /// Number of episodes according to the metadata.
    pub episodes: usize,
    /// Number of rows that were read and checked.
    pub frames: usize,
    /// Findings; empty if the data set is valid.
    pub findings: Vec<Finding>,
    /// Number of findings beyond those listed.
    pub further: usize,
    /// Identities of the episodes, for [`leaks`].
    #[serde(skip)]
    pub identities: Vec<Identity>,
    /// Summary of the data set's contents, for display.
    #[serde(skip)]
    pub overview: Overview,
}

/// Checks a data set completely, every row included.
///
/// `robots` supply the kinematics; tool poses are checked only if the data set's robot is among them.
///
/// # Errors
/// If the folder cannot be listed or is not a data set of a known format.
pub fn check(dataset: &Path, robots: &[Arc<RobotModel>]) -> Result<DatasetCheck, DataError> {
    let mut findings = Findings::default();
    let listed = paths::list(dataset)?;
    if listed.contains(".zgroup") {
        return Ok(zarr::check(dataset, &listed, findings));
    }
    let metadata = read(dataset, &listed, &mut findings)?;
    let robot = robots.iter().find(|robot| robot.name == metadata.info.robot).map(Arc::as_ref);
    paths::check(&metadata, &listed, &mut findings);
    metadata::check(&metadata, &mut findings);
    let (totals, identities) = rows::check(&metadata, robot, &mut findings);
    totals::check(&metadata, &totals, &mut findings);
    videos::check(&metadata, &mut findings);
    images::check(&metadata, &mut findings);
    record::check(&metadata, robot, &mut findings);
    depth::check(&metadata, robots, &mut findings)?;
    Ok(finished(dataset, &metadata, totals.rows(), identities, &totals, findings))
}

/// Reads the metadata of a LeRobot data set, with findings for invalid parts.
///
/// # Errors
/// If the folder cannot be listed, is not a LeRobot data set of a known version, or lacks a file that its metadata
/// names.
pub(crate) fn read_metadata(dataset: &Path) -> Result<(Metadata, Vec<Finding>), DataError> {
    let (metadata, findings, listed) = read_partial_metadata(dataset)?;
    require_videos(&metadata, &listed)?;
    Ok((metadata, findings))
}

/// Reads the metadata of a LeRobot data set that may lack videos, and lists the files that are there.
///
/// # Errors
/// As [`read_metadata`], but for videos.
pub(crate) fn read_partial_metadata(dataset: &Path) -> Result<(Metadata, Vec<Finding>, BTreeSet<String>), DataError> {
    let mut findings = Findings::default();
    let listed = paths::list(dataset)?;
    let metadata = read(dataset, &listed, &mut findings)?;
    require(dataset, &listed, metadata.episodes.iter().map(|episode| &episode.data))?;
    Ok((metadata, findings.into_parts().0, listed))
}

/// Refuses metadata that name a video that is not among the files of the data set.
///
/// # Errors
/// If a video is missing.
pub(crate) fn require_videos(metadata: &Metadata, listed: &BTreeSet<String>) -> Result<(), DataError> {
    let videos = metadata.episodes.iter().flat_map(|episode| episode.videos.iter().map(|video| &video.file));
    require(&metadata.root, listed, videos)
}

/// File names come from templates in `info.json` and may point outside the data set.
fn require<'a>(
    dataset: &Path,
    listed: &BTreeSet<String>,
    mut files: impl Iterator<Item = &'a String>,
) -> Result<(), DataError> {
    match files.find(|file| !listed.contains(*file)) {
        None => Ok(()),
        Some(file) => {
            Err(DataError::mismatch(format!("{file} in {}", dataset.display()), "a file of the data set", "none"))
        }
    }
}

fn read(dataset: &Path, listed: &BTreeSet<String>, findings: &mut Findings) -> Result<Metadata, DataError> {
    let info = metadata::read_info(dataset, findings)?;
    Ok(match info.version {
        Version::V30 => v30::read(dataset, info, listed, findings),
        Version::V21 | Version::V20 => v21::read(dataset, info, listed, findings),
    })
}

fn finished(
    dataset: &Path,
    metadata: &Metadata,
    frames: usize,
    identities: Vec<Identity>,
    totals: &totals::Totals,
    findings: Findings,
) -> DatasetCheck {
    let (findings, further) = findings.into_parts();
    DatasetCheck {
        dataset: dataset.display().to_string(),
        format: metadata.info.version.name(),
        episodes: metadata.episodes.len(),
        frames,
        findings,
        further,
        identities,
        overview: overview::overview(metadata, totals),
    }
}

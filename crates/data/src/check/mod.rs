//! Whether a data set is what its format, its own description and its record promise.
//!
//! Nothing here trusts the data set: what is missing, too long or of another type is a [`Finding`], not an error.
//! A data set of another program is held to the format alone; one of this program also to what it says of itself.

mod book;
mod consistency;
mod depth;
mod findings;
mod leaks;
mod paths;
mod pictures;
mod record;
mod rows;
mod sheet;
mod show;
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

use crate::DataError;
use findings::Findings;

pub(crate) use book::{Book, Feature, Listed, Version};

pub use findings::Finding;
pub use leaks::{Identity, leaks};
pub use sheet::{Strip, contact_sheet};
pub use show::{Bin, Group, Overview, Range};

/// What was checked of a data set, and what is wrong with it.
#[derive(Debug, Serialize)]
pub struct Checked {
    /// The folder as it was named.
    pub dataset: String,
    /// `lerobot-v3.0`, `lerobot-v2.1` or `zarr`.
    pub format: &'static str,
    /// Number of episodes that it lists.
    pub episodes: usize,
    /// Number of rows that were read.
    pub frames: usize,
    /// What is wrong; empty when it is sound.
    pub findings: Vec<Finding>,
    /// Findings beyond those listed.
    pub further: usize,
    /// What another data set must not share with it.
    #[serde(skip)]
    pub identities: Vec<Identity>,
    /// What is in it.
    #[serde(skip)]
    pub overview: Overview,
}

/// Reads a data set to its last row and says what is wrong with it.
///
/// `robots` are those whose kinematics are known; without the data set's own among them, tool poses are not compared.
///
/// # Errors
/// When the folder cannot be listed, or is no data set of a known format.
pub fn check(dataset: &Path, robots: &[Arc<RobotModel>]) -> Result<Checked, DataError> {
    let mut findings = Findings::default();
    let listed = paths::list(dataset)?;
    if listed.contains(".zgroup") {
        return Ok(zarr::check(dataset, &listed, findings));
    }
    let book = read(dataset, &listed, &mut findings)?;
    let robot = robots.iter().find(|robot| robot.name == book.info.robot).map(Arc::as_ref);
    paths::check(&book, &listed, &mut findings);
    book::check(&book, &mut findings);
    let (totals, identities) = rows::check(&book, robot, &mut findings);
    totals::check(&book, &totals, &mut findings);
    videos::check(&book, &mut findings);
    pictures::check(&book, &mut findings);
    record::check(&book, &mut findings);
    depth::check(&book, robots, &mut findings)?;
    Ok(finished(dataset, &book, totals.rows(), identities, &totals, findings))
}

/// What a LeRobot data set says of itself; what cannot be understood is found.
///
/// # Errors
/// When the folder cannot be listed, or is no LeRobot data set of a known version.
pub(crate) fn book(dataset: &Path) -> Result<(Book, Vec<Finding>), DataError> {
    let mut findings = Findings::default();
    let listed = paths::list(dataset)?;
    let book = read(dataset, &listed, &mut findings)?;
    // Names come from templates in `info.json`, which may lead anywhere.
    let files = |episode: &Listed| {
        [episode.data.clone()]
            .into_iter()
            .chain(episode.videos.iter().map(|video| video.file.clone()))
            .collect::<Vec<_>>()
    };
    if let Some(file) = book.episodes.iter().flat_map(files).find(|file| !listed.contains(file)) {
        return Err(DataError::mismatch(format!("{file} in {}", dataset.display()), "a file of the data set", "none"));
    }
    Ok((book, findings.into_parts().0))
}

fn read(dataset: &Path, listed: &BTreeSet<String>, findings: &mut Findings) -> Result<Book, DataError> {
    let info = book::read_info(dataset, findings)?;
    Ok(match info.version {
        Version::V30 => v30::read(dataset, info, listed, findings),
        Version::V21 => v21::read(dataset, info, listed, findings),
    })
}

fn finished(
    dataset: &Path,
    book: &Book,
    frames: usize,
    identities: Vec<Identity>,
    totals: &totals::Totals,
    findings: Findings,
) -> Checked {
    let (findings, further) = findings.into_parts();
    Checked {
        dataset: dataset.display().to_string(),
        format: book.info.version.name(),
        episodes: book.episodes.len(),
        frames,
        findings,
        further,
        identities,
        overview: show::overview(book, totals),
    }
}

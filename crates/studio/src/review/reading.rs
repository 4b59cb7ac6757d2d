//! Reading of a review desk from a collection, and the expert's trials of its scenarios.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use genmanip_assets::Catalogue;
use genmanip_benchmark::suites::frozen::certificate;
use genmanip_pipeline::suites::{horizon_s, try_expert};
use genmanip_workspace::{Cause, Progress, WorkspaceError, scenarios, with_causes};

use super::content::content_sha256;
use super::desk::{ReviewDesk, Reviewable};
use super::log::{ExpertTrials, ReviewLog};
use super::older::take_from_suites;
use crate::collections::{Collection, Listed};
use crate::edit::{EditLog, EditedScenario};

/// Review desk with the scenarios of a collection and the log in `out`; and messages about scenarios that cannot be
/// read.
///
/// # Errors
/// When the log or a suite's file is damaged.
pub fn read_desk(collection: &Collection, out: &Path) -> Result<(ReviewDesk, Vec<String>), WorkspaceError> {
    let mut desk = ReviewDesk::new(ReviewLog::read(out)?);
    let (mut left_out, mut superseded) = (Vec::new(), BTreeSet::new());
    for listed in collection.iter() {
        match read_item(listed) {
            Ok((item, parent)) => {
                desk.put(item);
                superseded.extend(parent.and_then(|parent| collection.key_of(&parent)));
            }
            Err(error) => {
                left_out.push(format!("{} is left out: {}", listed.path.display(), with_causes(error.as_ref())));
            }
        }
    }
    desk.supersede(&superseded);
    take_from_suites(&mut desk)?;
    Ok((desk, left_out))
}

/// A scenario of a collection as it is reviewed, and the file that it was copied from, if any.
///
/// # Errors
/// When it or its log of edits cannot be read.
pub fn read_item(listed: &Listed) -> Result<(Reviewable, Option<PathBuf>), Cause> {
    let item = |scenario| Reviewable::of(&listed.key, listed.path.clone(), &listed.source, scenario);
    if EditLog::path_of(&listed.path).is_file() {
        let edited = EditedScenario::open(&listed.path, Catalogue::all())?;
        let parent = edited.parent().map(|parent| PathBuf::from(&parent.path));
        return Ok((item(edited.scenario()), parent));
    }
    let scenario = scenarios::read_scenario(&listed.path)?;
    Ok((item(&scenario), None))
}

/// Lets the expert try each scenario, one after the other, and passes each result to `keep`. If interrupted, it ends
/// before the remaining scenarios without an error.
///
/// # Errors
/// When a scenario cannot be read or has changed since it was listed, an episode raises an error, or `keep` fails.
pub fn certify(
    items: &[Reviewable],
    at: &str,
    workers: usize,
    progress: &dyn Progress,
    stop: &AtomicBool,
    mut keep: impl FnMut(ExpertTrials) -> Result<(), WorkspaceError>,
) -> Result<(), WorkspaceError> {
    for item in items {
        let path = [item.path.clone()];
        let Some(mut tried) = try_expert(&path, None, workers, progress, stop)? else { return Ok(()) };
        let results = tried.remove(&item.id).unwrap_or_default();
        let now = scenarios::read_scenario(&item.path)?;
        if content_sha256(&now) != item.content_sha256 {
            return Err(WorkspaceError::input(format!("scenario {} was changed while the expert tried it", item.id))
                .with_hint("let the expert try it again"));
        }
        let found = certificate(&results);
        let is_solved = found.verified > 0;
        keep(ExpertTrials {
            scenario: item.id.clone(),
            content_sha256: item.content_sha256.clone(),
            episodes: found.episodes,
            verified: found.verified,
            shortest_path_m: is_solved.then_some(found.shortest_path_m),
            shortest_s: is_solved.then_some(found.shortest_s),
            horizon_s: horizon_s(&results),
            at: at.into(),
        })?;
    }
    Ok(())
}

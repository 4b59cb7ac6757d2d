//! Review desk of the server, kept up to date with edited scenarios.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use genmanip_workspace::WorkspaceError;

use super::answer::Refusal;
use super::room::Room;
use crate::collections::Listed;
use crate::review::{ReviewDesk, ReviewError, Reviewable, read_item};

/// Review desk and the revision of each edited scenario that it holds, by key; read on first use.
#[derive(Debug, Default)]
pub struct Reviews {
    desk: Mutex<Option<(ReviewDesk, BTreeMap<String, u64>)>>,
    /// Lock held while the expert tries a scenario, one at a time; it is asynchronous, so that waiting requests block
    /// no thread.
    pub expert: tokio::sync::Mutex<()>,
}

impl Reviews {
    /// Runs `work` on the desk, after updating it with all scenarios (edited ones at their present revision) and with
    /// the lines that other programs wrote to the log.
    ///
    /// # Errors
    /// When the desk cannot be read, and any error of `work`.
    pub fn at_desk<T>(
        &self,
        listed: &[Listed],
        edited: &[(Listed, Arc<Room>)],
        read: impl FnOnce() -> Result<ReviewDesk, WorkspaceError>,
        work: impl FnOnce(&mut ReviewDesk) -> Result<T, Refusal>,
    ) -> Result<T, Refusal> {
        let mut held = self.desk.lock().unwrap_or_else(PoisonError::into_inner);
        if held.is_none() {
            *held = Some((read()?, BTreeMap::new()));
        }
        let Some((desk, revisions)) = held.as_mut() else { return Err(Refusal::unsuited("there is no desk", "")) };
        let mut superseded = BTreeSet::new();
        for (listed, room) in edited {
            superseded.extend(room.parent.clone());
            let now = room.revision();
            if revisions.get(&listed.key) != Some(&now.number) {
                desk.put(Reviewable::of(&listed.key, listed.path.clone(), &listed.source, &now.scenario));
                revisions.insert(listed.key.clone(), now.number);
            }
        }
        for listed in listed.iter().filter(|listed| !revisions.contains_key(&listed.key)) {
            if desk.get(&listed.key).is_none()
                && let Ok((item, _)) = read_item(listed)
            {
                desk.put(item);
            }
        }
        desk.supersede(&superseded);
        desk.log_mut().refresh().map_err(|error| refused(error.into()))?;
        work(desk)
    }
}

/// HTTP refusal for an error of the review desk.
pub fn refused(error: ReviewError) -> Refusal {
    match error {
        ReviewError::Invalid(message) => Refusal::unsuited(message, ""),
        ReviewError::Voided => Refusal::unsuited(error.to_string(), "look at it again"),
        ReviewError::Log(error) => {
            Refusal::Stopped { message: error.to_string(), hint: "what was acknowledged is in the log".into() }
        }
    }
}

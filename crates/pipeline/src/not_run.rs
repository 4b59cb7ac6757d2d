//! Episodes that were not run, since their policy made a mistake or did not answer: their messages, and how many in a
//! row stop a run.

use std::sync::{Mutex, PoisonError};

use genmanip_core::NotRun;
use genmanip_workspace::WorkspaceError;

use crate::policy_spec::mistaken;

/// Number of episodes in a row that were not run after which the others are not tried: a policy that raises or a server
/// that is gone would fail them all.
const MOST_IN_A_ROW: usize = 3;

/// Counter of the episodes in a row, as they end, that were not run.
pub(crate) struct Series<'a> {
    policy: &'a str,
    keep_going: bool,
    in_a_row: Mutex<Vec<NotRun>>,
}

impl<'a> Series<'a> {
    /// An empty series of episodes of `policy`, which stops nothing if `keep_going`.
    pub fn new(policy: &'a str, keep_going: bool) -> Self {
        Self { policy, keep_going, in_a_row: Mutex::default() }
    }

    /// Ends the series: an episode was run.
    pub fn was_run(&self) {
        self.in_a_row.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Adds an episode that was not run.
    ///
    /// # Errors
    /// From the third in a row on, with the first of them.
    pub fn was_not_run(&self, episode: &NotRun) -> Result<(), WorkspaceError> {
        let mut in_a_row = self.in_a_row.lock().unwrap_or_else(PoisonError::into_inner);
        in_a_row.push(episode.clone());
        match &in_a_row[..] {
            [first, ..] if in_a_row.len() >= MOST_IN_A_ROW && !self.keep_going => Err(stopped(self.policy, first)),
            _ => Ok(()),
        }
    }
}

/// Error of a run that was stopped; `first` is the first episode of the series.
fn stopped(policy: &str, first: &NotRun) -> WorkspaceError {
    let what = format!("policy {policy}: {MOST_IN_A_ROW} episodes in a row were not run, the first is {}", first.id);
    let go_on = "what was finished is kept: start again to continue, with --keep-going to try every episode";
    if first.mistake {
        let (reason, remedy) = first.reason.split_once("\nhint: ").unwrap_or((&first.reason, ""));
        let remedy = if remedy.is_empty() { String::new() } else { format!("{remedy}; ") };
        return mistaken(&what, &format!("{reason}\nhint: {remedy}{go_on}"));
    }
    WorkspaceError::input(format!("{what}: {}", first.reason)).with_hint(go_on)
}

/// Error of a policy that ran no episode; `first` is the first that was not run.
pub(crate) fn no_episode(policy: &str, first: &NotRun) -> WorkspaceError {
    let what = format!("policy {policy} ran no episode, {} was not run", first.id);
    if first.mistake {
        return mistaken(&what, &first.reason);
    }
    WorkspaceError::input(format!("{what}: {}", first.reason))
        .with_hint("check that the service it asks is running, and that arguments such as `preset` fit it, then repeat the command; nothing was counted")
}

/// Note on the episodes that were not run, if there are any.
pub(crate) fn note(not_run: &[NotRun]) -> Option<String> {
    let (first, others) = not_run.split_first()?;
    let more = if others.is_empty() { String::new() } else { format!(" (and {} more)", others.len()) };
    Some(format!("{} was not run{more}: {}", first.id, first.reason))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Outcomes of episodes as letters: `r` run, `m` not run by a mistake, `u` not run otherwise; the number of those
    /// that are tried before the run stops.
    #[test]
    fn three_in_a_row_stop_a_run() {
        let tried = |episodes: &str, keep_going: bool| {
            let series = Series::new("mine", keep_going);
            for (number, letter) in episodes.chars().enumerate() {
                let reason = format!("broke at {number}\nhint: correct it");
                let episode =
                    NotRun { id: number.to_string(), scenario_id: String::new(), reason, mistake: letter == 'm' };
                match letter {
                    'r' => series.was_run(),
                    _ => {
                        if let Err(error) = series.was_not_run(&episode) {
                            return (number + 1, error.to_string(), error.hint().unwrap_or_default());
                        }
                    }
                }
            }
            (episodes.len(), String::new(), String::new())
        };
        for (episodes, keep_going, expected) in [
            ("mmrmmrmm", false, 8),
            ("rmmmmm", false, 4),
            ("uuuuuu", false, 3),
            ("umumu", false, 3),
            ("mmmmmm", true, 6),
        ] {
            assert_eq!(tried(episodes, keep_going).0, expected, "{episodes}");
        }
        let (_, what, hint) = tried("rmmm", false);
        assert!(what.contains("3 episodes in a row") && what.contains("broke at 1"), "{what}");
        assert!(hint.starts_with("correct it; ") && hint.contains("--keep-going"), "{hint}");
    }
}

//! Episodes that were not run, because their policy made a mistake or was unreachable: messages, and the number in a
//! row that ends a run.

use std::sync::{Mutex, PoisonError};

use genmanip_core::NotRun;
use genmanip_workspace::WorkspaceError;

use crate::policy_spec::mistaken;

/// Number of consecutive episodes that were not run after which the remaining ones are not tried: a policy that raises
/// an exception, or an unreachable server, would fail for all.
const MOST_IN_A_ROW: usize = 3;

/// Counter of consecutive episodes that were not run, in the order in which they end.
pub(crate) struct Series<'a> {
    policy: &'a str,
    keep_going: bool,
    in_a_row: Mutex<Vec<NotRun>>,
}

impl<'a> Series<'a> {
    /// A counter at 0 for episodes of `policy`; with `keep_going`, it never ends a run.
    pub fn new(policy: &'a str, keep_going: bool) -> Self {
        Self { policy, keep_going, in_a_row: Mutex::default() }
    }

    /// Resets the counter: an episode was run.
    pub fn was_run(&self) {
        self.in_a_row.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Adds an episode that was not run.
    ///
    /// # Errors
    /// From the third consecutive episode on, an error about the first of them; never with `keep_going`.
    pub fn was_not_run(&self, episode: &NotRun) -> Result<(), WorkspaceError> {
        let mut in_a_row = self.in_a_row.lock().unwrap_or_else(PoisonError::into_inner);
        in_a_row.push(episode.clone());
        match &in_a_row[..] {
            [first, ..] if in_a_row.len() >= MOST_IN_A_ROW && !self.keep_going => Err(stopped(self.policy, first)),
            _ => Ok(()),
        }
    }
}

/// Error that ends a run; `first` is the first of the consecutive episodes.
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

/// Error for a policy of which no episode was run; `first` is the first of its episodes.
pub(crate) fn no_episode(policy: &str, first: &NotRun) -> WorkspaceError {
    let what = format!("policy {policy} ran no episode, {} was not run", first.id);
    if first.mistake {
        return mistaken(&what, &first.reason);
    }
    WorkspaceError::input(format!("{what}: {}", first.reason))
        .with_hint("check that the service it asks is running, and that arguments such as `preset` fit it, then repeat the command; nothing was counted")
}

/// Note on the episodes that were not run; `None` without any.
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

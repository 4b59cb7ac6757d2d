//! Episodes that were not run, since their policy made a mistake or could not be reached: how they are told.

use genmanip_core::NotRun;
use genmanip_workspace::WorkspaceError;

use crate::policy_spec::mistaken;

/// Error of a policy that ran no episode; `first` is the first that was not run.
pub(crate) fn no_episode(policy: &str, first: &NotRun) -> WorkspaceError {
    if first.mistake {
        return mistaken(&format!("policy {policy} ran no episode, {} was not run", first.id), &first.reason);
    }
    WorkspaceError::input(format!("policy {policy} could not be reached for any episode: {}", first.reason))
        .with_hint("see that it runs, then start again; nothing was counted")
}

/// Note on the episodes that were not run, if there are any.
pub(crate) fn note(not_run: &[NotRun]) -> Option<String> {
    let (first, others) = not_run.split_first()?;
    let more = if others.is_empty() { String::new() } else { format!(" (and {} more)", others.len()) };
    Some(format!("{} was not run{more}: {}", first.id, first.reason))
}

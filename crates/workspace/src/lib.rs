//! Errors, files, documents and progress, shared by everything that works on folders.
//!
//! - [`WorkspaceError`]: why a request could not be met, with a hint.
//! - [`documents`]: bounded reads and atomic writes of files and versioned documents.
//! - [`task_files`], [`task_faults`], [`Tasks`]: tasks from files, everything wrong with them, and lists of any length.
//! - [`designed_tasks`], [`task_checks`]: tasks of the rule-based designer into a folder, and all faults of task files.
//! - [`scenarios`], [`worlds`]: scenarios, worlds, robots and planners by file or name.
//! - [`robots`]: robot files of the user, registered by name.
//! - [`Ledger`](resume_ledger::Ledger): finished items, one JSON line each, so that a killed call continues.
//! - [`shard`]: the part of a run that one of several machines does.
//! - [`disk_space`]: free disk space, and an estimate of what a run needs.
//! - [`Progress`]: progress callbacks; stages report, callers print.
//! - [`text_table`]: aligned tables of plain text.

pub mod designed_tasks;
pub mod difference;
pub mod disk_space;
pub mod documents;
mod error;
mod progress;
pub mod resume_ledger;
pub mod robots;
pub mod scenarios;
pub mod shard;
pub mod task_checks;
pub mod task_faults;
pub mod task_files;
pub mod task_spool;
mod text_table;
pub mod workers;
pub mod worlds;

pub use error::{Cause, Stopped, WorkspaceError, hint};
pub use progress::{NoProgress, Progress};
pub use task_spool::Tasks;
pub use text_table::{MAX_ROWS, attention, text_table};

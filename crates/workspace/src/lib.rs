//! Errors, files, documents and progress, shared by everything that works on folders.
//!
//! - [`WorkspaceError`]: the reason why a request failed, with a hint.
//! - [`documents`]: size-limited reads and atomic writes of files and versioned documents.
//! - [`task_files`], [`task_faults`], [`Tasks`]: tasks from files, their faults, and lists of any length.
//! - [`designed_tasks`], [`task_checks`]: tasks composed by the rule-based designer, and the flaws of task files.
//! - [`scenarios`], [`worlds`]: scenarios, worlds, robots and planners by file or name.
//! - [`robots`]: robot files of the user, registered by name.
//! - [`Ledger`](resume_ledger::Ledger): finished items, one JSON line each, so that a killed call continues.
//! - [`shard`]: the part of a run that one of several machines processes.
//! - [`disk_space`]: free disk space, and an estimate of the space that a run needs.
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

pub use error::{Cause, Stopped, WorkspaceError, hint, messages, with_causes};
pub use progress::{NoProgress, Progress};
pub use task_spool::Tasks;
pub use text_table::{MAX_ROWS, attention, text_table};

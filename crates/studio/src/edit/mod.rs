//! Edits of a scenario: operations with inverses in an append-only log, with conflict detection, undo and redo.

mod apply;
mod catalogue;
mod derived;
mod difference;
mod document;
mod error;
mod fields;
mod history;
mod log;
mod objects;
mod operation;
mod task_parts;

pub use difference::{Difference, Moved, Turned};
pub use document::{Applied, Command, EditedScenario};
pub use error::{Conflict, EditError};
pub use log::{CommandLine, EditLog, Header, Line, Parent, SCHEMA, Snapshot, Stamp};
pub use operation::{Change, ChosenAsset, Instance, NodeWithCard, Operation, Placement};

//! Edits of a scenario: operations with inverses, conflicts, undo and redo, in an append-only log.

mod document;
mod error;
mod operation;

pub use document::{Applied, Command, EditedScenario, Stamp};
pub use error::{Conflict, EditError};
pub use operation::{Change, ChosenAsset, Instance, NodeWithCard, Operation, Placement};

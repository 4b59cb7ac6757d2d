//! Runs: what is done around the stages, with folders that keep what is finished.
//!
//! - [`folder`]: what a run folder holds; a folder never mixes two runs, and an interrupted run continues.
//! - [`Survey`]: what lies in the store of a run, from its index.
//! - [`collect`]: demonstrations, their pictures and the dataset.
//! - [`shard`]: a part of a run or evaluation that one of several machines does; [`merge`] brings parts together.
//! - [`designs`]: tasks by rules into a folder; [`checks`]: what is wrong with task files.
//! - [`export`]: further data sets of a run.
//! - [`evaluate`]: policies on scenarios; [`policies`] is the one registry of policies by name with arguments.
//! - [`compare`]: two evaluations of one suite; [`leaderboard`]: all evaluations below a folder.
//! - [`suites`]: scenarios chosen, certified and frozen, to be evaluated on.
//! - [`sessions`]: environments that other programs drive, action by action.
//! - [`report`]: the input of the HTML page and the page itself, with [`pictures`] of the scenes.
//! - [`replay`], [`layouts`], [`plan`] and [`grasps`]: what the other verbs do.
//! - [`worlds`]: world files and cameras: check, show, edit in place; [`views`]: what cameras see.
//! - [`packs`]: objects from files into packs, and packs opened for the whole program.
//! - [`render`]: pictures of scenarios and recorded episodes, as they were or in another look.
//! - [`OracleSegmenter`]: masks from truth, for the modular system to be measured against.
//! - [`inputs`] and [`robots`]: tasks, answers, scenarios and robots from files that anybody may have written.
//!
//! Every stage is a function from input, settings and seed to a result or a [`RunError`];
//! it tells a [`Progress`] how far it is and prints nothing.

pub mod ablate;
pub mod act;
pub mod agents;
pub mod assets;
pub mod audit;
pub mod checks;
pub mod collect;
pub mod compare;
pub mod designs;
mod documents;
mod error;
pub mod evaluate;
pub mod export;
pub mod folder;
pub mod grasps;
mod index;
pub mod inputs;
pub mod launch;
pub mod layouts;
pub mod leaderboard;
mod ledger;
pub mod merge;
pub mod motion_pictures;
mod oracle_segmenter;
pub mod packs;
pub mod pictures;
pub mod plan;
pub mod policies;
mod progress;
mod remote;
pub mod render;
pub mod replay;
pub mod report;
pub mod rerender;
pub mod robots;
mod room;
mod seeing;
pub mod sessions;
pub mod shard;
pub mod suites;
pub mod tasks;
pub mod views;
pub mod worlds;

pub use error::{Cause, RunError};
pub use folder::{Run, RunFolder, Timings};
pub use index::{Known, Survey};
pub use oracle_segmenter::OracleSegmenter;
pub use policies::PolicyFactory;
pub use progress::{Progress, Silent};

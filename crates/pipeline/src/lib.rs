//! The pipeline on run folders: collect → images → dataset → evaluate → report, each resumable.
//!
//! - [`folder`]: contents of a run folder; a folder never mixes two runs, and an interrupted run continues.
//! - [`Survey`]: the episodes in the store of a run, from its index.
//! - [`collect`]: demonstrations, their images and the dataset; [`merge`] merges the shards of a run.
//! - [`export`] and [`rerender`]: further datasets of a run, with the recorded or another appearance.
//! - [`evaluate`]: policies on scenarios; [`policies`] is the registry of policies by name with arguments.
//! - [`offered`]: policies that this program serves to other programs.
//! - [`ablate`]: the agent with one setting changed at a time.
//! - [`suites`]: building and perturbing benchmark suites, the two steps that run policies.
//! - [`sessions`]: environments that other programs drive one action at a time.
//! - [`real`]: policies on a real arm behind a bridge, and on a simulated one in its place.
//! - [`report`]: input of the HTML page and the page itself.
//! - [`learn`]: policies trained on the demonstrations of a run.
//! - [`layouts`], [`plan`]: layouts of tasks as scenario files, and single motions of the arm.
//!
//! Every stage is a function from input, settings and seed to a result or a [`genmanip_workspace::WorkspaceError`];
//! it reports to a [`genmanip_workspace::Progress`] and prints nothing.

pub mod ablate;
pub mod collect;
pub mod evaluate;
pub mod export;
pub mod folder;
mod index;
pub mod layouts;
pub mod learn;
mod learned;
pub mod merge;
mod not_run;
pub mod offered;
pub mod plan;
pub mod policies;
mod policy_spec;
pub mod real;
mod remote;
pub mod report;
pub mod rerender;
pub mod sessions;
pub mod skills;
pub mod suites;

pub use folder::{Run, RunFolder, Timings};
pub use index::{IndexedAttempt, Survey};
pub use policies::PolicyFactory;

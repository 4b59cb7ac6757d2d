//! The studio: edits of scenarios as a log of operations, and verdicts on the consequences of each edit for the task.
//!
//! - [`edit`] changes a scenario by [`edit::Operation`]s, each with an inverse, and keeps them in an append-only log
//!   beside the scenario's file.
//! - [`faults`] plants faults in sound scenarios.
//! - [`review`] keeps reviews in an append-only log, derives the standing of each scenario and the next work of each
//!   reviewer, and writes a balanced suite of the approved scenarios.
//! - [`log_file`] is the append-only file that both logs use.
//! - [`new_scenario`] makes a scenario from one sentence.
//! - [`verdict`] judges an edited scenario in stages with the checks of `layout` and `tasks`, and offers repairs as
//!   operations.
//! - [`run`] runs policies on scenarios and plays their episodes back.
//! - [`scene`] encodes meshes as binary glTF, and describes the bodies of a scene with their poses.
//! - [`collections`] lists the scenarios of files, runs and suites; [`server`] offers them to the page in `web/`.

pub mod collections;
pub mod edit;
pub mod faults;
pub mod log_file;
pub mod new_scenario;
pub mod review;
pub mod run;
pub mod scene;
pub mod server;
pub mod teleop;
pub mod verdict;

//! The studio: edits of scenarios as a log of operations, and verdicts on what each edit does to the task.
//!
//! - [`edit`] changes a scenario by [`edit::Operation`]s, each with an inverse, and keeps them in an append-only log
//!   beside the scenario's file.
//! - [`review`] keeps reviews in an append-only log, says what they amount to and who reviews what next, and writes a
//!   balanced suite of the approved scenarios.
//! - [`log_file`] is the append-only file of both logs.
//! - [`new_scenario`] makes a scenario from one sentence.
//! - [`verdict`] judges an edited scenario in stages with the checks of `layout` and `tasks`, and offers repairs as
//!   operations.
//! - [`run`] runs policies on scenarios and plays their episodes back.
//! - [`scene`] writes meshes as binary glTF and describes what stands where.
//! - [`collections`] finds the scenarios of files, runs and suites; [`server`] offers them to the page in `web/`.

pub mod collections;
pub mod edit;
pub mod log_file;
pub mod new_scenario;
pub mod review;
pub mod run;
pub mod scene;
pub mod server;
pub mod verdict;

//! Tools for data sets: check, import from other programs, merge, split, filter and convert.
//!
//! - [`check`]: flaws of a data set, an overview of its contents, and train-test overlap of two data sets.
//! - [`import`]: data sets of other programs (LeRobot v2.1 and v3.0, recordings of the original GenManip).
//! - [`edit`]: data sets composed of others: merged, split, filtered, episodes deleted.
//! - [`learnability`]: how well a policy could predict demonstrations.
//!
//! The formats themselves are read and written by `genmanip-data`.

pub mod check;
pub mod edit;
pub mod import;
pub mod learnability;

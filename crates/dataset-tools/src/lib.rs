//! Tools for datasets: check them, import those of other programs, merge, split, filter and convert them.
//!
//! - [`check`]: everything that is wrong with a dataset, an overview of its contents, and leaks between two datasets.
//! - [`import`]: datasets of other programs (LeRobot v2.1 and v3.0, recordings of the original GenManip).
//! - [`edit`]: datasets made of datasets: merged, split, filtered, episodes deleted.
//! - [`learnability`]: how well a policy could predict demonstrations.
//!
//! Reading and writing the formats themselves is `genmanip-data`.

pub mod check;
pub mod edit;
pub mod import;
pub mod learnability;

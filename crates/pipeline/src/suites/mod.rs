//! Building and perturbing benchmark suites: the steps that run policies. Everything else about suites is in
//! `genmanip_benchmark::suites`.

mod build;
mod perturb;

pub use build::{BuildOptions, build};
pub use perturb::{PerturbOptions, perturb};

//! Building and perturbing benchmark suites, and certifying scenarios: the steps that run policies. Everything else about suites is in
//! `genmanip_benchmark::suites`.

mod build;
mod perturb;

pub use build::{BuildOptions, build, horizon_s, try_expert};
pub use perturb::{PerturbOptions, perturb};

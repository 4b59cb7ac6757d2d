//! Perturbations of scenarios along one axis. `genmanip-pipeline` certifies the perturbed scenarios.

mod axis;
mod change;
#[cfg(test)]
mod tests;

pub use axis::Axis;
pub use change::Perturber;

//! Perturbations of scenarios: one respect changed by a stated amount. `genmanip-pipeline` certifies the changed ones.

mod axis;
mod change;
#[cfg(test)]
mod tests;

pub use axis::Axis;
pub use change::Workshop;

//! Pure core of the bridge between a policy and an arm: when the arm may move, and how fast.
//!
//! [`Guard`] decides from leases, sequence numbers, deadlines and the dead-man's switch; [`Interpolator`] turns the
//! positions it lets pass into setpoints at a fixed rate, within limits of velocity, acceleration and jerk. Neither reads
//! a clock or opens a connection.

mod guard;
mod interpolator;

#[cfg(test)]
mod tests;

pub use guard::{Command, Guard, GuardSettings, Mode, Refused, StopReason};
pub use interpolator::{Interpolator, JointLimits, JointState};

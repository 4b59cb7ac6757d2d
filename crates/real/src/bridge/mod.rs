//! Safety core of the bridge between a policy and an arm: when the arm may move, and how fast.
//!
//! [`Guard`] decides by leases, sequence numbers, deadlines and the dead-man's switch which commands pass;
//! [`Interpolator`] turns their positions into setpoints at a fixed rate, within limits of velocity, acceleration and
//! jerk. Neither reads a clock or opens a connection.

mod guard;
mod interpolator;

#[cfg(test)]
mod tests;

pub use guard::{Command, Guard, GuardSettings, Mode, Refused, StopReason};
pub use interpolator::{Interpolator, JointLimits, JointState};

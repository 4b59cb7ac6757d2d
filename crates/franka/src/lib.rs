//! Driver of the bridge for Franka arms: an FR3 over version 10 of Franka's control interface, a Panda over version 5.
//!
//! ```text
//! Bridge ─ Orders ─▶ FrankaArm ─ joint positions, 1 kHz, UDP ─▶ arm
//!                        └─ Hand ─ commands, TCP ─▶ gripper
//! ```
//!
//! [`FrankaArm`] is a [`genmanip_real::bridge::Driver`]. While the bridge stands, the arm holds its position by itself; a
//! motion begins where the arm's controller holds it and ends when the setpoints have come to rest. When a reflex or a lost
//! connection aborts a motion, the reading carries the arm's error words, and the bridge recovers it.

mod arm;
mod hand;
mod velocity;

#[cfg(test)]
mod tests;

pub use arm::{ArmReport, FrankaArm, JOINTS};
pub use franka::{FrankaError, RealtimeConfig, Robot};
pub use hand::{Hand, HandSettings};
pub use velocity::{FR3, limit_velocity};

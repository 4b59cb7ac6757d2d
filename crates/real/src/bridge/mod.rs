//! Bridge between a policy and an arm: when the arm may move, and how fast.
//!
//! ```text
//! policy ─ ArmClient ─ Connection ─▶ server ─▶ Bridge ─▶ Interpolator ─▶ Driver ─▶ arm
//!                                              Guard, GripperMonitor, workspace, recovery
//! ```
//!
//! [`Guard`] decides by leases, sequence numbers, deadlines and the dead-man's switch which commands pass;
//! [`Interpolator`] turns their positions into setpoints at a fixed rate, within limits of velocity, acceleration and
//! jerk. [`Bridge`] adds the gripper, a workspace box, recovery from errors and the messages. None of them reads a clock
//! or opens a connection: time is an argument. [`server`] and [`client`] do, on TCP, with a [`Driver`] for the arm.

pub mod client;
mod gripper;
mod guard;
mod interpolator;
mod link;
mod machine;
mod message;
pub mod server;

#[cfg(test)]
mod tests;

pub use gripper::{GripperMonitor, GripperSettings, GripperState, GripperWord};
pub use guard::{Command, Guard, GuardSettings, Mode, Refused, StopReason};
pub use interpolator::{Interpolator, JointLimits, JointState};
pub use link::{Link, LinkSettings};
pub use machine::{Bridge, BridgeRobot, BridgeSettings, Orders, Reading, ToolPosition, beyond_m};
pub use message::{CameraImage, ImageHead, Motion, PROTOCOL, Recovery, Reply, Request, State, Welcome};
pub use server::{Driver, DriverError, ImageSource};

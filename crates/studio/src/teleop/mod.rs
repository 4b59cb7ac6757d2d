//! Teleoperation from the page: device events become takes of the ordinary episode loop, in real time.
//!
//! - `deputy`: policies and planned motions that a person hands the command to.
//! - [`Hidraw`]: native reader of a SpaceMouse, without a browser.
//! - [`inbox`]: events between the socket and the control loop, bounded, with the hold on silence.
//! - [`pace`]: control steps by the wall clock; late ones are counted.
//! - `live`: the environment as a robot in real time, which can be interrupted and go back.
//! - [`session`]: takes of one scenario: paused, repeated, taken back, handed over, kept or discarded.
//! - `touch`: touch of the device that stops a planned motion.
//! - [`take`]: teleoperated episodes with the record of their operator, stored and replayed.

mod deputy;
mod hidraw;
pub mod inbox;
mod live;
pub mod pace;
pub mod session;
pub mod status;
pub mod take;
mod touch;

pub use hidraw::Hidraw;
pub use inbox::Inbox;
pub use session::{Session, SessionSetup, Sessions};
pub use status::{Phase, Request, SessionStatus, TakeCommand};
pub use take::{Take, is_replayed};

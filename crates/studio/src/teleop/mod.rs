//! Teleoperation from the page: device events become takes of the ordinary episode loop, in real time.
//!
//! - [`inbox`]: events between the socket and the control loop, bounded, with the hold on silence.
//! - [`pace`]: control steps by the wall clock; late ones are counted.
//! - [`session`]: takes of one scenario: paused, repeated, kept or discarded.
//! - [`take`]: teleoperated episodes with the record of their operator, stored and replayed.

pub mod inbox;
pub mod pace;
pub mod session;
pub mod take;

pub use inbox::Inbox;
pub use session::{Phase, Session, SessionSetup, Sessions};
pub use take::{Take, is_replayed};

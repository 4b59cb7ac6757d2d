//! Tools between the program and a real arm: calibration of cameras, and a bridge.
//!
//! - [`boards`]: printed boards of tags, and their corners found in images.
//! - [`bridge`]: bridge between a policy and an arm: state machine, server and client.
//! - [`calibrate`](mod@calibrate): pose of a camera on the hand or beside the robot, with its uncertainty; check of the
//!   intrinsics; choice of hand poses that make the result well-conditioned.
//! - [`least_squares`], [`linear`]: minimisation of sums of squares, and the dense linear algebra behind it.
//! - [`synthetic`]: simulated views of a board with known truth, for rehearsals and measurements.

pub mod boards;
pub mod bridge;
pub mod calibrate;
pub mod homography;
pub mod least_squares;
pub mod linear;
pub mod synthetic;

pub use calibrate::{BoardViews, Calibration, CalibrationError, CalibrationSettings, calibrate};

//! Tools between the program and a real arm: calibration of cameras, and the safety core of a bridge.
//!
//! - [`boards`]: printed boards of tags, and their corners found in images.
//! - [`bridge`]: guard and interpolator for an arm, without connection and clock.
//! - [`calibrate`](mod@calibrate): pose of a camera on the hand or beside the robot, with its uncertainty; check of the
//!   intrinsics; choice of hand poses that make the result well-conditioned.
//! - [`synthetic`]: simulated views of a board with known truth, for rehearsals and measurements.
//!
//! Nothing here moves an arm or opens a connection.

pub mod boards;
pub mod bridge;
pub mod calibrate;
mod homography;
mod least_squares;
mod linear;
pub mod synthetic;

pub use calibrate::{BoardViews, Calibration, CalibrationError, CalibrationSettings, calibrate};

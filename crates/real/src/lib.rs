//! Tools between the program and a real arm: calibration of cameras, and the safe core of a bridge.
//!
//! - [`boards`]: printed boards of tags, and their corners found in images.
//! - [`bridge`]: guard and interpolator in front of an arm, without connection and clock.
//! - [`calibrate`](mod@calibrate): pose of a camera on the hand or beside the robot, with its uncertainty; check of its
//!   intrinsics; choice of poses that make the result well-conditioned.
//! - [`synthetic`]: views of a board with known truth, for rehearsals and measurements.
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

//! The modular manipulation system: it acts from RGB-D images, camera parameters and joint positions alone.
//!
//! - [`segmentation`] finds the things in an image.
//! - [`services`] asks other programs for masks and grasps, and says what they are asked.
//!
//! It never sees the simulator or the catalogue: the manifest forbids both.

pub mod segmentation;
pub mod services;

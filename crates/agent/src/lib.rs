//! The modular manipulation system: it acts from RGB-D images, camera parameters and joint positions alone.
//!
//! - [`segmentation`] finds the things in an image.
//!
//! It never sees the simulator or the catalogue: the manifest forbids both.

pub mod segmentation;

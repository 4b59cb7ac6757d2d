//! Frames: pass order, per-camera frame cache, output channels and image files.

pub(crate) mod cache;
pub mod encode;
mod normals;
pub(crate) mod renderer;

//! Light buffer: shadow mask and ambient occlusion per pixel.
//!
//! Each pixel has few taps, whose rotation repeats every 4×4 pixels; a bilateral filter then averages over such a
//! block. Ambient occlusion varies slowly, so it is sampled at every second row and column and upsampled.
//!
//! A tile depends only on tiles within a known reach, so that a frame can continue the last one where nothing changed.

mod blur;
mod buffer;
mod dirty;
mod estimate;
mod surfaces;
mod upsample;

pub(crate) use blur::Windows;
pub(crate) use buffer::LightBuffer;
pub(crate) use estimate::Estimator;
pub(crate) use upsample::UpsampleWindow;

//! Shadows of the key light: shadow map, percentage-closer soft shadows (PCSS) and planar receivers.

pub(crate) mod map;
pub(crate) mod pcss;
pub(crate) mod planar;
mod summed_area;

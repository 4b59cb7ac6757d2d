//! Shadows of the key light: shadow map and percentage-closer soft shadows (PCSS).

pub(crate) mod map;
pub(crate) mod pcss;

//! Geometry per pixel: cameras and placed parts, the static layer, surface points and material bins.

pub(crate) mod material_bins;
pub(crate) mod points;
pub(crate) mod static_layer;
pub(crate) mod view;

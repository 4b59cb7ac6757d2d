//! Key light and sky.

pub(crate) mod key_light;
pub(crate) mod lighting;
pub(crate) mod sky;

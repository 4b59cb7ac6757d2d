//! Transparent interfaces: visibility, refraction and compositing.

pub(crate) mod composite;
mod refraction;
pub(crate) mod visibility;

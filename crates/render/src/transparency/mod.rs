//! Transparent interfaces: visibility, refraction and compositing.

pub(crate) mod composite;
pub(crate) mod interface;
mod refraction;
pub(crate) mod visibility;

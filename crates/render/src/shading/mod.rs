//! Shading: metallic-roughness reflection of the key light and the environment.
//!
//! Specular reflection has the GGX distribution, Hammon's approximation of the Smith visibility term and Schlick's
//! Fresnel term; for the environment it is Karis' analytic fit of the split sum ("Physically Based Shading on Mobile",
//! 2014). Points are shaded in batches, each of one part.

pub(crate) mod backdrop;
mod near_field;
mod part;
mod points;
mod reflect;
mod reflectance;
mod shader;
mod terms;
pub(crate) mod tone_map;

pub(crate) use part::ShadedPart;
pub(crate) use shader::{Shading, ShadingPoint};

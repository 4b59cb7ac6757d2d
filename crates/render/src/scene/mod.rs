//! Scene contents: meshes, materials, fixtures and their appearance.

pub(crate) mod assets;
pub(crate) mod body_shape;
pub(crate) mod fixtures;
pub(crate) mod material;
pub(crate) mod mesh;
pub(crate) mod patterns;
pub mod sampling;
pub(crate) mod supports;
pub(crate) mod table_tops;
pub(crate) mod texture;
pub(crate) mod variation;
pub(crate) mod walls;

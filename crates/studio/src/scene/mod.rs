//! Scenes as the page and modelling programs draw them: meshes as GLB, scenarios as GLB and USD, and what stands where.

pub mod exported;
pub mod glb;
pub mod images;
pub mod meshes;
pub mod scene_message;
pub mod settling;
pub mod usd;

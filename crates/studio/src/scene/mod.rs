//! Scenes for the page and for modelling programs: meshes as GLB, and bodies with their poses.

pub mod exported;
pub mod glb;
pub mod images;
pub mod meshes;
pub mod scene_message;
pub mod settling;

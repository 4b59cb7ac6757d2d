//! Pictures of posed bodies: colour, metric depth, instance ids and normals from a CPU, without GL, GPU or display.
//!
//! A visibility-buffer rasteriser: triangles write only *which* surface a sample sees and how near it is;
//! every pixel's surface is then shaded once, at its centre, and edges are smoothed from the samples around it.
//! Depth and ids therefore cost a fraction of a colour image, and they never depend on whether colour was asked for.
//!
//! ```text
//! RobotModel + ObjectModels + World       ──► RenderAssets (immutable, shared by all frames and threads)
//! joint positions + object poses          ──► FrameState   (world_from_link of every body)
//! FrameState × Camera × Channels = ViewJob ──► Renderer ──► FrameBuffers ──► encode
//! ```
//!
//! One [`Renderer`] per worker thread; an image is drawn by one thread, and the same job gives the same bytes.
//! A picture continues the one before of the same camera: `layers` finds the tiles that may have changed, `cache`
//! draws these again, and nobody can tell.
//! Light, exposure, background, table top and paint are data ([`RenderVariation`]), drawn from a seed by [`sampling`]:
//! recorded episodes are drawn again with others.
//! What a real camera would make of such a perfect picture, [`sensor`] adds afterwards, for cameras that ask for it.

pub mod error;
pub mod job;
pub mod sensor;

mod ambient;
mod frame;
mod gbuffer;
mod light_buffer;
mod lights;
mod raster;
mod render_scene;
mod resolve;
mod scene;
mod shading;
mod shadow;
mod simd;
mod transparency;

/// Colour conversions.
pub mod color {
    pub use crate::lights::sky::luminance;
    pub use crate::scene::texture::{linear_from_srgb8, srgb8_from_linear};
}

/// Meshes, materials and lights for the path tracer of `genmanip-render-reference`; not a stable interface.
#[doc(hidden)]
pub mod internals {
    pub use crate::gbuffer::view::{CameraView, rotation};
    pub use crate::lights::lighting::Lighting;
    pub use crate::lights::sky::Sky;
    pub use crate::scene::assets::Part;
    pub use crate::scene::material::Material;
    pub use crate::scene::mesh::{Face, Mesh};
    pub use crate::scene::texture::MipTexture;
    pub use crate::shading::backdrop::Backdrop;
    pub use crate::shading::tone_map::tone_map;
}

#[cfg(test)]
mod tests;

pub use error::RenderError;
pub use frame::encode;
pub use frame::renderer::Renderer;
pub use genmanip_core::{Look, Vary};
pub use job::{Channels, FIRST_OBJECT, FrameBuffers, FrameState, NOTHING, ROBOT, TABLE, ViewJob, object_of_instance};
pub use scene::assets::RenderAssets;
pub use scene::posed::PosedMesh;
pub use scene::sampling;
pub use scene::table_tops::TableTop;
pub use scene::variation::{ObjectVariation, RenderVariation};
pub use scene::walls::{Room, Wall};

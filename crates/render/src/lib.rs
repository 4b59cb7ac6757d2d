//! CPU renderer: colour, metric depth, instance ids and normals of posed bodies, without GL, GPU or display.
//!
//! A visibility-buffer rasteriser: triangles write only the visible surface and its depth per sample; each pixel is then
//! shaded once, at its centre, and edges are anti-aliased from the samples around it. Depth and ids cost a fraction of a
//! colour image and never depend on whether colour was requested.
//!
//! ```text
//! RobotModel + ObjectModels + World        ──► RenderAssets (immutable, shared by all frames and threads)
//! joint positions + object poses           ──► FrameState   (world_from_link of every body)
//! FrameState × Camera × Channels = ViewJob ──► Renderer ──► FrameBuffers ──► encode
//! ```
//!
//! One [`Renderer`] per worker thread; the same job gives the same bytes. A frame continues the last one of the same camera:
//! only dirty tiles are repeated, with the bytes of an image rendered from scratch. Light, exposure, background, table top and
//! paint are data ([`RenderVariation`]), sampled from a seed by [`sampling`]. [`sensor`] adds lens, noise and stereo depth for
//! cameras that ask for them. `docs/concepts/rendering.md` describes the passes.

pub mod error;
pub mod job;
pub mod sensor;

mod ambient;
mod frame;
mod gbuffer;
mod light_buffer;
mod lights;
mod matched;
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
    pub use crate::scene::texture::{linear_from_srgb, linear_from_srgb8, srgb_from_linear, srgb8_from_linear};
}

/// Meshes, materials and lights for the path tracer of `genmanip-render-reference` and for the files of
/// `genmanip-studio`; not a stable interface.
#[doc(hidden)]
pub mod internals {
    pub use crate::gbuffer::view::{CameraView, rotation};
    pub use crate::lights::lighting::Lighting;
    pub use crate::lights::sky::Sky;
    pub use crate::scene::assets::Part;
    pub use crate::scene::fixtures::{Fixture, visuals as fixtures};
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
pub use genmanip_core::{AppearanceFactor, AppearanceRandomisation};
pub use job::{Channels, FIRST_OBJECT, FrameBuffers, FrameState, NOTHING, ROBOT, TABLE, ViewJob, object_of_instance};
pub use matched::camera_look::CameraLook;
pub use matched::photograph::{LinearPhotograph, decoded as decoded_photograph};
pub use matched::response::Response;
pub use scene::assets::RenderAssets;
pub use scene::sampling;
pub use scene::table_tops::TableTop;
pub use scene::variation::{ObjectVariation, RenderVariation};
pub use scene::walls::{Room, Wall};

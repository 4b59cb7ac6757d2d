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
//! A picture continues the one before of the same camera: `layers` finds the tiles that may have changed, `canvas`
//! draws these again, and nobody can tell.
//! Light, exposure, background, table top and paint are data ([`RenderVariation`]), drawn from a seed by [`sampling`]:
//! recorded episodes are drawn again with others.
//! What a real camera would make of such a perfect picture, [`sensor`] adds afterwards, for cameras that ask for it.

pub mod assets;
pub mod encode;
pub mod error;
pub mod job;
pub mod posed;
pub mod renderer;
pub mod sampling;
pub mod sensor;
pub mod variation;

mod arrival;
mod backdrop;
mod canvas;
mod develop;
mod edges;
mod glass;
mod key_light;
mod lanes;
mod layers;
mod lighting;
mod mesh;
mod normals;
mod occluders;
mod occlusion;
mod panes;
mod patterns;
mod points;
mod raster;
mod refine;
mod reflectance;
mod scene;
mod shade;
mod shadow;
mod shape;
mod sky;
mod surroundings;
mod table_light;
mod table_tops;
mod taps;
mod texture;
mod tops;
mod view;
mod walls;

/// Colour conversions.
pub mod color {
    pub use crate::sky::luminance;
    pub use crate::texture::{linear_from_srgb8, srgb8_from_linear};
}

/// Meshes, materials and lights as the path tracer of `genmanip-render-reference` needs them; no stable interface.
#[doc(hidden)]
pub mod internals {
    pub use crate::assets::{Part, Surface};
    pub use crate::backdrop::Backdrop;
    pub use crate::develop::tone_map;
    pub use crate::lighting::Lighting;
    pub use crate::mesh::{Face, Mesh};
    pub use crate::sky::Sky;
    pub use crate::texture::MipTexture;
    pub use crate::view::{Lens, rotation};
}

#[cfg(test)]
mod tests;

pub use assets::RenderAssets;
pub use error::RenderError;
pub use genmanip_core::{Look, Vary};
pub use job::{Channels, FIRST_OBJECT, FrameBuffers, FrameState, NOTHING, ROBOT, TABLE, ViewJob, object_of_instance};
pub use posed::PosedMesh;
pub use renderer::Renderer;
pub use table_tops::TableTop;
pub use variation::{ObjectVariation, RenderVariation};
pub use walls::{Room, Wall};

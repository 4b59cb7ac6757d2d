//! What the lens and the sensors of a camera make of a perfect picture; nothing, to the byte, for a camera without them.
//!
//! ```text
//! camera ── pinhole, needed ──► job of a perfect picture ── Renderer ──► picture ── developed ──► what the camera gives
//! ```
//!
//! Colours of a shutter that is open for a while are the mean of several pictures, see [`shutter`]. Depth is measured in
//! the perfect pinhole picture, then the lens bends all channels, then the colour imager reads.
//! Ids and normals stay true: they are labels, and no sensor gives them.

mod color;
mod depth;
mod lens;
pub mod shutter;
#[cfg(test)]
mod tests;

use genmanip_core::{Camera, Intrinsics, Seed};
use rand::Rng;

use crate::error::RenderError;
use crate::frame::renderer::Renderer;
use crate::job::{Channels, FrameBuffers};
use crate::lights::sky::luminance;
use crate::scene::material::Material;

/// The pinhole camera whose picture holds all that the camera shows through its lens; the camera itself without a lens.
///
/// # Errors
/// A lens that folds its picture over.
pub fn pinhole(camera: &Camera) -> Result<Camera, RenderError> {
    let Some(lens) = camera.distortion else { return Ok(camera.clone()) };
    let intrinsics = lens.pinhole(&camera.intrinsics).ok_or_else(|| RenderError::BadCamera {
        camera: camera.name.clone(),
        problem: format!("its lens shows some points twice or stretches an edge more than twice: {lens:?}"),
    })?;
    Ok(Camera { intrinsics, distortion: None, ..camera.clone() })
}

/// The channels of the perfect picture that a camera's sensors need for those that are wanted.
pub fn needed(camera: &Camera, wanted: Channels) -> Channels {
    let sensor = camera.sensor.unwrap_or_default();
    let measures = wanted.depth && sensor.depth.is_some();
    let blurs = wanted.rgb && shutter_s(camera) > 0.0;
    let Channels { depth, normal, parts, .. } = wanted;
    Channels { depth: depth || blurs, normal: normal || measures, parts: parts || measures || blurs, ..wanted }
}

/// How long the shutter of a camera is open, s.
pub fn shutter_s(camera: &Camera) -> f64 {
    camera.sensor.and_then(|sensor| sensor.color).map_or(0.0, |color| color.shutter_s)
}

/// What a camera gives of the perfect picture of its [`pinhole`], with the channels [`needed`], drawn by the renderer.
///
/// The same seed gives the same noise; it is forked by the camera's name, so that cameras of a frame may share one.
///
/// # Errors
/// When the picture cannot be compressed as the colour sensor asks.
pub fn developed(
    renderer: &Renderer,
    camera: &Camera,
    wanted: Channels,
    mut picture: FrameBuffers,
    seed: Seed,
) -> Result<FrameBuffers, RenderError> {
    if camera.distortion.is_none() && camera.sensor.is_none() {
        return Ok(picture);
    }
    let seed = seed.fork("sensor").fork(&camera.name);
    let sensor = camera.sensor.unwrap_or_default();
    let pinhole = pinhole(camera)?.intrinsics;
    if let Some(settings) = sensor.depth.filter(|_| wanted.depth) {
        let returns: Vec<f32> = renderer.materials().iter().map(returned).collect();
        picture.depth_m = depth::measured(&settings, &pinhole, &picture, &returns, seed.fork("depth"));
    }
    if !wanted.depth {
        picture.depth_m.clear();
    }
    if !wanted.parts {
        picture.parts.clear();
    }
    if !wanted.normal {
        picture.normal.clear();
    }
    picture = distorted(camera, &pinhole, picture);
    if let Some(settings) = sensor.color.filter(|_| wanted.rgb) {
        let size = [picture.width, picture.height];
        picture.rgb = color::exposed(&settings, size, &picture.rgb, seed.fork("color"))
            .map_err(|problem| RenderError::BadCamera { camera: camera.name.clone(), problem })?;
    }
    Ok(picture)
}

/// The perfect picture of a camera's [`pinhole`] as its lens bends it; the picture itself without a lens.
///
/// # Errors
/// As [`pinhole`].
pub fn through_lens(camera: &Camera, picture: FrameBuffers) -> Result<FrameBuffers, RenderError> {
    Ok(distorted(camera, &pinhole(camera)?.intrinsics, picture))
}

fn distorted(camera: &Camera, pinhole: &Intrinsics, picture: FrameBuffers) -> FrameBuffers {
    match camera.distortion {
        Some(lens) => lens::distorted(&lens, &camera.intrinsics, pinhole, &picture),
        None => picture,
    }
}

/// Share of the light that a surface throws back to where it came from when it faces it, taken for all colours alike:
/// diffuse paint its albedo, metal the blunt part of its mirror image, glass nearly nothing (chosen: the third power of
/// its opacity).
fn returned(surface: &Material) -> f32 {
    const TEXELS: u32 = 8;
    let texture = surface.texture.as_ref().map_or(1.0, |texture| {
        let places = (0..TEXELS * TEXELS).map(|index| glam::UVec2::new(index % TEXELS, index / TEXELS).as_vec2());
        let sum: f32 = places.map(|place| luminance(texture.at((place + 0.5) / TEXELS as f32))).sum();
        sum / (TEXELS * TEXELS) as f32
    });
    let blunt = (1.0 - surface.metallic) + surface.metallic * surface.roughness * surface.roughness;
    luminance(surface.base) * texture * blunt * surface.opacity.powi(3)
}

/// A number of the standard normal distribution, nearly: a sum of four uniform ones, which ends at 3.5.
fn bell(rng: &mut impl Rng) -> f32 {
    let bits = rng.next_u64();
    let sum: u32 = (0..4).map(|part| (bits >> (16 * part)) as u32 & 0xFFFF).sum();
    // Four uniform numbers below 65536 have a variance of a third of 65536².
    (sum as f32 - 131_070.0) * (1.732_050_8 / 65_536.0)
}

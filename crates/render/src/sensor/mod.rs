//! Lens distortion, exposure, noise and stereo depth: the sensor stage after rendering, no change without them.
//!
//! ```text
//! camera ── pinhole, needed ──► job ── Renderer ──► ideal image ── developed ──► sensor output
//! ```
//!
//! For motion blur, several images are averaged, see [`shutter`]. Depth is measured in the ideal pinhole image; then
//! the lens distorts all channels; then noise and exposure of the colour imager are applied. Ids and normals stay
//! exact: they are labels that no sensor measures.

mod color;
mod depth;
mod lens;
mod noise;
pub mod shutter;
#[cfg(test)]
mod tests;

use genmanip_core::{Camera, Intrinsics, Seed};

use crate::error::RenderError;
use crate::frame::renderer::Renderer;
use crate::job::{Channels, FrameBuffers};
use crate::lights::sky::luminance;
use crate::scene::material::Material;

/// Pinhole camera whose image contains all that a camera sees through its lens; the camera itself without a lens.
///
/// # Errors
/// A lens whose distortion is not invertible.
pub fn pinhole(camera: &Camera) -> Result<Camera, RenderError> {
    let Some(lens) = camera.distortion else { return Ok(camera.clone()) };
    let intrinsics = lens.pinhole(&camera.intrinsics).ok_or_else(|| RenderError::BadCamera {
        camera: camera.name.clone(),
        problem: format!("its lens shows some points twice or stretches an edge more than twice: {lens:?}"),
    })?;
    Ok(Camera { intrinsics, distortion: None, ..camera.clone() })
}

/// Channels of the ideal image that a camera's sensors need to produce the requested ones.
pub fn needed(camera: &Camera, wanted: Channels) -> Channels {
    let sensor = camera.sensor.unwrap_or_default();
    let measures = wanted.depth && sensor.depth.is_some();
    let blurs = wanted.rgb && shutter_s(camera) > 0.0;
    let Channels { depth, normal, parts, .. } = wanted;
    Channels { depth: depth || blurs, normal: normal || measures, parts: parts || measures || blurs, ..wanted }
}

/// Exposure time of a camera (s).
pub fn shutter_s(camera: &Camera) -> f64 {
    camera.sensor.and_then(|sensor| sensor.color).map_or(0.0, |color| color.shutter_s)
}

/// Sensor output from the ideal image of the camera's [`pinhole`] with the channels [`needed`].
///
/// The same seed gives the same noise; it is forked by the camera's name, so that the cameras of a frame may share one.
///
/// # Errors
/// When the image cannot be compressed as the colour sensor requires.
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

/// Ideal image of a camera's [`pinhole`] distorted by its lens; unchanged without a lens.
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

/// Share of light that a surface returns towards its source at normal incidence, averaged over colours: the albedo of
/// diffuse surfaces, the rough part of a metal's reflection, almost nothing from glass (cubed opacity, chosen by hand).
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

//! Path tracer: slow reference images for the rasteriser.
//!
//! Meshes, materials, lights and camera responses are the rasteriser's; photographs of workspaces are not shown. Paths
//! are sampled from a seed with next-event estimation and multiple importance sampling. Intended differences from the
//! rasteriser: full global illumination, shadows of everything on everything, and refraction by transparent objects.

mod bvh;
#[cfg(test)]
mod fixture;
#[cfg(test)]
mod glass_tests;
mod lamps;
mod path;
mod reflection;
mod samples;
mod scene;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use genmanip_core::{Pose, Seed};
use glam::{Vec2, Vec3A};
use rand::RngExt;

use bvh::{Bvh, Triangle};
use genmanip_render::color::{linear_from_srgb8, luminance, srgb8_from_linear};
use genmanip_render::internals::{Backdrop, CameraView, Lighting, rotation, tone_map};
use genmanip_render::{CameraLook, RenderAssets, RenderError, RenderVariation, ViewJob};
use lamps::Lamps;
use samples::Samples;
use scene::{Body, Brought, Reference};

/// Height by which transparent objects are lifted (m), so that their undersides lie above the table.
const LIFTED_M: f32 = 3e-4;

/// Sampling settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceSettings {
    /// Paths per pixel, at least 1.
    pub paths: u32,
    /// Seed of the sampled paths.
    pub seed: Seed,
    /// Number of threads; the image does not depend on it.
    pub threads: usize,
}

/// A path-traced image before exposure and tone mapping.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposed {
    width: usize,
    exposure: f32,
    /// Response of the camera if the variation has one, in place of tone mapping.
    look: Option<CameraLook>,
    pixels: Vec<Brought>,
}

/// Path-traces the colour of a job; its channels are ignored.
///
/// The same job, variation, seed and number of paths give the same image.
///
/// # Errors
/// A frame of other assets, an invalid pose or camera.
pub fn trace(
    assets: &Arc<RenderAssets>,
    variation: &RenderVariation,
    job: &ViewJob<'_>,
    settings: &ReferenceSettings,
) -> Result<Exposed, RenderError> {
    let camera = CameraView::of(assets, job)?;
    let materials = variation.materials(assets);
    let lighting = Lighting::new(variation, assets.ground_color(&materials));
    let poses: Vec<Pose> =
        assets.parts().iter().map(|part| part.body.map_or(Pose::IDENTITY, |body| job.frame.body_poses[body])).collect();
    let reference = Reference {
        bvh: Bvh::new(triangles(assets, &poses)),
        bodies: assets.parts().iter().zip(&poses).map(|(part, pose)| Body::new(&part.mesh, pose)).collect(),
        materials,
        lamps: Lamps::new(&lighting, variation.light_angular_radius),
        backdrop: Backdrop::new(variation, &lighting),
    };
    let mut pixels = vec![Brought::default(); camera.width * camera.height];
    let threads = settings.threads.clamp(1, camera.height);
    let mut rows: Vec<Vec<_>> = (0..threads).map(|_| Vec::new()).collect();
    for (row, line) in pixels.chunks_exact_mut(camera.width).enumerate() {
        rows[row % threads].push((row, line));
    }
    std::thread::scope(|scope| {
        for own in rows {
            let (reference, camera) = (&reference, &camera);
            scope.spawn(move || {
                for (row, line) in own {
                    let first = (row * camera.width) as u64;
                    for (column, pixel) in line.iter_mut().enumerate() {
                        let seed = settings.seed.fork_index(first + column as u64);
                        *pixel = reference.pixel(camera, [column, row], seed, settings.paths.max(1));
                    }
                }
            });
        }
    });
    let look = variation.looks.iter().find(|look| look.camera == job.camera.name).cloned();
    Ok(Exposed { width: camera.width, exposure: variation.exposure, look, pixels })
}

impl Exposed {
    /// Tone-mapped 8-bit sRGB, row by row; `exposure` is a factor on the variation's exposure.
    pub fn develop(&self, exposure: f32) -> Vec<u8> {
        self.pixels.iter().flat_map(|pixel| srgb8_from_linear(self.developed(pixel, exposure))).collect()
    }

    /// Factor on the variation's exposure, between 1/8 and 8, that gives the image the mean luminance of another 8-bit
    /// sRGB image of the same size.
    pub fn exposure_like(&self, rgb: &[u8]) -> f32 {
        let brightness = |color: Vec3A| f64::from(luminance(color));
        let wanted: f64 = rgb.chunks_exact(3).map(|rgb| brightness(linear_from_srgb8([rgb[0], rgb[1], rgb[2]]))).sum();
        let (mut low, mut high) = (0.125_f32, 8.0_f32);
        for _ in 0..30 {
            let middle = (low * high).sqrt();
            let got: f64 = self.pixels.iter().map(|pixel| brightness(self.developed(pixel, middle))).sum();
            if got < wanted { low = middle } else { high = middle }
        }
        (low * high).sqrt()
    }

    /// Radiance (linear RGB, without exposure) of all pixels, row by row; the background is black.
    pub fn radiance(&self) -> Vec<[f32; 3]> {
        self.pixels.iter().map(|pixel| pixel.radiance.to_array()).collect()
    }

    /// Width of the image (px).
    pub fn width(&self) -> usize {
        self.width
    }

    fn developed(&self, pixel: &Brought, exposure: f32) -> Vec3A {
        // The background is an image colour, not light: surfaces are tone-mapped as if they filled the pixel.
        let covered = 1.0 - luminance(pixel.behind);
        let color = if covered > 1e-3 {
            let radiance = pixel.radiance * (self.exposure * exposure / covered);
            let shown = match &self.look {
                Some(look) => look.response.display(radiance),
                None => Vec3A::from_array(tone_map(radiance.to_array())),
            };
            shown * covered
        } else {
            Vec3A::ZERO
        };
        (color + pixel.background).clamp(Vec3A::ZERO, Vec3A::ONE)
    }
}

impl Reference<'_> {
    /// Mean over paths through random points around a pixel centre, distributed like the rasteriser's tent filter.
    fn pixel(&self, camera: &CameraView, [column, row]: [usize; 2], seed: Seed, paths: u32) -> Brought {
        let seed = seed.rng().random();
        let mut sum = Brought::default();
        for path in 0..paths {
            let mut samples = Samples::new(seed, path);
            let place = Vec2::new(column as f32, row as f32) + samples.two().map(tent);
            let ray = camera.turn * Vec3A::from(((place - camera.center) / camera.focal).extend(1.0));
            let brought = self.follow(camera.viewpoint, ray.normalize(), &mut samples);
            sum.radiance += brought.radiance;
            sum.behind += brought.behind;
            sum.background += brought.background;
        }
        let mean = |sum: Vec3A| sum / paths as f32;
        Brought { radiance: mean(sum.radiance), behind: mean(sum.behind), background: mean(sum.background) }
    }
}

/// Inverse of the tent filter's cumulative distribution function: maps 0-1 to -1 to 1 (px).
fn tent(share: f32) -> f32 {
    let half = (2.0 * share.min(1.0 - share)).sqrt() - 1.0;
    if share < 0.5 { half } else { -half }
}

fn triangles(assets: &RenderAssets, poses: &[Pose]) -> Vec<Triangle> {
    let mut triangles = Vec::with_capacity(assets.triangle_count());
    for (index, (part, pose)) in assets.parts().iter().zip(poses).enumerate() {
        let (turn, shift) = (rotation(pose), pose.position.as_vec3a());
        let lift = Vec3A::Z * if part.is_transparent() { LIFTED_M } else { 0.0 };
        let placed: Vec<Vec3A> = part.mesh.positions.iter().map(|&at| turn * Vec3A::from(at) + shift + lift).collect();
        let corners = part.mesh.triangles.iter().map(|triangle| triangle.map(|corner| placed[corner as usize]));
        triangles.extend(corners.enumerate().map(|(triangle, corners)| Triangle::new(corners, index, triangle)));
    }
    triangles
}

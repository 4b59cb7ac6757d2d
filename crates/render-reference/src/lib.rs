//! Pictures by tracing light paths: slow, and the judge of the rasteriser's.
//!
//! The same meshes, materials and lights. Paths are drawn by chance from a seed and meet both lamps at every surface,
//! weighted with the chance of finding them by scattering (next-event estimation with multiple importance sampling).
//! What differs from the rasteriser on purpose: light between surfaces, shadows of everything on everything, bent light
//! behind glass.

mod bvh;
#[cfg(test)]
mod fixture;
#[cfg(test)]
mod glass_tests;
mod lamps;
mod path;
mod reflection;
mod samples;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use genmanip_core::{Pose, Seed};
use glam::{Affine3A, Vec2, Vec3A};
use rand::RngExt;

use bvh::{Bvh, Triangle};
use genmanip_render::color::{linear_from_srgb8, luminance, srgb8_from_linear};
use genmanip_render::internals::{Backdrop, CameraView, Lighting, Material, Mesh, rotation, tone_map};
use genmanip_render::{RenderAssets, RenderError, RenderVariation, ViewJob};
use lamps::Lamps;
use path::Brought;
use samples::Samples;

/// How far transparent things stand above their places, metres: their undersides must lie above the table.
const LIFTED_M: f32 = 3e-4;

/// How carefully paths are traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceSettings {
    /// Paths per pixel, at least 1.
    pub paths: u32,
    /// Of the paths.
    pub seed: Seed,
    /// Threads; pictures do not depend on it.
    pub threads: usize,
}

/// A traced picture before it is developed.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposed {
    width: usize,
    exposure: f32,
    pixels: Vec<Brought>,
}

/// Everything that paths meet.
struct Reference<'a> {
    bvh: Bvh,
    bodies: Vec<Body<'a>>,
    materials: Vec<Material>,
    lamps: Lamps<'a>,
    backdrop: Backdrop,
}

/// A part at its place.
struct Body<'a> {
    mesh: &'a Mesh,
    body_from_world: Affine3A,
}

/// Traces the colour of a job; its channels and samples per pixel are not looked at.
///
/// The same job, variation, seed and number of paths give the same picture.
///
/// # Errors
/// A frame of other assets, a pose or camera that cannot be drawn.
pub fn trace(
    assets: &Arc<RenderAssets>,
    variation: &RenderVariation,
    job: &ViewJob<'_>,
    settings: &ReferenceSettings,
) -> Result<Exposed, RenderError> {
    let camera = CameraView::of(assets, job)?;
    let materials = variation.materials(assets);
    let lighting = Lighting::new(variation, &materials);
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
    Ok(Exposed { width: camera.width, exposure: variation.exposure, pixels })
}

impl Exposed {
    /// 8-bit sRGB, row by row, with so many times the variation's exposure.
    pub fn develop(&self, exposure: f32) -> Vec<u8> {
        self.pixels.iter().flat_map(|pixel| srgb8_from_linear(self.developed(pixel, exposure))).collect()
    }

    /// The exposure, as a multiple of the variation's, at which surfaces are as bright on average as in another picture
    /// of the same size; between an eighth and eight.
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

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    fn developed(&self, pixel: &Brought, exposure: f32) -> Vec3A {
        // The background is a colour of the picture, not light: surfaces are developed as if they filled the pixel.
        let covered = 1.0 - luminance(pixel.behind);
        let color = if covered > 1e-3 {
            Vec3A::from_array(tone_map((pixel.radiance * (self.exposure * exposure / covered)).to_array())) * covered
        } else {
            Vec3A::ZERO
        };
        (color + pixel.background).clamp(Vec3A::ZERO, Vec3A::ONE)
    }
}

impl Reference<'_> {
    /// The mean of the paths around a pixel's centre, by the rasteriser's tent two pixels wide.
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

/// The place between -1 and 1 below which a share of a tent lies.
fn tent(share: f32) -> f32 {
    let half = (2.0 * share.min(1.0 - share)).sqrt() - 1.0;
    if share < 0.5 { half } else { -half }
}

impl<'a> Body<'a> {
    fn new(mesh: &'a Mesh, pose: &Pose) -> Self {
        let world_from_body = Affine3A { matrix3: rotation(pose), translation: pose.position.as_vec3a() };
        Self { mesh, body_from_world: world_from_body.inverse() }
    }
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

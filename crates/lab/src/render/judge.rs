//! LDR-FLIP difference of rasterised and path-traced images, with matched exposure.

use genmanip_workspace::documents;
use genmanip_workspace::workers;
use std::path::Path;
use std::sync::Arc;

use genmanip_assets::panda;
use genmanip_assets::worlds::default_world;
use genmanip_core::Seed;
use genmanip_render::{FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, encode};
use genmanip_render_reference::{ReferenceSettings, trace};
use genmanip_workspace::Progress;
use serde::Serialize;

use super::{CHANNELS, GRID, OBJECTS, episode, objects, render_failed, sized};
use crate::LabError;
use genmanip_visual_matching::flip::mean_flip;

/// Width and height of the images, px.
const SIZE: [u32; 2] = [512, 288];

/// Difference of rasterised and path-traced images.
#[derive(Debug, Serialize)]
pub struct Flip {
    /// Mean FLIP over all scenes: 0 identical, 1 maximal.
    pub mean: f64,
    /// Number of light paths per pixel of the traced images.
    pub paths: u32,
    /// Results by scene.
    pub scenes: Vec<FlipScene>,
}

/// Difference of one scene's rasterised and path-traced image.
#[derive(Debug, Serialize)]
pub struct FlipScene {
    /// Name of the camera.
    pub camera: &'static str,
    /// Mean FLIP over the pixels, 0 to 1.
    pub flip: f64,
    /// Factor on the traced image that makes it as bright as the rasterised one.
    pub exposure: f32,
}

/// Rasterises `scenes` scenes of catalogue objects, seen alternately by the static and the wrist camera, and
/// path-traces the same with `paths` light paths per pixel. Both images are written to `out`, if given. `None` if
/// `scenes` is 0.
///
/// # Errors
/// If the catalogue has too few objects, rendering fails, or an image cannot be written.
pub fn judge(
    seed: Seed,
    scenes: usize,
    paths: u32,
    out: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Option<Flip>, LabError> {
    if scenes == 0 {
        return Ok(None);
    }
    let (robot, world, variation) = (panda(), default_world(), RenderVariation::default());
    let mut flip = Flip { mean: 0.0, paths, scenes: Vec::new() };
    progress.begin("tracing", scenes);
    for index in 0..scenes {
        let seed = seed.fork("flip").fork_index(index as u64);
        let name = ["static", "wrist"][index % 2];
        let camera = world.camera(name).map(|camera| sized(camera, SIZE));
        let camera = camera.ok_or_else(|| LabError::input(format!("the default world has no camera `{name}`")))?;
        let objects = objects(seed.fork("objects"), false, OBJECTS)?;
        let assets = RenderAssets::new(Arc::clone(&robot), &objects, Some(&world)).map_err(render_failed)?;
        let frames = episode(&robot, &assets, OBJECTS, GRID, seed.fork("episode"))?;
        let job = ViewJob::new(&frames[frames.len() / 2], &camera, CHANNELS);
        let mut drawn = [FrameBuffers::default()];
        Renderer::new(Arc::clone(&assets), variation.clone()).render(&[job], &mut drawn).map_err(render_failed)?;
        let settings = ReferenceSettings { paths, seed: seed.fork("light paths"), threads: workers::workers(None) };
        let traced = trace(&assets, &variation, &job, &settings).map_err(render_failed)?;
        let [FrameBuffers { rgb, .. }] = &drawn;
        let exposure = traced.exposure_like(rgb);
        let reference = traced.develop(exposure);
        let value = mean_flip(&reference, rgb, SIZE[0] as usize).unwrap_or(f64::NAN);
        for (kind, rgb) in [("drawn", rgb), ("traced", &reference)] {
            let Some(folder) = out else { continue };
            let failed = |error| LabError::broken("an image cannot be encoded", error);
            let png = encode::png_rgb(SIZE[0], SIZE[1], rgb).map_err(failed)?;
            documents::write_file(&folder.join(format!("{index:02}_{name}_{kind}.png")), &png)?;
        }
        flip.scenes.push(FlipScene { camera: name, flip: value, exposure });
        progress.advance();
    }
    progress.end();
    flip.mean = flip.scenes.iter().map(|scene| scene.flip).sum::<f64>() / scenes as f64;
    Ok(Some(flip))
}

//! How far the rasteriser's pictures are from traced ones: LDR-FLIP with matched exposure.

use std::path::Path;
use std::sync::Arc;

use genmanip_assets::panda;
use genmanip_assets::worlds::default_world;
use genmanip_core::Seed;
use genmanip_render::{FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob, encode};
use genmanip_render_reference::{ReferenceSettings, trace};
use genmanip_run::{Progress, inputs};
use serde::Serialize;

use super::flip::mean_flip;
use super::{CHANNELS, GRID, OBJECTS, episode, not_drawn, objects, sized};
use crate::LabError;

/// Size of the pictures, pixels.
const SIZE: [u32; 2] = [512, 288];

/// Pictures beside traced ones.
#[derive(Debug, Serialize)]
pub struct Flip {
    /// Mean over the scenes of the mean over the pixels: 0 is the same, 1 the most.
    pub mean: f64,
    /// Light paths per pixel of the traced pictures.
    pub paths: u32,
    /// Each scene.
    pub scenes: Vec<FlipScene>,
}

/// A scene, drawn and traced.
#[derive(Debug, Serialize)]
pub struct FlipScene {
    /// Which camera sees it.
    pub camera: &'static str,
    /// Mean over the pixels.
    pub flip: f64,
    /// By how much the traced picture was exposed longer, so that both are as bright.
    pub exposure: f32,
}

/// Draws so many scenes of objects from the catalogue, seen by the static and the wrist camera in turn, and traces the
/// same; writes both pictures into a folder, if one is given. `None` for no scenes.
///
/// # Errors
/// When the catalogue has too few objects, a scene cannot be drawn, or a picture not be written.
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
        let assets = RenderAssets::new(Arc::clone(&robot), &objects, Some(&world)).map_err(not_drawn)?;
        let frames = episode(&robot, &assets, OBJECTS, GRID, seed.fork("episode"))?;
        let job = ViewJob::new(&frames[frames.len() / 2], &camera, CHANNELS);
        let mut drawn = [FrameBuffers::default()];
        Renderer::new(Arc::clone(&assets), variation.clone()).render(&[job], &mut drawn).map_err(not_drawn)?;
        let settings = ReferenceSettings { paths, seed: seed.fork("light paths"), threads: inputs::workers(None) };
        let traced = trace(&assets, &variation, &job, &settings).map_err(not_drawn)?;
        let [FrameBuffers { rgb, .. }] = &drawn;
        let exposure = traced.exposure_like(rgb);
        let reference = traced.develop(exposure);
        let value = mean_flip(&reference, rgb, SIZE[0] as usize).unwrap_or(f64::NAN);
        for (kind, rgb) in [("drawn", rgb), ("traced", &reference)] {
            let Some(folder) = out else { continue };
            let failed = |error| LabError::broken("a picture cannot be encoded", error);
            let png = encode::png_rgb(SIZE[0], SIZE[1], rgb).map_err(failed)?;
            inputs::write_file(&folder.join(format!("{index:02}_{name}_{kind}.png")), &png)?;
        }
        flip.scenes.push(FlipScene { camera: name, flip: value, exposure });
        progress.advance();
    }
    progress.end();
    flip.mean = flip.scenes.iter().map(|scene| scene.flip).sum::<f64>() / scenes as f64;
    Ok(Some(flip))
}

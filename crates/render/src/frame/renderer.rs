//! Renderer of view jobs with cached frames, shadow maps and irradiance grids.

use std::sync::Arc;

use genmanip_core::{CameraMount, Intrinsics, Pose};
use glam::{DQuat, Vec3A};

use crate::ambient::irradiance_grid::IrradianceGrids;
use crate::ambient::proxy_set::{Proxies, colors_of};
use crate::error::RenderError;
use crate::frame::cache::{FrameCache, write_geometry};
use crate::gbuffer::view::{CameraView, View};
use crate::job::{Channels, FIRST_OBJECT, FrameBuffers, FrameState, ViewJob};
use crate::lights::lighting::Lighting;
use crate::matched::look::Look;
use crate::raster::VisibilityBuffer;
use crate::render_scene::RenderScene;
use crate::scene::assets::RenderAssets;
use crate::scene::material::Material;
use crate::scene::variation::RenderVariation;
use crate::shading::backdrop::Backdrop;
use crate::shadow::map::ShadowMap;

/// Largest total number of pixels of the kept frame caches; the least recently used ones are dropped.
const KEPT_PIXELS: usize = 4 << 20;
/// Largest longer side (px) of an image that counts as small, and gets coarser shadow maps and irradiance grids.
const SMALL_PX: u32 = 128;
/// Texels along a side of the shadow map for small images.
const SMALL_SHADOW: usize = 192;

/// Renderer of jobs on the calling thread; its allocations and caches are reused by the next job.
///
/// The same job gives the same bytes, whatever was rendered before and whatever other threads do. A fixed camera is
/// cheaper than a moving one: only dirty tiles are repeated.
#[derive(Debug)]
pub struct Renderer {
    assets: Arc<RenderAssets>,
    variation: RenderVariation,
    /// Materials of the parts under this renderer's variation.
    materials: Vec<Material>,
    lighting: Lighting,
    backdrop: Backdrop,
    /// Shadow maps for large and for small images, each with the frame that it was rendered for.
    shadows: [(ShadowMap, Option<FrameState>); 2],
    /// Ellipsoid proxies of the bodies, placed for the last colour image.
    proxies: Proxies,
    /// Mean linear colour of each body's opaque parts.
    body_colors: Vec<Vec3A>,
    /// Irradiance grids, for large and for small images; of each, for fixed and for wrist cameras.
    irradiance_grids: [[IrradianceGrids; 2]; 2],
    /// Frame caches by camera, the most recently used last.
    kept: Vec<(CacheKey, FrameCache)>,
    /// View and visibility buffer of images without colour, kept to reuse their allocations.
    view: View,
    solid: VisibilityBuffer,
    shaded_pixels: usize,
}

/// Key of a frame cache: a camera, its mount and its pose on the mount.
#[derive(Clone, Debug, PartialEq)]
struct CacheKey {
    mount: CameraMount,
    mount_from_camera: Pose,
    intrinsics: Intrinsics,
    /// Index of the camera's look, which its name selects.
    look: Option<usize>,
}

impl Renderer {
    /// Renderer of these assets under a variation of light and appearance.
    pub fn new(assets: Arc<RenderAssets>, variation: RenderVariation) -> Self {
        let materials = variation.materials(&assets);
        let lighting = Lighting::new(&variation, assets.ground_color(&materials));
        let body_colors = colors_of(&assets, &materials);
        let irradiance_grids = irradiance_grids(&assets, &variation);
        Self {
            assets,
            backdrop: Backdrop::new(&variation, &lighting),
            lighting,
            materials,
            variation,
            shadows: Default::default(),
            proxies: Proxies::default(),
            body_colors,
            irradiance_grids,
            kept: Vec::new(),
            view: View::default(),
            solid: VisibilityBuffer::default(),
            shaded_pixels: 0,
        }
    }

    /// Meshes and materials given to [`Renderer::new`], shared with other renderers of the scene.
    pub fn assets(&self) -> &Arc<RenderAssets> {
        &self.assets
    }

    /// Variation of light and appearance.
    pub fn variation(&self) -> &RenderVariation {
        &self.variation
    }

    /// Materials of the parts under this renderer's variation.
    pub(crate) fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// Drops all caches, so that the next images are rendered from scratch, with the same bytes.
    pub fn forget(&mut self) {
        self.shadows = Default::default();
        self.irradiance_grids = irradiance_grids(&self.assets, &self.variation);
        self.kept.clear();
    }

    /// Number of pixels shaded for the last colour image; the other pixels came from the frame cache.
    pub fn shaded_pixels(&self) -> usize {
        self.shaded_pixels
    }

    /// Renders all jobs, `jobs[i]` into `out[i]`.
    ///
    /// All views of a frame should be consecutive jobs, since they share the shadow map.
    ///
    /// # Errors
    /// A frame of other assets, an invalid pose or camera, or a wrong number of buffers; nothing is rendered then.
    pub fn render(&mut self, jobs: &[ViewJob<'_>], out: &mut [FrameBuffers]) -> Result<(), RenderError> {
        if jobs.len() != out.len() {
            return Err(RenderError::BufferCount { expected: jobs.len(), got: out.len() });
        }
        let cameras = jobs.iter().map(|job| CameraView::of(&self.assets, job)).collect::<Result<Vec<_>, _>>()?;
        for ((job, camera), buffers) in jobs.iter().zip(cameras).zip(out) {
            (buffers.width, buffers.height) = (camera.width as u32, camera.height as u32);
            let frame = snapped(job.frame);
            if job.channels.rgb {
                self.draw(job, &frame, camera, buffers);
            } else {
                buffers.rgb.clear();
                self.solid.reset::<true>(camera.width, camera.height, 1);
                self.view.place(&self.assets, &frame, camera);
                for part in 0..self.assets.parts.len() {
                    self.view.draw_opaque(&self.assets, part, &mut self.solid);
                }
                self.view.draw_transparent(&self.assets, [true, true], &mut self.solid);
                write_geometry(&self.assets, &self.view, &self.solid, job.channels, buffers);
            }
        }
        Ok(())
    }

    /// Renders each object's instance mask without occlusion by anything else; `take` receives instance id and mask.
    ///
    /// # Errors
    /// As [`Renderer::render`], and errors of `take`.
    pub fn alone(
        &mut self,
        job: &ViewJob<'_>,
        take: &mut dyn FnMut(u16, FrameBuffers) -> Result<(), RenderError>,
    ) -> Result<(), RenderError> {
        let camera = CameraView::of(&self.assets, job)?;
        let (width, height) = (camera.width, camera.height);
        self.view.place(&self.assets, &snapped(job.frame), camera);
        let mut parts = self.assets.parts.iter().map(|part| part.instance).enumerate().peekable();
        while let Some((first, instance)) = parts.next() {
            let mut end = first + 1;
            while parts.next_if(|(_, next)| *next == instance).is_some() {
                end += 1;
            }
            if instance < FIRST_OBJECT {
                continue;
            }
            self.solid.reset::<true>(width, height, 1);
            for part in first..end {
                self.view.draw_whole(&self.assets, part, &mut self.solid);
            }
            let mut out = FrameBuffers { width: width as u32, height: height as u32, ..FrameBuffers::default() };
            let ids = Channels { instance: true, ..Channels::default() };
            write_geometry(&self.assets, &self.view, &self.solid, ids, &mut out);
            take(instance, out)?;
        }
        Ok(())
    }

    fn draw(&mut self, job: &ViewJob<'_>, frame: &FrameState, camera: CameraView, out: &mut FrameBuffers) {
        let (image_size, camera) = ([camera.width, camera.height], camera.in_whole_tiles());
        let intrinsics = job.camera.intrinsics;
        let is_small = intrinsics.width.max(intrinsics.height) <= SMALL_PX;
        let full = self.variation.shadow_resolution.min(8192) as usize;
        let size = if is_small { full.min(SMALL_SHADOW) } else { full };
        let (shadow, shadow_of) = &mut self.shadows[usize::from(is_small)];
        if shadow_of.as_ref() != Some(frame) {
            shadow.update(&self.assets, frame, &self.variation, size, is_small);
            shadow_of.get_or_insert_with(|| frame.clone()).clone_from(frame);
        }
        let (colors, to_light) = (&self.body_colors, self.lighting.to_light);
        self.proxies.place(&self.assets, colors, frame, job.camera.mount, to_light);
        let irradiance_grids =
            &mut self.irradiance_grids[usize::from(is_small)][usize::from(job.camera.mount == CameraMount::Hand)];
        irradiance_grids.update(&self.proxies, &self.variation, &self.lighting, &camera);
        let own_look = self.variation.looks.iter().position(|look| look.camera == job.camera.name);
        let (mount, mount_from_camera) = (job.camera.mount, job.camera.mount_from_camera);
        let key = CacheKey { mount, mount_from_camera, intrinsics, look: own_look };
        let (key, mut cache) = match self.kept.iter().position(|(known, _)| *known == key) {
            Some(index) => self.kept.remove(index),
            None => (key, FrameCache::default()),
        };
        let (assets, materials) = (&*self.assets, &*self.materials);
        let (variation, lighting, backdrop) = (&self.variation, &self.lighting, &self.backdrop);
        let (proxies, irradiance_grids) = (&self.proxies, &*irradiance_grids);
        let look = Look::of(&variation.looks, job.camera);
        let look = look.as_ref();
        let scene =
            RenderScene { assets, materials, variation, lighting, backdrop, look, shadow, proxies, irradiance_grids };
        cache.draw(&scene, frame, camera);
        cache.write(&self.assets, job.channels, image_size, out);
        self.shaded_pixels = cache.shaded_pixels;
        self.kept.push((key, cache));
        while self.kept.len() > 1 && self.kept.iter().map(|(_, cache)| cache.pixels()).sum::<usize>() > KEPT_PIXELS {
            self.kept.remove(0);
        }
    }
}

fn irradiance_grids(assets: &RenderAssets, variation: &RenderVariation) -> [[IrradianceGrids; 2]; 2] {
    [false, true].map(|is_small| std::array::from_fn(|_| IrradianceGrids::new(assets, variation, is_small)))
}

/// Rounds positions and quaternion components to 2⁻¹⁷ (7.6 µm, about 15 µrad), far below the resolution of depth
/// images, so that simulation jitter of resting objects changes nothing.
fn snapped(frame: &FrameState) -> FrameState {
    const STEPS: f64 = 131_072.0;
    // Adding 0 turns -0 into 0.
    let snap = |value: f64| (value * STEPS).round() / STEPS + 0.0;
    let body_poses = frame.body_poses.iter().map(|pose| {
        let [x, y, z, w] = pose.rotation.to_array().map(snap);
        Pose { position: pose.position.to_array().map(snap).into(), rotation: DQuat::from_xyzw(x, y, z, w) }
    });
    FrameState { body_poses: body_poses.collect() }
}

//! The renderer: jobs in, pictures out.

use std::sync::Arc;

use genmanip_core::Pose;

use crate::assets::RenderAssets;
use crate::error::RenderError;
use crate::hit::normal_in_camera;
use crate::job::{FrameBuffers, FrameState, ViewJob};
use crate::occlusion::Arrival;
use crate::raster::Target;
use crate::resolve::Resolve;
use crate::shade::Lighting;
use crate::shadow::ShadowMap;
use crate::variation::RenderVariation;
use crate::view::{Layer, Lens, View, check_finite, part_and_triangle};

/// Draws jobs on the thread that calls it; keeps its memory from job to job.
///
/// The same job gives the same bytes, whatever was drawn before and whatever other threads do.
#[derive(Debug)]
pub struct Renderer {
    assets: Arc<RenderAssets>,
    variation: RenderVariation,
    lighting: Lighting,
    view: View,
    shadow: ShadowMap,
    /// The frame whose shadows `shadow` holds: all views of a frame share them, also from call to call.
    shadow_of: Option<FrameState>,
    arrival: Arrival,
    /// One sample per pixel: opaque things, then with transparent ones.
    opaque: Target,
    solid: Target,
    /// Samples for the colour: opaque things, back and front sides of transparent ones.
    samples: Target,
    glass_back: Target,
    glass_front: Target,
}

impl Renderer {
    /// A renderer of these assets under a light.
    pub fn new(assets: Arc<RenderAssets>, variation: RenderVariation) -> Self {
        Self {
            assets,
            lighting: Lighting::new(&variation),
            variation,
            view: View::default(),
            shadow: ShadowMap::default(),
            shadow_of: None,
            arrival: Arrival::default(),
            opaque: Target::default(),
            solid: Target::default(),
            samples: Target::default(),
            glass_back: Target::default(),
            glass_front: Target::default(),
        }
    }

    /// What is drawn.
    pub fn assets(&self) -> &Arc<RenderAssets> {
        &self.assets
    }

    /// Draws all jobs, `out[i]` for `jobs[i]`.
    ///
    /// Draw all views of a frame one after the other, in one call or in several: they share the shadow map.
    ///
    /// # Errors
    /// A frame of other assets, a pose or camera that cannot be drawn, or too few buffers; nothing is drawn then.
    pub fn render(&mut self, jobs: &[ViewJob<'_>], out: &mut [FrameBuffers]) -> Result<(), RenderError> {
        if jobs.len() != out.len() {
            return Err(RenderError::BufferCount { expected: jobs.len(), got: out.len() });
        }
        let lenses = jobs.iter().map(|job| self.lens(job)).collect::<Result<Vec<_>, _>>()?;
        for ((job, lens), buffers) in jobs.iter().zip(lenses).zip(out) {
            self.see(job, lens);
            self.write_geometry(job, buffers);
            buffers.rgb.clear();
            if job.channels.rgb {
                if !self.shadow_of.as_ref().is_some_and(|drawn| is_same(drawn, job.frame)) {
                    self.shadow.draw(&self.assets, job.frame, &self.variation);
                    self.shadow_of = Some(job.frame.clone());
                }
                self.write_rgb(job, buffers);
            }
        }
        Ok(())
    }

    fn lens(&self, job: &ViewJob<'_>) -> Result<Lens, RenderError> {
        let (expected, got) = (self.assets.body_count(), job.frame.body_poses.len());
        if expected != got {
            return Err(RenderError::BodyCount { expected, got });
        }
        for (index, pose) in job.frame.body_poses.iter().enumerate() {
            check_finite(pose, || format!("the pose of body {index}"))?;
        }
        Lens::new(job.camera, &self.assets.world_from_hand(job.frame))
    }

    /// Which surface every pixel's centre sees.
    fn see(&mut self, job: &ViewJob<'_>, lens: Lens) {
        let (width, height) = (lens.width, lens.height);
        self.view.place(&self.assets, job.frame, lens);
        self.opaque.reset::<true>(width, height);
        self.view.draw(&self.assets, Layer::Opaque, 1, &mut self.opaque);
        if self.view.has_transparent {
            self.solid.copy_from(&self.opaque);
            self.view.draw(&self.assets, Layer::Transparent, 1, &mut self.solid);
        }
    }

    fn write_geometry(&self, job: &ViewJob<'_>, out: &mut FrameBuffers) {
        let seen = if self.view.has_transparent { &self.solid } else { &self.opaque };
        (out.width, out.height) = (seen.width as u32, seen.height as u32);
        out.depth_m.clear();
        if job.channels.depth {
            let depth = |&nearness: &f32| if nearness > 0.0 { 1.0 / nearness } else { 0.0 };
            out.depth_m.extend(seen.nearness.iter().map(depth));
        }
        out.instance.clear();
        if job.channels.instance {
            let instance = |&id: &u32| part_and_triangle(id).map_or(0, |(part, _)| self.assets.parts[part].instance);
            out.instance.extend(seen.ids.iter().map(instance));
        }
        out.normal.clear();
        if job.channels.normal {
            out.normal.extend(seen.ids.iter().enumerate().map(|(pixel, &id)| {
                let at = [(pixel % seen.width) as f32, (pixel / seen.width) as f32];
                part_and_triangle(id).map_or([0; 3], |(part, triangle)| self.normal(part, triangle, at))
            }));
        }
    }

    fn normal(&self, part: usize, triangle: usize, at: [f32; 2]) -> [i8; 3] {
        let (part, placed) = (&self.assets.parts[part], &self.view.parts[part]);
        let normal = normal_in_camera(part, placed, &self.view.lens, triangle, at);
        (normal * 127.0).to_array().map(|value| value.round() as i8)
    }

    fn write_rgb(&mut self, job: &ViewJob<'_>, out: &mut FrameBuffers) {
        let supersample = job.supersample.clamp(1, 4) as usize;
        let (width, height) = (self.view.lens.width * supersample, self.view.lens.height * supersample);
        let (assets, view) = (&*self.assets, &self.view);
        self.samples.reset::<true>(width, height);
        view.draw(assets, Layer::Opaque, supersample, &mut self.samples);
        if view.has_transparent {
            self.glass_back.reset::<true>(width, height);
            view.draw(assets, Layer::TransparentBack, supersample, &mut self.glass_back);
            self.glass_front.reset::<true>(width, height);
            view.draw(assets, Layer::TransparentFront, supersample, &mut self.glass_front);
        }
        self.arrival.estimate(assets, view, &self.opaque, &self.shadow, &self.variation);
        let resolve = Resolve {
            assets,
            view,
            variation: &self.variation,
            lighting: &self.lighting,
            arrival: &self.arrival,
            shadow: &self.shadow,
            opaque: &self.samples,
            glass: view.has_transparent.then_some([&self.glass_back, &self.glass_front]),
            supersample,
        };
        resolve.write_rgb(&mut out.rgb);
    }
}

/// Whether two frames agree to the last bit, so that one's shadows are the other's.
fn is_same(a: &FrameState, b: &FrameState) -> bool {
    let bits = |pose: &Pose| (pose.position.to_array().map(f64::to_bits), pose.rotation.to_array().map(f64::to_bits));
    a.body_poses.len() == b.body_poses.len() && a.body_poses.iter().zip(&b.body_poses).all(|(a, b)| bits(a) == bits(b))
}

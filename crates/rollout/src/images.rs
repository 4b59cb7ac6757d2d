//! Images of a stage: of recorded frames after the simulation, and of the current state for policies with cameras.

use genmanip_core::perception::{FIRST_OBJECT, VisibleRegion, visible_region};
use genmanip_core::{Camera, CameraRequest, Episode, EpisodeResult, Frame, ImageChannels, Pose, RgbdImage, Seed};
use genmanip_data::images::appearance_seed;
use genmanip_data::masks::{self, MaskTrack};
use genmanip_data::{CameraTrack, TrackRecorder, VideoSettings};
use genmanip_render::sensor::shutter::{self, Past};
use genmanip_render::{
    AppearanceFactor, AppearanceRandomisation, Channels, FrameBuffers, FrameState, RenderAssets, RenderError,
    RenderVariation, Renderer, ViewJob, sampling, sensor,
};
use genmanip_render_reference::{ReferenceSettings, trace};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use crate::{RolloutError, Stage};

/// Images of a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImageSettings {
    /// Names of the cameras to render.
    pub cameras: Vec<String>,
    /// Images per second; must divide the 60 Hz of the recording.
    pub fps: u32,
    /// Settings of the video encoder.
    pub video: VideoSettings,
    /// Randomised aspects of the appearance, by the episode's seed ([`appearance_seed`]); none if empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub vary: Vec<AppearanceFactor>,
    /// Index of the appearance: other indices give other random appearances of the same episode.
    #[serde(skip_serializing_if = "is_first")]
    pub look: u64,
}

fn is_first(look: &u64) -> bool {
    *look == 0
}

impl Default for ImageSettings {
    fn default() -> Self {
        Self {
            cameras: vec!["static".into(), "wrist".into()],
            fps: 15,
            video: VideoSettings::default(),
            vary: Vec::new(),
            look: 0,
        }
    }
}

/// Inputs of the sensor simulation besides the scene: random noise, and motion during the exposure.
#[derive(Clone, Copy, Debug)]
pub struct Exposure<'a> {
    /// Noise seed, see [`sensor_seed`]; each camera derives its own.
    pub noise: Seed,
    /// Recorded frames before this one; nothing moved before the first.
    pub before: &'a [Frame],
    /// Time between consecutive frames, and from the last earlier frame to this one, s.
    pub step_s: f64,
}

impl<'a> Exposure<'a> {
    /// Exposure of a static scene.
    pub fn still(noise: Seed) -> Self {
        Self { noise, before: &[], step_s: 1.0 }
    }

    /// Exposure of an episode's frame; equal in the loop, in a data set and when rendered again.
    pub fn of(episode: &'a Episode, frame: usize) -> Self {
        let EpisodeResult { seed, control_rate_hz, .. } = episode.result;
        Self { noise: sensor_seed(seed, frame), before: &episode.frames[..frame], step_s: 1.0 / control_rate_hz }
    }
}

/// Renderer of the frames of one stage; shares the meshes of the stage, and shadows between views of a frame.
#[derive(Debug)]
pub struct StageRenderer {
    renderer: Renderer,
    /// Settings of the path tracer if it replaces the rasteriser for colours; `None` otherwise.
    reference: Option<ReferenceSettings>,
    scenario: String,
}

impl StageRenderer {
    /// Renderer with the appearance given by the world.
    ///
    /// # Errors
    /// If a mesh or the world's measured appearance is invalid.
    pub fn new(stage: &Stage) -> Result<Self, RolloutError> {
        Self::with_appearance(stage, usual_variation(stage)?)
    }

    /// Renderer with another appearance.
    ///
    /// # Errors
    /// As [`StageRenderer::new`].
    pub fn with_appearance(stage: &Stage, variation: RenderVariation) -> Result<Self, RolloutError> {
        let renderer = Renderer::new(stage.render_assets()?, variation);
        Ok(Self { renderer, reference: None, scenario: stage.scenario.id.clone() })
    }

    /// Uses path tracing for colours, thousands of times slower; depth, ids and normals are rasterised as before.
    #[must_use]
    pub fn tracing(self, reference: Option<ReferenceSettings>) -> Self {
        Self { reference, ..self }
    }

    /// True if this is a renderer of the given stage.
    pub fn is_of(&self, stage: &Stage) -> bool {
        stage.render_assets().is_ok_and(|assets| Arc::ptr_eq(&assets, self.renderer.assets()))
    }

    /// Renders one recorded frame with one camera.
    ///
    /// # Errors
    /// If the frame does not belong to the stage.
    pub fn render_frame(
        &mut self,
        frame: &Frame,
        camera: &Camera,
        channels: ImageChannels,
        exposure: Exposure<'_>,
    ) -> Result<RgbdImage, RolloutError> {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let views = [(camera, channels)];
        let images = self.render_state(&frame.joint_position, frame.gripper_width, objects, &views, exposure);
        images.map(|mut images| images.remove(0))
    }

    /// Renders one state with several cameras: arm joint positions, gripper opening, poses and joints of the objects.
    ///
    /// # Errors
    /// If the objects do not match the stage, or a camera cannot be rendered.
    pub fn render_state<'a>(
        &mut self,
        arm: &[f64],
        gripper_width: f64,
        objects: impl IntoIterator<Item = (Pose, &'a [f64])>,
        views: &[(&Camera, ImageChannels)],
        exposure: Exposure<'_>,
    ) -> Result<Vec<RgbdImage>, RolloutError> {
        let assets = Arc::clone(self.renderer.assets());
        let scenario = self.scenario.clone();
        let failed = |error: RenderError| failed(&scenario, error);
        let state = assets.frame_state(arm, gripper_width, objects).map_err(failed)?;
        let pinholes = views.iter().map(|(camera, _)| sensor::pinhole(camera)).collect::<Result<Vec<_>, _>>();
        let pinholes = pinholes.map_err(failed)?;
        let job = |((camera, channels), pinhole): (&(&Camera, ImageChannels), _)| {
            ViewJob::new(&state, pinhole, sensor::needed(camera, (*channels).into()))
        };
        let jobs: Vec<ViewJob> = views.iter().zip(&pinholes).map(job).collect();
        let mut buffers = vec![FrameBuffers::default(); jobs.len()];
        self.renderer.render(&jobs, &mut buffers).map_err(failed)?;
        let longest = views.iter().map(|(camera, _)| sensor::shutter_s(camera)).fold(0.0, f64::max);
        let moments = moments_before(&assets, &state, exposure, longest).map_err(failed)?;
        let past = Past { moments: &moments, step_s: exposure.step_s };
        for ((job, buffers), (camera, _)) in jobs.iter().zip(&mut buffers).zip(views) {
            if job.channels.rgb {
                self.apply_exposure(job, buffers, past, sensor::shutter_s(camera)).map_err(failed)?;
            }
        }
        let world_from_hand = assets.world_from_hand(&state);
        let image = |((camera, channels), buffers): (&(&Camera, ImageChannels), FrameBuffers)| {
            let buffers = sensor::developed(&self.renderer, camera, (*channels).into(), buffers, exposure.noise)?;
            let image = buffers.into_image(camera, camera.world_from_camera(&world_from_hand));
            Ok(if channels.points { image.with_points() } else { image })
        };
        views.iter().zip(buffers).map(image).collect::<Result<_, _>>().map_err(failed)
    }

    /// Replaces the colour image by one averaged over the exposure time (motion blur), path traced if requested.
    fn apply_exposure(
        &mut self,
        job: &ViewJob<'_>,
        buffers: &mut FrameBuffers,
        past: Past<'_>,
        shutter_s: f64,
    ) -> Result<(), RenderError> {
        let assets = Arc::clone(self.renderer.assets());
        let earlier = shutter::moments(&assets, job.camera, buffers, past, shutter_s);
        let mut images = vec![std::mem::take(&mut buffers.rgb)];
        if let Some(settings) = &self.reference {
            let paths = settings.paths.div_ceil(1 + earlier.len() as u32);
            images.clear();
            for (index, frame) in std::iter::once(job.frame).chain(&earlier).enumerate() {
                let seed = if index == 0 { settings.seed } else { settings.seed.fork_index(index as u64) };
                let (job, settings) = (ViewJob { frame, ..*job }, ReferenceSettings { paths, seed, ..*settings });
                images.push(trace(&assets, self.renderer.variation(), &job, &settings)?.develop(1.0));
            }
        } else {
            let mut out = [FrameBuffers::default()];
            for frame in &earlier {
                self.renderer.render(&[ViewJob { frame, channels: Channels::RGB, ..*job }], &mut out)?;
                images.push(std::mem::take(&mut out[0].rgb));
            }
        }
        buffers.rgb = if images.len() > 1 { shutter::mean(&images) } else { images.remove(0) };
        Ok(())
    }
}

/// The current state and the earlier ones within the exposure time, newest first.
fn moments_before(
    assets: &RenderAssets,
    now: &FrameState,
    exposure: Exposure<'_>,
    shutter_s: f64,
) -> Result<Vec<FrameState>, RenderError> {
    let count = Past::moments_within(shutter_s, exposure.step_s) - 1;
    let before = exposure.before.iter().rev().take(count).map(|frame| assets.frame_state_of(frame));
    std::iter::once(Ok(now.clone())).chain(before).collect()
}

impl StageRenderer {
    /// Unoccluded visibility: bounding box and pixels of each object as if it were alone, per camera, in the images of
    /// [`StageRenderer::render_state`] of the same state; objects in their order.
    ///
    /// # Errors
    /// As [`StageRenderer::render_state`].
    pub fn unoccluded<'a>(
        &mut self,
        arm: &[f64],
        gripper_width: f64,
        objects: impl IntoIterator<Item = (Pose, &'a [f64])>,
        cameras: &[Camera],
    ) -> Result<Vec<Vec<VisibleRegion>>, RolloutError> {
        let assets = Arc::clone(self.renderer.assets());
        let state = assets.frame_state(arm, gripper_width, objects).map_err(|error| failed(&self.scenario, error))?;
        let whole = cameras.iter().map(|camera| self.unoccluded_in(&state, camera)).collect::<Result<_, _>>();
        whole.map_err(|error: RenderError| failed(&self.scenario, error))
    }

    fn unoccluded_in(&mut self, state: &FrameState, camera: &Camera) -> Result<Vec<VisibleRegion>, RenderError> {
        const IDS: Channels = Channels { rgb: false, depth: false, instance: true, normal: false, parts: false };
        let pinhole = sensor::pinhole(camera)?;
        let mut whole = Vec::new();
        self.renderer.alone(&ViewJob::new(state, &pinhole, IDS), &mut |instance, drawn| {
            let object = usize::from(instance - FIRST_OBJECT);
            let drawn = sensor::through_lens(camera, drawn)?;
            // The renderer skips objects without any pixel.
            whole.resize(object, VisibleRegion::default());
            whole.push(visible_region(&drawn.instance, drawn.width, instance));
            Ok(())
        })?;
        Ok(whole)
    }
}

/// Appearance of a stage according to its world.
///
/// # Errors
/// As [`RenderVariation::of_world`].
pub fn usual_variation(stage: &Stage) -> Result<RenderVariation, RolloutError> {
    RenderVariation::of_world(&stage.scenario.world).map_err(|error| failed(&stage.scenario.id, error))
}

/// Seed of the sensor noise at a frame (control step) of an episode; equal in the loop, in a data set and when rendered
/// again.
pub fn sensor_seed(episode: Seed, frame: usize) -> Seed {
    episode.fork("sensor noise").fork_index(frame as u64)
}

/// Renders colour video and depth of an episode for every camera of the settings.
///
/// # Errors
/// If a camera is not in the scenario, or rendering or encoding fails.
pub fn render_tracks(
    stage: &Stage,
    episode: &Episode,
    settings: &ImageSettings,
) -> Result<Vec<CameraTrack>, RolloutError> {
    let (seed, vary) = (appearance_seed(episode.result.seed, settings.look), &settings.vary);
    let requests = settings.cameras.iter().map(|name| CameraRequest::new(name, ImageChannels::RGBD));
    let camera = |request| stage.camera(&request).map(|camera| sampling::moved(&camera, seed, vary));
    let cameras = requests.map(camera).collect::<Result<Vec<_>, _>>()?;
    let mut tracks = cameras
        .iter()
        .map(|camera| TrackRecorder::new(camera, settings.fps, &settings.video))
        .collect::<Result<Vec<_>, _>>()?;
    let look = AppearanceRandomisation::new(seed, vary.clone());
    let mut renderer = StageRenderer::with_appearance(stage, sampling::varied(&usual_variation(stage)?, &look))?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, ImageChannels::RGBD)).collect();
    render_frames(&mut renderer, episode, settings.fps, &views, &mut |view, image| Ok(tracks[view].push(image)?))?;
    Ok(tracks.into_iter().map(TrackRecorder::finish).collect::<Result<Vec<_>, _>>()?)
}

/// Renders instance masks for the images of [`render_tracks`]; ids as in [`masks`].
///
/// # Errors
/// As [`render_tracks`].
pub fn render_masks(
    stage: &Stage,
    episode: &Episode,
    settings: &ImageSettings,
) -> Result<Vec<MaskTrack>, RolloutError> {
    const IDS: ImageChannels = ImageChannels { rgb: false, depth: false, ids: true, normals: false, points: false };
    let seed = appearance_seed(episode.result.seed, settings.look);
    let camera = |name: &String| {
        stage.camera(&CameraRequest::new(name, IDS)).map(|camera| sampling::moved(&camera, seed, &settings.vary))
    };
    let cameras = settings.cameras.iter().map(camera).collect::<Result<Vec<_>, _>>()?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, IDS)).collect();
    let track = |camera: &Camera| MaskTrack { camera: camera.name.clone(), fps: settings.fps, png: Vec::new() };
    let mut tracks: Vec<MaskTrack> = cameras.iter().map(track).collect();
    let mut renderer = StageRenderer::new(stage)?;
    render_frames(&mut renderer, episode, settings.fps, &views, &mut |view, image| {
        let size = &image.intrinsics;
        tracks[view].png.push(masks::encode(&image.ids, size.width, size.height)?);
        Ok(())
    })?;
    Ok(tracks)
}

/// Renders the frames of an episode at a rate; `take` receives the images of each view in order, with the view's index.
fn render_frames(
    renderer: &mut StageRenderer,
    episode: &Episode,
    fps: u32,
    views: &[(&Camera, ImageChannels)],
    take: &mut dyn FnMut(usize, &RgbdImage) -> Result<(), RolloutError>,
) -> Result<(), RolloutError> {
    let stride = (episode.result.control_rate_hz / f64::from(fps)).round().max(1.0) as usize;
    for (index, frame) in episode.frames.iter().enumerate().step_by(stride) {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let exposure = Exposure::of(episode, index);
        let images = renderer.render_state(&frame.joint_position, frame.gripper_width, objects, views, exposure)?;
        images.iter().enumerate().try_for_each(|(view, image)| take(view, image))?;
    }
    Ok(())
}

fn failed(scenario: &str, error: RenderError) -> RolloutError {
    RolloutError::Images { scenario: scenario.into(), source: error.into() }
}

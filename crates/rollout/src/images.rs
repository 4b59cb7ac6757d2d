//! Images of a stage: of recorded frames after the physics, and of the state in the loop for policies that ask for them.

use genmanip_core::perception::{FIRST_OBJECT, Seen, seen_of};
use genmanip_core::{Camera, CameraRequest, Episode, EpisodeResult, Frame, ImageChannels, Pose, RgbdImage, Seed};
use genmanip_data::images::look_seed;
use genmanip_data::masks::{self, MaskTrack};
use genmanip_data::{CameraTrack, TrackRecorder, VideoSettings};
use genmanip_render_reference::{ReferenceSettings, trace};
use genmanip_render::sensor::shutter::{self, Past};
use genmanip_render::{
    Channels, FrameBuffers, FrameState, Look, RenderAssets, RenderError, RenderVariation, Renderer, Vary, ViewJob,
    sampling, sensor,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use crate::{RolloutError, Stage};

/// Which pictures a data set holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImageSettings {
    /// Names of the cameras.
    pub cameras: Vec<String>,
    /// Pictures per second; divides the 60 Hz of the recording.
    pub fps: u32,
    /// Colour compression.
    pub video: VideoSettings,
    /// What is drawn differently in each episode, by its own seed ([`look_seed`]); nothing when it is empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub vary: Vec<Vary>,
    /// Which look it is of those that the episode's seed leads to.
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

/// What sensors make of a moment, besides what is there: chance, and what moved while a shutter was open.
#[derive(Clone, Copy, Debug)]
pub struct Exposure<'a> {
    /// Of the noise, see [`sensor_seed`]; each camera has its own of it.
    pub noise: Seed,
    /// The moments before this one as they were recorded; nothing moved before the first.
    pub before: &'a [Frame],
    /// Time between them, and from the last of them to this moment, s.
    pub step_s: f64,
}

impl<'a> Exposure<'a> {
    /// Of something that stands still.
    pub fn still(noise: Seed) -> Self {
        Self { noise, before: &[], step_s: 1.0 }
    }

    /// Of a frame of an episode: in the loop, in a dataset and drawn again it is the same.
    pub fn of(episode: &'a Episode, frame: usize) -> Self {
        let EpisodeResult { seed, control_rate_hz, .. } = episode.result;
        Self { noise: sensor_seed(seed, frame), before: &episode.frames[..frame], step_s: 1.0 / control_rate_hz }
    }
}

/// Draws frames of one stage; meshes are shared by all painters of the stage, views of a frame share its shadows.
#[derive(Debug)]
pub struct Painter {
    renderer: Renderer,
    /// How colours are traced instead of rasterised, if they are.
    reference: Option<ReferenceSettings>,
    scenario: String,
}

impl Painter {
    /// A painter of a stage as its world says that it looks.
    ///
    /// # Errors
    /// When a mesh is broken.
    pub fn new(stage: &Stage) -> Result<Self, RolloutError> {
        Self::in_variation(stage, usual_variation(stage))
    }

    /// A painter of a stage that looks differently.
    ///
    /// # Errors
    /// As [`Painter::new`].
    pub fn in_variation(stage: &Stage, variation: RenderVariation) -> Result<Self, RolloutError> {
        let renderer = Renderer::new(stage.render_assets()?, variation);
        Ok(Self { renderer, reference: None, scenario: stage.scenario.id.clone() })
    }

    /// The same painter with colours from traced light paths, thousands of times slower; depth, ids and normals stay
    /// what they are.
    #[must_use]
    pub fn tracing(self, reference: Option<ReferenceSettings>) -> Self {
        Self { reference, ..self }
    }

    /// Whether this painter draws that stage.
    pub fn is_of(&self, stage: &Stage) -> bool {
        stage.render_assets().is_ok_and(|assets| Arc::ptr_eq(&assets, self.renderer.assets()))
    }

    /// One recorded frame, seen by one camera.
    ///
    /// # Errors
    /// When the frame does not belong to the stage.
    pub fn paint(
        &mut self,
        frame: &Frame,
        camera: &Camera,
        channels: ImageChannels,
        exposure: Exposure<'_>,
    ) -> Result<RgbdImage, RolloutError> {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let views = [(camera, channels)];
        let images = self.paint_state(&frame.joint_position, frame.gripper_width, objects, &views, exposure);
        images.map(|mut images| images.remove(0))
    }

    /// One moment, seen by several cameras: arm joint positions, opening width, poses and joints of the objects.
    ///
    /// # Errors
    /// When the objects are not those of the stage, or a camera cannot be drawn.
    pub fn paint_state<'a>(
        &mut self,
        arm: &[f64],
        gripper_width: f64,
        objects: impl IntoIterator<Item = (Pose, &'a [f64])>,
        views: &[(&Camera, ImageChannels)],
        exposure: Exposure<'_>,
    ) -> Result<Vec<RgbdImage>, RolloutError> {
        let assets = Arc::clone(self.renderer.assets());
        let scenario = self.scenario.clone();
        let failed = |error: RenderError| failed(&scenario, &error);
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
                self.expose(job, buffers, past, sensor::shutter_s(camera)).map_err(failed)?;
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

    /// Makes the colours of a job those of a shutter that was open for a while, and of traced paths if they are asked
    /// for.
    fn expose(
        &mut self,
        job: &ViewJob<'_>,
        buffers: &mut FrameBuffers,
        past: Past<'_>,
        shutter_s: f64,
    ) -> Result<(), RenderError> {
        let assets = Arc::clone(self.renderer.assets());
        let earlier = shutter::moments(&assets, job.camera, buffers, past, shutter_s);
        let mut pictures = vec![std::mem::take(&mut buffers.rgb)];
        if let Some(settings) = &self.reference {
            let paths = settings.paths.div_ceil(1 + earlier.len() as u32);
            pictures.clear();
            for (index, frame) in std::iter::once(job.frame).chain(&earlier).enumerate() {
                let seed = if index == 0 { settings.seed } else { settings.seed.fork_index(index as u64) };
                let (job, settings) = (ViewJob { frame, ..*job }, ReferenceSettings { paths, seed, ..*settings });
                pictures.push(trace(&assets, self.renderer.variation(), &job, &settings)?.develop(1.0));
            }
        } else {
            let mut out = [FrameBuffers::default()];
            for frame in &earlier {
                self.renderer.render(&[ViewJob { frame, channels: Channels::RGB, ..*job }], &mut out)?;
                pictures.push(std::mem::take(&mut out[0].rgb));
            }
        }
        buffers.rgb = if pictures.len() > 1 { shutter::mean(&pictures) } else { pictures.remove(0) };
        Ok(())
    }
}

/// A moment and those before it, one after the other, as far as a shutter needs them.
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

impl Painter {
    /// What each camera would see of each object with nothing before it, in the pictures of [`Painter::paint_state`] of
    /// the same moment: a list per camera, with the objects in their order.
    ///
    /// # Errors
    /// As [`Painter::paint_state`].
    pub fn whole<'a>(
        &mut self,
        arm: &[f64],
        gripper_width: f64,
        objects: impl IntoIterator<Item = (Pose, &'a [f64])>,
        cameras: &[Camera],
    ) -> Result<Vec<Vec<Seen>>, RolloutError> {
        let assets = Arc::clone(self.renderer.assets());
        let state = assets.frame_state(arm, gripper_width, objects).map_err(|error| failed(&self.scenario, &error))?;
        let whole = cameras.iter().map(|camera| self.whole_in(&state, camera)).collect::<Result<_, _>>();
        whole.map_err(|error: RenderError| failed(&self.scenario, &error))
    }

    fn whole_in(&mut self, state: &FrameState, camera: &Camera) -> Result<Vec<Seen>, RenderError> {
        const IDS: Channels = Channels { rgb: false, depth: false, instance: true, normal: false, parts: false };
        let pinhole = sensor::pinhole(camera)?;
        let mut whole = Vec::new();
        self.renderer.alone(&ViewJob::new(state, &pinhole, IDS), &mut |instance, drawn| {
            let object = usize::from(instance - FIRST_OBJECT);
            let drawn = sensor::through_lens(camera, drawn)?;
            // Objects that nothing is drawn of are left out by the renderer.
            whole.resize(object, Seen::default());
            whole.push(seen_of(&drawn.instance, drawn.width, instance));
            Ok(())
        })?;
        Ok(whole)
    }
}

/// How a stage is drawn when nothing else is said: as its world says.
pub fn usual_variation(stage: &Stage) -> RenderVariation {
    let usual = RenderVariation::default();
    stage.scenario.world.look.as_ref().map_or_else(|| usual.clone(), |look| sampling::varied(&usual, look))
}

/// The seed of the noise of sensors at a frame of an episode, counted in control steps: in the loop, in a dataset and
/// drawn again it is the same.
pub fn sensor_seed(episode: Seed, frame: usize) -> Seed {
    episode.fork("sensor noise").fork_index(frame as u64)
}

/// Colour video and depth of an episode for every camera of the settings.
///
/// # Errors
/// When a camera is not in the scenario, or drawing or encoding fails.
pub fn draw(stage: &Stage, episode: &Episode, settings: &ImageSettings) -> Result<Vec<CameraTrack>, RolloutError> {
    let (seed, vary) = (look_seed(episode.result.seed, settings.look), &settings.vary);
    let requests = settings.cameras.iter().map(|name| CameraRequest::new(name, ImageChannels::RGBD));
    let camera = |request| stage.camera(&request).map(|camera| sampling::moved(&camera, seed, vary));
    let cameras = requests.map(camera).collect::<Result<Vec<_>, _>>()?;
    let mut tracks = cameras
        .iter()
        .map(|camera| TrackRecorder::new(camera, settings.fps, &settings.video))
        .collect::<Result<Vec<_>, _>>()?;
    let look = Look::new(seed, vary.clone());
    let mut painter = Painter::in_variation(stage, sampling::varied(&usual_variation(stage), &look))?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, ImageChannels::RGBD)).collect();
    paint_frames(&mut painter, episode, settings.fps, &views, &mut |view, image| Ok(tracks[view].push(image)?))?;
    Ok(tracks.into_iter().map(TrackRecorder::finish).collect::<Result<Vec<_>, _>>()?)
}

/// Which thing each pixel shows, for every camera of the settings, in the pictures that [`draw`] draws; ids as
/// [`masks`] tells them.
///
/// # Errors
/// As [`draw`].
pub fn draw_masks(stage: &Stage, episode: &Episode, settings: &ImageSettings) -> Result<Vec<MaskTrack>, RolloutError> {
    const IDS: ImageChannels = ImageChannels { rgb: false, depth: false, ids: true, normals: false, points: false };
    let seed = look_seed(episode.result.seed, settings.look);
    let camera = |name: &String| {
        stage.camera(&CameraRequest::new(name, IDS)).map(|camera| sampling::moved(&camera, seed, &settings.vary))
    };
    let cameras = settings.cameras.iter().map(camera).collect::<Result<Vec<_>, _>>()?;
    let views: Vec<_> = cameras.iter().map(|camera| (camera, IDS)).collect();
    let track = |camera: &Camera| MaskTrack { camera: camera.name.clone(), fps: settings.fps, png: Vec::new() };
    let mut tracks: Vec<MaskTrack> = cameras.iter().map(track).collect();
    let mut painter = Painter::new(stage)?;
    paint_frames(&mut painter, episode, settings.fps, &views, &mut |view, image| {
        let size = &image.intrinsics;
        tracks[view].png.push(masks::encode(&image.ids, size.width, size.height)?);
        Ok(())
    })?;
    Ok(tracks)
}

/// Paints the frames of an episode at a rate; each view's pictures come in order, with the place of the view.
fn paint_frames(
    painter: &mut Painter,
    episode: &Episode,
    fps: u32,
    views: &[(&Camera, ImageChannels)],
    take: &mut dyn FnMut(usize, &RgbdImage) -> Result<(), RolloutError>,
) -> Result<(), RolloutError> {
    let stride = (episode.result.control_rate_hz / f64::from(fps)).round().max(1.0) as usize;
    for (index, frame) in episode.frames.iter().enumerate().step_by(stride) {
        let objects = frame.objects.iter().map(|object| (object.pose, object.joint_positions.as_slice()));
        let exposure = Exposure::of(episode, index);
        let images = painter.paint_state(&frame.joint_position, frame.gripper_width, objects, views, exposure)?;
        images.iter().enumerate().try_for_each(|(view, image)| take(view, image))?;
    }
    Ok(())
}

fn failed(scenario: &str, error: &dyn std::error::Error) -> RolloutError {
    RolloutError::Images { scenario: scenario.into(), reason: error.to_string() }
}

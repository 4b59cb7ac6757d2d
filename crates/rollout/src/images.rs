//! Pictures of recorded episodes: jobs over recorded states, after the physics.

use genmanip_core::{Camera, Episode, Frame};
use genmanip_data::{CameraTrack, TrackRecorder, VideoSettings};
use genmanip_render::{Channels, FrameBuffers, RenderAssets, RenderVariation, Renderer, ViewJob};
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
}

impl Default for ImageSettings {
    fn default() -> Self {
        Self { cameras: vec!["static".into(), "wrist".into()], fps: 15, video: VideoSettings::default() }
    }
}

/// Draws frames of one stage.
pub struct Painter {
    assets: Arc<RenderAssets>,
    renderer: Renderer,
}

impl Painter {
    /// Collects the meshes of a stage.
    ///
    /// # Errors
    /// When a mesh is broken.
    pub fn new(stage: &Stage) -> Result<Self, RolloutError> {
        let assets = RenderAssets::new(Arc::clone(&stage.robot), &stage.models, Some(&stage.scenario.world))
            .map_err(|error| failed(&stage.scenario.id, &error))?;
        let renderer = Renderer::new(Arc::clone(&assets), RenderVariation::default());
        Ok(Self { assets, renderer })
    }

    /// One recorded frame, seen by one camera.
    ///
    /// # Errors
    /// When the frame does not belong to the stage.
    pub fn paint(&mut self, frame: &Frame, camera: &Camera, channels: Channels) -> Result<FrameBuffers, RolloutError> {
        let state = self.assets.frame_state_of(frame).map_err(|error| failed(&camera.name, &error))?;
        let mut buffers = [FrameBuffers::default()];
        self.renderer
            .render(&[ViewJob::new(&state, camera, channels)], &mut buffers)
            .map_err(|error| failed(&camera.name, &error))?;
        let [buffers] = buffers;
        Ok(buffers)
    }
}

/// Colour video and depth of an episode for every camera of the settings.
///
/// # Errors
/// When a camera is not in the scenario, or drawing or encoding fails.
pub fn draw(stage: &Stage, episode: &Episode, settings: &ImageSettings) -> Result<Vec<CameraTrack>, RolloutError> {
    let id = &episode.result.id;
    let cameras = settings
        .cameras
        .iter()
        .map(|name| {
            episode.scenario.world.camera(name).ok_or_else(|| RolloutError::Images {
                episode: id.clone(),
                reason: format!("the scenario has no camera `{name}`"),
            })
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut tracks = cameras
        .iter()
        .map(|camera| TrackRecorder::new(camera, settings.fps, &settings.video))
        .collect::<Result<Vec<_>, _>>()?;
    let painter = Painter::new(stage)?;
    let (assets, mut renderer) = (painter.assets, painter.renderer);
    let mut buffers = vec![FrameBuffers::default(); cameras.len()];
    let stride = (episode.result.control_rate_hz / f64::from(settings.fps)).round().max(1.0) as usize;
    for frame in episode.frames.iter().step_by(stride) {
        let state = assets.frame_state_of(frame).map_err(|error| failed(id, &error))?;
        let jobs: Vec<ViewJob> = cameras.iter().map(|camera| ViewJob::new(&state, camera, Channels::RGBD)).collect();
        renderer.render(&jobs, &mut buffers).map_err(|error| failed(id, &error))?;
        let world_from_hand = assets.world_from_hand(&state);
        for ((track, camera), picture) in tracks.iter_mut().zip(&cameras).zip(&buffers) {
            track.push(camera.world_from_camera(&world_from_hand), &picture.rgb, Some(&picture.depth_m))?;
        }
    }
    Ok(tracks.into_iter().map(TrackRecorder::finish).collect::<Result<Vec<_>, _>>()?)
}

fn failed(episode: &str, error: &dyn std::error::Error) -> RolloutError {
    RolloutError::Images { episode: episode.into(), reason: error.to_string() }
}

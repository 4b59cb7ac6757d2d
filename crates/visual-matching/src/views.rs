//! Photographs and scenes of a request while it is matched.

use std::sync::Arc;

use genmanip_core::{Camera, CameraResponse, Pose};
use genmanip_render::{FrameState, RenderAssets, RenderError, Response};
use glam::Vec3A;
use serde::Serialize;

use crate::error::MatchError;
use crate::request::{MatchRequest, Photo};
use crate::scene::SeenScene;

/// Codes of 8-bit sRGB outside of which a channel counts as clipped.
const USABLE: [u8; 2] = [4, 251];

/// A camera's photographs while it is matched.
pub struct View<'a> {
    /// Camera of the world.
    pub camera: &'a Camera,
    /// Photograph of the empty workspace.
    pub photo: &'a Photo,
    /// Its response so far.
    pub found: MatchedCamera,
    /// True if its response comes from a colour chart.
    pub has_chart: bool,
}

/// Response of a camera, and how it was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MatchedCamera {
    /// Name of the camera.
    pub camera: String,
    /// Response.
    pub response: CameraResponse,
    /// Source of the response.
    pub source: &'static str,
    /// Root mean square of the chart's residuals, in steps of 8-bit sRGB; `None` without a chart.
    pub chart_rms: Option<f64>,
}

/// Posed assets of the photographs.
pub struct Scenes {
    /// Table, and arm if it is in the photographs.
    pub empty: (Arc<RenderAssets>, FrameState),
    /// Table alone.
    pub open: (Arc<RenderAssets>, FrameState),
    /// The same with the objects of each scene.
    pub objects: Vec<(Arc<RenderAssets>, FrameState)>,
    /// True if the arm is in the photographs.
    pub has_arm: bool,
}

impl Scenes {
    /// Assets of a request.
    ///
    /// # Errors
    /// When a mesh is invalid.
    pub fn new(request: &MatchRequest) -> Result<Self, MatchError> {
        let world = Some(&request.world);
        let drawn = |source: RenderError| MatchError::NotDrawn { camera: request.empty[0].camera.clone(), source };
        let posed = |models: &[_], poses: &[(Pose, Vec<f64>)]| {
            let poses = poses.iter().map(|(pose, joints)| (*pose, joints.as_slice()));
            let (arm, gripper) = request.arm.as_ref().map_or((&[][..], 0.0), |(arm, gripper)| (&arm[..], *gripper));
            let assets = match request.arm {
                Some(_) => RenderAssets::new(Arc::clone(&request.robot), models, world),
                None => RenderAssets::without_robot(models, world),
            };
            let assets = assets.map_err(drawn)?;
            let state = assets.frame_state(arm, gripper, poses).map_err(drawn)?;
            Ok::<_, MatchError>((assets, state))
        };
        let open = RenderAssets::without_robot(&[], world).map_err(drawn)?;
        let state = open.frame_state(&[], 0.0, []).map_err(drawn)?;
        Ok(Self {
            empty: posed(&[], &[])?,
            open: (open, state),
            objects: request.objects.iter().map(|it| posed(&it.models, &it.poses)).collect::<Result<_, _>>()?,
            has_arm: request.arm.is_some(),
        })
    }

    /// One of the scenes, as a camera sees it.
    ///
    /// # Errors
    /// When the camera cannot be rendered.
    pub fn seen((assets, frame): &(Arc<RenderAssets>, FrameState), camera: &Camera) -> Result<SeenScene, MatchError> {
        SeenScene::new(assets, frame.clone(), camera)
    }
}

/// Radiance of the pixels of a camera's photograph of the empty workspace.
pub fn radiance(view: &View<'_>) -> Vec<Vec3A> {
    linear(&view.found.response, view.photo)
}

/// Radiance of the pixels of a photograph under a response; empty for a response without a rising tone curve.
pub fn linear(response: &CameraResponse, photo: &Photo) -> Vec<Vec3A> {
    Response::new(response).map_or_else(Vec::new, |response| response.radiance(&photo.rgb))
}

/// Linear display colours of a camera's photograph.
pub fn display(view: &View<'_>) -> Vec<Vec3A> {
    linear(&CameraResponse::default(), view.photo)
}

/// Pixels with an overexposed channel, which are at least as bright as they look.
pub fn overexposed(photo: &Photo) -> Vec<bool> {
    photo.rgb.chunks_exact(3).map(|rgb| rgb.iter().any(|value| *value > USABLE[1])).collect()
}

/// Pixels without a clipped channel.
pub fn usable(photo: &Photo) -> Vec<bool> {
    let fits = |rgb: &[u8]| rgb.iter().all(|value| (USABLE[0]..=USABLE[1]).contains(value));
    photo.rgb.chunks_exact(3).map(fits).collect()
}
